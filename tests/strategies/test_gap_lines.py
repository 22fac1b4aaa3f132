"""Lines across what the grid leaves out, and the search for the object's ends."""

import itertools

import numpy as np
import pytest
from naive_gap_lines import steep_between

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.gap_lines import _hollows, _places_across, lines_across, near_sides
from lwrprobe_strategies.planning.outlines import outlines

FLOOR, RADIUS = 0.006, 0.005
NONE = np.empty(0)


def contacts_on(height, xs, ys, facing=lambda x, y: np.array([0.0, 0.0, 1.0])):
    """Touches of a height field z(x, y) of the sphere's centre along grid lines; NaN where there is nothing."""
    touched = ContactMemory()
    for x in xs:
        for y in ys:
            z = height(x, y)
            if np.isfinite(z):
                normal = facing(x, y)
                centre = np.array([x, y, z])
                touched.add(centre, centre - RADIUS * normal, normal, x)
    return touched


def across(touched):
    return lines_across(touched.contacts(), touched.trail(), XS, 0.01, FLOOR, lambda line: 0.007)


def block(x, y):
    return 0.055 if abs(x) <= 0.05 and abs(y) <= 0.025 else np.nan


XS = np.arange(-0.08, 0.081, 0.01).round(9)
YS = np.arange(-0.03, 0.0301, 0.0005)


def test_both_ends_of_a_block_are_crossed_and_nothing_else():
    lines = across(contacts_on(block, XS, YS))
    assert len(lines) == 10
    assert {(min(line.begin, line.end), max(line.begin, line.end)) for line in lines} == {(-0.06, -0.05), (0.05, 0.06)}
    places = sorted({round(line.place, 6) for line in lines})
    assert places == pytest.approx([-0.02, -0.01, 0.0, 0.01, 0.02], abs=5e-4)
    for line in lines:
        assert (abs(line.begin), line.height, line.on_surface) == (0.06, 0.007, False), "up from the foot"
        down = line.fallback
        assert (down.begin, down.end, down.place) == (line.end, line.begin, line.place)
        assert (down.height, down.on_surface) == (0.055, True)
        assert not line.free_end


def test_a_line_across_begins_where_a_line_of_the_grid_has_passed():
    """Beside a given-up line nothing is known, and the body of the probe would have to stay away from there."""
    touched = contacts_on(block, XS, YS)
    for x in (-0.06, 0.06):  # given up at y = -0.005
        for y in YS[YS < -0.005]:
            touched.passed(np.array([x, y, FLOOR]), x)
    for x in (-0.07, 0.07, 0.08):
        for y in YS:
            touched.passed(np.array([x, y, FLOOR]), x)
    lines = across(touched)
    assert {(round(line.place, 3), abs(line.begin)) for line in lines} == {
        (-0.02, 0.06), (-0.01, 0.06), (0.0, 0.07), (0.01, 0.07), (0.02, 0.07),
    }  # fmt: skip
    assert all(abs(line.end) == 0.05 for line in lines)


def test_a_line_down_leads_on_past_where_the_sphere_went_by_below():
    """A flank that overhangs the neighbouring line was left where the line down ended on that."""
    touched = contacts_on(block, XS, YS)
    for line in lines_across(touched.contacts(), touched.trail(), XS, 0.01, FLOOR, lambda line: 0.007, RADIUS):
        down = line.fallback
        assert down.sign * (down.end - line.begin) == pytest.approx(RADIUS)
        assert down.begin == pytest.approx(line.end - line.sign * RADIUS)


def rolled(x, y, middle, edge, sign):
    """Height and normal of a sphere that rolls over a round edge about a middle; `sign` 1 for a bore, -1 for a boss."""
    out = np.array([x, y]) - middle
    rho = float(np.hypot(*out))
    inside = sign * (edge - rho)
    if inside >= RADIUS:
        return (0.03 if sign > 0.0 else np.nan), np.array([0.0, 0.0, 1.0])
    lean = max(inside, 0.0) / RADIUS
    across = -sign * lean * out / max(rho, 1e-9)
    return 0.05 + RADIUS * np.sqrt(1.0 - lean * lean), np.array([*across, np.sqrt(1.0 - lean * lean)])


