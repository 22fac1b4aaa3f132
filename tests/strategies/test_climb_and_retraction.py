"""Walls that lead down are climbed from the line's other end where that is quicker, and nowhere else."""

from contextlib import suppress
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest

from lwrprobe.contracts import Clearance, Contact, Observation
from lwrprobe.control import ContourControl
from lwrprobe.scene import load_scene
from lwrprobe_strategies.encounter import beside_line
from lwrprobe_strategies.free_motion import BACK, MAX_DETOURS
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.climb import WALL, DescentWatch
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.contour_end import under
from lwrprobe_strategies.planning.free_space import COLUMN, LIFT, FreeSpace
from lwrprobe_strategies.planning.lean import UP, turned
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import OFF, SpeedLimit
from lwrprobe_strategies.planning.retraction import goes_up, off_surface, out_from_under, return_path
from lwrprobe_strategies.planning.shaft import BEHIND, PASSED, UNEXPECTED, stretch
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.retraction_planner import IN_VAIN, RetractionPlanner
from lwrprobe_strategies.skills import follow_contour, transit
from lwrprobe_strategies.tip import Tip
from strategy_task import AREA, DOWN, task

LINKS = load_scene("block").probe.as_probe().links
BORDER = float(AREA.upper[1])


def stand(free, *places, rotation=DOWN, normal=None):
    """Let the probe have been at places (3,), one after the other."""
    for place in places:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, place
        free.note(pose, normal)


def descend(height, travel=1.0, known=True, normal=None, first=0.0):
    """Follow a wall at y = 0.03 down from `height`; the line offered instead, or None, and where it was offered."""
    t = task(approach=0.03, links=LINKS)
    free = FreeSpace(AREA)
    if known:
        stand(free, *([-0.01, travel * BORDER, z] for z in np.arange(0.06, 0.006, -0.001)))
    control = ContourControl(t)
    watch = DescentWatch(t, control, lambda line: float(t.area.lower[2]), free)
    line = Line(1, 0.0, -travel * BORDER, travel * BORDER, 0.006, free_end=True)
    frame = TrackingFrame(line, AREA)
    wall = np.array([0.0, travel, 0.0]) if normal is None else normal
    control.begin(wall)
    for z in np.arange(height - first, 0.006, -0.0005):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = DOWN, (0.0, 0.03 * travel, z)
        seen = Observation(0.0, pose, np.zeros(3), 0.8 * wall)
        offered = watch.climb(seen, frame, DOWN)
        if offered is not None:
            return offered, z
    return None, None


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_a_high_wall_is_left_under_its_edge_and_climbed_from_the_border(travel):
    up, left_at = descend(0.055, travel)
    assert left_at == pytest.approx(0.055 - WALL, abs=6e-4)
    assert up.begin == travel * BORDER
    assert travel * up.end < 0.03, "past the edge where the wall was left"
    assert up.height == 0.006
    down = up.fallback
    assert down.on_surface
    assert (down.begin, down.end, down.height) == (pytest.approx(0.03 * travel), travel * BORDER, left_at)


def test_a_low_wall_is_descended():
    assert descend(0.015) == (None, None)


def test_without_a_known_column_beside_the_way_around_is_not_worth_it():
    assert descend(0.055, known=False) == (None, None)


def test_a_slope_is_no_wall():
    slope = np.array([0.0, 0.8, 0.6])
    assert descend(0.055, normal=slope) == (None, None)


def wall(y, x=0.0, normal=(0.0, -1.0, 0.0)):
    """A contact of the line at x, facing -y, at the centre's place y."""
    touched = ContactMemory()
    normal = np.array(normal) / np.linalg.norm(normal)
    centre = np.array([x, y, 0.02])
    touched.add(centre, centre - 0.005 * normal, normal, x)
    return touched


def pieces(line, touched):
    """(begin, end, times the stick's speed) of all pieces in which a line is driven."""
    here, found = line.start, []
    while abs(here[line.axis] - line.end) > 1e-9:
        end, times = stretch(line, here, touched, 0.015)
        assert line.sign * (end - here[line.axis]) > 1e-4, "each piece leads on"
        found.append((float(here[line.axis]), end, times))
        here = line.at(end)
        assert len(found) < 6
    return found


LINE = Line(1, 0.0, -BORDER, BORDER, 0.006)


def test_a_line_is_driven_with_care_where_nothing_is_known_beside_it():
    assert pieces(LINE, ContactMemory()) == [(-BORDER, BORDER, 1.0)]
    passed = ContactMemory()
    for y in np.arange(-BORDER, BORDER, 0.01):
        passed.passed(np.array([0.01, y, 0.006]), 0.01)
    assert pieces(LINE, passed) == [(-BORDER, BORDER, np.inf)], "the line beside met nothing"
    assert pieces(Line(1, 0.03, -BORDER, BORDER, 0.006), passed)[0][2] == 1.0, "too far beside"


