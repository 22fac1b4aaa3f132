"""The line scheduler alone, against contacts drawn by hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import LinkShape
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.gap_planner import LOWER, GapPlanner
from lwrprobe_strategies.planning.lean import UP, turned
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.outer_parts import outer_parts
from lwrprobe_strategies.planning.scheduler import FARTHER, LineScheduler
from strategy_task import AREA, DOWN, task

BORDER = float(AREA.upper[1])
NEAR, FAR = np.array([0.0, -BORDER, 0.0]), np.array([0.0, BORDER, 0.0])
RADIUS = 0.005


def grid_alone(first_line="border"):
    options = CoverageConfig(first_line=first_line, near_sides=False, across=False, find_ends=False)
    return LineScheduler(task(), ContactMemory(), options)


def touch_block(memory, xs, top=0.035, half=0.03, low=0.006):
    """Contacts of lines along y over a block, as the grid makes them: up the near side, over the top, down the far."""
    for x in xs:
        path = [(-half - RADIUS, z, -1.0, 0.0) for z in np.arange(low, top, 0.001)]
        path += [(y, top + RADIUS, 0.0, 1.0) for y in np.arange(-half, half + 1e-9, 0.001)]
        path += [(half + RADIUS, z, 1.0, 0.0) for z in np.arange(top, low, -0.001)]
        for y, z, ny, nz in path:
            centre, normal = np.array([x, y, z]), np.array([0.0, ny, nz])
            memory.add(centre, centre - RADIUS * normal, normal, x)


def drain(lines, here=FAR):
    driven = []
    while (line := lines.next(here)) is not None:
        driven.append(line)
    return driven


def test_the_grid_comes_first_and_each_line_from_the_border_that_is_nearer():
    lines = grid_alone()
    first = lines.next(NEAR)
    assert (first.begin, first.end) == (-BORDER, BORDER)
    rest = drain(lines)
    assert all(line.begin == BORDER for line in rest)
    assert [first.place, *(line.place for line in rest)] == list(lines.grid.x)
    done, known = lines.count()
    assert done == known == len(lines.grid)


def test_from_the_middle_one_side_is_done_before_the_other():
    places = [line.place for line in drain(grid_alone("middle"))]
    start = places.index(min(p for p in places if p >= 0.0))
    assert start == 0
    turn = next(i for i in range(1, len(places)) if places[i] < 0.0)
    assert all(p >= 0.0 for p in places[:turn])
    assert all(p < 0.0 for p in places[turn:])


def test_an_inserted_line_comes_next_and_is_none_of_the_grid():
    lines = grid_alone()
    first = lines.next(NEAR)
    up = Line(1, first.place, first.end, 0.0, 0.006)
    lines.insert(up)
    assert lines.next(NEAR) is up
    assert [line.place for line in drain(lines)] == list(lines.grid.x[1:])


def test_lower_lines_are_planned_again_until_what_they_have_shown_lets_none_go_lower():
    options = CoverageConfig(first_line="border", find_ends=False)
    lines = LineScheduler(task(), ContactMemory(), options, body=Body())
    heights = iter([0.03, 0.02, 0.01])

    def low_sides(axis, places):
        height = next(heights, None) if lines.count()[0] >= len(lines.grid) and axis == 1 else None
        return [] if height is None else [Line(1, 0.0, BORDER, 0.0, height, low=True)]

    lines._gaps._low_sides = low_sides
    low = [line.height for line in drain(lines) if line.low]
    assert low == [0.03, 0.02, 0.01]


def test_before_lines_that_lean_come_upright_ones_that_show_where_they_may_go_fast():
    options, leaning = CoverageConfig(first_line="border", find_ends=False), turned(UP, np.array([0.0, -1.0, 0.0]), 0.3)
    body = Body()
    body.lowest = lambda line, rotation: (np.array([line.begin, line.end]), np.zeros(2))
    body.fits_to, body.upright = lambda line: line.begin, DOWN
    lines = LineScheduler(task(), ContactMemory(), options, body=body)
    low = iter([[Line(1, 0.0, -BORDER, 0.0, 0.006, low=True, rotation=leaning @ DOWN)]])
    lines._gaps._low_sides = lambda axis, places: next(low, []) if axis == 1 else []
    found = [line for line in iter(lines._gaps.next_pass, None) if line]
    assert [(line.survey, line.rotation is None) for some in found for line in some] == [(True, True), (False, False)]


def test_lower_lines_that_always_show_a_little_more_come_to_an_end():
    options = CoverageConfig(first_line="border", find_ends=False)
    lines = LineScheduler(task(), ContactMemory(), options, body=Body())
    deeper = itertools.count()

    def low_sides(axis, places):
        tall = lines.count()[0] >= len(lines.grid) and axis == 1
        return [Line(1, 0.0, BORDER, 0.0, 0.03 - 1e-5 * next(deeper), low=True)] if tall else []

    lines._gaps._low_sides = low_sides
    assert len([line for line in drain(lines) if line.low]) <= 1 + 2 * LOWER


def test_a_side_that_a_low_line_did_not_touch_is_tried_again_half_way_up_until_that_is_near():
    """Beneath what overhangs it cannot be touched, and farther up it can."""
    lines, low = grid_alone(), Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.030)
    heights = []
    lines.give_up(low, touched=False)
    while (line := lines.next(NEAR)).low:
        heights.append(line.height)
        lines.give_up(line, touched=False)
    assert heights == pytest.approx([0.018, 0.024])
    for other, touched in ((low, True), (replace(low, low=False), False), (replace(low, ceiling=np.inf), False)):
        lines.give_up(other, touched)
        assert not lines.next(NEAR).low


def test_nothing_comes_in_the_place_of_a_line_that_shows_what_is_free():
    lines = grid_alone()
    survey = Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.030, survey=True)
    lines.give_up(survey, touched=False)
    assert not lines.next(NEAR).low
    beside = Line(1, 0.01, BORDER, 0.02, 0.006, low=True, ceiling=0.030)
    lines.give_up(beside, touched=False)
    assert lines.next(NEAR).height == pytest.approx(0.018), "nor does it say that the sides beside it recede"


@pytest.mark.parametrize(("place", "heights"), [(0.01, []), (-0.01, []), (0.02, [0.018, 0.024])])
def test_a_side_is_not_tried_higher_up_where_the_line_beside_touched_nothing_there(place, heights):
    lines, beside = grid_alone(), Line(1, 0.0, BORDER, 0.02, 0.018, low=True, ceiling=0.022)
    lines.give_up(beside, touched=False)
    line, found = Line(1, place, BORDER, 0.02, 0.006, low=True, ceiling=0.030), []
    lines.give_up(line, touched=False)
    while (line := lines.next(NEAR)).low:
        found.append(line.height)
        lines.give_up(line, touched=False)
    assert found == pytest.approx(heights)


@pytest.mark.parametrize(
    ("ahead", "up", "lost", "again"),
    [(-1.0, 0.0, False, True), (0.0, 1.0, False, False), (1.0, 0.0, False, False), (-1.0, 0.0, True, False)],
)
def test_a_line_of_the_grid_that_did_not_come_over_the_object_is_driven_from_its_other_end(ahead, up, lost, again):
    memory = ContactMemory()
    options = CoverageConfig(first_line="border", near_sides=False, across=False, find_ends=False)
    lines = LineScheduler(task(), memory, options)
    line = lines.next(NEAR)
    for y in (-0.030, -0.031):
        centre, normal = np.array([line.place, y, 0.01]), np.array([0.0, ahead, up])
        memory.add(centre, centre - RADIUS * normal, normal, line.place)
    lines.give_up(replace(line, height=0.02, raised=True), lost=lost)
    more = drain(lines)[len(lines.grid) - 1 :]
    assert [(last.begin, last.end) for last in more] == [(line.end, line.begin)] * again
    assert all((last.place, last.height, last.raised) == (line.place, line.height, False) for last in more)
    for last in more:
        lines.give_up(last)
    assert lines.next(FAR) is None, "once"


def test_a_line_that_came_to_its_end_without_a_contact_is_not_driven_again():
    lines = grid_alone()
    line = lines.next(NEAR)
    lines._memory.add(line.start, line.start + RADIUS * line.ahead, -line.ahead, line.place)
    lines._memory.passed(line.at(line.end), line.place)
    lines.give_up(line, touched=False)
    assert len(drain(lines)) == len(lines.grid) - 1


@pytest.mark.parametrize(("end", "again"), [(0.02, 1), (BORDER, 0)])
def test_beside_what_is_low_a_line_that_stopped_short_of_its_end_is_driven_from_there(end, again):
    """Over a step it came to a corner under what overhangs, where it was not given up for a wall that it met."""
    lines = grid_alone()
    line = lines.next(NEAR)
    for y in np.arange(-BORDER, end + 1e-9, 0.01) * np.sign(line.ahead[1]):
        lines._memory.passed(np.array([line.place, y, 0.01]), line.place)
    more = drain(lines)[len(lines.grid) - 1 :]
    assert [(last.begin, last.end, last.place) for last in more] == [(line.end, line.begin, line.place)] * again


@pytest.mark.parametrize(("expected", "heights"), [(0.022, [0.022]), (0.008, []), (0.028, [])])
def test_a_side_that_recedes_is_tried_again_once_from_as_low_as_it_is_expected(expected, heights):
    lines, found = grid_alone(), []
    line = Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.030, expected=expected)
    while line.low:
        lines.give_up(line, touched=False)
        line = lines.next(NEAR)
        found.append(line.height)
    assert found[:-1] == pytest.approx(heights)


def test_a_side_below_which_a_line_met_something_is_tried_again_from_half_of_the_way():
    lines, found = grid_alone(), []
    line = Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.034, expected=0.006)
    while line.low:
        lines.give_up(line, touched=False, met=True)
        line = lines.next(NEAR)
        found.append(line.height)
    assert found[:-1] == pytest.approx([0.020, 0.027])


@pytest.mark.parametrize("low", [0.006, 0.030])
def test_where_no_line_has_passed_beside_a_tall_object_one_comes_from_the_border_to_it(low):
    memory, xs = ContactMemory(), [-0.01, 0.0, 0.01]
    touch_block(memory, xs, top=0.05, low=low)
    memory.passed(np.array([0.0, BORDER, 0.03]), 0.0)
    memory.passed(np.array([0.01, BORDER, 0.05]), 0.01)  # as high as the object: that shows nothing
    args = memory.contacts(), memory.trail(), np.array([*xs, 0.05])
    pose = np.eye(4)
    pose[2, 3] = -0.075
    body = LinkShape("body", "cylinder", (0.01, 0.05), pose)
    lines = outer_parts(*args, task(links=(body,)), 0.03, 0.01)
    pose = pose.copy()
    pose[2, 3] = -0.045
    short = task(links=(replace(body, pose=pose),))
    assert outer_parts(*args, short, 0.03, 0.01) == [], "the body would meet the top"
    ends = [(line.place, line.begin, round(line.end, 6), line.height) for line in lines]
    near = [(x, -BORDER, -0.035, 0.03) for x in xs]
    far = [(x, BORDER, 0.035, 0.03) for x in xs if x != 0.0]
    assert ends == ([] if low == 0.006 else near + far), "a side that is touched down to its foot needs none"


def test_past_a_side_before_which_a_plate_was_touched_comes_a_line_although_the_side_is_touched_down_to_its_foot():
    memory, xs = ContactMemory(), [-0.01, 0.0, 0.01, 0.03]
    touch_block(memory, xs, top=0.05, low=0.006)
    pose = np.eye(4)
    pose[2, 3] = -0.075
    body = LinkShape("body", "cylinder", (0.01, 0.05), pose)

    def places():
        lines = outer_parts(memory.contacts(), memory.trail(), np.array(xs), task(links=(body,)), 0.03, 0.01)
        return [(line.place, line.begin) for line in lines]

    assert places() == []
    plate = np.array([0.0, 0.045, 0.013])
    memory.add(plate, plate - np.array([0.0, 0.0, 0.005]), np.array([0.0, 0.0, 1.0]), 0.0)
    # Beside the touch of the plate, and one line on: the body is wider than a line.
    assert places() == [(x, BORDER) for x in xs[:3]], "and none on the other side, nor far from it"


def test_a_body_wider_than_a_line_gets_the_line_beside_as_well_up_to_the_outline_there():
    memory = ContactMemory()
    touch_block(memory, [-0.02, -0.01, 0.0], top=0.04, low=0.030)  # a side that is left
    touch_block(memory, [0.02, 0.03], top=0.09, low=0.030, half=0.045)  # no upright body clears this one
    pose = np.eye(4)
    pose[2, 3] = -0.075
    body = LinkShape("body", "cylinder", (0.01, 0.05), pose)
    places = np.array([-0.02, -0.01, 0.0, 0.01, 0.02, 0.03])
    lines = outer_parts(memory.contacts(), memory.trail(), places, task(links=(body,)), 0.03, 0.01)
    ends = [(line.place, round(line.end, 6)) for line in lines if line.begin > 0.0]
    assert ends == [(-0.02, 0.035), (-0.01, 0.035), (0.0, 0.035), (0.01, 0.0425)], "and none two lines on"


def test_what_had_to_be_given_up_beside_is_not_tried_again():
    lines = grid_alone()
    down = Line(1, 0.0, 0.03, BORDER, 0.05, on_surface=True)
    lines.give_up(Line(1, 0.0, BORDER, 0.02, 0.006, fallback=down))
    assert lines.next(NEAR) is down
    assert lines.blocked_before(Line(1, 0.01, BORDER, 0.02, 0.006))
    assert not lines.blocked_before(Line(1, 0.02, BORDER, 0.02, 0.006)), "two lines on"
    assert not lines.blocked_before(Line(1, 0.01, -BORDER, -0.02, 0.006)), "the other side"
    assert not lines.blocked_before(Line(0, 0.01, BORDER, 0.02, 0.006)), "along the other axis"
    lines.leave_out(Line(1, 0.01, BORDER, 0.02, 0.006))
    assert lines.blocked_before(Line(1, 0.02, BORDER, 0.02, 0.006)), "nor beside one that was left out for it"


@pytest.mark.parametrize(("lowest", "foot"), [(0.013, 0.013), (0.047, None)])
def test_beside_a_wall_that_was_followed_down_a_line_begins_where_that_ended(lowest, foot):
    """The foot of a wall that overhangs is not reached from below; up it is three times as fast as down."""
    memory = ContactMemory()
    lines = LineScheduler(task(), memory, CoverageConfig(first_line="border"))
    drain(lines)
    along, top = (-1.0, 0.0, 0.0), 0.05
    ways = [Line(0, y, 0.05, 0.015, 0.006, fallback=Line(0, y, 0.02, 0.05, top, on_surface=True)) for y in (0.0, 0.01)]
    lines.give_up(ways[0])
    assert lines.next(NEAR) is ways[0].fallback
    for z in np.arange(top, lowest - 1e-9, -0.001):
        place = np.array([0.026, 0.0, z])
        memory.add(place, place + 0.005 * np.array(along), -np.array(along), np.nan)
    lines._coming.append(ways[1])
    beside = lines.next(NEAR)
    assert beside == (ways[1].fallback if foot is None else replace(ways[1], height=beside.height, foot_followed=True))
    assert foot is None or beside.height == pytest.approx(foot, abs=1e-6)
    assert lines.blocked_before(replace(ways[1], place=0.02)) == (foot is not None), "nor beside that one"


def test_a_wall_that_was_climbed_to_its_top_is_not_descended_as_well():
    """The line went on over the top and was given up there: the way down the same wall shows nothing new."""
    down = Line(0, 0.0, 0.03, -0.03, 0.03, on_surface=True)
    for height, instead in ((0.03, None), (0.022, None), (0.015, down)):
        memory = ContactMemory()
        memory.add(down.start, down.start - [0.0, 0.0, 0.005], np.array([0.0, 0.0, 1.0]), 0.03)  # by the grid
        lines = LineScheduler(task(), memory, CoverageConfig())
        lines.next(NEAR)
        line = Line(0, 0.0, -0.03, 0.03, 0.006, fallback=down)
        place = np.array([0.03, 0.0, height])
        memory.add(place, place - [0.005, 0.0, 0.0], np.array([1.0, 0.0, 0.0]), np.nan)
        lines.give_up(line)
        assert (lines.next(NEAR) is down) == (instead is down)
        assert lines.blocked_before(line) == (instead is down)


def test_a_line_beside_a_raised_one_is_raised_as_high():
    lines = grid_alone()
    lines.next(NEAR)
    across = Line(0, 0.0, -0.05, 0.05, 0.006)
    lines.raise_line(Line(0, 0.0, -0.05, 0.05, 0.011))
    assert lines.next(NEAR).height == 0.011
    lines.insert(Line(0, 0.01, -0.05, 0.05, 0.006))
    beside = lines.next(NEAR)
    assert (beside.height, beside.raised) == (0.011, True)
    lines.insert(Line(0, 0.03, -0.05, 0.05, 0.006))
    assert lines.next(NEAR).height == across.height, "three lines on nothing is known"


@pytest.mark.parametrize("across", [True, False])
def test_after_the_grid_the_faces_along_the_lines_are_crossed(across):
    memory = ContactMemory()
    options = CoverageConfig(first_line="border", low_lines=True, near_sides=False, across=across, find_ends=False)
    lines = LineScheduler(task(), memory, options)
    touched = [x for x in lines.grid.x if abs(x) <= 0.04]
    touch_block(memory, touched)
    after = [line for line in drain(lines) if line.axis == 0]
    assert bool(after) is across
    ends = {round(max(abs(line.begin), abs(line.end)), 6) for line in after}
    assert ends <= {round(max(touched) + 0.01, 6), round(-min(touched) + 0.01, 6)}
    assert all(abs(line.place) < 0.035 for line in after)


class Body:
    """Lets the body come as low as `needed` m, everywhere."""

    needed = 0.02

    def survey(self):
        """It is known already."""

    unknown = np.zeros((3, 3), dtype=bool)

    def squares(self, places):
        return np.zeros((len(places), 2), dtype=int)

    def lowest_at(self, line, rotation):
        return self.lowest(line, rotation)

    def lowest(self, line, rotation):
        places = np.linspace(line.begin, line.end, 5)
        return places, np.full(5, self.needed)


class Beside(Body):
    """Beside a wall that leans back: the body may come to a place y at heights above `needed(y)`."""

    def __init__(self, needed):
        self.needed = needed

    def lowest(self, line, rotation):
        places = np.linspace(line.begin, line.end, 4)
        return places, np.maximum.accumulate([self.needed(y) for y in places])


def test_where_the_body_stops_a_line_up_a_side_it_goes_on_higher_from_there():
    """It had begun again from half of the way up, and all below was left."""
    low, here = Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.040), np.array([0.0, 0.030, 0.006])
    options = CoverageConfig(near_sides=False, across=False, find_ends=False)

    def higher(body, line=low):
        lines = LineScheduler(task(), ContactMemory(), options, body)
        return lines.next(NEAR) if lines.go_on_higher(line, here, DOWN) else None

    line = higher(Beside(lambda y: 0.012 + 4.0 * (0.030 - y)))
    assert (line.begin, line.end, line.place) == (0.030, low.end, low.place)
    assert line.height == pytest.approx(0.012 + 4.0 * FARTHER)
    assert higher(Beside(lambda y: 0.0)).height > here[2] + 0.002, "it always gets on"
    assert higher(Beside(lambda y: 0.038)) is None, "next to nothing is left of the side"
    assert higher(Beside(lambda y: 0.0), replace(low, low=False)) is None
    assert higher(None) is None


@pytest.mark.parametrize(("then", "lines"), [(0.02, 0), (0.012, 2)])
def test_a_side_is_driven_again_where_the_body_may_come_lower_than_before(then, lines):
    memory, body = ContactMemory(), Body()
    options = CoverageConfig(first_line="border", across=True, find_ends=False)
    scheduler = LineScheduler(task(), memory, options, body, lambda away: [task().orientation])
    x = scheduler.grid.x[3]
    touch_block(memory, [x], low=0.03)  # the grid was driven as high as that
    sides = []
    while (line := scheduler.next(FAR)) is not None:
        if line.low and line.axis == 1 and line.expected is None:
            sides.append((line.place, line.begin, line.height))
            body.needed = then  # as what is driven since then shows
    assert len(sides) == 2 + lines
    first, again = sides[:2], sides[2:]
    assert {side[:2] for side in first} == {(x, -BORDER), (x, BORDER)}
    assert {side[:2] for side in again} <= {side[:2] for side in first}
    assert all(side[2] == pytest.approx(then, abs=0.0026) for side in again)


def test_a_side_up_which_a_line_was_given_up_is_not_driven_again_because_it_was_touched_lower_since_then():
    memory, body = ContactMemory(), Body()
    body.needed = float(task().area.lower[2])
    options = CoverageConfig(first_line="border", across=True, find_ends=False)
    scheduler = LineScheduler(task(), memory, options, body, lambda away: [task().orientation])
    x = scheduler.grid.x[3]
    touch_block(memory, [x], low=0.03)
    sides = []
    while (line := scheduler.next(FAR)) is not None:
        if line.low and line.axis == 1 and line.expected is None:
            sides.append(line)
            if len(sides) == 2:  # both were given up before they touched, and others touched in between
                touch_block(memory, [x], low=0.02)
    assert len(sides) == 2
    assert {side.height for side in sides} == {body.needed}


@pytest.mark.parametrize(("up", "between"), [(0.0, False), (1.0, True)])
def test_lines_on_the_floor_come_closer_where_the_first_ones_met_a_plate(up, between):
    memory, body = ContactMemory(), Body()
    body.needed = float(task().area.lower[2])
    options = CoverageConfig(first_line="border", across=False, find_ends=False)
    scheduler = LineScheduler(task(), memory, options, body, lambda away: [])
    touch_block(memory, [scheduler.grid.x[3]], low=0.03)
    places = []
    while (line := scheduler.next(FAR)) is not None:
        if line.expected is not None and not line.on_surface:
            if not places:
                point = np.array([line.place, -0.07, 0.005])
                normal = np.array([0.0, 1.0 - up, up])
                memory.add(point + RADIUS * normal, point, normal, line.place)
            places.append(line.place)
    apart = np.diff(np.unique(places))
    assert len(apart) > 0
    assert bool(apart.min() < 1.5 * options.step) is between


def test_a_line_that_no_path_has_reached_is_driven_once_more_and_after_the_others():
    memory = ContactMemory()
    xs = np.arange(-0.02, 0.0201, 0.01)
    touch_block(memory, xs)
    lines = LineScheduler(task(), memory, CoverageConfig(step=0.01, near_sides=False, find_ends=False))
    usual = drain(lines)
    lines = LineScheduler(task(), memory, CoverageConfig(step=0.01, near_sides=False, find_ends=False))
    grid = [lines.next(FAR) for _ in range(len(lines.grid))]
    first = lines.next(FAR)
    assert lines.postpone(first)
    rest = drain(lines)
    assert rest[-1] == first
    assert {(line.axis, line.place, line.begin) for line in [*grid, *rest]} == {
        (line.axis, line.place, line.begin) for line in usual
    }
    assert not lines.postpone(first), "once more, and not again"


def test_neighbours_end_with_a_side_of_the_grid():
    lines = grid_alone("middle")
    for _ in range(len(lines.grid)):
        lines.next(NEAR)
        pair = lines.neighbours()
        if pair is not None:
            assert (pair[1] - pair[0]) * lines.towards_next() > 0.0
    assert lines.neighbours() is None


def test_of_the_lines_that_come_the_nearest_is_driven_next():
    """In the order in which they were planned the probe would change sides over the top of the area with each line."""
    lines = grid_alone()
    drain(lines)
    sides = [Line(1, x, y, 0.0, 0.006) for x in (-0.01, 0.0, 0.01) for y in (-BORDER, BORDER)]
    lines._coming.extend(sides)
    here, driven = np.array([-0.02, -BORDER, 0.006]), []
    while (line := lines.next(here)) is not None:
        driven.append((line.place, line.begin))
        here = line.start
    assert driven == [(x, -BORDER) for x in (-0.01, 0.0, 0.01)] + [(x, BORDER) for x in (0.01, 0.0, -0.01)]


@pytest.mark.parametrize(
    ("expected", "other", "height"),
    [
        (0.022, {}, 0.022), (None, {}, 0.006), (0.022, {"height": 0.012}, 0.022), (0.022, {"height": 0.003}, 0.006),
        (0.022, {"place": 0.03}, 0.006), (0.022, {"begin": -BORDER}, 0.006),
    ],
)  # fmt: skip
def test_a_side_that_recedes_is_not_sought_at_the_foot_where_the_line_beside_met_nothing_there(expected, other, height):
    lines = grid_alone()
    drain(lines)
    beside = Line(1, 0.01, BORDER, 0.02, 0.006, low=True, ceiling=0.030, expected=0.022)
    lines.give_up(replace(beside, **other), touched=False)
    lines.insert(None)
    lines._coming.append(Line(1, 0.0, BORDER, 0.02, 0.006, low=True, ceiling=0.030, expected=expected))
    assert lines.next(FAR).height == pytest.approx(height)


def test_a_line_across_begins_as_high_as_the_grid_where_the_side_recedes_below():
    options = CoverageConfig(first_line="border", find_ends=False)

    def height(slope, top):
        memory = ContactMemory()
        gaps = GapPlanner(task(), memory, options, np.zeros(1), lambda line: 0.010, object(), lambda away: ())
        gaps.height = 0.030
        normal = np.array([-1.0, 0.0, slope]) / np.hypot(1.0, slope)
        for z in np.arange(0.030, top, 0.001):
            memory.add(centre := np.array([0.0, 0.0, z]), centre - RADIUS * normal, normal, 0.0)
        return gaps._lowest_before_receding(Line(0, 0.0, -0.01, 0.0, 0.006))

    assert height(-0.2, 0.06) == 0.030
    assert height(0.0, 0.06) == 0.010, "the foot of an upright wall is within reach"
    assert height(-0.2, 0.032) == 0.010, "a line so high would pass above it"


@pytest.mark.parametrize(
    ("touched", "facing", "body", "begins"),
    [
        (0.02, -1.0, object(), [BORDER]), (0.02, 1.0, object(), []), (-0.015, -1.0, object(), []),
        (-0.015, 1.0, None, [BORDER]),
    ],
)  # fmt: skip
def test_a_line_that_ends_in_a_hollow_comes_from_its_other_end_too(touched, facing, body, begins):
    """The far half of a mug had been left out: each line had come down its inner wall, and left it for the next one."""
    memory, options = ContactMemory(), CoverageConfig(first_line="border", find_ends=False, step=0.01)
    for y in np.arange(-BORDER, -0.0199, 0.001):
        memory.passed(np.array([0.0, y, 0.006]), 0.0)
    for y in np.arange(-BORDER, BORDER + 1e-9, 0.001):
        memory.passed(np.array([0.01, y, 0.006]), 0.01)
    place = np.array([0.01, touched, 0.02])
    memory.add(place, place, np.array([0.0, facing, 0.0]), 0.01)
    gaps = GapPlanner(task(), memory, options, np.array([0.0, 0.01]), lambda line: 0.006, body, lambda away: ())
    lines = gaps._from_the_other_end()
    assert [(line.place, line.begin) for line in lines] == [(0.0, begin) for begin in begins]
    assert not gaps._from_the_other_end(), "no line comes twice"


def test_what_the_lines_across_touched_shows_that_a_line_ended_in_a_hollow():
    """Half of the inner wall of a mug had been left out: only the lines across touched what faces the grid's there."""
    memory = ContactMemory()
    options = CoverageConfig(first_line="border", near_sides=False, low_lines=False, find_ends=False, step=0.01)
    for x, end in ((0.0, -0.02), (0.01, BORDER)):
        for y in np.arange(-BORDER, end + 1e-9, 0.001):
            memory.passed(np.array([x, y, 0.006]), x)
    gaps = GapPlanner(task(), memory, options, np.array([0.0, 0.01]), lambda line: 0.006, object(), lambda away: ())
    assert gaps.next_pass() == []
    assert gaps.next_pass() == [], "there is nothing to be crossed"
    place = np.array([0.01, 0.02, 0.02])
    memory.add(place, place, np.array([0.0, -1.0, 0.0]), np.nan)
    lines = gaps.next_pass()
    assert [(line.axis, line.place, line.begin) for line in lines] == [(1, 0.0, BORDER)]
    while lines is not None:
        lines = gaps.next_pass()
        assert not lines, "once"