@pytest.mark.parametrize("off", [-0.0015, 0.0, 0.0015])
def test_a_bore_between_two_lines_is_crossed(off):
    """A bore of 20 mm between lines 15 mm apart had been passed over."""
    xs, middle = np.arange(-0.045, 0.0451, 0.015).round(9), np.array([0.0075 + off, 0.004])

    def found(x, y):
        on = abs(x) <= 0.05 and abs(y) <= 0.025
        return rolled(x, y, middle, 0.01, 1.0) if on else (np.nan, None)

    touched = contacts_on(lambda x, y: found(x, y)[0], xs, YS, lambda x, y: found(x, y)[1])
    lines = lines_across(touched.contacts(), touched.trail(), xs, 0.015, FLOOR, lambda line: 0.007)
    over = [line for line in lines if {line.begin, line.end} == {0.0, 0.015}]
    assert len(over) >= 3
    assert all(line.on_surface for line in over)
    inside = [line.place - middle[1] for line in over if abs(line.place - middle[1]) < 0.005]
    assert min(inside) < -0.002, "its walls along y as well"
    assert max(inside) > 0.002


@pytest.mark.parametrize("size", [0.0092, 0.0095, 0.0105, 0.0125])
def test_lines_over_one_hollow_keep_a_distance(size):
    """Over a notch a few millimetres wide there were three lines from each side within 1 mm."""
    xs, middle = np.arange(-0.045, 0.0451, 0.015).round(9), np.array([0.0075, 0.004])

    def found(x, y):
        return rolled(x, y, middle, size, 1.0)

    touched = contacts_on(lambda x, y: found(x, y)[0], xs, YS, lambda x, y: found(x, y)[1])
    lines = lines_across(touched.contacts(), touched.trail(), xs, 0.015, FLOOR, lambda line: 0.007)
    over = sorted(line.place for line in lines)
    assert len(over) >= 1
    assert np.diff(over).min(initial=np.inf) >= 0.002 - 1e-9
    assert {line.begin for line in lines} | {line.end for line in lines} == {0.0, 0.015}


@pytest.mark.parametrize("off", [0.0, 0.002, 0.005, 0.0065])
def test_nothing_that_bulges_is_taken_for_a_hollow(off):
    xs, middle = np.arange(-0.045, 0.0451, 0.015).round(9) + off, np.zeros(2)
    touched = contacts_on(
        lambda x, y: rolled(x, y, middle, 0.03, -1.0)[0], xs, YS, lambda x, y: rolled(x, y, middle, 0.03, -1.0)[1]
    )
    assert list(_hollows(touched.contacts(), xs, 0.015, FLOOR)) == []


def test_a_line_across_that_ends_in_free_space_may_be_driven_from_there():
    def wall(x, y):
        return 0.055 if abs(x) <= 0.001 and abs(y) <= 0.025 else np.nan

    lines = across(contacts_on(wall, XS, YS))
    assert len(lines) == 5
    assert all(line.free_end and line.fallback is None and abs(line.begin) == 0.01 for line in lines)


def test_how_low_a_line_may_begin_is_asked_for_the_wall_it_meets_first():
    asked = []
    touched = contacts_on(block, XS, YS)
    lines_across(touched.contacts(), touched.trail(), XS, 0.004, FLOOR, lambda line: asked.append(line) or 0.007)
    assert asked
    assert all(abs(line.end - line.begin) <= 0.004 + 1e-12 for line in asked)


def test_a_groove_is_crossed_at_once():
    def bridge(x, y):
        if not np.isfinite(block(x, y)):
            return np.nan
        return 0.05 - np.sqrt(0.019**2 - x * x) if abs(x) < 0.019 else 0.055

    lines = across(contacts_on(bridge, XS, YS))
    groove = [line for line in lines if max(abs(line.begin), abs(line.end)) < 0.04]
    assert len(groove) == 5
    assert all(line.on_surface and {round(line.begin, 3), round(line.end, 3)} == {-0.02, 0.02} for line in groove)