def test_a_line_is_driven_with_care_where_the_one_beside_it_has_not_come_to():
    """It came from the other end, as far as its stick met something; this one was driven fast into the other side."""
    passed = ContactMemory()
    for y in np.arange(BORDER, 0.04, -0.001):
        passed.passed(np.array([0.01, y, 0.006]), 0.01)
    (begin, end, times), rest = pieces(LINE, passed)
    assert (begin, end, times) == (-BORDER, pytest.approx(0.04, abs=0.001), 1.0)
    assert rest[2] == np.inf


def test_a_line_is_driven_with_care_just_behind_the_wall_that_the_one_beside_it_met():
    touched = wall(-0.03, 0.01)
    *_, third = pieces(LINE, touched)
    assert third[1:] == (BORDER, UNEXPECTED), "nobody has passed there yet"
    for y in np.arange(0.026, BORDER, 0.01):
        touched.passed(np.array([0.01, y, 0.006]), 0.01)
    first, second, _, third = pieces(LINE, touched)
    assert first == (-BORDER, pytest.approx(-0.03 + BEHIND), np.inf)
    assert second[1:] == (pytest.approx(-0.03 + BEHIND + PASSED), 1.0)
    assert third[1:] == (BORDER, np.inf)
    end, times = stretch(LINE, LINE.start, touched, 0.015, 0.01)
    assert (end, times) == (pytest.approx(-0.04 + BEHIND), np.inf)
    assert stretch(LINE, LINE.at(-0.035), touched, 0.015, 0.01)[1] == UNEXPECTED, "something overhangs on this object"
    up = np.array([0.0, 0.0, 1.0])
    for y in (-0.02, 0.035):
        touched.add(np.array([0.01, y, 0.04]), np.array([0.01, y, 0.035]), up, 0.01)
    *_, third, fourth = pieces(LINE, touched)
    assert third[1:] == (pytest.approx(0.035), UNEXPECTED), "where the line beside went over it something may stand out"
    assert fourth[1:] == (BORDER, np.inf)


def seen(place, confidence=None, rotation=DOWN, clearance=None):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    normal = np.array([0.0, 0.0, 1.0])
    contact = None if confidence is None else Contact(0.0, pose[:3, 3], normal, normal, pose[:3, 3], confidence)
    return Observation(0.0, pose, np.zeros(3), np.zeros(3), contact, clearance)


def test_a_surface_is_left_along_its_normal():
    place = np.array([0.026, 0.0, 0.011])
    (up,) = off_surface(seen(place, 1.0), np.array([0.0, 0.0, 1.0]), 0.01, True)
    assert (up.speed_limit, up.place[2]) == (SpeedLimit.FREE, pytest.approx(0.011 + OFF)), "the probe's own column"
    (side,) = off_surface(seen(place, 1.0), np.array([1.0, 0.0, 0.0]), 0.01, True)
    assert (side.speed_limit, side.place[0]) == (SpeedLimit.GUARDED, pytest.approx(0.026 + OFF))
    (doubted,) = off_surface(seen(place, 0.2), np.array([1.0, 0.0, 0.0]), 0.01, True)
    assert doubted.place[0] == pytest.approx(0.036), "further where the point is imprecise"
    assert off_surface(seen(place), np.array([0.0, 0.0, 1.0]), 0.01, True) == []


@pytest.mark.parametrize("taller", [True, False])
@pytest.mark.parametrize("begin", [0.0, 0.01])
def test_a_floor_is_left_with_care_where_the_sphere_slid_in_beside_something_taller(begin, taller):
    """At 200 mm/s the sphere had struck a ledge, which was beside the stick, with 4.6 N (random:steps:11608)."""
    tip = Tip(task())
    if taller:
        place, point, out = np.array([[-0.007, 0.0, 0.03], [-0.012, 0.0, 0.03], [1.0, 0.0, 0.0]])
        tip.observe(replace(seen(place), contact=Contact(0.0, point, out, out, place, 1.0)))
    for z in np.arange(AREA.upper[2], 0.011, -0.0005):
        tip.observe(seen(np.array([begin, 0.0, z])))
    for x in np.arange(begin, -1e-9, -0.0005):
        tip.observe(seen(np.array([x, 0.0, 0.011]), 1.0))
    slid = begin > 0.0
    (up,) = off_surface(tip.seen, UP, 0.01, tip.column_is_free)
    assert up.speed_limit is (SpeedLimit.COLUMN if slid and taller else SpeedLimit.FREE)


def test_off_an_imprecise_contact_nearly_along_the_stick_the_probe_goes_straight_up_in_its_own_column():
    """Along the normal, 10 mm at 200 mm/s, the sphere had struck a wall 1 mm beside it with 3.6 N."""
    (up,) = off_surface(seen(np.array([0.026, 0.0, 0.011]), 0.2), np.array([0.1, 0.2, 0.97]), 0.01, True)
    assert up.place == pytest.approx([0.026, 0.0, 0.021])
    assert up.speed_limit is SpeedLimit.COLUMN


