"""The other methods: the thesis's three and the rival implicit surface, behind one signature."""

import tomllib
from importlib import import_module
from pathlib import Path

import naive_reconstruction as naive
import numpy as np
import pytest

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, InputError, MissingExtraError, TouchRecord, UnknownNameError
from lwrprobe.reconstruction import reconstruct
from lwrprobe.reconstruction.closed import count_pieces, is_closed
from lwrprobe.reconstruction.concave_hull import ConcaveHull
from lwrprobe.reconstruction.convex_hull import convex_hull
from lwrprobe.reconstruction.grid import MAX_NODES, Grid, affordable
from lwrprobe.reconstruction.hermite_rbf import HermiteRbf
from lwrprobe.reconstruction.normals import estimate_normals
from lwrprobe.reconstruction.poisson import Poisson, upsample


def test_a_grid_over_a_large_object_is_no_finer_than_memory_allows():
    """Lines 5 mm apart over an area of 400 mm: 48 million nodes, made for a comparison that nobody asked for."""
    lower, upper = np.zeros(3), np.array([0.4, 0.4, 0.3])
    step = affordable(lower, upper, 0.001)
    assert np.prod(Grid.around(lower - 3.0 * step, upper + 3.0 * step, step).shape) < 1.2 * MAX_NODES
    assert affordable(lower, 0.1 * upper, 0.001) == 0.001


@pytest.fixture(scope="module")
def dome():
    """Half a ball of 30 mm on lines 5 mm apart, without noise."""
    lines = [np.column_stack([np.full(121, x), np.linspace(-0.03, 0.03, 121)]) for x in np.arange(-0.0275, 0.03, 0.005)]
    plan = np.concatenate(lines)
    plan = plan[np.linalg.norm(plan, axis=1) < 0.0299]
    points = np.column_stack([plan, np.sqrt(0.03**2 - np.sum(plan**2, axis=1))])
    return TouchRecord(points, normals=points / 0.03, probe_radius=0.005, table=0.0)


def test_every_declared_method_keeps_the_contract():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    declared = project["project"]["entry-points"]["lwrprobe.reconstructors"]
    assert {"contact_surface", "convex_hull", "concave_hull", "hermite_rbf", "poisson"} <= declared.keys()
    for target in declared.values():
        module, name = target.split(":")
        method = getattr(import_module(module), name)
        assert method.contract == RECONSTRUCTOR_CONTRACT
        assert method(method.Config()).config == method.Config()


def test_unknown_methods_and_options_are_named(dome):
    with pytest.raises(UnknownNameError, match="convex_hull"):
        reconstruct(dome, "convex_hul")
    with pytest.raises(InputError):
        reconstruct(dome, "convex_hull", alpha=1.0)
    assert reconstruct(dome, "convex_hull").report["method"] == "convex_hull"


def test_a_bare_cloud_becomes_a_record(dome):
    record = TouchRecord(dome.points)
    assert record.normals is None
    assert record.probe_radius is None
    assert is_closed(reconstruct(record, "convex_hull").mesh.faces)


@pytest.mark.slow
def test_a_wide_alpha_gives_the_convex_hull():
    points = np.random.default_rng(1).normal(size=(300, 3)) * 0.02
    result = ConcaveHull(ConcaveHull.Config(100.0)).reconstruct(TouchRecord(points))
    assert naive.volume(result.mesh) == pytest.approx(naive.volume(convex_hull(points)), rel=1e-6)
    assert result.report["components"] == 1


@pytest.mark.slow
def test_an_alpha_shape_follows_a_hollow():
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (25_000, 3)) * [0.05, 0.02, 0.02]
    points = points[~((np.abs(points[:, 0]) < 0.02) & (points[:, 2] > 0.0))]
    result = ConcaveHull(ConcaveHull.Config(0.004)).reconstruct(TouchRecord(points))
    assert naive.volume(result.mesh) == pytest.approx(0.8 * 0.1 * 0.04 * 0.04, rel=0.1)
    assert naive.volume(result.mesh) < 0.9 * naive.volume(convex_hull(points))