def test_two_things_apart_are_crossed_apart():
    def two(x, y):
        return 0.055 if 0.02 <= abs(x) <= 0.05 and abs(y) <= 0.025 else np.nan

    lines = across(contacts_on(two, XS, YS))
    assert all(abs(line.begin - line.end) == pytest.approx(0.01) for line in lines)
    assert len(lines) == 20


@pytest.mark.parametrize("seed", range(5))
def test_every_steep_place_is_crossed_and_every_crossing_meets_one(seed):
    random = np.random.default_rng(seed)
    knots = random.uniform(FLOOR, 0.05, len(XS))
    knots[random.random(len(XS)) < 0.3] = np.nan
    touched = contacts_on(lambda x, y: knots[np.argmin(abs(XS - x))], XS, YS[::3])
    table, lines = touched.contacts(), across(touched)
    for y in sorted({line.place for line in lines}):
        own = [line for line in lines if line.place == y]
        for x_a, x_b in itertools.pairwise(XS):
            inside = [min(o.begin, o.end) <= x_a + 1e-9 and x_b <= max(o.begin, o.end) + 1e-9 for o in own]
            if steep_between(table, x_a, x_b, y, 0.01, FLOOR):
                assert sum(inside) == 1
        for line in own:
            low, high = min(line.begin, line.end), max(line.begin, line.end)
            pairs = [(a, b) for a, b in itertools.pairwise(XS) if low - 1e-9 <= a and b <= high + 1e-9]
            assert any(steep_between(table, a, b, y, 0.01, FLOOR) for a, b in pairs)


def test_nothing_touched_needs_no_line():
    assert across(ContactMemory()) == []
    assert outlines(np.empty((0, 10)), XS, 0.007) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_end_beside_the_outermost_touch_is_sought_on_the_side_it_lies(sign):
    angle = 0.3  # the outermost touch lies beside the end of an upright cylinder, in +y
    normal = np.array([sign * np.cos(angle), np.sin(angle), 0.0])
    point = 0.024 * normal + [0.0, 0.0, 0.01]
    touched = ContactMemory()
    touched.add(point + RADIUS * normal, point, normal, np.nan)
    (line,) = outlines(touched.contacts(), XS, 0.007)
    assert line.axis == 0
    assert line.outline == -1, "towards lower y, where the normal turns along x"
    assert line.sign == -sign
    assert sign * line.begin > sign * line.end
    assert line.place == pytest.approx(point[1] + RADIUS * normal[1])
    assert line.height == pytest.approx(point[2])
    assert sign * line.end < sign * (point[0] + RADIUS * normal[0]) - 0.001, "a touch is not known to a tenth of that"


def test_an_end_is_sought_on_the_wall_and_not_on_the_edge_above_it():
    out = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    touched = ContactMemory()
    for height, up in ((0.02, 0.0), (0.03, 0.0), (0.05, 0.6)):
        normal = np.sqrt(1.0 - up * up) * out + [0.0, 0.0, up]
        point = 0.024 * out + [0.0, 0.0, height]
        touched.add(point + RADIUS * normal, point + np.array([1e-5 * up, 0.0, 0.0]), normal, np.nan)
    (line,) = outlines(touched.contacts(), XS, 0.007)
    assert line.height < 0.04


def test_a_flat_end_is_found_already():
    normal = np.array([1.0, 0.01, 0.0]) / np.hypot(1.0, 0.01)
    touched = ContactMemory()
    touched.add(np.array([0.055, 0.0, 0.02]), np.array([0.05, 0.0, 0.02]), normal, np.nan)
    assert outlines(touched.contacts(), XS, 0.007) == []


def test_a_descent_is_known_to_be_free_as_far_as_the_probe_has_stood():
    touched = contacts_on(block, XS, YS)
    for y in YS:
        touched.passed(np.array([0.05, y, 0.0575]), 0.05)
    ends = [line.fallback for line in across(touched) if line.end == 0.05]
    assert ends
    assert all(line.height == 0.055 and line.free_to == 0.0575 for line in ends)