@pytest.mark.parametrize(("beside", "turned"), [(0.0005, True), (0.003, False)])
def test_a_light_touch_does_not_turn_around_what_a_reliable_normal_has_said_just_before(beside, turned):
    """A force of 0.2 N that remained had said that the surface is above: the way back led into it, with 11 N."""
    free = FreeSpace(AREA)
    stand(free, *([0.0, y, 0.03] for y in np.arange(-0.02, -beside, 0.001)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, (0.0, -beside, 0.03)
    free.note(pose, np.array([-0.4, 0.3, 0.87]))
    pose[:3, 3] = 0.0, 0.0012, 0.03
    free.note(pose, np.array([0.1, -0.2, -0.98]), reliable=False)
    (off, _), *_ = free.return_path(0.01)
    assert (off[2] > 0.03) == turned


def test_back_from_a_contact_that_is_not_reliable_the_first_step_is_guarded():
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    stand(strategy.tip.free, *([0.0, y, 0.02] for y in np.arange(-0.03, 0.0, 0.001)))
    strategy.tip.observe(replace(seen([0.0, 0.0, 0.02], 0.2), force=np.array([0.0, -0.8, 0.0])))
    planner = RetractionPlanner(strategy.tip, DOWN, 0.01)
    planner.go_back()
    first, *onward = planner.path()
    assert onward
    assert first.speed_limit is SpeedLimit.GUARDED
    assert all(piece.speed_limit is SpeedLimit.FREE for piece in onward)


@pytest.mark.parametrize("wedged", [False, True])
def test_back_out_of_a_groove_the_sphere_does_not_meet_the_other_side_of_it(wedged):
    """Two rods that come nearer to each other: a millimetre off one of them the sphere met the other."""
    free, ways = FreeSpace(AREA), np.arange(0.0, 0.02, 0.001)
    narrow = np.deg2rad(6.0)
    other = np.array([-np.sin(narrow), np.cos(narrow), 0.0])  # of the side that comes nearer; they meet at x = 0.02
    stand(free, *([x, 0.0, 0.02] for x in ways), normal=np.array([0.0, -1.0, 0.0]))
    path = np.array([piece.place for piece in return_path(free, 0.015, wedged)])
    fine = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise([[0.019, 0.0, 0.02], *path.tolist()])])
    room = (fine - [0.02, 0.0, 0.0]) @ other
    assert (room.min() > -1e-4) == wedged
    assert path[-1][1] == pytest.approx(-LIFT, abs=1e-6), "off both where there is room"


def test_the_way_up_is_taken_only_by_an_upright_probe_that_is_under_nothing():
    place, flat, under = np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([0.8, 0.0, -0.6])
    leaning = turned(UP, np.array([0.0, 1.0, 0.0]), 0.3) @ DOWN
    near = Clearance(0.0, place, place, "stick", required=0.001)
    assert goes_up(seen(place, 1.0), flat, DOWN)
    assert goes_up(seen(place), flat, DOWN)
    assert not goes_up(seen(place, 1.0), under, DOWN)
    assert not goes_up(seen(place, 0.05), flat, DOWN), "the stick touches"
    assert not goes_up(seen(place, 1.0, leaning), flat, DOWN)
    assert not goes_up(seen(place, None, clearance=near), flat, DOWN)


def test_under_something_the_probe_goes_back_the_way_it_came():
    free = FreeSpace(AREA)
    stand(free, *([0.0, -0.05, z] for z in np.arange(0.06, 0.0059, -0.0012)))
    stand(free, *([0.0, y, 0.006] for y in np.arange(-0.05, 0.0101, 0.0012)))
    stand(free, *([0.0, 0.01, z] for z in np.arange(0.006, 0.0301, 0.0012)), normal=np.array([0.0, -1.0, 0.0]))
    path = return_path(free)
    assert all(piece.speed_limit is SpeedLimit.FREE for piece in path)
    places = np.array([piece.place for piece in path])
    assert places[0] == pytest.approx([0.0, 0.01 - LIFT, 0.03]), "off the wall first"
    assert places[-1][1] == pytest.approx(-0.05, abs=0.003), "to where it came down"
    assert (places[:, 2] <= 0.03 + 1e-9).all()
    assert 2 <= len(path) <= 8
    short = return_path(free, 0.01)
    assert short[-1].place == pytest.approx([0.0, 0.01 - LIFT, 0.02], abs=0.0015)


@pytest.mark.parametrize(("over", "lean", "end"), [(True, 0.0, 0.016), (False, 0.0, -0.05), (True, 0.5, -0.05)])
def test_the_way_back_ends_on_top_of_what_was_followed_down_since_then(over, lean, end):
    """Up a wall, over the top, and down behind it, to under an edge: up from the top, and not back over all of it."""
    free, rotation = FreeSpace(AREA), turned(UP, np.array([0.0, -1.0, 0.0]), lean) @ DOWN
    stand(free, *([0.0, -0.05, z] for z in np.arange(0.06, 0.0059, -0.0012)))
    stand(free, *([0.0, y, 0.006] for y in np.arange(-0.05, -0.0101, 0.0012)), rotation=rotation)
    wall = [[0.0, -0.01, z] for z in np.arange(0.006, 0.0301, 0.0012)]
    stand(free, *wall, normal=np.array([0.0, -1.0, 0.0]), rotation=rotation)
    top = [[0.0, y, 0.03] for y in np.arange(-0.01, 0.0161, 0.0012)]
    stand(free, *top, normal=UP, rotation=rotation)
    if over:
        down = [[0.0, 0.018 + 0.3 * d, 0.03 - d] for d in np.arange(0.0, 0.03, 0.0012)]
        stand(free, *down, normal=np.array([0.0, 0.9578, 0.2873]), rotation=rotation)
    last = return_path(free)[-1].place
    assert last[1] == pytest.approx(end, abs=0.012 if over and not lean else 0.003)
    assert (last[2] > 0.025) == (over and not lean)


