"""Which strokes are considered, and which one is driven next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.mapping.estimate import SurfaceEstimate
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.free_space import FreeSpace
from lwrprobe_strategies.planning.lines import Grid, X, Y, Z
from lwrprobe_strategies.planning.outline_watch import OutlineWatch
from lwrprobe_strategies.planning.paths import Speeds
from lwrprobe_strategies.planning.stroke_profile import StrokeProfile
from lwrprobe_strategies.planning.stroke_scheduler import LITTLE_PATIENCE, MANY, PATIENCE, SHORTLIST, StrokeScheduler
from lwrprobe_strategies.planning.strokes import SHORTEST, StrokePlanner
from strategy_task import AREA, DOWN, task

LINKS = load_scene("block").probe.as_probe().links
UP = np.array([0.0, 0.0, 1.0])
LOW, TOP = 0.006, 0.045
HALF = 0.04, 0.03
"""m, half lengths of a block along x and y, for the sphere's centre."""


def outlined(height=0.02):
    """An estimate that knows a block's outline."""
    known = SurfaceEstimate(AREA, 0.015)
    for axis in (X, Y):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = sign
            for along in np.arange(-HALF[1 - axis], HALF[1 - axis] + 1e-9, 0.002):
                place = np.array([along, along, height])
                place[axis] = sign * HALF[axis]
                known.touch(place, normal)
    known.update()
    return known


def over_top(known, x):
    for y in np.arange(-HALF[1], HALF[1] + 1e-9, 0.002):
        known.touch(np.array([x, y, TOP]), UP)
    known.update()


def beneath(above):
    """m/s: the nearer to the sensor, the slower."""
    return 0.02 * (1.0 - above / 0.05)


def strokes(known, here=(0.0, 0.0, TOP), normal=None):
    planner = StrokePlanner(task(), known.edge, 0.007, 0.025, beneath)
    faces = known.faces()
    return planner.strokes(faces, planner.success(faces), LOW, np.array(here), normal)


def scheduler(known, aim=2e-4, body=None, passed=True):
    """Of an area in which the probe has `passed` everywhere beside the object."""
    speeds = Speeds(0.2, 0.01, lambda along: 0.02)
    free = FreeSpace(AREA)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, (0.0, -0.1, AREA.upper[Z])
    free.note(pose, None)
    wanted = task(links=LINKS) if body is not None else task()
    memory = ContactMemory()
    if passed:
        for x in np.arange(AREA.lower[X], AREA.upper[X], 0.02):
            for y in np.arange(AREA.lower[Y], AREA.upper[Y], 0.02):
                memory.passed(np.array([x, y, LOW]), np.nan)
    return StrokeScheduler(wanted, memory, 0.015, known, free, speeds, 0.007, beneath, aim, body)


def test_every_stroke_stays_in_the_area_and_is_long():
    for stroke in strokes(outlined()):
        line = stroke.line
        low, high = AREA.lower[line.axis], AREA.upper[line.axis]
        assert low <= line.begin <= high
        assert low <= line.end <= high
        assert abs(line.end - line.begin) >= SHORTEST
        assert stroke.gain > 0.0
        assert stroke.seconds > 0.0


def test_the_unknown_top_comes_before_the_known_walls():
    best = max(strokes(outlined()), key=lambda stroke: stroke.score)
    assert best.line.outline == 0
    assert best.line.on_surface


def test_an_outline_far_below_what_was_touched_takes_as_long_as_the_stick_needs():
    alone, under = outlined(), outlined()
    over_top(under, 0.0)
    free, slow = (
        min((s for s in strokes(known) if s.line.outline), key=lambda s: s.line.height) for known in (alone, under)
    )
    assert free.line.height == slow.line.height
    assert slow.seconds > 2.0 * free.seconds


def test_a_stroke_is_worth_less_where_others_agreed():
    known = outlined()

    def gain(x):
        near = [s for s in strokes(known) if s.line.axis == Y and s.line.on_surface and abs(s.line.place - x) < 0.004]
        return max(stroke.gain for stroke in near)

    before = gain(0.006)
    over_top(known, 0.0)
    over_top(known, 0.012)
    assert gain(0.006) < 0.1 * before


