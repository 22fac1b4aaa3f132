"""Exact solids against twins that know nothing of edges: membership, nearest points, contacts of a sphere."""

import naive_scene as naive
import numpy as np
import odd_solids as odd
import pytest
from scipy.spatial import cKDTree

from lwrprobe.contracts import InputError, SceneError
from lwrprobe.scene import load_scene, scene_names
from lwrprobe.scene import program as layout
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.solid_kernels import nearest, outside_bounds, sphere_contacts
from lwrprobe.scene.surface_kernels import surface_gradient, surface_value, tree_value
from lwrprobe.scene.table import Pose

RADIUS = 0.005
COSTLY = pytest.param("jaw_chuck", marks=pytest.mark.slow)
SCENES = [COSTLY if name == "jaw_chuck" else name for name in scene_names() if name != "empty"]
JUDGED = ["bridge", "combination", COSTLY, "wedge_15deg", "polystyrene_1", "polystyrene_2", *odd.ODD]


def shapes_of(name):
    scene = odd.scene(odd.ODD[name]) if name in odd.ODD else load_scene(name)
    return scene.objects, scene.solid()


def around(solid, count, margin, seed=0):
    lower, upper = solid.bounds()
    return np.random.default_rng(seed).uniform(lower - margin, upper + margin, (count, 3))


@pytest.mark.parametrize("name", [*SCENES, *odd.ODD])
def test_membership_is_that_of_the_definition(name):
    shapes, solid = shapes_of(name)
    points = around(solid, 5000, 0.005)
    expected = np.any([naive.contains(shape, points) for shape in shapes], axis=0)
    assert 0 < expected.sum() < len(points)
    assert (solid.contains(points) == expected).all()
    assert ((solid.signed_distance(points) < 0) == expected).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", JUDGED)
def test_the_nearest_point_is_on_the_boundary_and_none_of_a_dense_boundary_is_nearer(name):
    shapes, solid = shapes_of(name)
    spacing = 0.001
    dense, _ = naive.boundary(shapes, spacing)
    points = around(solid, 2000, 0.03)
    near = solid.nearest(points)
    dense_distance, _ = cKDTree(dense).query(points)
    distance = np.abs(near.distance)
    assert np.linalg.norm(points - near.points, axis=1) == pytest.approx(distance, abs=1e-12)
    assert (distance <= dense_distance + 1e-9).all()
    assert (distance >= dense_distance - 3 * spacing).all()
    assert np.abs(solid.signed_distance(near.points)).max() < 1e-10
    assert _on_boundary(shapes, near.points[:100]).all()


def _on_boundary(shapes, points):
    """Whether within 2 um there are points inside and outside."""
    rng = np.random.default_rng(5)
    inside = np.zeros(len(points), dtype=int)
    for _ in range(200):
        moved = points + rng.uniform(-1e-6, 1e-6, points.shape)
        inside += np.any([naive.contains(shape, moved) for shape in shapes], axis=0)
    return (inside > 0) & (inside < 200)


@pytest.mark.parametrize("name", [name for name in JUDGED if name is not COSTLY])
def test_the_nearest_point_cannot_be_bettered_by_a_step(name):
    shapes, solid = shapes_of(name)
    points = around(solid, 30, 0.02, seed=3)
    near = solid.nearest(points)
    rng = np.random.default_rng(0)
    for point, foot, distance in zip(points, near.points, near.distance):
        if distance > 1e-4:
            assert naive.is_local_minimum(shapes, foot, point, rng)


def test_distances_of_primitives_are_those_of_their_formulas():
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.08, 0.08, (5000, 3))
    p = np.abs(points)
    over = p - [0.03, 0.02, 0.01]
    box = np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(axis=1), 0)
    across, along = np.hypot(points[:, 0], points[:, 1]) - 0.02, p[:, 2] - 0.03
    cylinder = np.hypot(np.maximum(across, 0), np.maximum(along, 0)) + np.minimum(np.maximum(across, along), 0)
    held = np.clip(points[:, 2], -0.03, 0.03)
    capsule = np.linalg.norm(points - np.outer(held, [0, 0, 1]), axis=1) - 0.02
    sphere = np.linalg.norm(points, axis=1) - 0.02
    for shape, expected in (
        (odd.box(0.06, 0.04, 0.02), box),
        (odd.cylinder(0.02, 0.06), cylinder),
        (odd.capsule(0.02, 0.06), capsule),
        (odd.sphere(0.02), sphere),
    ):
        turned = {**shape, "at": odd.at(0.1, -0.2, 0.3, (20, 50, -110))}
        frame = odd.scene(turned).objects[0].at.matrix()
        moved = points @ frame[:3, :3].T + frame[:3, 3]
        assert odd.scene(turned).solid().signed_distance(moved) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", ["polystyrene_1", "polystyrene_2"])