def test_the_way_back_ends_where_the_sphere_came_down_and_not_beside_that():
    """On the way up it would meet with its flank what stands above its way in, as fast as the probe can go."""
    free = FreeSpace(AREA)
    stand(free, *([0.0, -0.02, z] for z in np.arange(0.06, 0.0059, -0.0012)))
    stand(free, *([0.0, y, 0.006] for y in np.arange(-0.0195, -0.015, 0.0005)))
    path = return_path(free)
    assert path[-1].place[1] == pytest.approx(-0.02, abs=COLUMN)
    assert path[-1].place[2] < 0.006 + 2 * 0.0012


def test_a_leaning_probe_goes_back_in_the_orientation_in_which_it_came():
    free = FreeSpace(AREA)
    stand(free, *([0.0, -0.05, z] for z in np.arange(0.06, 0.0059, -0.0012)))
    leaning = turned(UP, np.array([0.0, -1.0, 0.0]), 0.5) @ DOWN
    stand(free, [0.0, -0.05, 0.006], *([0.0, y, 0.006] for y in np.arange(-0.05, 0.0101, 0.0012)), rotation=leaning)
    path = return_path(free)
    assert np.allclose(path[0].rotation, leaning)
    assert np.allclose(path[-1].rotation, DOWN), "upright again where it turned"


def test_the_way_back_leads_off_what_was_touched_before_its_normal_was_sure():
    strategy = GridVersion()
    strategy.start(task())
    tip, free = strategy.tip, [[0.0, y, 0.006] for y in np.arange(-0.1, 0.0, 0.0012)]
    for place in free:
        tip.observe(seen(place))
    tip.observe(seen([0.0, 0.0012, 0.006], 0.2))
    tip.observe(seen([0.0, 0.0012, 0.0075], 1.0))
    places = np.array([piece.place for piece in return_path(tip.free)])
    touched = places[np.abs(places[:, 1] - 0.0012) < 1e-9]
    assert touched[:, 2].min() >= 0.006 + LIFT - 1e-9


def test_the_way_back_passes_a_place_where_a_contact_was_lost():
    """There the sphere may still touch the wall by less than a contact."""
    free, wall = FreeSpace(AREA), np.array([0.0, 1.0, 0.0])
    stand(free, *([0.0, 0.06, z] for z in np.arange(0.06, 0.0119, -0.0012)))
    stand(free, *([0.0, y, 0.012] for y in np.arange(0.0588, 0.0301, -0.0012)))
    stand(free, [0.0, 0.03, 0.012], [0.0, 0.03, 0.0132], normal=wall)
    stand(free, [0.0, 0.03, 0.0144], [0.0, 0.0306, 0.0156])
    stand(free, *([0.0, 0.03, z] for z in np.arange(0.0168, 0.03, 0.0012)), normal=wall)
    places = np.array([piece.place for piece in return_path(free)])
    assert np.abs(places - [0.0, 0.03, 0.0144]).max(axis=1).min() > 1e-6
    assert np.hypot(places[:, 1] - 0.0306, places[:, 2] - 0.0156).min() < 1e-9, "where it was off the wall"


def test_a_detour_is_left_out_on_the_way_back():
    """Back and forth along a wall, as after a touch on the way back: the way to the open end stays as it was."""
    normal, leaning = np.array([0.0, -1.0, 0.0]), turned(UP, np.array([0.0, -1.0, 0.0]), 0.5) @ DOWN
    free, once = FreeSpace(AREA), None
    stand(free, *([0.0, y, 0.006] for y in np.arange(-0.1, 0.0301, 0.0012)), rotation=leaning)
    wall = [[0.0, 0.0312, z] for z in np.arange(0.006, 0.05, 0.0012)]
    for _ in range(20):
        stand(free, *wall, rotation=leaning, normal=normal)
        stand(free, *wall[::-1], rotation=leaning, normal=normal)
        path = np.array([piece.place for piece in return_path(free)])
        once = path if once is None else once
    assert path[-1] == pytest.approx([0.0, -0.1, 0.006], abs=1e-9), "on the border, where it came from"
    assert len(path) == len(once)
    assert path[:, 2].max() < 0.008, "not up the wall again"