def test_in_contact_a_stroke_may_begin_where_the_tip_is():
    known = outlined()
    wall = strokes(known, (0.0, -HALF[1], 0.02), np.array([0.0, -1.0, 0.0]))
    chained = [stroke for stroke in wall if stroke.chained]
    assert chained
    assert all((s.line.axis, s.line.sign, s.line.begin) == (Y, 1.0, -HALF[1]) for s in chained)
    assert not any(stroke.chained for stroke in strokes(known))


def test_no_stroke_is_driven_twice():
    known = outlined()
    planner = StrokePlanner(task(), known.edge, 0.007, 0.025, beneath)
    seen = set()
    for _ in range(12):
        faces = known.faces()
        found = planner.strokes(faces, planner.success(faces), LOW, np.zeros(3), None)
        best = max(found, key=lambda stroke: stroke.score)
        assert best.line not in seen
        seen.add(best.line)
        planner.driven(known.faces(), best)  # and nothing was touched


def test_the_object_is_sought_from_the_middle_of_the_top_outwards_and_then_from_the_side():
    lines, here = scheduler(SurfaceEstimate(AREA, 0.015)), np.array([0.0, -0.1, 0.06])
    middle = 0.5 * (AREA.lower + AREA.upper)
    driven = [lines.next(here) for _ in range(4)]
    assert all(line.on_surface and line.start[:2] == pytest.approx(middle[:2]) for line in driven)
    assert {(line.axis, line.sign) for line in driven} == {(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)}
    line = lines.next(here)
    assert (line.axis, line.place, line.outline) == (Y, 0.0, 1)


def test_the_top_inside_an_outline_is_as_unknown_as_it_is_far_from_what_looks_up():
    """Contacts of the walls just under its edge say nothing of how high it is, or how it leans."""
    known = outlined(TOP - 0.006)

    def expected(x):
        faces = known.faces()
        top = (faces.axes == Z) & (np.abs(faces.centres[:, :Z] - [x, 0.0]).max(axis=1) < 0.004)
        return float(faces.expected()[top].mean())

    over_top(known, 0.0)
    near, far = expected(0.0), expected(HALF[0] - 0.006)
    assert far > 0.25 * (HALF[0] - 0.015 - 0.006) > 10.0 * near


def test_a_line_over_the_top_tells_little_of_a_wall_below_it():
    """Lines along an edge were worth as much as if they touched the whole wall under it."""
    known = outlined(TOP - 0.006)
    over_top(known, 0.0)
    place = HALF[0] - 0.006
    profile = StrokePlanner(task(), known.edge, 0.007, 0.025, beneath)._profile
    faces = known.faces()
    low = (faces.axes == X) & (faces.centres[:, Z] < TOP - 0.03)
    assert low.any()
    assert profile(faces, np.where(low, faces.expected(), 0.0), Y, place).removed.sum() == 0.0


def test_a_stroke_through_a_hole_takes_the_time_of_its_descent():
    """Descents into a hole had counted as nothing, and one of 50 mm took 11 s."""
    above, low = np.arange(-0.03, 0.0301, 0.003), np.arange(0.015, 0.0451, 0.003)
    hole = StrokeProfile(
        along=np.concatenate([above, np.full(11, -0.0085), np.full(11, 0.0085)]),
        removed=np.ones(len(above) + 22),
        wall=np.concatenate([np.zeros(len(above), np.int64), np.full(11, 1), np.full(11, -1)]),
        path_along=np.concatenate([above, np.full(11, -0.0085), np.full(11, 0.0085)]),
        lengths=np.full(len(above) + 22, 0.003),
        path_wall=np.concatenate([np.zeros(len(above), np.int64), np.full(11, 1), np.full(11, -1)]),
    )
    for begin, end in ((-0.02, 0.02), (0.02, -0.02)):
        gain, onward, down = hole.between(begin, end)
        passed = np.abs(above) <= 0.02
        assert gain == np.count_nonzero(passed) + 2 * len(low)
        assert onward == pytest.approx(0.003 * (np.count_nonzero(passed) + len(low)))
        assert down == pytest.approx(0.003 * len(low))
    assert hole.between(0.0, 0.02)[2] == 0.0, "out of the hole it only climbs"
    assert hole.beyond(0.02, 1) == (0.0, 0.0), "a hole's walls are no sides of the object"
    assert hole.beyond(-0.02, 1) == pytest.approx((len(low), 0.003 * len(low)))