def test_the_automatic_alpha_leaves_no_point_out(dome):
    report = ConcaveHull().reconstruct(dome).report
    assert report["points_left_out"] == 0
    assert report["components"] == 1


def test_too_small_an_alpha_says_what_is_enough(dome):
    with pytest.raises(InputError, match="at least"):
        ConcaveHull(ConcaveHull.Config(1e-7)).reconstruct(dome)
    with pytest.raises(InputError):
        ConcaveHull.Config(-1.0)


def test_the_watertight_flag_is_that_of_the_edges():
    record = TouchRecord(np.random.default_rng(4).random((300, 3)) * 0.05)
    for alpha in (0.003, 0.005, 0.008, 0.1):
        result = ConcaveHull(ConcaveHull.Config(alpha)).reconstruct(record)
        assert result.report["watertight"] == naive.closed(result.mesh.faces)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_alpha_shapes_at_any_scale(scale):
    points = np.random.default_rng(3).normal(size=(100, 3)) * scale
    assert ConcaveHull().reconstruct(TouchRecord(points)).report["points_left_out"] == 0


def test_pieces_and_closedness():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert is_closed(tetrahedron)
    assert not is_closed(tetrahedron[:3])
    assert not is_closed(tetrahedron[:, ::-1][:1])
    assert not is_closed(np.zeros((0, 3), dtype=np.int64))
    assert count_pieces(np.vstack([tetrahedron, tetrahedron + 4])) == 2
    assert count_pieces(np.zeros((0, 3), dtype=np.int64)) == 0


def test_hermite_surface_of_a_dome(dome):
    result = HermiteRbf().reconstruct(dome)
    assert naive.closed(result.mesh.faces)
    high = result.mesh.vertices[result.mesh.vertices[:, 2] > 0.006]
    assert np.abs(np.linalg.norm(high, axis=1) - 0.03).mean() < 3e-4


def test_normals_of_lines(dome):
    found = estimate_normals(dome.points, 0.005)
    turned = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", found, dome.normals), -1, 1)))
    assert np.median(turned) < 3.0
    assert np.percentile(turned, 95) < 25.0


def test_upsampling_stays_on_the_surface(dome):
    points, normals = upsample(dome.points[::4], 0.005)
    inner = points[:, 2] > 0.015
    assert len(points) > 5 * len(dome.points[::4])
    assert np.median(np.abs(np.linalg.norm(points[inner], axis=1) - 0.03)) < 3e-4
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)


@pytest.mark.slow
def test_poisson_needs_its_extra_or_gives_the_dome(dome):
    try:
        import open3d  # noqa: F401
    except (ImportError, OSError):
        with pytest.raises(MissingExtraError, match=r"lwrprobe\[poisson\]"):
            Poisson().reconstruct(dome)
        return
    result = Poisson().reconstruct(dome)
    high = result.mesh.vertices[result.mesh.vertices[:, 2] > 0.01]
    assert np.median(np.abs(np.linalg.norm(high, axis=1) - 0.03)) < 1e-3
    assert result.report["watertight"] == naive.closed(result.mesh.faces)


@pytest.mark.parametrize("options", [{"depth": 2}, {"depth": 20}, {"trim": 0.9}])
def test_poisson_refuses_bad_options(options):
    with pytest.raises(InputError):
        Poisson.Config(**options)


@pytest.mark.parametrize("method", [ConcaveHull, HermiteRbf])
@pytest.mark.parametrize(
    "points", [np.zeros((0, 3)), np.eye(3), np.ones((50, 3)), np.full((9, 3), np.nan), np.eye(3)[[0, 1, 2] * 9]]
)
def test_degenerate_points_get_one_typed_error(method, points):
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    with pytest.raises(InputError):
        method().reconstruct(TouchRecord(points, normals=normals, probe_radius=0.005))