@pytest.mark.parametrize(("normal", "in_plane"), [((-0.59, 0.81, 0.0), True), ((-0.95, 0.31, 0.0), False)])
def test_a_wall_across_which_a_line_leads_aslant_is_left_in_the_plane_of_the_line(normal, in_plane):
    """What the body may rely on between two lines would end where one of them is left."""
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    strategy.tip.observe(seen([0.0, 0.0, 0.02], 1.0))
    strategy.tip.control.begin(np.array(normal))
    strategy.drive.frame = TrackingFrame(Line(1, 0.0, -BORDER, BORDER, 0.02), AREA)
    strategy.tip.trace.running.clear()
    velocity = next(strategy.drive.retract_onward()).velocity
    assert velocity @ normal > 0.5 * np.linalg.norm(velocity), "off the wall"
    assert (abs(velocity[0]) < 1e-9) == in_plane


@pytest.mark.parametrize("aside", [0.008, -0.008, 0.0])
def test_a_tip_that_was_led_aside_comes_back_to_its_line(aside):
    """Lines that keep their distance show what is free between them."""
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    strategy.tip.observe(seen([aside, 0.0, 0.02], 1.0))
    strategy.drive.frame = TrackingFrame(Line(1, 0.0, -BORDER, BORDER, 0.02), AREA)
    strategy.tip.trace.running.clear()
    goal = next(strategy.drive.along_line()).pose[:3, 3]
    assert goal[0] == 0.0
    assert goal[1] == pytest.approx(BACK * abs(aside) if aside else BORDER)


def driven(strategy, lines, where=lambda number: 0.003 * number, ended=None, touching=1.0):
    """The program of a strategy whose lines take no time, up to its end; what it ends with, and the lines.

    After each line the tip is `where` its number says, x in m, `touching` with a confidence or nothing, and the skill
    that ended last is `ended`.
    """

    def drive(line):
        strategy.drive.begin_line(line)
        lines.append(line)
        strategy.tip.observe(seen([where(len(lines)), -0.1, 0.06], touching))
        strategy.tip.trace.ended = ended
        return iter(())

    strategy.drive_line = drive
    program = strategy.program()
    try:
        motion = next(program)
        while True:
            strategy.tip.observe(replace(strategy.tip.seen, time=strategy.tip.seen.time + 0.008, pose=motion.pose))
            motion = program.send(strategy.tip.seen)
    except StopIteration as stop:
        return stop.value


@pytest.mark.parametrize(
    ("below", "headroom", "reach", "raised"),
    [(0.0, 0.0, 1.0, None), (0.0, 0.004, 1.0, None), (0.0, 0.05, 0.062, None), (0.0, 0.05, 1.0, 0.005),
     (0.001, 0.05, 1.0, 0.0), (-0.006, 0.05, 1.0, 0.01), (-0.031, 0.04, 1.0, 0.035), (-0.036, 0.04, 1.0, 0.04)],
)  # fmt: skip
def test_the_area_is_raised_over_an_object_that_reaches_its_upper_end_or_the_run_ends(below, headroom, reach, raised):
    """The table had been 3.7 mm higher than stated: flights over the object had met it with 27 N."""
    strategy, lines = GridVersion(), []
    strategy.start(task(approach=0.03, headroom=headroom, reachable=lambda poses: poses[0][2, 3] < reach))
    stand(strategy.tip.free, [0.05, 0.05, 0.06], [0.05, 0.05, 0.03])
    place = AREA.upper - np.array([0.05, 0.05, below])
    strategy.tip.memory.add(place, place, np.array([0.0, 1.0, 0.0]), 0.0)
    done = driven(strategy, lines)
    assert done.complete == (raised is not None)
    assert ("as high as the area's upper end, 60.0 mm" in done.reason) == (raised is None)
    assert strategy.raised == pytest.approx(raised or 0.0)
    assert strategy.task.area.upper[2] == strategy.tip.task.area.upper[2] == pytest.approx(0.06 + strategy.raised)
    if raised:
        again = round(raised / 0.005)
        assert [line.place for line in lines[: again + 2]] == [lines[0].place] * (again + 1) + [lines[again + 1].place]
        assert lines[again + 1].place != lines[0].place
        top = float(strategy.task.area.upper[2])
        assert strategy.tip.free.clear_down_to(0.05, 0.05) == top, "above where it came down something may be"


@pytest.mark.parametrize(("apart", "complete"), [(0.002, False), (0.03, True)])
def test_a_run_whose_last_lines_no_path_has_reached_from_one_place_is_not_complete(apart, complete):
    """random:boolean:8805 had ended as done with half of it untouched: the tip was caught inside a ring."""
    strategy, lines = GridVersion(), []
    strategy.start(task(approach=0.03))
    done = driven(strategy, lines, lambda number: apart * (number % 2), transit)
    assert len(lines) > IN_VAIN
    assert done.complete == complete
    assert ("cannot leave its place" in done.reason) == (not complete)


def test_lines_that_the_arm_cannot_reach_are_no_narrow_place():
    strategy, lines = GridVersion(), []
    strategy.start(task(approach=0.03))
    done = driven(strategy, lines, lambda number: 0.0, transit, touching=None)
    assert len(lines) > 2 * IN_VAIN
    assert "lines that the arm cannot reach" in done.reason