def test_it_ends_when_the_expected_error_is_as_small_as_wanted():
    known = outlined()
    assert scheduler(known, aim=0.01).next(np.array([0.0, -0.1, 0.06])) is None
    assert scheduler(known, aim=1e-4).next(np.array([0.0, -0.1, 0.06])) is not None


def test_few_contacts_are_followed_by_lines_over_the_top_from_its_middle():
    """Three contacts under the lower side of a leaning wall were taken for all of an object 0.25 m long."""
    known, here = SurfaceEstimate(AREA, 0.015), np.array([0.0, -0.04, 0.02])
    for x in (-0.001, 0.001, 0.003):
        known.touch(np.array([x, -0.04, 0.02]), np.array([0.0, -0.9, -0.4]))
    lines = scheduler(known)
    driven = [lines.next(here) for _ in range(4)]
    middle = 0.5 * (AREA.lower + AREA.upper)
    assert all(line.on_surface and line.start[:2] == pytest.approx(middle[:2]) for line in driven)
    assert {(line.axis, line.sign) for line in driven} == {(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)}
    after = lines.next(here)
    assert after.outline or after.on_surface


@pytest.mark.slow
def test_it_ends_when_strokes_teach_nothing_any_more():
    """The contacts stay the same: as if each stroke had gone over what none can reach."""
    known, here, spent = outlined(), np.array([0.0, -0.1, TOP]), 0.0
    lines, best = scheduler(known), []
    chosen = lines._best
    lines._best = lambda faces, here: best.append(chosen(faces, here)) or best[-1]
    while lines.next(here) is not None:
        spent += best[-1].seconds
        assert spent < 2.0 * PATIENCE + 100.0
    assert spent >= PATIENCE


def test_a_surface_that_is_found_anew_is_no_reason_to_end():
    known = outlined()
    lines, here = scheduler(known, aim=1e-6), np.array([0.0, -0.1, TOP])
    mean = known.faces().error()[0]
    lines._means, lines._spent = [(0.0, 0.5 * mean), (0.7 * PATIENCE, 1.3 * mean)], 1.5 * PATIENCE
    assert lines.next(here) is not None  # less than in between, and more than at the beginning
    lines._means, lines._spent = [(0.0, 1.3 * mean), (1.0, mean)], 1.5 * PATIENCE
    assert lines.next(here) is None
    lines._means, lines._spent = [(0.0, 2.0 * mean), (0.6 * PATIENCE, 0.6 * mean)], 1.5 * PATIENCE
    assert lines.next(here) is not None  # there is more of it now than there was
    lines._means, lines._spent = [(0.0, mean), (0.7 * PATIENCE, 1.4 * mean)], 1.5 * PATIENCE
    assert lines.next(here) is None  # a little more and as little as before: nothing was found


def test_what_lies_lower_than_the_upright_probe_can_be_held_does_not_count():
    known = outlined(0.04)
    for x in (-0.03, -0.015, 0.0, 0.015, 0.03):
        over_top(known, x)
    aim, here = 0.8 * known.faces().error()[0], np.array([0.0, -0.1, TOP])
    lines = scheduler(known, aim)
    assert lines.next(here) is not None
    lines = scheduler(known, aim)
    lines.height = 0.035
    assert lines.next(here) is None


