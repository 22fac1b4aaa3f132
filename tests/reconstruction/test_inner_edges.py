"""Inner edges: sharper than the sphere where both faces say so, and never where a rounding was touched."""

import numpy as np
import pytest

from lwrprobe.bench.sampled_lines import sample_lines
from lwrprobe.evaluation import mesh_error
from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.inner_edges import meet
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

RADIUS, PITCH = 0.005, 0.010
UP, OUT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
EDGE = np.array([[0.0, RADIUS, RADIUS]])
"""The sphere's centre in the edge between the floor z = 0 and the wall y = 0."""


def faces(*more):
    """Centres over the floor and before the wall, 4 and 8 mm from the edge, and more pairs of centre and normal."""
    pairs = [(EDGE[0] + d * OUT, UP) for d in (0.004, 0.008)] + [(EDGE[0] + d * UP, OUT) for d in (0.004, 0.008)]
    points, normals = (np.array(rows) for rows in zip(*pairs, *more))
    return Clusters(points, normals, np.ones(len(points)), np.arange(len(points)))


def arc(degrees):
    a = np.radians(degrees)
    return EDGE + RADIUS * np.array([[0.0, -np.cos(a), -np.sin(a)]])


@pytest.mark.parametrize(("degrees", "where"), [(45.0, [0.0, 0.0, 0.0]), (60.0, None), (30.0, None)])
def test_the_faces_meet(degrees, where):
    found = meet(arc(degrees), EDGE, faces(), RADIUS, PITCH)[0]
    assert min(found[1], found[2]) == pytest.approx(0.0, abs=1e-9)
    assert max(found[1], found[2]) >= -1e-9
    if where is not None:
        assert found == pytest.approx(where, abs=1e-9)


def test_a_rounding_that_was_touched_stays():
    """A face at 45 degrees, felt 3 mm beside the sphere's place in the edge: the corner is filled."""
    diagonal = (UP + OUT) / np.sqrt(2.0)
    felt = [(EDGE[0] + np.array([x, 0.0, 0.0]), diagonal) for x in (-0.003, 0.003)]
    assert meet(arc(45.0), EDGE, faces(*felt), RADIUS, PITCH) == pytest.approx(arc(45.0), abs=1e-9)


def test_one_face_alone_and_an_outer_edge_move_nothing():
    points = EDGE[0] + np.array([[0.0, d, 0.0] for d in (0.004, 0.008)])
    one = Clusters(points, np.array([UP, UP]), np.ones(2), np.arange(2))
    assert (meet(arc(45.0), EDGE, one, RADIUS, PITCH) == arc(45.0)).all()
    behind = EDGE[0] + np.array([[0.0, -0.004, 0.0], [0.0, 0.0, -0.004]])
    outer = Clusters(behind, np.array([UP, OUT]), np.ones(2), np.arange(2))
    assert (meet(arc(45.0), EDGE, outer, RADIUS, PITCH) == arc(45.0)).all()


def test_a_step_is_nearly_as_sharp_as_it_is():
    """A sphere's arc in an inner edge of 90 degrees is 0.41 radii off at most: 2.1 mm."""
    low = Box(shape="box", size=(0.08, 0.08, 0.02), at=Pose(xyz=(0.0, 0.0, 0.01)))
    high = Box(shape="box", size=(0.08, 0.03, 0.04), at=Pose(xyz=(0.0, -0.025, 0.02)))
    solid = Solid.from_shapes([low, high])
    result = ContactSurface(ContactSurface.Config(pitch=PITCH)).reconstruct(sample_lines(solid, PITCH, 0.25))
    assert mesh_error(result.mesh, solid, 0.006, samples=2000).watertight
    x, y, z = result.mesh.vertices.T
    in_edge = (np.abs(x) < 0.03) & (np.abs(y + 0.01) < 0.004) & (np.abs(z - 0.02) < 0.004)
    assert in_edge.sum() > 20
    assert np.abs(solid.signed_distance(result.mesh.vertices[in_edge])).mean() < 5e-4
    assert result.unreachable[in_edge & (np.abs(y + 0.0095) < 0.001) & (np.abs(z - 0.0205) < 0.001)].mean() > 0.8