@pytest.mark.parametrize(("moved", "ended", "stays"), [(0.0015, transit, True), (0.0015, follow_contour, False)])
def test_a_path_that_touches_one_side_of_a_narrow_place_and_then_the_other_has_not_left_it(moved, ended, stays):
    """Line after line had been given up there, none of them driven."""
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    planner, tip = RetractionPlanner(strategy.tip, DOWN, 0.01), strategy.tip
    planner.line_begins()
    tip.observe(seen(tip.here + np.array([moved, 0.0, 0.0]), 1.0))
    tip.trace.ended = ended
    planner.line_ends()
    assert planner.stays == stays


@pytest.mark.parametrize("blocked", ["", "out of reach: limited"])
def test_the_way_back_begins_with_what_the_arm_can_reach(blocked):
    """A leaning probe had gone up a wall to the end of a joint's range, and could not go off it."""
    wall, leaning = np.array([0.0, -1.0, 0.0]), turned(UP, np.array([1.0, 0.0, 0.0]), -0.4) @ DOWN
    asked = []

    def reachable(poses):
        asked.append(poses)
        return poses[-1][2, 3] < 0.02

    strategy = GridVersion()
    strategy.start(task(approach=0.03, reachable=reachable))
    stand(strategy.tip.free, *([0.0, -y, 0.006] for y in np.arange(0.03, 0.0, -0.001)), rotation=leaning)
    stand(strategy.tip.free, *([0.0, 0.0, z] for z in np.arange(0.006, 0.03, 0.001)), rotation=leaning, normal=wall)
    strategy.tip.observe(replace(seen([0.0, 0.0, 0.029], 1.0, leaning), blocked=blocked))
    strategy.drive.frame = TrackingFrame(Line(1, 0.0, -BORDER, BORDER, 0.006), AREA)
    asked.clear()
    strategy.retractions.back = 0.1
    path = strategy.retractions.path()
    assert (path[0].place[2] < 0.02) == bool(blocked)
    assert bool(asked) == bool(blocked)
    assert path[-1].place[1] < -0.01


class BodyAbove:
    """A body that may come no lower than with the sphere at a height [m], up to a place `end` m along x."""

    def __init__(self, height, end):
        self._height, self._end = height, end

    def survey(self):
        """Nothing more is known."""

    def allows(self, begin, end):
        return bool(end[2, 3] > self._height or end[0, 3] > self._end)


@pytest.mark.parametrize(
    ("height", "end", "heights"),
    [(0.0, 1.0, [0.0195, 0.0195]), (0.0199, 1.0, [0.02, 0.02]), (0.0199, -0.005, [0.0195, 0.02])],
)
def test_the_way_back_off_a_side_that_leans_out_is_level_where_the_body_may_come_no_lower(height, end, heights):
    """It leads off along the normal, half a millimetre down, and the body was 0.04 mm too deep: the run had ended."""
    out = np.array([0.0, -0.87, -0.5])
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    tip = strategy.tip
    stand(tip.free, *([x, -0.0025, 0.019] for x in np.arange(0.003, -0.0305, -0.001)))  # no floor is there
    stand(tip.free, *([x, 0.0, 0.02] for x in np.arange(-0.03, 0.0005, 0.001)), normal=out)
    tip.observe(
        replace(seen([0.001, 0.0, 0.02], 1.0), contact=replace(seen([0.001, 0.0, 0.02], 1.0).contact, normal=out))
    )
    tip.body = BodyAbove(height, end)
    planner = RetractionPlanner(tip, DOWN, 0.01)
    planner.go_back()
    places = np.array([waypoint.place for waypoint in planner.path()])
    assert places[-1, 0] < -0.008
    assert (places[:, 1] < -0.0008).all(), "off the surface"
    assert places[:, 2] == pytest.approx(heights, abs=1e-4)


@pytest.mark.parametrize("reach", [0.1, 0.02])
def test_the_path_to_a_line_leads_where_the_arm_can_reach(reach):
    """Near a stretched elbow joint 4 was to accelerate beyond its limit, and the run ended."""
    strategy = GridVersion()
    strategy.start(task(approach=0.03, reachable=lambda poses: all(pose[1, 3] < reach for pose in poses)))
    for y in (0.03, -0.06):
        stand(strategy.tip.free, *([-0.05, y, z] for z in np.linspace(AREA.upper[2], 0.006, 60)))
    strategy.tip.observe(seen([0.05, 0.0, AREA.upper[2]]))
    approach = strategy.approach(Line(0, 0.0, -0.05, -0.04, 0.006))
    goal, highest = next(approach), -np.inf
    with suppress(StopIteration):
        while True:
            highest = max(highest, goal.pose[1, 3])
            strategy.tip.observe(replace(seen(goal.pose[:3, 3]), goal_reached=True))
            goal = approach.send(strategy.tip.seen)
    assert highest == pytest.approx(0.03 if reach > 0.03 else 0.0, abs=0.001)