def test_a_blend_follows_its_formula_and_its_gradient(name):
    shape = load_scene(name).objects[0].children[0]
    solid = odd.scene(shape.model_dump()).solid()
    points = around(solid, 300, 0.005)
    value = np.array([surface_value(solid.numbers, 0, *p) for p in points])
    assert value == pytest.approx(naive.blend(shape, points), abs=1e-12)
    step = 1e-6
    slope = np.column_stack(
        [(naive.blend(shape, points + d) - naive.blend(shape, points - d)) / (2 * step) for d in step * np.eye(3)]
    )
    gradient = np.array([surface_gradient(solid.numbers, 0, *p) for p in points])
    assert gradient == pytest.approx(slope, abs=1e-7)
    assert (np.abs(value) <= np.abs(solid.signed_distance(points)) + 1e-9).all()


@pytest.mark.parametrize("name", ["polystyrene_1", "polystyrene_2"])
def test_the_smooth_objects_are_dented_and_the_sphere_reaches_every_dent(name):
    scene = load_scene(name)
    solid = scene.solid()
    points, normals = solid.sample_surface(1000, 1)
    open_to_air = points[:, 2] > 0.006
    centres = points[open_to_air] + RADIUS * normals[open_to_air]
    assert solid.signed_distance(centres) == pytest.approx(RADIUS, abs=1e-9)
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    depth = -(points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    assert depth.max() > 0.004


@pytest.mark.parametrize("name", [*SCENES, *odd.ODD])
def test_the_bound_never_exceeds_the_distance(name):
    _, solid = shapes_of(name)
    points = around(solid, 500, 0.03, seed=7)
    room, normals, parts = np.empty((8, 3)), np.empty((8, 3)), np.empty(8, dtype=np.int64)
    for point, distance in zip(points, solid.signed_distance(points)):
        count, bound = sphere_contacts(solid.numbers, solid.indices, point, RADIUS, room, normals, parts)
        assert bound <= distance + 1e-12
        assert (count > 0) == (distance < RADIUS)
        assert tree_value(solid.numbers, solid.indices, *point) <= max(distance, 0.0) + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["bridge", "combination", "inner_corner", "slot_12mm", "overhang", "cross_drilled", "tee"]
)
def test_contacts_are_all_the_local_minima_of_the_distance(name):
    shapes, solid = shapes_of(name)
    spacing = 0.0005
    dense, _ = naive.boundary(shapes, spacing)
    tree = cKDTree(dense)
    points = around(solid, 3000, 0.005, seed=11)
    distance = solid.signed_distance(points)
    rng = np.random.default_rng(0)
    for centre in points[(distance > 0.001) & (distance < RADIUS - 0.0003)][:50]:
        touch = solid.touch(centre, RADIUS)
        assert touch.depths.max() == pytest.approx(RADIUS - solid.signed_distance(centre[None])[0], abs=1e-12)
        for point in touch.points:
            assert naive.is_local_minimum(shapes, point, centre, rng)
        for expected in naive.minima(shapes, dense, tree, centre, RADIUS - 3e-4, spacing):
            assert np.linalg.norm(touch.points - expected, axis=1).min() < 5 * spacing


def test_a_sphere_in_an_inner_corner_touches_all_three_walls():
    solid = load_scene("inner_corner").solid()
    corner = np.array([0.02, 0.02, 0.02])
    touch = solid.touch(corner + np.array([-0.0048, -0.0047, 0.0046]), RADIUS)
    assert len(touch.points) == 3
    order = np.argsort(touch.normals @ [1.0, 2.0, 3.0])
    assert touch.normals[order] == pytest.approx(np.array([[0, -1, 0], [-1, 0, 0], [0, 0, 1]]))
    assert touch.depths[order] == pytest.approx([0.0003, 0.0002, 0.0004])


def test_a_sphere_over_a_narrow_slot_rests_on_both_its_edges():
    solid = load_scene("slot_8mm").solid()
    touch = solid.touch(np.array([0.0, 0.0, 0.0529]), RADIUS)
    distance = np.hypot(0.004, 0.0029)
    assert sorted(touch.points[:, 1]) == pytest.approx([-0.004, 0.004])
    assert touch.points[:, 2] == pytest.approx([0.05, 0.05])
    assert touch.depths == pytest.approx([RADIUS - distance] * 2)
    assert np.abs(touch.normals[:, 1]) == pytest.approx([0.004 / distance] * 2)


