"""Heights in the plan view, and a body above them, beside twins that go from square to square and point to point."""

import naive_mapping as naive
import numpy as np
import pytest
from scipy.ndimage import minimum_filter
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import InputError
from lwrprobe.mapping import BodyOverHeights, PlanView, SweptColumns

SHAPE, LOW, CELL, TOP = (41, 31), np.array([-0.02, -0.015]), 0.001, 0.1
DOWN = np.diag([1.0, -1.0, -1.0])
POINTS = np.random.default_rng(3).uniform((-0.006, -0.004, -0.08), (0.006, 0.004, -0.05), (200, 3))
"""Of a body 50 mm and more behind the tip."""


def pose(place, rotation=DOWN):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, place
    return found


def leaning(degrees, axis):
    return Rotation.from_rotvec(np.radians(degrees) * np.asarray(axis)).as_matrix() @ DOWN


def poses_of(chance, count):
    """Inside and beside the squares, upright and leaning; the body is below and above the top."""
    places = chance.uniform((-0.03, -0.025, 0.0), (0.03, 0.025, 0.06), (count, 3))
    return np.array(
        [pose(place, leaning(chance.uniform(0, 30), (1, 0, 0)[:: (-1) ** k])) for k, place in enumerate(places)]
    )


def body(heights):
    return BodyOverHeights(POINTS, LOW, CELL, heights, TOP)


def test_the_depth_is_that_of_the_deepest_point():
    chance = np.random.default_rng(1)
    heights = chance.uniform(0.0, TOP, SHAPE)
    poses = poses_of(chance, 60)
    expected = np.array([naive.body_depth(POINTS, pose, heights, LOW, CELL, TOP) for pose in poses])
    found = body(heights).depth(poses)
    assert np.isinf(found).any()
    assert (found > 0.0).any()
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_where_the_body_was_is_kept_below_the_top_and_off_the_border():
    chance = np.random.default_rng(2)
    poses = poses_of(chance, 40)
    over = body(np.zeros(SHAPE))
    lowered = [over.note(pose) for pose in poses]
    low = [pose for pose in poses if (POINTS @ pose[:3, :3].T)[:, 2].min() + pose[2, 3] < TOP]
    assert sum(lowered) == len(low)
    assert 5 < len(low) < 40
    np.testing.assert_allclose(over.lowest, naive.body_was(POINTS, low, SHAPE, LOW, CELL, TOP), atol=1e-12)
    rest = low[-1].copy()
    rest[0, 3] += 0.0009
    over.note(low[-1])
    assert not over.note(rest), "it has hardly moved"