@pytest.mark.parametrize(("mass", "fits"), [(0.0, True), (16.0, False)])
def test_an_arm_with_a_mass_goes_down_fast_only_where_the_sphere_came_down_itself(mass, fits):
    """Beside its own column, at 200 mm/s, its flank had struck a cylinder's end with 3.7 N."""
    strategy = GridVersion()
    strategy.start(replace(task(approach=0.03), arm_mass=mass, arm_stiffness=2e4))
    free = strategy.tip.free
    stand(free, *([0.0, 0.1 * z, z] for z in np.arange(0.06, 0.0299, -0.001)))
    assert (free.clear_down_to(0.002, 0.004) < 0.045) == fits
    assert (free.open_places(0, 0.0)[:, 2].min() < 0.045) == fits


def test_a_place_that_the_planned_path_does_not_leave_is_left_otherwise():
    """The path along the normal led the body where it must not go: line after line was given up in one place."""
    strategy, tried = GridVersion(), []
    strategy.start(task(approach=0.03))
    strategy.tip.observe(replace(seen([0.0, 0.0, 0.02], 1.0), force=np.array([0.0, -0.8, 0.0])))
    stand(strategy.tip.free, *([0.0, y, 0.02] for y in np.arange(-0.03, 0.0, 0.001)))
    ends = []

    def drive(line):
        tried.append((line, strategy.retractions.path()))
        strategy.drive.begin_line(line)
        return iter(())

    def whole():
        ends.append((yield from strategy.program()))

    strategy.drive_line = drive
    motions = list(islice(whole(), 3000))
    assert [end.reason for end in ends] == ["the probe cannot leave its place: no path off the contact is free"]
    assert {motion.reason for motion in motions} == {"slide out"}, "before each other path, and to the same place"
    assert len({line.place for line, _ in tried}) == 1, "no line is lost"
    _, along_force, back, up = (path[0].place - strategy.tip.here if path else None for _, path in tried)
    assert along_force == pytest.approx([0.0, -0.01, 0.0])
    assert back[1] < 0.0
    assert abs(back[2]) < 1e-3
    assert up == pytest.approx([0.0, 0.0, 0.01])


def test_a_line_that_the_arm_does_not_reach_from_free_space_is_left_out_and_the_next_one_is_tried():
    """At the border of its reach the arm did not come to one line: the run ended, "no path off the contact is free"."""
    strategy, tried = GridVersion(), []
    strategy.start(task(approach=0.03))
    strategy.tip.observe(seen([0.0, 0.0, 0.02]))
    strategy.drive_line = lambda line: strategy.drive.begin_line(line) or tried.append(line.place) or iter(())
    with pytest.raises(StopIteration) as stop:
        next(strategy.program())
    assert set(tried) >= set(strategy.lines.grid.x)
    assert (stop.value.value.complete, "cannot reach" in stop.value.value.reason) == (False, True)


def test_a_line_that_ends_where_it_began_has_been_driven():
    """Along a wall and back: taken for one that had not been left, it had been driven four times, and the run ended."""
    strategy, driven = GridVersion(), []
    strategy.start(task(approach=0.03))
    strategy.tip.observe(replace(seen([0.0, 0.0, 0.02], 1.0), force=np.array([0.0, -0.8, 0.0])))
    stand(strategy.tip.free, *([0.0, y, 0.02] for y in np.arange(-0.03, 0.0, 0.001)))

    def there_and_back(line):
        strategy.drive.begin_line(line)
        driven.append(line.place)
        strategy.tip.memory.passed(np.array([0.0, 0.01 + 0.001 * len(driven), 0.02]), line.place)
        return iter(())

    strategy.drive_line = there_and_back
    next(strategy.program())
    assert len(driven) == len(set(driven)) > 4


@pytest.mark.parametrize("cut", [False, True])
def test_a_border_through_which_an_object_goes_is_no_way_up_near_that(cut):
    """What is cut by the border may overhang there as anywhere."""
    free, x = FreeSpace(AREA), float(AREA.upper[0])
    stand(free, *([x, y, 0.006] for y in np.arange(-0.1, 0.0, 0.0012)))
    stand(free, [x if cut else x - 0.003, 0.0012, 0.006], normal=np.array([0.0, -1.0, 0.0]))
    stand(free, *([x, y, 0.006] for y in np.arange(-0.001, -0.006, -0.0012)))
    way = np.array([piece.place for piece in return_path(free)])
    up = free.clear_down_to(x, -0.006)
    if cut:
        assert way[-1][1] < -0.0145
        assert up == AREA.upper[2]
    else:
        assert len(way) == 1
        assert up == pytest.approx(0.006)


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_down_a_wall_that_leads_in_under_itself_there_is_no_fast_way_up(slope):
    """The sphere came down within half its radius of there, and would meet with its flank what it has touched."""
    free, edge = FreeSpace(AREA), 0.03
    normal = np.array([0.0, -1.0, -slope]) / np.hypot(1.0, slope)
    stand(free, *([0.0, -0.02, z] for z in np.arange(AREA.upper[2], edge, -0.001)))
    foot = [0.0, -0.02 + slope * (edge - 0.006), 0.006]
    stand(free, *np.linspace([0.0, -0.02, edge], foot, 25), normal=normal)
    under = edge - COLUMN / slope if slope else 0.006
    assert free.open_places(0, 0.0)[:, 2].min() == pytest.approx(under, abs=0.0011), "nor a fast way down to it"
    assert free.clear_down_to(foot[0], foot[1]) == pytest.approx(edge if slope else 0.006, abs=0.0011)