def test_error_that_strokes_were_to_remove_and_did_not_is_no_reason_to_go_on():
    known, here = outlined(), np.array([0.0, -0.1, TOP])
    faces = known.faces()
    lines = scheduler(known, aim=0.5 * faces.error()[0])
    while (stroke := lines._best(faces, here)) is not None:
        lines._planner.driven(faces, stroke)
    assert faces.error(lines._planner.success(faces))[0] < 0.5 * faces.error()[0]


def tall_scheduler(known, aim):
    """Over an object that goes on below the lowest height of a stroke."""
    lines = scheduler(known, aim, BodySpace(task(links=LINKS), 0.015))
    lines.height = lines._gaps.height = 0.5 * (LOW + TOP)
    return lines


def test_lines_of_the_grid_come_when_strokes_remove_little_and_the_object_goes_on_below_them():
    known = outlined(height=0.03)
    over_top(known, 0.0)
    here = np.array([0.0, -0.1, 0.06])
    error = known.faces().above(0.5 * (LOW + TOP)).error()[0]
    assert tall_scheduler(known, 0.01 * error).next(here).axis in (X, Y)
    early, late = tall_scheduler(known, 0.01 * error), tall_scheduler(known, 0.5 * error)
    early.next(here)
    line = late.next(here)
    assert (early._number, late._number) == (-1, 0)
    assert line.place == late.grid.x[0]


@pytest.mark.parametrize(("share", "lines_first"), [(0.25, True), (1.1, False)])
def test_lines_of_the_grid_come_when_they_remove_more_per_second_than_a_stroke(monkeypatch, share, lines_first):
    """Compared by the error that is left alone, 23 lines over `combination` had come before strokes worth more."""
    known, here = outlined(height=0.03), np.array([0.0, -0.1, 0.06])
    whole, lines = known.faces(), tall_scheduler(known, 1e-6)
    worth = float((whole.expected() * whole.areas).sum())
    stroke = lines._best(whole.above(lines.height), here)
    seconds = share * worth / stroke.score
    monkeypatch.setattr(StrokeScheduler, "_seconds_of_grid", lambda self, area: seconds)
    lines.next(here)
    assert lines.grid_now == lines_first


def test_the_lines_of_the_grid_take_longer_over_more_lines_and_over_more_surface_below_them():
    lines = tall_scheduler(outlined(height=0.03), 1e-6)
    time = lines._seconds_of_grid(0.0)
    assert lines._seconds_of_grid(0.01) - time == pytest.approx(0.01 / (0.015 * lines._task.contour_speed))
    lines.grid = Grid(np.tile(lines.grid.x, 2), 2 * len(lines.grid))
    assert lines._seconds_of_grid(0.0) == pytest.approx(2.0 * time)


def test_lines_of_the_grid_come_in_the_end_where_another_part_may_stand_that_was_not_seen():
    known, here = outlined(), np.array([0.0, -0.1, 0.06])
    over_top(known, 0.0)
    aim = 2.0 * known.faces().above(scheduler(known).height).error()[0]
    assert scheduler(known, aim).next(here) is None  # all was seen
    assert scheduler(known, aim, passed=False).next(here).free_end
    early = scheduler(known, 0.1 * aim, passed=False)
    early.next(here)
    assert early._number == -1
    lines = scheduler(known, aim, passed=False)
    driven = 0
    while (line := lines.next(here)) is not None:
        driven += 1
        for along in np.arange(AREA.lower[Y], AREA.upper[Y], 0.01):
            lines._memory.passed(np.array([line.place, along, LOW]), line.place)
    assert 1 < driven <= len(lines.grid)


