"""The estimate of the surface and of its error."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from lwrprobe.contracts import Area, InputError
from lwrprobe.mapping import estimate, nearest_places
from lwrprobe.mapping.estimate import MAX_POINTS, SurfaceEstimate, predicted_height
from lwrprobe.mapping.estimate_kernels import lower_to_nearest

AREA = Area(np.array([-0.06, -0.05, 0.006]), np.array([0.06, 0.05, 0.05]))
TOP = 0.04
UP = np.array([0.0, 0.0, 1.0])


def naive_nearest(grid, places, weights):
    """Squared distances of grid points (n, 3) to the nearest of all places, and which that is."""
    step = grid[:, None] - places
    upright = np.where(step[..., 2] > 0.0, weights[:, 1], weights[:, 2])
    square = weights[:, 0] * (step[..., 0] ** 2 + step[..., 1] ** 2) + upright * step[..., 2] ** 2
    return square.min(axis=1), square.argmin(axis=1)


def table(places):
    """An estimate that knows places (n, 2) of a level top."""
    known = SurfaceEstimate(AREA, 0.015)
    for x, y in places:
        known.touch(np.array([x, y, TOP]), UP)
    known.update()
    return known


def line(x):
    return [(x, y) for y in np.arange(-0.03, 0.0301, 0.002)]


@pytest.mark.parametrize("seed", range(5))
def test_nearest_places_are_those_of_a_full_search(seed):
    rng = np.random.default_rng(seed)
    shape, edge, origin = (5, 7, 6), 0.003, np.array([-0.01, 0.02, 0.0])
    grid = origin + edge * np.argwhere(np.ones(shape))
    places, weights = rng.uniform(-0.02, 0.04, (240, 3)), rng.choice([0.16, 1.0, 2.25], (240, 3))
    places = places[np.argsort(places[:, seed % 3])]  # neighbours lie near one another, as along a stroke
    square, owner = np.full(shape, np.inf), np.full(shape, -1, np.int64)
    for first in range(0, 240, 80):  # as strokes come in
        part = slice(first, first + 80)
        lower_to_nearest(square, owner, origin, edge, places[part], weights[part], first)
    wanted, which = naive_nearest(grid, places, weights)
    assert np.allclose(square.ravel(), wanted, rtol=1e-12)
    assert (owner.ravel() == which).all()


def test_a_plane_is_predicted_exactly():
    rng = np.random.default_rng(3)
    normal = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    points = rng.uniform(-0.02, 0.02, (4, 12, 3))
    points -= (points @ normal)[..., None] * normal
    away = np.array([0.0, 0.001, -0.002, 0.005])
    queries = rng.uniform(-0.01, 0.01, (4, 3))
    queries += (away - queries @ normal)[:, None] * normal
    found = predicted_height(queries, points, np.broadcast_to(normal, points.shape), 0.02)
    assert np.allclose(found, away, atol=1e-12)


def test_a_ball_is_predicted_far_better_than_by_its_tangent_plane():
    radius, angles = 0.03, np.linspace(-0.4, 0.4, 8)
    normals = np.array([[np.sin(a), 0.3 * s, np.cos(a)] for s in (-1.0, 1.0) for a in angles])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    query = radius * np.array([[0.02, 0.0, 1.0]]) / np.hypot(0.02, 1.0)
    order = np.argsort(np.linalg.norm(radius * normals - query, axis=1))
    centres = (radius * normals)[order][None]
    plane = abs(float((query[0] - centres[0, 0]) @ normals[order[0]]))
    found = predicted_height(query, centres, normals[order][None], 0.02)
    assert plane > 0.001
    assert abs(found[0]) < 0.1 * plane


def test_nothing_is_expected_before_the_first_contact():
    empty = SurfaceEstimate(AREA, 0.015)
    empty.passed(np.zeros(3))
    empty.update()
    assert empty.faces().error() == (np.inf, np.inf)
    assert not len(empty.faces().areas)


def test_each_line_makes_the_expected_error_smaller():
    known = table(line(0.0))
    errors = [known.faces().error()[0]]
    for x in (0.03, -0.03, 0.015, -0.015):
        for place in line(x):
            known.touch(np.array([*place, TOP]), UP)
        known.update()
        errors.append(known.faces().error()[0])
    assert (np.diff(errors) < 0.0).all()


def test_a_surprise_raises_the_expected_error_and_agreement_lowers_it():
    flat, stepped = table(line(0.0)), table(line(0.0))
    for x, y in line(0.012):
        flat.touch(np.array([x, y, TOP]), UP)
        stepped.touch(np.array([x, y, TOP - 0.004]), UP)
    flat.update()
    stepped.update()
    there = np.array([0.006, 0.0, TOP])

    def rough(known):
        faces = known.faces()
        return faces.roughness[np.argmin(np.linalg.norm(faces.centres - there, axis=1))]

    assert rough(flat) < rough(table(line(0.0))) < rough(stepped)


def test_what_was_predicted_from_close_by_counts_little(monkeypatch):
    """Each was scaled to the distance D: over `combination` 12.7 mm were expected at 110 s, where 1.4 mm were true."""
    off = 0.0003
    monkeypatch.setattr(estimate, "predicted_height", lambda queries, *of: np.full(len(queries), off))
    known = table(line(0.0))
    for x in (0.007, 0.021):
        for _, y in line(x):
            known.touch(np.array([x, y, TOP]), UP)
        known.update()
    near, far = (0.007 / 0.015) ** 2, (0.014 / 0.015) ** 2
    old = estimate.OLDER
    expected = (off - estimate.NOISE) * (1.0 + old) / (old * near + far)
    faces = known.faces()
    there = np.linalg.norm(faces.centres - [0.014, 0.0, TOP], axis=1) < 0.005
    assert faces.roughness[there] - estimate.SMOOTH == pytest.approx(expected, rel=0.15)


def test_updates_within_a_stroke_leave_the_expected_error_as_one_update_after_it_does():
    """Every 2 s, as for `--until accurate`: surprises were forgotten, and a stroke predicted itself."""
    whole, often = table(line(0.0)), table(line(0.0))
    for x in (0.012, 0.024):
        for k, (_, y) in enumerate(line(x)):
            place = np.array([x, y, TOP - 0.004 * np.sin(90.0 * y)])
            whole.touch(place, UP)
            often.touch(place, UP)
            if k % 5 == 4:
                often.update(stroke_ended=False)
        whole.update()
        often.update()
    assert often.faces().error() == pytest.approx(whole.faces().error(), rel=0.1)


def test_the_expected_error_covers_what_the_prediction_misses_on_a_curved_surface():
    """Lines over a cylinder cap, nearer and nearer: on the average an error is no larger than was expected there."""
    radius, centre = 0.05, TOP - 0.05
    known = SurfaceEstimate(AREA, 0.015)
    for y in (-0.03, -0.01, 0.01, 0.03):
        for x in np.arange(-0.03, 0.0301, 0.002):
            normal = np.array([x, 0.0, np.sqrt(radius**2 - x**2)]) / radius
            known.touch(np.array([0.0, y, centre]) + radius * normal, normal)
        known.update()
    faces = known.faces()
    near = (np.abs(faces.centres[:, 0]) < 0.02) & (np.abs(faces.centres[:, 1]) < 0.03) & (faces.axes == 2)
    near &= faces.centres[:, 2] > centre + 0.8 * radius  # not what is extrapolated down to the area's bottom
    assert near.any()
    off = np.abs(np.hypot(faces.centres[near, 0], faces.centres[near, 2] - centre) - radius)
    assert off.mean() < faces.expected()[near].mean() + 0.5 * known.edge


def test_a_wall_below_its_lowest_contact_is_known_less_well_than_one_between_two():
    """An outline alone says more of the wall over it, up to the top, than of the wall under it."""
    known = table([(x, y) for x in np.arange(-0.03, 0.0301, 0.002) for y in np.arange(-0.03, 0.0301, 0.004)])
    for y in np.arange(-0.03, 0.0301, 0.002):
        known.touch(np.array([0.03, y, 0.023]), np.array([1.0, 0.0, 0.0]))
    known.update()
    faces = known.faces()
    wall = (faces.axes == 0) & (faces.centres[:, 0] > 0.025) & (np.abs(faces.centres[:, 1]) < 0.02)
    height = faces.centres[wall, 2] - 0.023
    above, below = (np.abs(height - away) < 0.6 * known.edge for away in (0.009, -0.009))
    assert above.any()
    assert below.any()
    assert faces.distances[wall][above].max() < 0.7 * faces.distances[wall][below].min()


def test_where_the_sphere_passed_nothing_is():
    without = table(line(0.0))
    known = table(line(0.0))
    for y in np.arange(-0.04, 0.0401, 0.003):
        known.passed(np.array([0.01, y, 0.02]))
    known.update()

    def beside(which):
        return int((which.faces().centres[:, 0] > 0.008).sum())

    assert beside(known) < beside(without)


@pytest.mark.parametrize(("above", "full"), [(0.007, False), (0.0095, True)])
def test_what_was_passed_takes_nothing_away_that_is_hardly_farther_from_a_contact(above, full):
    """Over a table, between two lines on it, 12 mm from both: its top goes on from one to the other."""
    known = SurfaceEstimate(AREA, 0.015)
    cell = np.floor((np.array([0.0, 0.0, TOP - 1e-4]) - known._origin) / known.edge).astype(int)
    place = known._origin + known.edge * cell
    for x, y in itertools.product((-0.012, 0.012), np.arange(-0.03, 0.0301, 0.002)):
        known.touch(np.array([place[0] + x, place[1] + y, TOP]), UP)
    known.passed(place + np.array([0.0, 0.0, above]))
    known.update()
    assert known._inside()[tuple(cell)] == full


def test_no_wall_goes_up_through_a_top_that_was_touched_beside_its_edge():
    """Over the ends of `combination` walls were expected up to the area's top, 27 mm over what was touched there."""
    known = SurfaceEstimate(Area(AREA.lower, np.array([0.06, 0.05, 0.08])), 0.015)
    for y in np.arange(-0.03, 0.0301, 0.002):
        for z in np.arange(0.01, 0.037, 0.002):
            known.touch(np.array([0.03, y, z]), np.array([1.0, 0.0, 0.0]))
        known.touch(np.array([0.02, y, TOP]), UP)
    known.update()
    assert known.footprint(TOP).any()
    assert not known.footprint(TOP + 0.015).any(), "the wall's contacts are the nearest up to 10 mm over its edge"