@pytest.mark.parametrize(("x", "rises"), [(-0.0014, True), (0.0014, False)])
def test_beside_a_touched_slope_a_descent_is_fast_down_to_where_the_slope_is_expected(x, rises):
    """On a bevelled edge, 1.4 mm up the slope from where the sphere had been, it met the surface at 50 mm/s: 3.5 N."""
    free, touched = FreeSpace(AREA), 0.03
    stand(free, *([0.0, 0.0, z] for z in np.arange(AREA.upper[2], touched, -0.001)))
    stand(free, [0.0, 0.0, touched], normal=np.array([0.6, 0.0, 0.8]))
    surface = touched - x * 0.6 / 0.8
    level = free.clear_down_to(x, 0.0)
    assert level > surface - 1e-6
    assert level < (surface if rises else touched) + 0.0011


@pytest.mark.parametrize(("normal", "ends"), [((0.7, -0.71), True), ((0.3, -0.95), True), ((0.05, -1.0), False)])
def test_a_lower_edge_is_come_down_to_and_what_is_met_from_below_is_none(normal, ends):
    """On the way up a wall the sphere meets what stands out above, and goes on around it."""
    control, frame = ContourControl(task()), TrackingFrame(Line(1, 0.0, -BORDER, BORDER, 0.006), AREA)
    control.begin(np.array([0.0, *normal]))
    assert under(control, frame) == ends
    control.begin(np.array([0.0, -normal[0], normal[1]]))
    assert not under(control, frame), "from there the contour leads up"


def test_under_an_edge_the_sphere_goes_sideways_until_it_may_pass():
    place, normal = [0.01, 0.0, 0.03], np.array([0.6, 0.0, -0.8])
    (out,) = out_from_under(seen(place, 1.0), normal, 0.005)
    edge = np.array(place) - 0.005 * normal
    assert out.speed_limit is SpeedLimit.GUARDED
    assert out.place[2] == pytest.approx(place[2])
    assert out.place[0] - edge[0] == pytest.approx(0.006), "past the edge by a millimetre"
    assert out_from_under(seen(place, 1.0), np.array([0.0, 0.2, -0.98]), 0.005) == [], "right under it is no way out"
    assert out_from_under(seen(place, 1.0), np.array([1.0, 0.0, 0.0]), 0.005) == []
    assert out_from_under(seen(place), normal, 0.005) == []


def test_what_stands_beside_the_way_to_a_line_is_not_followed_as_if_it_was_on_the_line():
    strategy = GridVersion()
    strategy.start(task(approach=0.03))
    line = strategy.drive.frame.line
    strategy.tip.trace.running.clear()
    strategy.tip.trace.ended = transit
    for aside, expected in ((0.0, "contour"), (0.01, "way")):
        place = line.start
        place[line.aside] += aside
        strategy.tip.observe(seen(place, 1.0))
        strategy.tip.control.begin(np.array([0.0, -1.0, 0.0]))
        next(strategy.next_skill(Ended.CONTACT))
        assert (strategy.tip.trace.running[-1] is transit) == (expected == "way")
        strategy.tip.trace.running.clear()
    strategy.free_motion.detours = MAX_DETOURS
    assert strategy.next_skill(Ended.CONTACT) is None, "not for ever"


@pytest.mark.parametrize(("away", "tries"), [(0.003, 4), (0.05, 1)])
def test_a_line_that_begins_in_the_object_is_not_taken_for_a_place_that_nothing_leads_off(away, tries):
    """Its path ended on the object where it had begun, after 60 mm over the top, and the run had ended for that."""
    strategy, tried = GridVersion(), []
    strategy.start(task(approach=0.03))
    place = [0.0, 0.0, 0.02]
    strategy.tip.observe(replace(seen(place, 1.0), force=np.array([0.0, -0.8, 0.0])))

    def drive(line):
        strategy.drive.begin_line(line)
        tried.append(line)
        stand(strategy.tip.free, [0.0, 0.0, 0.02 + away], place)
        return iter(())

    strategy.drive_line = drive
    with suppress(StopIteration):
        next(strategy.program())
    assert tried.count(tried[0]) == tries


@pytest.mark.parametrize(
    ("place", "again"),
    [((0.0, -0.02), False), ((0.0, 0.04), True), ((0.003, -0.02), True), ((0.0, -0.048), False)],
)
def test_what_the_path_to_a_line_touches_beside_it_or_behind_its_end_is_not_followed(place, again):
    """The line before had touched the far side of the same object when it was broken off: this one was not driven."""
    strategy, line = GridVersion(), Line(1, 0.0, -0.05, -0.015, 0.006, low=True)
    strategy.start(task(approach=0.03))
    strategy.drive.begin_line(line)
    strategy.tip.observe(seen([*place, 0.02], 1.0))
    strategy.tip.trace.ended = transit
    assert beside_line(strategy.tip, line) == again