@pytest.mark.slow
def test_what_is_plainly_clear_is_clear_all_along():
    """A motion is called clear only where the body is above everything on its path; and most are that are."""
    chance = np.random.default_rng(4)
    over, found, free = body(np.zeros(SHAPE)), 0, 0
    for k in range(1500):
        if k % 50 == 0:  # other heights: what was remembered of the last ones is void
            heights = np.full(SHAPE, 0.02)
            i, j = chance.integers(0, SHAPE[0] - 8), chance.integers(0, SHAPE[1] - 8)
            heights[i : i + 8, j : j + 8] = 0.09
            over.heights = heights
            place, rotation = (
                np.array([*chance.uniform(LOW, -LOW), 0.02]),
                (DOWN, leaning(15.0, (1, 0, 0)))[k % 100 // 50],
            )
        shift = chance.uniform(-0.003, 0.003, 3)
        begin, end = pose(place, rotation), pose(place + shift, rotation)
        path = [pose(place + share * shift, rotation) for share in np.linspace(0.0, 1.0, 5)]
        deepest = max(naive.body_depth(POINTS[::10], at, heights, LOW, CELL, TOP) for at in path)
        clears = over.clears(begin, end, shift)
        assert not (clears and deepest > 0.0)
        found, free = found + clears, free + (deepest <= -0.002)
        place = np.clip(place + shift, (-0.03, -0.025, 0.0), (0.03, 0.025, 0.04))
    assert 0.5 * free < found < 1500


def test_a_turn_is_never_plainly_clear():
    over, place = body(np.zeros(SHAPE)), np.array([0.0, 0.0, 0.05])
    upright, leans = pose(place), pose(place, leaning(1.0, (1, 0, 0)))
    assert over.clears(upright, upright, np.zeros(3))
    assert not over.clears(upright, leans, np.zeros(3))
    assert over.clears(leans, leans, np.zeros(3)), "and then it is held otherwise"
    assert (over.depth_on_path(upright, leans) <= 0.0).all()
    with pytest.raises(InputError, match="end"):
        over.depth_on_path(upright, np.zeros((4, 4)))


def test_a_body_without_points_is_nowhere():
    over = BodyOverHeights(np.empty((0, 3)), LOW, CELL, np.full(SHAPE, 0.09), TOP)
    assert not over.note(pose((0.0, 0.0, 0.0)))
    assert over.clears(pose((0.0, 0.0, 0.0)), pose((0.0, 0.0, 0.0)), np.zeros(3))
    assert np.isneginf(over.depth(np.array([pose((0.0, 0.0, 0.0))]))).all()


def test_a_window_is_looked_through_up_to_the_last_square():
    chance = np.random.default_rng(6)
    for _ in range(200):
        view = PlanView(SHAPE, -np.inf)
        touched = chance.random(SHAPE) < 0.02
        view.heights[touched] = chance.uniform(0.0, TOP, touched.sum())
        normals = np.ascontiguousarray(np.moveaxis(chance.normal(size=(2, *SHAPE)), 0, -1))
        i, j = chance.integers(0, SHAPE[0] + 5), chance.integers(0, SHAPE[1] + 5)
        window = (int(i), int(i) + 9, int(j), int(j) + 12)
        squares = naive.in_window(window, SHAPE)
        assert view.tallest(window) == max((view.heights[at] for at in squares), default=-np.inf)
        view.heights[~touched] = np.inf
        along = np.array([0.6, -0.8])
        facing = [view.heights[at] for at in squares if -normals[at] @ along > 0.5]
        assert view.lowest_facing(normals, window, (0.6, -0.8), 0.5) == min(facing, default=np.inf)


def test_columns_are_free_above_what_the_sphere_swept_up_to_where_nothing_is():
    chance = np.random.default_rng(9)
    half = chance.uniform(-0.002, 0.006, (7, 7))
    swept, twin = SweptColumns(SHAPE, half), naive.SweptColumns(SHAPE, half)
    above = chance.uniform(0.02, 0.08, SHAPE)
    at, height, lower = np.array(SHAPE) // 2, 0.04, 0
    for _ in range(1500):
        at = np.clip(at + chance.integers(-2, 3, 2), -4, np.array(SHAPE) + 4)
        height = float(np.clip(height + chance.normal(0.0, 0.008), 0.0, 0.09))
        swept.note(*at.tolist(), height)
        twin.note(at, height)
        found = swept.free_from(above)
        np.testing.assert_array_equal(found, twin.free_from(above))
        lower = max(lower, int((found < above).sum()))
    assert lower > 100


def test_a_column_is_not_free_where_the_sphere_has_passed_below_without_coming_up():
    half = np.full((1, 1), 0.004)
    swept, above = SweptColumns((1, 1), half), np.full((1, 1), 0.05)
    for height in (0.047, 0.03, 0.008, 0.012, 0.02, 0.0219):
        swept.note(0, 0, height)
    assert swept.free_from(above)[0, 0] == pytest.approx(0.043), "the sphere came up to 25.9 mm"
    swept.note(0, 0, 0.0225)
    assert swept.free_from(above)[0, 0] == pytest.approx(0.043), "what was passed at 30 mm is forgotten"
    for height in (0.03, 0.036, 0.0395):
        swept.note(0, 0, height)
    assert swept.free_from(above)[0, 0] == pytest.approx(0.004)


def test_between_two_known_squares_it_is_as_tall_as_the_taller_of_both():
    chance = np.random.default_rng(8)
    for _ in range(20):
        view = PlanView((23, 17), np.inf)
        stood = chance.random((23, 17)) < 0.12
        view.heights[stood] = chance.uniform(0.0, TOP, stood.sum())
        view.heights[0], view.heights[:, -1] = -np.inf, -np.inf
        known = view.heights < 0.8 * TOP
        touched, hidden = known & (chance.random(known.shape) < 0.3), 1e-3 * np.arange(7.0)
        found = view.bridged(known, touched, hidden)
        np.testing.assert_array_equal(found, naive.bridged(view.heights, known, touched, hidden))
        assert (found < np.inf).sum() > known.sum() + 20
        assert np.isinf(found).any()


def test_a_hole_that_the_end_of_a_line_leaves_is_closed_from_both_sides_and_nothing_wider_is():
    def known(missing):
        view = PlanView((41, 31), np.inf)
        view.heights[::10] = 0.02
        view.heights[10, missing] = np.inf
        lines = view.heights < np.inf
        return view.bridged(lines, lines & False, np.zeros(12))

    lines = known(slice(0, 0))
    assert (lines == 0.02).all()
    np.testing.assert_array_equal(known(slice(12, 20)), lines)
    gone = np.isinf(known(slice(5, 20)))
    assert gone[1:20, 5:20].all(), "lines farther apart than the spacing show nothing between"
    assert gone.sum() == 19 * 15


def test_around_where_the_body_was_it_is_no_taller():
    over, heights = body(np.zeros(SHAPE)), np.full(SHAPE, 0.09)
    assert over.note(pose((0.0, 0.0, 0.0)))
    over.lower(heights, 2, 0.001)
    expected = np.minimum(minimum_filter(over.lowest, 5) + 0.001, 0.09)
    np.testing.assert_array_equal(heights, expected)
    assert 100 < (heights < 0.09).sum() < heights.size
