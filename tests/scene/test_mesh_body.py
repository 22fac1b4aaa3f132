"""Triangle meshes as objects: the same answers as the shapes that they stand for."""

import numpy as np
import odd_solids as odd
import pytest

from lwrprobe.contracts import InputError, SceneError, TriangleMesh
from lwrprobe.evaluation.truth import read_truth
from lwrprobe.scene.mesh_distance import MeshDistance

trimesh = pytest.importorskip("trimesh")
RADIUS = 0.005


def mesh_of(path, mesh, **more):
    mesh.export(path)
    return {"shape": "mesh", "file": str(path), **more}


def around(solid, count, margin, seed=0):
    lower, upper = solid.bounds()
    return np.random.default_rng(seed).uniform(lower - margin, upper + margin, (count, 3))


@pytest.fixture(scope="module")
def box_pair(tmp_path_factory):
    path = tmp_path_factory.mktemp("mesh") / "box.stl"
    place = odd.at(0.01, 0.02, 0.03, (10, 20, 30))
    exact = odd.scene(odd.box(0.06, 0.04, 0.02, at=place)).solid()
    return exact, odd.scene(mesh_of(path, trimesh.creation.box([0.06, 0.04, 0.02]), at=place)).solid()


def test_a_box_as_a_mesh_is_the_box(box_pair):
    exact, meshed = box_pair
    points = around(exact, 2000, 0.02)
    true, seen = exact.nearest(points), meshed.nearest(points)
    assert seen.distance == pytest.approx(true.distance, abs=1e-8)  # a binary STL holds single precision
    outside = true.distance > 0
    assert seen.points[outside] == pytest.approx(true.points[outside], abs=1e-8)
    assert seen.normals[outside] == pytest.approx(true.normals[outside], abs=1e-5)
    assert (meshed.contains(points) == exact.contains(points)).mean() > 0.999


def test_contacts_with_a_box_as_a_mesh_are_those_with_the_box(box_pair):
    exact, meshed = box_pair
    points = around(exact, 3000, RADIUS, seed=1)
    distance = exact.signed_distance(points)
    for centre in points[(distance > 1e-4) & (distance < RADIUS - 1e-6)][:300]:
        true, seen = exact.touch(centre, RADIUS), meshed.touch(centre, RADIUS)
        assert len(true.points) == len(seen.points) == 1
        assert seen.points == pytest.approx(true.points, abs=1e-7)
        assert seen.depths == pytest.approx(true.depths, abs=1e-7)


def test_a_fine_ball_is_a_ball(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.02)
    solid = odd.scene(mesh_of(tmp_path / "ball.stl", ball)).solid()
    points = around(solid, 500, 0.01)
    points = points[np.linalg.norm(points, axis=1) > 0.005]
    sagitta = 0.02 - np.linalg.norm(ball.triangles_center, axis=1).min()
    assert solid.signed_distance(points) == pytest.approx(np.linalg.norm(points, axis=1) - 0.02, abs=sagitta + 1e-8)
    for direction in points / np.linalg.norm(points, axis=1, keepdims=True):
        touch = solid.touch(0.0248 * direction, RADIUS)
        assert len(touch.points) == 1
        assert touch.depths == pytest.approx([0.0002], abs=sagitta + 1e-8)


def test_facets_of_one_hollow_are_one_contact(tmp_path):
    """Inside a faceted bowl many facets are near at once; the sphere that rests in it is touched once."""
    turn = np.linspace(0, 2 * np.pi, 61)[:-1]
    rings = [(0.03 * np.sin(t), -0.03 * np.cos(t)) for t in np.linspace(0.02, np.pi / 2, 40)] + [
        (0.035, 0.0),
        (0.035, -0.04),
    ]
    profile = np.array([[0.0, -0.03], *rings, [0.0, -0.04]])
    bowl = trimesh.creation.revolve(profile[::-1], sections=len(turn))
    assert bowl.is_watertight
    solid = odd.scene(mesh_of(tmp_path / "bowl.stl", bowl)).solid()
    touch = solid.touch(np.array([0.001, 0.0005, -0.0252]), RADIUS)
    assert len(touch.points) == 1
    assert touch.normals[0, 2] > 0.98


def test_an_inner_edge_of_a_mesh_is_touched_on_both_sides(tmp_path):
    corner = trimesh.creation.extrude_polygon(_l_shape(), 0.04)
    solid = odd.scene(mesh_of(tmp_path / "corner.stl", corner)).solid()
    touch = solid.touch(np.array([0.0148, 0.0147, 0.02]), RADIUS)
    assert sorted(map(tuple, np.round(touch.normals, 6) + 0.0)) == [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]
    assert sorted(touch.depths) == pytest.approx([0.0002, 0.0003], abs=1e-8)


def _l_shape():
    shapely = pytest.importorskip("shapely")
    return shapely.Polygon([(0, 0), (0.04, 0), (0.04, 0.01), (0.01, 0.01), (0.01, 0.04), (0, 0.04)])