def test_near_touches_are_remembered_once():
    touched = ContactMemory()
    up = np.array([0.0, 0.0, 1.0])
    for k in range(11):
        touched.add(np.array([0.0, 1e-4 * k, 0.05]), np.array([0.0, 1e-4 * k, 0.045]), up, 0.0)
    assert len(touched) == 3


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_a_near_side_that_was_met_above_its_foot_is_felt_from_as_low_as_it_may_be(travel):
    touched = ContactMemory()
    wall, up = np.array([0.0, -travel, 0.0]), np.array([0.0, 0.0, 1.0])
    for z in np.arange(0.03, 0.05, 0.001):
        centre = np.array([0.0, -0.03 * travel, z])
        touched.add(centre, centre - RADIUS * wall, wall, 0.0)
    for y in np.arange(-0.025, 0.0251, 0.001) * travel:
        centre = np.array([0.0, y, 0.055])
        touched.add(centre, centre - RADIUS * up, up, 0.0)
    area = Area(np.array([-0.08, -0.06, FLOOR]), np.array([0.08, 0.06, 0.06]))
    assert near_sides(touched.contacts(), touched.trail(), area, 0.01, lambda line: 0.008, NONE) == [], (
        "the far side went no lower"
    )
    raised = np.array([0.0])
    (down,) = near_sides(touched.contacts(), touched.trail(), area, 0.01, lambda line: 0.008, raised)
    assert (down.on_surface, down.begin, down.end) == (True, pytest.approx(-0.025 * travel), -0.06 * travel), (
        "above what the stick has met the wall is descended"
    )
    for z in np.arange(0.05, FLOOR, -0.001):
        centre = np.array([0.0, 0.03 * travel, z])
        touched.add(centre, centre + RADIUS * wall, -wall, 0.0)
    (line,) = near_sides(touched.contacts(), touched.trail(), area, 0.01, lambda line: 0.008, NONE)
    assert (line.axis, line.place, line.height, line.on_surface) == (1, 0.0, 0.008, False)
    assert line.begin == pytest.approx(-0.06 * travel)
    assert line.end == pytest.approx(-0.025 * travel)
    down = line.fallback
    assert (down.begin, down.end, down.height, down.on_surface) == (line.end, line.begin, 0.055, True)


def test_the_table_grows_and_what_was_asked_for_before_stays():
    touched, normal = ContactMemory(), np.array([0.0, 0.0, 1.0])
    assert touched.contacts().shape == touched.trail().shape == (0, 10)
    seen = []
    for k in range(5):
        centre = np.array([0.001 * k, 0.0, 0.05])
        touched.add(centre, centre - RADIUS * normal, normal, 0.0)
        touched.passed(centre + np.array([0.0, 0.001, 0.0]), 0.0)
        seen.append((touched.contacts(), touched.trail()))
    for k, (table, way) in enumerate(seen):
        assert (len(table), len(way)) == (k + 1, 2 * k + 2)
        np.testing.assert_array_equal(table[:, 0], 0.001 * np.arange(k + 1))
        np.testing.assert_array_equal(way, touched.trail()[: len(way)])


def test_a_contact_at_the_end_of_a_trail_has_its_place_in_it():
    """The tip had stood half a millimetre from it when it touched: the strategy had failed for a place without any."""
    touched, up = contacts_on(lambda x, y: 0.055, [0.0], np.arange(0.0, 0.0201, 0.0005)), np.array([0.0, -1.0, 0.0])
    for place in _places_across(touched.contacts(), 0.01)[:1]:
        for y in (*(place - 0.0022 - 0.0006 * np.arange(40)[::-1]), place - 0.00165):
            touched.passed(np.array([0.01, y, 0.03]), 0.01)
        centre = np.array([0.01, place - 0.0014, 0.03])
        touched.add(centre, centre - RADIUS * up, up, 0.01)
    lines = lines_across(
        touched.contacts(), touched.trail(), np.array([0.0, 0.01]), 0.01, FLOOR, lambda line: FLOOR, RADIUS
    )
    assert lines