def test_the_normal_turns_steadily_around_a_sharp_edge():
    solid = load_scene("wedge_15deg").solid()
    angles = np.radians(np.arange(-96.0, 96.5, 0.5))
    edge = np.array([0.01, 0.0, 0.06])
    for angle in angles:
        direction = np.array([0.0, np.sin(angle), np.cos(angle)])
        touch = solid.touch(edge + 0.0045 * direction, RADIUS)
        held = np.clip(angle, -np.radians(82.5), np.radians(82.5))
        assert len(touch.points) == 1
        assert touch.normals[0] == pytest.approx([0.0, np.sin(held), np.cos(held)], abs=1e-9)


def test_a_centre_inside_has_one_contact_that_leads_out():
    solid = load_scene("block").solid()
    touch = solid.touch(np.array([0.01, 0.005, 0.049]), RADIUS)
    assert touch.points == pytest.approx(np.array([[0.01, 0.005, 0.05]]))
    assert touch.normals == pytest.approx(np.array([[0.0, 0.0, 1.0]]))
    assert touch.depths == pytest.approx([0.006])


def test_a_centre_on_the_axis_of_a_groove_as_wide_as_the_sphere_is_touched():
    groove = odd.difference(odd.box(0.04, 0.04, 0.02), odd.cylinder(0.005, 0.06, at=odd.at(z=0.01, rpy=(90, 0, 0))))
    solid = odd.scene(groove).solid()
    touch = solid.touch(np.array([0.0, 0.0, 0.01]), 0.0051)
    assert len(touch.points) >= 1
    assert touch.depths == pytest.approx(np.full(len(touch.points), 0.0001))
    assert np.linalg.norm(touch.points[:, [0, 2]] - [0.0, 0.01], axis=1) == pytest.approx(0.005)
    hollow = odd.scene(odd.difference(odd.box(0.04, 0.04, 0.02), odd.sphere(0.005))).solid()
    assert hollow.signed_distance(np.zeros((1, 3))) == pytest.approx([0.005])
    assert len(hollow.touch(np.zeros(3), 0.0051).points) == 1


def test_two_walls_of_a_thin_plate_are_kept_apart():
    solid = load_scene("thin_plate").solid()
    for side in (-1.0, 1.0):
        touch = solid.touch(np.array([0.0, side * 0.00475, 0.02]), RADIUS)
        assert touch.normals == pytest.approx(np.array([[0.0, side, 0.0]]))
        assert touch.points[0, 1] == pytest.approx(side * 0.00025)


def test_each_contact_names_its_object():
    solid = load_scene("stacked_blocks").solid()
    for y, x in ((0.0295, 0.0), (0.028, 0.053)):
        low, high = (solid.touch(np.array([x, y, z]), RADIUS) for z in (0.02, 0.08))
        assert (low.parts.tolist(), high.parts.tolist()) == ([0], [1])
        assert solid.nearest(np.array([[x, y, 0.02], [x, y, 0.08]])).parts.tolist() == [0, 1]


def test_objects_that_share_a_face_have_no_boundary_there():
    solid = load_scene("stacked_blocks").solid()
    assert solid.signed_distance(np.array([[0.0, 0.0, 0.05], [0.0, 0.0, 0.0501]])) == pytest.approx([-0.025, -0.025])


def test_the_edge_of_flush_parts_is_found_where_their_faces_are_a_fraction_of_a_micrometre_apart():
    """With places rounded to a micrometre, the sphere had sunk in there without a force: "the object has moved"."""
    yaw = (0.0, 0.0, 338.0)
    along, across = Pose(rpy_deg=yaw).matrix()[:3, :2].T
    fin = Pose(xyz=tuple((0.043 * along + [0.0, 0.0, 0.024]).round(6)), rpy_deg=yaw)
    solid = Solid.from_shapes(
        [
            Box(shape="box", size=(0.09, 0.024, 0.01), at=Pose(xyz=(0.0, 0.0, 0.005), rpy_deg=yaw)),
            Box(shape="box", size=(0.004, 0.024, 0.032), at=fin),
        ]
    )
    out = (along - across) / np.sqrt(2.0)
    for height in np.linspace(0.004, 0.03, 53):
        centre = 0.045 * along - 0.012 * across + 0.0045 * out + [0.0, 0.0, height]
        touch = solid.touch(centre, RADIUS)
        assert touch.depths.max(initial=0.0) == pytest.approx(0.0005, abs=2e-6), height
        assert touch.normals[touch.depths.argmax()] == pytest.approx(out, abs=1e-3)
        assert solid.signed_distance(centre[None]) == pytest.approx(0.0045, abs=2e-6)


