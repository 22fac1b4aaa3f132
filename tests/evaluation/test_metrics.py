"""Metrics on cases whose answers are known by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import Area, InputError, LinkShape, TriangleMesh
from lwrprobe.evaluation import (
    aligned_points,
    coverage,
    coverage_over_time,
    deviation,
    end_errors,
    face_deviation,
    gap_over_time,
    is_watertight,
    lower_bound_path,
    lower_bound_time,
    mesh_error,
    normal_error,
    point_error,
    reach,
    reachable_error,
    surface_error,
    upright,
)
from lwrprobe.evaluation.coverage import touched
from lwrprobe.scene import load_scene
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid

RADIUS, LOWEST, PITCH = 0.005, 0.006, 0.010
UP = np.array([[0.0, 0.0, 1.0]])
NOTHING = np.empty((0, 3))


@pytest.fixture(scope="module")
def block():
    return load_scene("block").solid()


@pytest.fixture(scope="module")
def found(block):
    return reach(block, RADIUS, LOWEST)


def cuboid(lower, upper):
    """A closed box as a mesh, outwards."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return TriangleMesh(np.asarray(lower) + corner * np.subtract(upper, lower), np.array(faces))


def test_point_errors_are_distances_in_millimetres():
    true = np.zeros((5, 3))
    estimated = np.array([[0.001, 0, 0], [0, 0.002, 0], [0, 0, -0.003], [0, 0, 0], [0.003, 0, 0.004]])
    error = point_error(estimated, true)
    assert error.as_dict() == {"median": 2.0, "mean": 2.2, "rms": pytest.approx(2.79285), "p95": 4.6, "max": 5.0}
    assert error.count == 5


def test_aligned_errors_leave_out_a_rigid_motion_and_nothing_else():
    rng = np.random.default_rng(3)
    true, noise = rng.uniform(-0.05, 0.05, (400, 3)), 1e-4 * rng.normal(size=(400, 3))
    turn, aside = Rotation.from_euler("xyz", [3.0, -2.0, 5.0], degrees=True), np.array([0.01, 0.02, -0.03])
    assert point_error(aligned_points(turn.apply(true) + aside, true), true).max < 1e-12
    moved = point_error(aligned_points(turn.apply(true + noise) + aside, true), true)
    assert moved.rms == pytest.approx(point_error(aligned_points(true + noise, true), true).rms, rel=1e-9)
    assert moved.rms < point_error(true + noise, true).rms
    assert moved.rms == pytest.approx(np.sqrt(3) * 1e-4, rel=0.1)
    assert point_error(aligned_points(1.01 * true, true), true).max > 2e-4  # another size is no motion
    assert point_error(aligned_points(true[:2], true[:2] + 0.01), true[:2] + 0.01).max == 0.0


def test_surface_errors_count_on_both_sides(block):
    points = np.array([[0.0, 0.0, 0.0501], [0.0, 0.0, 0.0499], [0.0503, 0.0, 0.02], [0.0503, 0.0254, 0.02]])
    error = surface_error(points, block)
    assert error.max == pytest.approx(0.0005)
    assert error.median == pytest.approx(0.0002)