def naive_connected(inside, touched):
    """What is left of inside points (a, b, c): no point that outside ones do not come to, by whole steps from a side or
    from the top; and none that inside ones do not come to from a point that is `touched`."""

    def spread(begin, allowed):
        begin, seen = [place for place in begin if allowed[place]], np.zeros(allowed.shape, dtype=bool)
        while begin:
            place = begin.pop()
            if seen[place]:
                continue
            seen[place] = True
            for axis, step in itertools.product(range(3), (-1, 1)):
                other = tuple(place[a] + step * (a == axis) for a in range(3))
                if all(0 <= i < n for i, n in zip(other, allowed.shape)) and allowed[other]:
                    begin.append(other)
        return seen

    every, last = [tuple(place) for place in np.argwhere(np.ones(inside.shape))], np.array(inside.shape) - 1
    border = [p for p in every if p[0] in (0, last[0]) or p[1] in (0, last[1]) or p[2] == last[2]]
    filled = ~spread(border, ~inside)
    return spread([place for place in every if touched[place]], filled)


@pytest.mark.parametrize("seed", range(4))
def test_the_estimate_has_no_cavities_and_no_pieces_without_a_contact(seed):
    rng, known = np.random.default_rng(seed), SurfaceEstimate(AREA, 0.015)
    shape = known._touched.square.shape
    inside = rng.uniform(size=shape) < 0.6
    inside[5:25, 5:25, :12] = True
    inside[9:15, 9:15, 0:6] = False  # open below alone: the object goes on there
    inside[30:34, 6:10, 4:8] = True
    far = np.where(rng.uniform(size=shape) < 0.01, rng.uniform(0.0, 1.5, shape), 3.0) * known.edge
    known._touched.square = far**2
    found = known._connected(inside)
    np.testing.assert_array_equal(found, naive_connected(inside, far <= 2.0 * known.edge))
    assert found[9:15, 9:15, 0:6].all()
    assert (found & ~inside).any()
    assert (inside & ~found).any()