def test_edges_and_corners_are_counted_once():
    def count(name, section):
        return load_scene(name).solid().indices[section]

    assert (count("block", layout.CHAINS), count("block", layout.VERTICES)) == (12, 8)
    assert (count("cylinder_vertical", layout.CHAINS), count("cylinder_vertical", layout.VERTICES)) == (2, 0)
    # The groove adds two edges along it and an arc at each end, and splits two edges of the block in two.
    assert (count("bridge", layout.CHAINS), count("bridge", layout.VERTICES)) == (12 + 2 + 2 + 2, 8 + 4)


def test_an_empty_scene_is_touched_by_nothing():
    solid = load_scene("empty").solid()
    assert solid.empty
    assert np.isinf(solid.signed_distance(np.zeros((2, 3)))).all()
    assert not solid.contains(np.zeros((2, 3))).any()
    assert len(solid.touch(np.zeros(3), RADIUS).points) == 0
    assert outside_bounds(solid.numbers, solid.indices, 0.0, 0.0, 0.0) == np.inf
    with pytest.raises(InputError, match="empty"):
        solid.nearest(np.zeros((1, 3)))


def test_bad_points_are_refused():
    solid = load_scene("block").solid()
    with pytest.raises(InputError, match="points"):
        solid.signed_distance(np.zeros(3))
    with pytest.raises(InputError, match="finite"):
        solid.nearest(np.array([[np.nan, 0.0, 0.0]]))
    with pytest.raises(InputError, match="finite"):
        solid.touch(np.array([np.inf, 0.0, 0.0]), RADIUS)


def test_shapes_nested_too_deeply_are_refused():
    shape = odd.sphere(0.01)
    for _ in range(40):
        shape = odd.union(odd.sphere(0.01), odd.difference(odd.box(0.1, 0.1, 0.1), shape))
    with pytest.raises(SceneError, match="levels"):
        odd.scene(shape).solid()


def test_the_kernel_fills_no_more_than_it_is_given():
    solid = load_scene("inner_corner").solid()
    points, normals, parts = np.full((2, 3), 9.0), np.full((2, 3), 9.0), np.full(2, 9)
    centre = np.array([0.0152, 0.0153, 0.0246])
    assert sphere_contacts(solid.numbers, solid.indices, centre, RADIUS, points[:1], normals[:1], parts[:1])[0] == 1
    assert (points[1] == 9.0).all()
    assert sphere_contacts(solid.numbers, solid.indices, centre, RADIUS, points[:0], normals[:0], parts[:0])[0] == 0


def test_the_nearest_kernel_and_the_batch_agree():
    solid = load_scene("bridge").solid()
    points = around(solid, 50, 0.02)
    batch = solid.nearest(points)
    for n, point in enumerate(points):
        distance, *rest = nearest(solid.numbers, solid.indices, *point)
        assert distance == batch.distance[n]
        assert rest[:3] == pytest.approx(batch.points[n])
        assert rest[3:6] == pytest.approx(batch.normals[n])


@pytest.mark.parametrize("turn", [0.0, 1.0, 30.0, 45.0, 90.0, 137.0, 175.0])
def test_a_hole_s_rim_is_an_edge_however_the_object_is_turned(turn):
    """The bridge's hole ends in its top face: there begins the parameter of the rim's circle once it is turned."""
    bridge = load_scene("bridge").objects[0].model_copy(update={"at": Pose(rpy_deg=(0.0, 0.0, turn))})
    solid, frame = Solid.from_shapes([bridge]), bridge.at.matrix()
    across = np.linspace(-0.023, 0.023, 41)
    rim = np.column_stack([across, np.full(41, -0.025), 0.05 - np.sqrt(0.024**2 - across**2), np.ones(41)])
    beside = rim + np.array([0.0, -0.003, 0.001, 0.0])
    found = solid.nearest(np.ascontiguousarray((beside @ frame.T)[:, :3]))
    apart = np.linalg.norm((beside - rim)[:, :3], axis=1)
    assert (found.distance <= apart + 1e-9).all()
    assert (found.distance > 0.0).all()