@pytest.mark.parametrize("wide", [0.2, 0.31, 0.433])
def test_a_large_object_is_crossed_from_its_middle_outwards_first_and_in_between_later(wide):
    """In the order of the grid, 8 strokes over random:hull:2:250 had left 6.3 mm of error: all were on one side."""
    grid = Grid.over(Area(np.array([-0.5 * wide, -0.1, LOW]), np.array([0.5 * wide, 0.1, 0.1])), 0.015, 0.0, 0.005)
    x, places = grid.coarse_to_fine().x, np.sort(grid.x)
    assert np.array_equal(np.sort(x), places)
    assert x[0] == places[len(grid) // 2]
    for lines in range(1, len(grid) // 4):
        assert np.ptp(x[:lines]) <= 4.0 * 0.015 * lines
    assert np.diff(np.sort(x[: len(grid) // 4])).max() < 4.5 * 0.015
    assert np.diff(np.sort(x[: len(grid) // 2])).max() < 2.5 * 0.015


@pytest.mark.parametrize("wide", [0.1, 0.4])
def test_the_lines_of_a_wide_area_are_driven_from_coarse_to_fine_and_few_as_they_lie(wide):
    area = Area(np.array([-0.5 * wide, -0.1, LOW]), np.array([0.5 * wide, 0.1, 0.1]))
    given = replace(task(), area=area, start=np.array([0.0, -0.1, 0.1]))
    free, estimate = FreeSpace(area, 0.02), SurfaceEstimate(area, 0.015)
    lines = StrokeScheduler(
        given, ContactMemory(), 0.015, estimate, free, Speeds(0.2, 0.02, lambda _: 0.02), 0.006, lambda _: 0.02, 2e-4
    )
    plain = Grid.over(area, 0.015, 0.0, given.probe.radius)
    many = len(plain) >= MANY
    assert many == (wide == 0.4)
    assert np.array_equal(lines.grid.x, plain.coarse_to_fine().x if many else plain.x)


def test_lines_of_the_grid_come_when_strokes_make_no_progress():
    known, here = outlined(height=0.03), np.array([0.0, -0.1, 0.06])
    over_top(known, 0.0)
    lines = tall_scheduler(known, 1e-5)
    for _ in range(40):
        lines.next(here)  # which brings nothing, since nothing is added to the estimate
        if lines.grid_now:
            break
    assert LITTLE_PATIENCE <= lines._spent < LITTLE_PATIENCE + 40.0


def test_after_the_lines_of_the_grid_strokes_without_progress_end_soon():
    """On combination 140 s of strokes had followed, none of which touched anything new."""
    known, here = outlined(height=0.03), np.array([0.0, -0.1, 0.06])
    over_top(known, 0.0)
    spent = []
    for grid_left in (True, False):
        lines = scheduler(known, 1e-5)
        lines._grid_left = grid_left
        while lines._grid_left == grid_left and lines.next(here) is not None:
            pass
        spent.append(lines._spent)
    assert LITTLE_PATIENCE <= spent[1] < 0.6 * spent[0]


def test_a_line_of_the_grid_leads_to_what_it_meets_where_the_surface_above_is_known():
    """And then one comes from the other end; a line that met nothing is driven once."""
    known = outlined(height=0.03)
    for x in np.arange(-HALF[0], HALF[0] + 1e-9, 0.004):
        over_top(known, x)
    lines, here = tall_scheduler(known, 0.02), np.array([0.0, -0.1, 0.06])
    driven = []
    for _ in range(2 * len(lines.grid)):
        line = lines.next(here)
        if line is None or not line.free_end:  # one of the next pass
            break
        driven.append(line)
        lines._memory.passed(line.start, line.grid_x)
        if abs(line.place) < HALF[0]:
            wall = line.at(-line.sign * HALF[1])
            lines._memory.add(wall, wall, -line.ahead, line.grid_x)
        else:
            lines._memory.passed(line.at(line.end), line.grid_x)
    over = [line for line in driven if abs(line.place) < HALF[0]]
    assert all(line.ceiling == pytest.approx(line.height + 0.001) for line in over)
    assert len({line.place for line in driven}) == len(lines.grid)
    for line in over:
        assert sorted(other.sign for other in over if other.place == line.place) == [-1.0, 1.0]
    assert len(driven) == len(lines.grid) + len(over) // 2


def test_lines_of_the_grid_lead_over_the_object_where_its_top_is_not_known():
    known = outlined(height=0.03)
    lines, here = tall_scheduler(known, 0.0005), np.array([0.0, -0.1, 0.06])
    lines.grid_now = True
    line = lines.next(here)
    assert abs(line.place) < HALF[0]
    assert line.ceiling == np.inf


def test_a_contact_beside_the_border_gives_no_surface_and_lines_go_on():
    """The run had ended as done, without a contact."""
    known = SurfaceEstimate(AREA, 0.015)
    known.touch(AREA.lower + np.array([0.001, 0.001, 0.0]), np.array([0.0, -1.0, 0.0]))
    lines = scheduler(known)
    assert lines.next(np.array([0.0, -0.1, TOP])) is not None
    assert not len(known.faces().areas)


def test_on_a_larger_surface_strokes_may_teach_little_for_longer():
    known = outlined()
    over_top(known, 0.0)
    lines, faces = scheduler(known, aim=1e-6), known.faces()
    assert lines.patience(replace(faces, areas=0.5 * faces.areas)) == PATIENCE
    larger = replace(faces, areas=25.0 * faces.areas)
    swept = 2.0 * faces.reach * task().contour_speed
    assert lines.patience(larger) == pytest.approx(2.0 * larger.areas.sum() / swept)
    assert lines.patience(larger) > 4.0 * PATIENCE


def test_ways_are_planned_for_the_best_strokes_alone(monkeypatch):
    """At 10 000 contacts: what a choice costs is bounded by counts."""
    known = outlined()
    for z in np.arange(0.006, 0.045, 0.001):
        for along in np.arange(-HALF[0], HALF[0], 0.0006):
            known.touch(np.array([along, HALF[1], z]), np.array([0.0, 1.0, 0.0]))
            known.touch(np.array([along, -HALF[1], z]), np.array([0.0, -1.0, 0.0]))
    known.update()
    calls = []

    def counted(departure, line):
        calls.append(line)
        return path_to(departure, line)

    path_to = Departure.path_to
    monkeypatch.setattr(Departure, "path_to", counted)
    assert len(known) > 10_000
    assert scheduler(known, aim=1e-5).next(np.array([0.0, -0.1, 0.06])) is not None
    assert len(calls) <= SHORTLIST
    assert len(strokes(known)) <= 300


def test_the_stroke_that_is_chosen_is_the_best_with_the_path_to_it():
    known, here = outlined(), np.array([0.0, -0.1, 0.06])
    lines = scheduler(known, aim=1e-5)
    faces = known.faces()
    found = lines._planner.strokes(faces, lines._planner.success(faces), lines.height, here, None)
    listed = sorted(found, key=lambda stroke: -stroke.score)[:SHORTLIST]
    departure = Departure(here, DOWN, AREA, lines._free, lines._speeds)
    scores = [stroke.gain / (stroke.seconds + lines._seconds_to(stroke, departure)) for stroke in listed]
    chosen = lines._best(known.faces(), here)
    assert np.argmax(scores) > 0, "the path decides"
    assert chosen.line == listed[int(np.argmax(scores))].line
    assert chosen.score == max(scores)


def test_an_outline_ends_where_it_began():
    watch = OutlineWatch()
    angles = np.linspace(0.0, 2.0 * np.pi, 400)
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(400)], axis=1)
    ends = [watch.ends(0.03 * normal, normal, reliable=True) for normal in around]
    assert ends.index(True) > 370


@pytest.mark.parametrize(("lean", "reliable"), [(-0.4, True), (0.0, False)])
def test_an_outline_under_an_overhang_is_given_up(lean, reliable):
    watch, normal = OutlineWatch(), np.array([np.sqrt(1.0 - lean**2), 0.0, lean])
    ways = np.arange(0.0, 0.02, 0.0005)
    ends = [watch.ends(np.array([0.0, way, 0.01]), normal, reliable) for way in ways]
    assert 0.005 < ways[ends.index(True)] < 0.008


@pytest.mark.parametrize("aim", [0.0, -1.0, np.nan, 0.5])
def test_a_bad_aim_is_refused(aim):
    from lwrprobe.contracts import InputError
    from lwrprobe_strategies.active import ActiveConfig

    with pytest.raises(InputError, match="aim"):
        ActiveConfig(aim=aim)
