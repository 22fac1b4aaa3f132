"""Even samples of a solid's surface, and the surface as a mesh."""

import naive_scene as naive
import numpy as np
import odd_solids as odd
import pytest

from lwrprobe.contracts import InputError
from lwrprobe.evaluation import is_watertight
from lwrprobe.scene import load_scene, scene_names
from lwrprobe.scene.mesh_distance import MeshDistance

COSTLY = pytest.param("jaw_chuck", marks=pytest.mark.slow)
SCENES = [COSTLY if name == "jaw_chuck" else name for name in scene_names() if name != "empty"]

AREAS = {
    "block": 2 * (0.1 * 0.05 + 0.1 * 0.05 + 0.05 * 0.05),
    "stacked_blocks": 2 * (0.1 * 0.05 + 0.1 * 0.1 + 0.05 * 0.1),
    "cylinder_vertical": 2 * np.pi * 0.024 * (0.05 + 0.024),
    "sphere": 4 * np.pi * 0.025**2,
    "bridge": 0.025 + np.pi * 0.024 * 0.05 - 0.048 * 0.05 - np.pi * 0.024**2,
    "overhang": 2 * 0.08 * 0.06 + 2 * (0.08 + 0.06) * 0.015 + 4 * 0.03 * 0.03,
}

VOLUMES = {
    "block": 0.1 * 0.05 * 0.05,
    "bridge": 0.1 * 0.05 * 0.05 - 0.5 * np.pi * 0.024**2 * 0.05,
    "combination": 0.1 * 0.05 * 0.05 + 0.5 * np.pi * 0.024**2 * 0.05,
    "cylinder_vertical": np.pi * 0.024**2 * 0.05,
    "sphere": 4 / 3 * np.pi * 0.025**3,
    "thin_plate": 0.08 * 0.0005 * 0.04,
    "slot_8mm": 0.1 * 0.05 * 0.05 - 0.1 * 0.008 * 0.03,
    "overhang": 0.08 * 0.06 * 0.015 + 0.03**3,
    "tilted_table": 0.1 * 0.05 * 0.05,
    "wedge_15deg": 0.08 * 0.06**2 * np.tan(np.radians(7.5)),
}


@pytest.mark.parametrize("name", [*SCENES, *odd.ODD])
def test_samples_lie_on_the_surface_and_their_normals_lead_out(name):
    solid = (odd.scene(odd.ODD[name]) if name in odd.ODD else load_scene(name)).solid()
    points, normals = solid.sample_surface(1000, seed=4)
    assert points.shape == normals.shape == (1000, 3)
    assert np.abs(solid.signed_distance(points)).max() < 1e-9
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    step = 1e-6
    assert np.mean(np.abs(solid.signed_distance(points + step * normals) - step) < 1e-9) > 0.99
    assert solid.contains(points - step * normals).mean() > 0.99


@pytest.mark.parametrize("name", AREAS)
def test_the_area_is_that_of_the_formula(name):
    assert load_scene(name).solid().area() == pytest.approx(AREAS[name], rel=0.005)


def test_samples_are_even():
    """On each face of the block as many as its share of the area, and no large hole between them."""
    from scipy.spatial import cKDTree

    points, normals = load_scene("block").solid().sample_surface(20_000, seed=1)
    for axis, area in ((0, 0.05 * 0.05), (1, 0.1 * 0.05), (2, 0.1 * 0.05)):
        for side in (-1, 1):
            assert np.mean(normals[:, axis] == side) == pytest.approx(area / AREAS["block"], rel=0.03)
    others, _ = load_scene("block").solid().sample_surface(2000, seed=2)
    assert cKDTree(points).query(others)[0].max() < 0.004


def test_samples_of_a_blend_are_as_dense_on_lobes_as_in_hollows():
    """A thin shell around the surface, counted by membership, against the share of samples, octant by octant."""
    solid = odd.scene(_blend().model_dump()).solid()
    points, _ = solid.sample_surface(5000, seed=3)
    lower, upper = solid.bounds()
    shell = np.random.default_rng(8).uniform(lower - 1e-4, upper + 1e-4, (100_000, 3))
    shell = shell[np.abs(naive.blend(_blend(), shell)) < 2e-4]
    shell = shell[np.abs(solid.signed_distance(shell)) < 1e-4]
    for axis in range(3):
        half = np.median(shell[:, axis])
        assert np.mean(points[:, axis] < half) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(shell)) + 0.01)


def _blend():
    return load_scene("polystyrene_2").objects[0].children[0]


def test_the_same_seed_gives_the_same_samples():
    solid = load_scene("bridge").solid()
    for a, b in zip(solid.sample_surface(500, 9), solid.sample_surface(500, 9)):
        assert (a == b).all()


@pytest.mark.parametrize("name", [*SCENES, "cross_drilled", "lens", "tee", "ball_in_a_box"])
def test_the_mesh_is_closed_and_its_corners_lie_on_the_surface(name):
    solid = (odd.scene(odd.ODD[name]) if name in odd.ODD else load_scene(name)).solid()
    mesh = solid.mesh()
    assert is_watertight(mesh)
    assert np.abs(solid.signed_distance(mesh.vertices)).max() < 1e-9
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume > 0
    if name in VOLUMES:
        assert volume == pytest.approx(VOLUMES[name], rel=0.003)
    points, _ = solid.sample_surface(2000)
    assert MeshDistance(mesh).distance(points).max() < (
        0.0005 if name in ("wedge_15deg", "cross_drilled", "lens") else 2e-4
    )
    assert np.percentile(MeshDistance(mesh).distance(points), 99) < 1.5e-4


@pytest.mark.parametrize("name", ["block", "slot_8mm", "cliff", "inner_corner", "overhang", "thin_plate"])
def test_the_mesh_keeps_level_edges_and_corners_sharp(name):
    solid = load_scene(name).solid()
    mesh = solid.mesh()
    points, _ = solid.sample_surface(4000, seed=2)
    assert MeshDistance(mesh).distance(points).max() < 1e-9


def test_a_finer_mesh_is_nearer():
    solid = load_scene("sphere").solid()
    points, _ = solid.sample_surface(1000)
    worst = [MeshDistance(solid.mesh(tolerance)).distance(points).max() for tolerance in (4e-4, 1e-4, 2.5e-5)]
    assert worst[0] < 4e-4
    assert worst[1] < 1e-4
    assert worst[2] < 2.5e-5


def test_nothing_has_an_empty_mesh_and_no_samples():
    solid = load_scene("empty").solid()
    assert len(solid.mesh().faces) == 0
    with pytest.raises(InputError, match="empty"):
        solid.sample_surface(10)
    with pytest.raises(InputError, match="tolerance"):
        load_scene("block").solid().mesh(0.0)


@pytest.mark.parametrize("name", SCENES)
def test_bounds_fit(name):
    solid = load_scene(name).solid()
    lower, upper = solid.bounds()
    points, _ = solid.sample_surface(4000)
    assert (points >= lower - 1e-12).all()
    assert (points <= upper + 1e-12).all()
    assert (points.min(axis=0) - lower < 1e-3).all()
    assert (upper - points.max(axis=0) < 1e-3).all()