def test_a_mesh_joined_with_a_shape_hides_what_lies_inside(tmp_path):
    box = trimesh.creation.box([0.04, 0.04, 0.02])
    joined = odd.union(mesh_of(tmp_path / "box.stl", box), odd.cylinder(0.01, 0.04, at=odd.at(z=0.02)))
    solid = odd.scene(joined).solid()
    exact = odd.scene(odd.union(odd.box(0.04, 0.04, 0.02), odd.cylinder(0.01, 0.04, at=odd.at(z=0.02)))).solid()
    points = around(exact, 2000, 0.004, seed=3)
    distance = exact.signed_distance(points)
    outside = distance > 1e-4
    assert solid.signed_distance(points[outside]) == pytest.approx(distance[outside], abs=1e-7)
    assert (solid.contains(points) == exact.contains(points)).mean() > 0.999
    for centre in points[outside & (distance < RADIUS - 1e-4)][:200]:
        true, seen = exact.touch(centre, RADIUS), solid.touch(centre, RADIUS)
        assert sorted(seen.depths) == pytest.approx(sorted(true.depths), abs=1e-7)


def test_a_mesh_that_is_wound_inwards_is_turned_round(tmp_path):
    box = trimesh.creation.box([0.04, 0.04, 0.02])
    box.invert()
    solid = odd.scene(mesh_of(tmp_path / "box.ply", box)).solid()
    assert solid.signed_distance(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.02]])) == pytest.approx([-0.01, 0.01])


def two_boxes(apart, second_inverted, all_inverted=False):
    first, second = trimesh.creation.box([0.04, 0.04, 0.04]), trimesh.creation.box([0.02, 0.01, 0.015])
    second.apply_translation([apart, 0.0, 0.0])
    if second_inverted:
        second.invert()
    both = trimesh.util.concatenate([first, second])
    if all_inverted:
        both.invert()
    return both


@pytest.mark.parametrize("all_inverted", [False, True])
def test_a_mesh_of_which_one_body_is_inside_out_is_refused(tmp_path, all_inverted):
    """All that lies outside of that body had counted as inside."""
    mesh = two_boxes(0.06, True, all_inverted)
    with pytest.raises(SceneError, match=r"object\[0\]\.file.* one of them is inside out"):
        odd.scene(mesh_of(tmp_path / "boxes.stl", mesh)).solid()
    with pytest.raises(SceneError, match="one of them is inside out"):
        read_truth(str(tmp_path / "boxes.stl"))


@pytest.mark.parametrize("all_inverted", [False, True])
def test_cavities_and_bodies_apart_are_as_they_are(tmp_path, all_inverted):
    points = np.array([[0.0, 0.0, 0.0], [0.018, 0.0, 0.0], [0.06, 0.0, 0.0], [0.1, 0.0, 0.0]])
    hollow = odd.scene(mesh_of(tmp_path / "hollow.stl", two_boxes(0.0, True, all_inverted))).solid()
    assert hollow.contains(points).tolist() == [False, True, False, False]
    apart = odd.scene(mesh_of(tmp_path / "apart.stl", two_boxes(0.06, False, all_inverted))).solid()
    assert apart.contains(points).tolist() == [True, True, True, False]


def test_scale_counts_in_metres(tmp_path):
    box = trimesh.creation.box([40, 40, 20])
    solid = odd.scene(mesh_of(tmp_path / "box.stl", box, scale=0.001)).solid()
    assert np.allclose(solid.bounds(), [[-0.02, -0.02, -0.01], [0.02, 0.02, 0.01]])


@pytest.mark.parametrize("scale", [1e-5, 1e3, 1e300])
def test_a_mesh_that_its_scale_makes_too_small_or_too_large_is_refused(tmp_path, scale):
    """A file in metres read as one in millimetres had ended in a traceback after the whole exploration."""
    box = trimesh.creation.box([0.05, 0.05, 0.05])
    with pytest.raises(SceneError, match=r"object\[0\]\.scale.*millimetres need 0\.001"):
        odd.scene(mesh_of(tmp_path / "box.stl", box, scale=scale)).solid()


def test_a_mesh_that_is_gone_is_named(tmp_path):
    shape = mesh_of(tmp_path / "box.stl", trimesh.creation.box([0.04, 0.04, 0.02]))
    scene = odd.scene(shape)
    (tmp_path / "box.stl").unlink()
    with pytest.raises(SceneError, match=r"object\[0\]\.file"):
        scene.solid()


def test_distance_to_an_open_mesh_is_that_of_brute_force():
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(60, 3)), rng.integers(0, 60, (40, 3))
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
    points = rng.normal(size=(200, 3))
    expected = [
        np.linalg.norm(trimesh.triangles.closest_point(vertices[faces], np.tile(p, (len(faces), 1))) - p, axis=1).min()
        for p in points
    ]
    assert MeshDistance(TriangleMesh(vertices, faces)).distance(points) == pytest.approx(expected, abs=1e-12)


def test_membership_along_columns_is_that_of_the_shape():
    ring = trimesh.creation.torus(0.03, 0.01)
    mesh = TriangleMesh(np.array(ring.vertices), np.array(ring.faces))
    rng = np.random.default_rng(1)
    columns, heights = rng.uniform(-0.04, 0.04, (400, 2)), rng.uniform(-0.012, 0.012, (400, 7))
    inside = MeshDistance(mesh).contains(columns, heights)
    points = np.column_stack([np.repeat(columns, 7, axis=0), heights.ravel()])
    away = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.03, points[:, 2]) - 0.01
    clear = np.abs(away) > 3e-4
    assert (inside.ravel() == (away < 0))[clear].all()


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(InputError, match="mesh"):
        MeshDistance(TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int64)))