def test_normal_errors_are_angles_whatever_the_length():
    true = np.tile([0.0, 0.0, 2.0], (4, 1))
    tilt = np.radians([0.0, 1e-7, 30.0, 180.0])
    error = normal_error(np.column_stack([np.sin(tilt), 0 * tilt, np.cos(tilt)]), true)
    assert error.as_dict()["max"] == pytest.approx(180.0)
    assert error.median == pytest.approx((np.radians(1e-7) + np.radians(30.0)) / 2)
    tiny = normal_error(np.array([[1e-9, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert tiny.max == pytest.approx(1e-9, rel=1e-6)


def test_no_points_make_no_error(block):
    nothing = np.empty((0, 3))
    for error in (point_error(nothing, nothing), surface_error(nothing, block), normal_error(nothing, nothing)):
        assert error.count == 0
        assert set(error.as_dict().values()) == {0.0}


def test_bad_arrays_are_refused(block, found):
    with pytest.raises(InputError, match="estimated"):
        point_error(np.zeros(3), np.zeros((1, 3)))
    with pytest.raises(InputError, match="true"):
        point_error(np.zeros((2, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="NaN"):
        surface_error(np.array([[np.nan, 0, 0]]), block)
    with pytest.raises(InputError, match="pitch"):
        coverage(np.zeros((1, 3)), UP, found, 0.0)
    with pytest.raises(InputError, match="contour_speed"):
        lower_bound_time(found, PITCH, 0.0)
    with pytest.raises(InputError, match="normals"):
        coverage(np.zeros((2, 3)), UP, found, PITCH)
    with pytest.raises(InputError, match="times"):
        coverage_over_time(np.zeros((2, 3)), np.tile(UP, (2, 1)), np.zeros(1), np.zeros(1), found, PITCH)


def test_the_sphere_reaches_five_faces_of_a_block_above_its_lowest_height(block):
    found = reach(block, RADIUS, LOWEST)
    sides = 2 * (0.1 + 0.05) * (0.05 - LOWEST)
    assert found.area == pytest.approx(0.1 * 0.05 + sides, rel=0.01)
    assert found.footprint == pytest.approx(0.1 * 0.05, rel=0.02)
    assert found.points[:, 2].min() >= LOWEST
    assert lower_bound_path(found, PITCH) == pytest.approx((0.1 * 0.05 + sides) / PITCH, rel=0.01)


def test_the_sphere_reaches_into_a_wide_slot_and_not_into_a_narrow_one():
    block = 0.1 * 0.05 + 2 * (0.1 + 0.05) * (0.05 - LOWEST)
    wide, narrow = (reach(load_scene(f"slot_{width}mm").solid(), RADIUS, LOWEST) for width in (12, 8))
    in_wide = (np.abs(wide.points[:, 1]) < 0.0059) & (wide.points[:, 2] < 0.049)
    assert in_wide.any()
    in_narrow = (
        (np.abs(narrow.points[:, 1]) < 0.0039) & (narrow.points[:, 2] < 0.049) & (np.abs(narrow.points[:, 0]) < 0.04)
    )
    assert not in_narrow.any()
    # The slot's mouth and its profile at both ends are lost, and the flat floor between the inner edges is won.
    lost = 0.1 * 0.008 + 2 * 0.008 * 0.03
    assert narrow.area == pytest.approx(block - lost, rel=0.015)


def test_an_inner_edge_is_out_of_reach_by_the_morphological_limit():
    """In a right angle the sphere's contacts end one radius from the edge."""
    found = reach(load_scene("inner_corner").solid(), RADIUS, LOWEST)
    floor = found.points[np.abs(found.points[:, 2] - 0.02) < 1e-9]
    floor = floor[(np.abs(floor[:, 0]) < 0.035) & (np.abs(floor[:, 1]) < 0.035)]
    assert floor[:, :2].max() == pytest.approx(0.02 - RADIUS, abs=0.001)
    assert floor[:, :2].max() <= 0.02 - RADIUS + 1e-6


def test_the_surface_under_an_overhang_is_reachable_for_the_bare_sphere():
    found = reach(load_scene("overhang").solid(), RADIUS, LOWEST)
    assert (found.normals[:, 2] < -0.9).any()


def test_coverage_counts_what_lies_near_a_contact(block, found):
    points, normals = block.sample_surface(6000, seed=5)
    assert coverage(points, normals, found, PITCH).share == 1.0
    left = points[:, 0] < 0
    half = coverage(points[left], normals[left], found, PITCH)
    assert half.share == pytest.approx(0.5 + 0.006 * 0.138 / 0.0182, abs=0.01)  # and a stripe of half a pitch + 1 mm
    assert half.share_5mm == pytest.approx(0.5 + 0.005 * 0.188 / 0.0182 - 0.05 * 0.05 * 0, abs=0.03)
    assert coverage(NOTHING, NOTHING, found, PITCH).share == 0.0
    wide = coverage(np.array([[0.0, 0.0, 0.05]]), UP, found, 0.018)
    assert wide.share == pytest.approx(np.pi * 0.010**2 / 0.0182, rel=0.1)
    assert wide.share_5mm == pytest.approx(np.pi * 0.005**2 / 0.0182, rel=0.25)
    assert json.dumps(wide.as_dict())


def test_a_contact_counts_only_for_the_side_that_it_faces():
    plate = load_scene("thin_plate").solid()
    found = reach(plate, RADIUS, LOWEST)
    points, normals = plate.sample_surface(8000, seed=5)
    assert coverage(points, normals, found, PITCH).share == 1.0
    thin = int(np.argmin(np.ptp(np.array(plate.bounds()), axis=0)))
    one = normals[:, thin] > 0.9
    share = coverage(points[one], normals[one], found, PITCH).share
    facing = float((found.normals[:, thin] > 0.5).mean())
    assert facing == pytest.approx(share, abs=0.01)
    assert share < 0.55


@pytest.mark.parametrize(("degrees", "share"), [(0.0, 1.0), (59.0, 1.0), (61.0, 0.0), (180.0, 0.0)])
def test_a_contact_may_face_up_to_60_degrees_aside(found, degrees, share):
    top = found.normals[:, 2] > 0.9
    angle = np.radians(degrees)
    leaning = np.tile([np.sin(angle), 0.0, np.cos(angle)], (int(top.sum()), 1))
    on_top = replace(found, points=found.points[top], normals=found.normals[top])
    assert coverage(on_top.points, leaning, on_top, PITCH).share == share


def test_coverage_is_that_of_all_pairs(block, found):
    points, normals = block.sample_surface(150, seed=9)
    some = replace(found, points=found.points[::20], normals=found.normals[::20])
    near = np.linalg.norm(some.points[:, None] - points, axis=2) <= 0.5 * PITCH + 0.001
    facing = some.normals @ normals.T >= 0.5
    assert coverage(points, normals, some, PITCH).share == (near & facing).any(axis=1).mean()


def test_what_is_just_as_far_as_counts_is_not_covered_by_what_faces_away():
    """Rounding left no contact at that distance: "zero-size array"."""
    away = np.random.default_rng(0).normal(size=(5000, 3))
    points = 0.006 * away / np.linalg.norm(away, axis=1, keepdims=True)
    assert not touched(points, np.tile(-UP, (5000, 1)), np.zeros((1, 3)), UP, PITCH).any()
    assert touched(points, np.tile(UP, (5000, 1)), np.zeros((1, 3)), UP, PITCH).mean() > 0.2


def test_coverage_inside_an_area_leaves_out_what_the_area_does_not_hold(block, found):
    area = Area(np.array([-0.2, -0.2, LOWEST]), np.array([0.0, 0.2, 0.2]))
    points, normals = block.sample_surface(6000, seed=5)
    left = points[:, 0] < 0
    inside = coverage(points[left], normals[left], found.within(area), PITCH)
    assert inside.share == pytest.approx(1.0, abs=0.001)
    assert inside.reachable_area == pytest.approx(0.0182 / 2, rel=0.02)


def test_coverage_of_nothing_is_not_known():
    nothing = reach(load_scene("empty").solid(), RADIUS, LOWEST)
    of_nothing = coverage(NOTHING, NOTHING, nothing, PITCH).as_dict()
    assert of_nothing["coverage"] is None
    assert of_nothing["coverage_5mm"] is None
    assert np.isnan(coverage_over_time(NOTHING, NOTHING, np.empty(0), np.array([1.0]), nothing, PITCH)).all()


def test_coverage_over_time_ends_at_the_coverage_and_never_falls(block, found):
    points, normals = block.sample_surface(500, seed=6)
    times = np.linspace(0.0, 10.0, len(points))
    at = np.linspace(-1.0, 11.0, 25)
    share = coverage_over_time(points, normals, times, at, found, PITCH)
    assert share[0] == 0.0
    assert (np.diff(share) >= 0).all()
    for time, one in zip(at, share):
        known = times <= time
        assert one == pytest.approx(coverage(points[known], normals[known], found, PITCH).share, abs=1e-12)


def test_ends_that_were_missed_are_measured(found):
    points = np.array([[-0.045, 0.0, 0.05], [0.05, 0.0, 0.03]])
    outward = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert end_errors(points, outward, found) == pytest.approx((0.005, 0.0), abs=1e-9)
    sideways = outward[:, [1, 0, 2]]
    assert end_errors(points, sideways, found, axis=1) == pytest.approx((0.025, 0.025), abs=1e-9)
    assert end_errors(points, sideways, found) == (np.inf, np.inf), "touched from the side alone"
    assert end_errors(np.empty((0, 3)), np.empty((0, 3)), found) == (np.inf, np.inf)


def test_the_lower_bound_is_path_over_speed_and_grows_with_what_it_counts(found):
    path = lower_bound_path(found, PITCH)
    assert lower_bound_time(found, PITCH, 0.02) == pytest.approx(path / 0.02)
    area = Area(np.array([-0.085, -0.06, 0.006]), np.array([0.085, 0.06, 0.058]))
    free = (0.17 * 0.12 - 0.1 * 0.05) / PITCH / 0.1
    with_free = lower_bound_time(found, PITCH, 0.02, area, 0.1)
    assert with_free == pytest.approx(path / 0.02 + free, rel=0.02)
    with_turns = lower_bound_time(found, PITCH, 0.02, area, 0.1, 1.0)
    assert with_turns - with_free == pytest.approx(18 * 2 * 0.1 / 1.0)
    walls = path - 0.1 * 0.05 / PITCH
    down = lower_bound_time(found, PITCH, 0.02, descent_speed=0.01)
    assert down == pytest.approx(path / 0.02 + 0.5 * walls * (100.0 - 50.0), rel=0.01)
    assert lower_bound_time(found, PITCH, 0.02, descent_speed=0.1) == pytest.approx(path / 0.02)


def test_the_true_shape_as_a_mesh_has_no_error(block):
    error = mesh_error(cuboid([-0.05, -0.025, 0.0], [0.05, 0.025, 0.05]), block, LOWEST)
    assert error.hausdorff < 1e-12
    assert error.normals.max < 1e-6
    assert error.watertight
    assert error.volume_error == 0.0
    assert error.overlap == 1.0
    assert json.dumps(error.as_dict())


def test_a_larger_box_errs_by_what_was_added(block):
    grown = cuboid([-0.051, -0.026, 0.0], [0.051, 0.026, 0.051])
    error = mesh_error(grown, block, LOWEST)
    assert error.mean == pytest.approx(0.001, rel=0.02)
    assert error.hausdorff == pytest.approx(0.001 * np.sqrt(3), rel=1e-3)
    assert error.surface_to_mesh == pytest.approx(0.001)
    true, made = 0.1 * 0.05 * (0.05 - LOWEST), 0.102 * 0.052 * (0.051 - LOWEST)
    assert error.volume_error == pytest.approx(made / true - 1, abs=0.002)
    assert error.overlap == pytest.approx(true / made, abs=0.002)


def test_a_shifted_box_errs_at_two_faces_only(block):
    shifted = cuboid([-0.048, -0.025, 0.0], [0.052, 0.025, 0.05])
    error = mesh_error(shifted, block, LOWEST)
    ends = 2 * 0.05 * 0.044 / 0.0182
    assert error.mean == pytest.approx(0.002 * ends, rel=0.06)
    assert error.p95 == pytest.approx(0.002, rel=1e-6)
    assert error.volume_error == pytest.approx(0.0, abs=0.002)
    assert error.overlap == pytest.approx(0.098 / 0.102, abs=0.005)  # cells of 1.3 mm


def test_what_lies_below_the_height_does_not_count(block):
    stump = cuboid([-0.05, -0.025, 0.004], [0.05, 0.025, 0.05])
    assert mesh_error(stump, block, LOWEST).surface_to_mesh < 1e-12
    skirt = cuboid([-0.05, -0.025, -0.2], [0.05, 0.025, 0.05])
    assert mesh_error(skirt, block, LOWEST).hausdorff < 1e-12


def test_a_missing_half_shows_in_one_way_and_in_both(block):
    half = cuboid([-0.05, -0.025, 0.0], [0.0, 0.025, 0.05])
    error = mesh_error(half, block, LOWEST)
    assert error.surface_to_mesh > 0.005
    assert error.hausdorff == pytest.approx(0.05, abs=0.002)
    assert error.overlap == pytest.approx(0.5, abs=0.005)


def test_an_open_mesh_has_no_volume(block):
    closed = cuboid([-0.05, -0.025, 0.0], [0.05, 0.025, 0.05])
    lidless = TriangleMesh(closed.vertices, closed.faces[:-1])
    error = mesh_error(lidless, block, LOWEST)
    assert not error.watertight
    assert error.volume_error is None
    assert error.overlap is None


def test_watertight_means_each_edge_joins_two_faces_that_are_wound_alike():
    closed = cuboid([0, 0, 0], [1, 1, 1])
    assert is_watertight(closed)
    assert not is_watertight(TriangleMesh(closed.vertices, closed.faces[1:]))
    flipped = closed.faces.copy()
    flipped[0] = flipped[0, ::-1]
    assert not is_watertight(TriangleMesh(closed.vertices, flipped))
    soup = TriangleMesh(closed.vertices[closed.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert is_watertight(soup)
    twice = TriangleMesh(closed.vertices, np.concatenate([closed.faces, closed.faces[:1]]))
    assert not is_watertight(twice)
    assert not is_watertight(TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=int)))


def test_deviations_have_a_sign(block):
    mesh = cuboid([-0.051, -0.025, 0.001], [0.049, 0.025, 0.05])
    assert deviation(mesh, block) == pytest.approx([0.001] * 4 + [0.0] * 4, abs=1e-12)
    assert face_deviation(mesh, block).min() == pytest.approx(-0.001)
    assert face_deviation(mesh, block).max() == pytest.approx(0.001)


def test_a_mesh_or_a_solid_that_cannot_be_compared_is_refused(block):
    nothing = TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    with pytest.raises(InputError, match="no faces"):
        mesh_error(nothing, block, LOWEST)
    with pytest.raises(InputError, match="above"):
        mesh_error(cuboid([0, 0, 0], [0.01, 0.01, 0.005]), block, LOWEST)
    with pytest.raises(InputError, match="solid"):
        mesh_error(cuboid([0, 0, 0], [0.01, 0.01, 0.05]), load_scene("empty").solid(), LOWEST)
    broken = cuboid([0, 0, 0], [0.01, 0.01, 0.05])
    broken.vertices[0, 0] = np.nan
    with pytest.raises(InputError, match="NaN"):
        mesh_error(broken, block, LOWEST)


@pytest.mark.parametrize("below", [1e-5, 1e-9])
def test_a_height_just_below_the_top_of_an_object_is_refused(below):
    """More and more samples were asked for, up to billions; or none were left, and the error was NaN."""
    sphere = load_scene("sphere").solid()
    top = float(sphere.bounds()[1][2])
    with pytest.raises(InputError, match="solid: got 'next to nothing above'"):
        mesh_error(cuboid([-0.02, -0.02, 0.0], [0.02, 0.02, 0.08]), sphere, top - below)
    assert mesh_error(sphere.mesh(), sphere, top - 1e-3).mean < 1e-4


def test_metrics_repeat_bit_for_bit(block, found):
    mesh = cuboid([-0.048, -0.025, 0.0], [0.052, 0.025, 0.05])
    assert mesh_error(mesh, block, LOWEST) == mesh_error(mesh, block, LOWEST)
    points, normals = block.sample_surface(100, 3)
    assert coverage(points, normals, found, PITCH) == coverage(points, normals, found, PITCH)


def test_an_upright_stick_shadows_what_lies_under_an_overhang():
    """A plate of 60 mm on a post of 20 mm: the sphere fits beside the post, and the stick would stand in the plate."""
    post = Box(shape="box", size=[0.02, 0.02, 0.04], at={"xyz": [0.0, 0.0, 0.02]})
    plate = Box(shape="box", size=[0.06, 0.06, 0.01], at={"xyz": [0.0, 0.0, 0.045]})
    table = Solid.from_shapes([post, plate])
    area = Area(np.array([-0.1, -0.1, LOWEST]), np.array([0.1, 0.1, 0.1]))
    within = reach(table, RADIUS, LOWEST, area, 4000)
    behind = np.eye(4)
    behind[2, 3] = -0.0275
    stick = LinkShape("stick", "cylinder", (0.002, 0.045), behind)
    reached = upright(within, table, [stick], np.diag([1.0, -1.0, -1.0]), [1e-4])
    assert (within.points[:, 2] < 0.038).any()
    assert reached.points[:, 2].min() > 0.038
    assert len(reached.points) == np.count_nonzero(within.points[:, 2] > 0.04 + 1e-9)


def test_an_upright_probe_does_not_get_down_beside_a_tall_object(block):
    """A body as wide as a fist, 30 mm above the sphere's centre: 20 mm of the block's 50 stay out of its reach."""
    behind = np.eye(4)
    behind[2, 3] = -0.05
    body = LinkShape("body", "cylinder", (0.02, 0.04), behind)
    down = np.diag([1.0, -1.0, -1.0])
    area = Area(np.array([-0.2, -0.2, LOWEST]), np.array([0.2, 0.2, 0.2]))
    within = reach(block, RADIUS, LOWEST, area, 4000)
    beside = upright(within, block, [body], down, [0.0])
    points, normals = block.sample_surface(8000, seed=2)
    lowest = (points[:, 2] < 0.01) & (points[:, 2] > LOWEST)
    high = points[:, 2] > 0.0185

    def share(made):
        return coverage(points[made], normals[made], beside, PITCH).share

    assert share(high) == 1.0
    assert coverage(points[high], normals[high], within, PITCH).share < 1.0
    assert share(lowest) < 0.2
    assert coverage(points[high], normals[high], upright(within, block, [], down, []), PITCH).share < 1.0
    lower, upper = block.bounds()
    right = cuboid(lower, upper)
    bulge = cuboid(lower - [0.02, 0.02, 0.0], [upper[0] + 0.02, upper[1] + 0.02, 0.01])
    both = TriangleMesh(np.vstack([right.vertices, bulge.vertices]), np.vstack([right.faces, bulge.faces + 8]))
    assert mesh_error(both, block, LOWEST).mean > 1e-3
    assert reachable_error(both, block, within, LOWEST)["mean"] > 1.0
    assert reachable_error(both, block, beside, LOWEST) == {"mean": 0.0, "p95": 0.0}


def test_the_gap_to_the_nearest_contact_shrinks_as_contacts_come(found):
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    gap = gap_over_time(points, np.array([2.0, 1.0]), np.array([0.5, 1.0, 2.0]), found)
    far = np.linalg.norm(found.points[:, None] - points, axis=2)
    assert gap[0] == np.inf
    nothing = replace(found, points=found.points[:0], normals=found.normals[:0])
    assert np.isnan(gap_over_time(points, np.array([2.0, 1.0]), np.array([0.5]), nothing)).all()
    assert gap[1:] == pytest.approx([far[:, 1].mean(), far.min(axis=1).mean()], abs=1e-12)