def test_the_tallest_place_near_others_is_that_of_a_full_search():
    estimate = SurfaceEstimate(AREA, 0.015)
    for x in np.arange(-0.03, 0.031, 0.002):
        for y in np.arange(-0.02, 0.021, 0.002):
            slope = np.array([-0.3, 0.1, 1.0])
            estimate.touch(np.array([x, y, 0.03 + 0.3 * x - 0.1 * y]), slope / np.linalg.norm(slope))
    estimate.update()
    inside, edge = estimate._inside(), estimate.edge
    places = np.random.default_rng(3).uniform(-0.05, 0.05, (40, 3))
    half = np.array([0.007, 0.012])
    cells = np.rint((places[:, :2] - estimate._origin[:2]) / edge).astype(int)
    reach = np.ceil(half / edge).astype(int)
    expected = []
    for i, j in cells:
        there = inside[max(i - reach[0], 0) : i + reach[0] + 1, max(j - reach[1], 0) : j + reach[1] + 1]
        levels = np.flatnonzero(there.any(axis=(0, 1)))
        expected.append(estimate._origin[2] + edge * levels[-1] if len(levels) else -np.inf)
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(estimate.tallest_beside(places, half), expected)


def test_only_new_contacts_are_gone_through(monkeypatch):
    rows = []

    def counted(square, owner, origin, edge, places, weights, first):
        rows.append(len(places))
        lower_to_nearest(square, owner, origin, edge, places, weights, first)

    known = table([(x, y) for x in np.linspace(-0.04, 0.04, 100) for y in np.arange(-0.04, 0.0401, 0.002)])
    monkeypatch.setattr(nearest_places, "lower_to_nearest", counted)
    for place in line(0.0101):
        known.touch(np.array([*place, TOP]), UP)
    known.update()
    known.update()
    assert len(known) > 4000
    assert rows == [len(line(0.0101)), len(line(0.0101)), 0], "by distance, by weighted distance, and of walls none"


def test_the_grid_keeps_its_size_in_a_large_area():
    large = SurfaceEstimate(Area(np.array([-0.2, -0.2, 0.0]), np.array([0.2, 0.2, 0.2])), 0.015)
    assert large.faces().reach == 0.015
    assert 0.4 * 0.4 * 0.2 / large.edge**3 == pytest.approx(MAX_POINTS)


@pytest.mark.parametrize("reach", [0.0, -0.01, np.nan, np.inf])
def test_a_bad_reach_is_refused(reach):
    with pytest.raises(InputError, match="reach"):
        SurfaceEstimate(AREA, reach)
