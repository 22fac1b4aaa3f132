"""Beyond the tangent planes of a convex object nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from partly_touched import upper_part

from lwrprobe.bench.sampled_lines import RADIUS, sample_lines
from lwrprobe.evaluation import mesh_error
from lwrprobe.reconstruction import contact_surface
from lwrprobe.reconstruction.clusters import cluster
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.convexity import tangent_bound
from lwrprobe.reconstruction.convexity_kernels import AGREE, beyond, beyond_planes
from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.touches import prepare
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

PITCH, DEPTH = 0.01, 0.05


def tilted():
    """A box on an edge: two of its sides recede below."""
    at = Pose(xyz=(0.0, 0.0, 0.052), rpy_deg=(30.0, 0.0, 25.0))
    return Solid.from_shapes([Box(shape="box", size=(0.07, 0.05, 0.06), at=at)])


def upper(solid):
    """Lines over the solid that reach no lower than DEPTH."""
    return upper_part(sample_lines(solid, PITCH, 0.25), DEPTH)


def bound_of(record):
    touches = prepare(record, 0.002)
    clusters = cluster(touches.centres, touches.normals, touches.confidence, PITCH / 3.0)
    grid = Grid.around(clusters.points.min(axis=0) - 0.02, clusters.points.max(axis=0) + 0.02, 0.004)
    return grid, tangent_bound(touches, clusters, PITCH, grid, np.full(grid.shape, -1.0))


def test_no_node_within_a_convex_object_is_beyond_its_planes_and_those_far_outside_are():
    solid = tilted()
    grid, bound = bound_of(upper(solid))
    off = solid.signed_distance(grid.nodes().reshape(-1, 3)).reshape(grid.shape) - RADIUS
    assert bound[off < 0.0].max() < 5e-4
    above = (off > 0.01) & (grid.nodes()[..., 2] > DEPTH)
    assert (bound[above] > 0.0).mean() > 0.95


def test_what_was_touched_of_a_notch_is_not_convex():
    boxes = [
        Box(shape="box", size=(0.06, 0.04, h), at=Pose(xyz=(x, 0.0, 0.5 * h))) for x, h in ((0.0, 0.08), (0.05, 0.06))
    ]
    assert bound_of(upper(Solid.from_shapes(boxes)))[1] is None


@pytest.mark.parametrize("degrees", [2.5, -2.5])
def test_walls_whose_normals_are_all_wrong_alike_are_not_cut(degrees):
    """As where friction, or a lever that is not quite known, turns all of them."""
    at = Pose(xyz=(0.0, 0.0, 0.025), rpy_deg=(0.0, 0.0, 20.0))
    solid = Solid.from_shapes([Box(shape="box", size=(0.06, 0.04, 0.05), at=at)])
    record = sample_lines(solid, PITCH, 0.25)
    normals = record.normals.copy()
    normals[np.abs(normals[:, 2]) < 0.3, 2] += np.radians(degrees)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    grid, bound = bound_of(replace(record, normals=normals))
    off = solid.signed_distance(grid.nodes().reshape(-1, 3)).reshape(grid.shape) - RADIUS
    assert bound is None or bound[off < -2e-4].max() < 2e-4


def test_below_sides_that_recede_a_convex_object_has_a_third_of_the_error_less(monkeypatch):
    solid = tilted()
    record = upper(solid)
    errors = []
    for bound in (tangent_bound, lambda *_: None):
        monkeypatch.setattr(contact_surface, "tangent_bound", bound)
        result = ContactSurface(ContactSurface.Config(pitch=PITCH)).reconstruct(record)
        error = mesh_error(result.mesh, solid, 0.006, samples=4000)
        assert error.watertight
        errors.append(error.mean)
    assert errors[0] < 0.67 * errors[1]


@pytest.mark.parametrize("seed", [1, 2])
def test_the_kernels_are_what_their_definition_says(seed):
    random = np.random.default_rng(seed)
    points, places = 0.05 * random.standard_normal((12, 3)), 0.05 * random.standard_normal((40, 3))
    normals = random.standard_normal((12, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    angle = random.uniform(0.0, 0.2, 12)

    def above(at):
        return np.array([[(at[j] - points[i]) @ normals[i] for i in range(12)] for j in range(len(at))])

    def apart(at):
        return np.linalg.norm(at[:, None] - points, axis=2)

    count = beyond(places, points, normals, angle, 2.0, 1e-3)
    assert count.tolist() == ((above(places) - 1e-3) > 2.0 * angle * apart(places)).sum(axis=0).tolist()
    grid = Grid(np.array([-0.05, -0.04, -0.03]), 0.02, (5, 4, 3))
    values = random.standard_normal(grid.shape)
    out = np.full(grid.shape, -np.inf)
    beyond_planes(grid.origin, grid.step, values, points, normals, angle, 2e-4, out)
    nodes = grid.nodes().reshape(-1, 3)
    best = np.sort(above(nodes) - 2e-4 - angle * apart(nodes), axis=1)[:, -AGREE].reshape(grid.shape)
    assert out[values <= 0.0] == pytest.approx(best[values <= 0.0])
    assert np.isneginf(out[values > 0.0]).all()
