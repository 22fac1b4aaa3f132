"""The body behind the stick goes only where nothing can be; what would lead it elsewhere is not sent."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area, Done, Goal, Observation, VelocityCommand
from lwrprobe.scene import load_scene
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.orientation_change import OrientationChange
from lwrprobe_strategies.outcomes import Ended, UnknownSpace
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.gap_planner import GapPlanner
from lwrprobe_strategies.planning.lean import UP, turned
from lwrprobe_strategies.planning.lines import Line, X, Y
from lwrprobe_strategies.planning.low_sides import low_sides
from lwrprobe_strategies.planning.upright_body import body
from lwrprobe_strategies.skills import guarded_move
from lwrprobe_strategies.supervisor import SkillStrategy
from strategy_task import DOWN, task

LINKS = load_scene("block").probe.as_probe().links
AREA = Area(np.array([-0.085, -0.06, 0.006]), np.array([0.085, 0.06, 0.108]))
PITCH, LOW, TALL = 0.015, 0.056, 0.105
"""m; the lines' height, and that of the sphere's centre on a block that is 100 mm high."""
TALLEST = 0.103


def pose(x, y, z, rotation=DOWN):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, (x, y, z)
    return found


def leaning(degrees, towards=(0.0, -1.0, 0.0)):
    return turned(UP, np.array(towards), np.radians(degrees)) @ DOWN


def space(lines=(), half=(0.05, 0.025), area=AREA):
    """What lines along y at some x, over a block with these half edges, show to be free."""
    found = BodySpace(replace(task(links=LINKS, area=area)), PITCH)
    wall = half[1] + 0.005
    for x in lines:
        over = abs(x) <= half[0] + 0.005
        for y in np.arange(-0.06, 0.0601, 0.0005):
            on_top = over and abs(y) < wall
            found.note(pose(x, y, TALL if on_top else LOW), np.array([x, y, TALL - 0.005]) if on_top else None)
        for z in np.arange(LOW, TALL, 0.0005) if over else ():
            found.note(pose(x, -wall, z), np.array([x, -half[1], z]))
            found.note(pose(x, wall, z), np.array([x, half[1], z]))
    found.survey()
    return found


def test_an_object_that_is_lower_than_the_stick_is_long_needs_none():
    assert BodySpace.needed(task(links=LINKS, area=AREA))
    low = Area(AREA.lower, np.array([0.085, 0.06, 0.058]))
    assert not BodySpace.needed(task(links=LINKS, area=low))


def test_at_first_the_body_stays_above_the_tallest():
    found = space()
    above, below = pose(0.0, 0.0, TALLEST - 0.05 + 1e-4), pose(0.0, 0.0, 0.04)
    assert found.allows(pose(0.0, 0.0, 0.1), above)
    assert not found.allows(pose(0.0, 0.0, 0.1), below)
    assert found.allows(below, pose(0.0, 0.0, 0.1)), "what is too deep already may leave"
    assert not found.allows(pose(0.0, -0.06, 0.006, leaning(12.5)), pose(0.0, -0.04, 0.006, leaning(12.5))), (
        "leaning back from what is unknown does not make it free"
    )


def test_beside_a_block_the_body_comes_down_as_far_as_the_lines_have_shown():
    found = space(np.arange(-0.075, 0.0751, PITCH))
    out, beside = pose(0.0, -0.06, 0.006, leaning(17.5)), pose(0.0, -0.03, 0.0075, leaning(17.5))
    assert found.allows(out, beside)
    assert not found.allows(pose(0.0, -0.06, 0.006), pose(0.0, -0.03, 0.0075)), "upright it would meet the wall"
    depth = found.depth(np.array([pose(0.0, -0.03, 0.006)]))[0]
    block = TALL - 0.005
    assert block - 0.056 <= depth <= TALLEST - 0.056


def test_nothing_is_known_between_lines_that_are_too_far_apart():
    lines = [-0.075, -0.06, -0.045, -0.03, -0.015, 0.03, 0.045, 0.06, 0.075]
    whole, gap = space(np.arange(-0.075, 0.0751, PITCH)), space(lines)
    there = np.array([pose(-0.02, -0.05, 0.0075)])
    assert whole.depth(there)[0] < 0.0 < gap.depth(there)[0]


def test_a_flight_above_all_there_is_hides_nothing_that_lines_have_shown():
    found, crossed = space(), space()
    for known in (found, crossed):
        for x in np.arange(-0.075, 0.0751, PITCH):
            for y in np.arange(-0.06, -0.0349, 0.0005):
                known.note(pose(x, y, LOW), None)
    for x in np.arange(-0.05, 0.0501, 0.0005):
        crossed.note(pose(x, -0.032, TALLEST + 0.01), None)
    found.survey()
    crossed.survey()
    beside = [pose(x, -0.046, 0.0075) for x in np.arange(-0.05, 0.0501, 0.005)]
    assert found.depth(np.array(beside)).max() < 0.0
    np.testing.assert_array_equal(crossed.depth(np.array(beside)), found.depth(np.array(beside)))


@pytest.mark.parametrize("touches", [False, True])
def test_a_place_between_two_lines_counts_if_it_was_touched_and_not_if_the_probe_flew_over_it(touches):
    found = space(np.arange(-0.075, 0.0751, PITCH))
    there = np.array([pose(0.0075, -0.048, 0.012)])
    assert found.depth(there)[0] < 0.0
    for y in np.arange(-0.055, -0.0399, 0.0005):
        found.note(pose(0.0075, y, 0.09), np.array([0.0075, y, 0.085]) if touches else None)
    found.survey()
    assert bool(found.depth(there)[0] > 0.02) is touches


def touched_plane(slope):
    """A plane that falls along y, touched all the way along one line; and heights (n,) m of it at some y."""
    found, normal = space(), np.array([0.0, -slope, 1.0]) / np.hypot(slope, 1.0)
    for y in np.arange(-0.02, 0.0051, 0.0001):
        point = np.array([0.0, y, 0.06 + slope * y])
        found.note(pose(*(point + 0.005 * normal)), point)
    found.survey()
    return found, [(y, 0.06 + slope * y) for y in (-0.012, -0.010, -0.008)]


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.7])
def test_on_a_line_the_surface_is_known_and_not_only_that_the_centre_was_above_it(slope):
    found, surface = touched_plane(slope)
    for y, height in surface:
        known = found._body.heights[round((0.0 - AREA.lower[0]) / 0.001), round((y - AREA.lower[1]) / 0.001)]
        assert height - 1e-9 <= known <= height + 0.0011 + slope * 0.0016


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.7])
def test_a_line_keeps_the_body_as_far_from_what_was_touched_as_it_has_to(slope):
    found, surface = touched_plane(slope)
    (y, height), normal = surface[1], np.array([0.0, -slope, 1.0]) / np.hypot(slope, 1.0)
    i, j = round((0.0 - AREA.lower[0]) / 0.001), round((y - AREA.lower[1]) / 0.001)
    keep = found._task.clearance_threshold
    above = (found._clear.heights[i, j] - height) * normal[2]
    assert keep <= above < keep + 0.0035


def climbed_wall(lean, gap=None):
    """A wall along x at y = 0 that leans back by `lean`, climbed from 40 mm to its top at 100 mm along lines along y.

    Between the heights `gap` the sphere has flown off it.
    """
    spacing = 0.010
    found = BodySpace(replace(task(links=LINKS, area=AREA)), spacing)
    normal = np.array([0.0, -np.cos(lean), np.sin(lean)])
    for x in np.arange(-0.08, 0.0801, spacing):
        for y in np.arange(-0.06, -0.012, 0.0005):
            found.note(pose(x, y, 0.04), None)
        for z in np.arange(0.04, 0.1, 0.0005):
            off = gap is not None and gap[0] < z < gap[1]
            point = np.array([x, (z - 0.04) * np.tan(lean), z])
            if not off:
                found.note(pose(*(point + 0.005 * normal)), point)
        for y in np.arange(0.06 * np.tan(lean), 0.0601, 0.0005):
            found.note(pose(x, y, TALL), np.array([x, y, 0.1]))
    found.survey()
    return found


@pytest.mark.parametrize("degrees", [8.0, 15.0])
def test_beside_a_steep_wall_that_was_climbed_the_body_comes_to_the_distance_that_it_keeps(degrees):
    """The squares between the centre's path and the wall counted as full: the body kept 5 mm more from a steep one."""
    lean = np.radians(degrees)
    found = climbed_wall(lean)
    tip, keep = 0.02, found._task.clearance_threshold / np.cos(lean)
    parts = body(found._task)
    there = min((tip + bottom - 0.04) * np.tan(lean) - half[Y] - keep for half, bottom in parts if tip + bottom < 0.1)
    line = Line(Y, 0.0, -0.06, there, tip, rotation=DOWN)
    for farther, fits in ((0.0035, True), (-0.0015, False)):
        _, needed = found.lowest(replace(line, end=there - farther), DOWN)
        assert bool(needed[-1] <= tip) is fits, (farther, needed[-1])


def test_between_two_heights_at_which_the_sphere_was_near_a_wall_there_may_be_something():
    line = Line(Y, 0.0, -0.06, -0.01, 0.02, rotation=DOWN)
    whole, broken = (climbed_wall(0.14, gap).lowest(line, DOWN)[1][-1] for gap in (None, (0.06, 0.085)))
    assert broken > whole + 0.005


def test_what_stands_on_one_of_two_lines_may_reach_the_other():
    found = space([-0.075, -0.06, -0.045, -0.03, -0.015, 0.0, 0.015, 0.03, 0.045, 0.06, 0.075], half=(0.02, 0.025))
    # The block ends somewhere between the lines at 15 and 30 mm.
    assert found.depth(np.array([pose(0.03, 0.0, 0.03)]))[0] > 0.02
    assert found.depth(np.array([pose(0.075, 0.0, 0.0075)]))[0] < 0.0


def test_one_noisy_normal_does_not_make_a_side_slope():
    found, contacts = space(np.arange(-0.075, 0.0751, PITCH)), touched(xs=(0.0,))
    for side in (-1.0, 1.0):
        lowest = np.argmin(contacts[:, 2] + (side * contacts[:, 7] < 0.0))
        contacts[lowest, 6:9] = np.array([0.0, side, 0.15]) / np.hypot(1.0, 0.15)

    def leans(away):
        return [leaning(angle, away) for angle in np.arange(2.5, 40.1, 2.5)]

    lines = low_sides(contacts, Y, np.array([0.0]), AREA, PITCH, found, leans, lambda line: True)
    assert len(lines) == 2
    for line in lines:
        poses = [pose(line.place, y, line.height, line.rotation) for y in np.linspace(line.begin, line.begin / 2, 31)]
        assert found.depth(np.array(poses)).max() <= 1e-9, "it leans so far that the wall is reached"


class Straight(SkillStrategy):
    """Goes to a place, and notes how that ended."""

    Config = object

    def program(self):
        self.tip.body = BodySpace(self.task, PITCH)
        self.ended = None
        try:
            self.ended = yield from guarded_move(self.tip, self.goal)
        except UnknownSpace as refused:
            self.ended = refused
        while True:
            yield VelocityCommand(np.zeros(3))


@pytest.mark.parametrize(("goal", "allowed"), [((0.0, 0.0, 0.06), True), ((0.0, 0.0, 0.01), False)])
def test_a_motion_that_leads_the_body_into_the_unknown_is_not_sent(goal, allowed):
    strategy = Straight()
    strategy.goal = np.array(goal)
    strategy.start(replace(task(links=LINKS, area=AREA), start=np.array([0.0, 0.0, 0.108]), tallest=TALLEST))
    here = pose(0.0, 0.0, 0.108)
    for k in range(2000):
        motion = strategy.step(Observation(0.008 * k, here.copy(), np.zeros(3), np.zeros(3)))
        assert not isinstance(motion, Done)
        if isinstance(motion, Goal):
            way = motion.pose[:3, 3] - here[:3, 3]
            length = float(np.linalg.norm(way))
            here[:3, 3] += min(0.008 * motion.speed / max(length, 1e-9), 1.0) * way
        if strategy.ended is not None:
            break
    assert (strategy.ended is Ended.NO_CONTACT) == allowed
    assert isinstance(strategy.ended, UnknownSpace) != allowed
    assert here[2, 3] + 0.05 > TALLEST - 0.0015


def touched(z_low=LOW, slope=0.0, xs=(-0.03, -0.015, 0.0, 0.015, 0.03)):
    """Contacts of lines along y up both walls of a block, from a height on; `slope` of the walls, outwards below."""
    normal = np.array([0.0, 1.0, slope]) / np.hypot(1.0, slope)
    rows = []
    for x in xs:
        for side in (-1.0, 1.0):
            for z in np.arange(z_low, TALL, 0.001):
                centre = np.array([x, side * (0.03 + slope * (TALL - z)), z])
                out = normal * (1.0, side, 1.0)
                rows.append([*centre, *(centre - 0.005 * out), *out, x])
    return np.array(rows)


def test_sides_of_a_tall_block_are_touched_leaning_from_below_up_to_where_they_were_touched():
    found = space(np.arange(-0.075, 0.0751, PITCH))

    def leans(away):
        return [DOWN, *[leaning(angle, away) for angle in np.arange(2.5, 40.1, 2.5)]]

    xs = np.array([-0.03, 0.0, 0.03])
    lines = low_sides(touched(), Y, xs, AREA, PITCH, found, leans, lambda line: True)
    assert sorted((line.place, line.begin) for line in lines) == sorted((x, y) for x in xs for y in (-0.06, 0.06))
    for line in lines:
        assert line.height < 0.01
        assert line.ceiling == pytest.approx(LOW, abs=0.002)
        assert 10.0 < np.degrees(np.arccos(line.rotation[:, 2] @ DOWN[:, 2])) < 30.0
        poses = [pose(line.place, y, line.height, line.rotation) for y in np.linspace(line.begin, line.begin / 2, 9)]
        assert found.depth(np.array(poses)).max() <= 1e-9
    assert low_sides(touched(), Y, xs, AREA, PITCH, found, lambda away: [DOWN], lambda line: True) == [], (
        "upright the body would meet the wall"
    )
    assert low_sides(touched(), Y, xs, AREA, PITCH, found, leans, lambda line: False) == []
    assert low_sides(touched(z_low=0.008), Y, xs, AREA, PITCH, found, leans, lambda line: True) == []
    ends = low_sides(touched(), X, np.array([0.0]), AREA, PITCH, found, leans, lambda line: True)
    assert ends == [], "no touch faces along x"


class Open:
    """A body that may be everywhere above a height."""

    under = 0.003

    def __init__(self, above):
        self.above = above

    def lowest(self, line, rotation):
        return np.array([line.begin, line.end]), np.full(2, self.above)


@pytest.mark.parametrize(("slope", "depth"), [(0.0, None), (-0.1, 0.015), (-0.5, 0.0)])
def test_a_side_that_recedes_is_expected_down_to_where_the_stick_keeps_the_sphere_off_it(slope, depth):
    contacts = touched(slope=slope, xs=(0.0,))
    contacts = contacts[contacts[:, 2] > TALL - 0.015]  # the sphere comes in by 1.5 mm of the 3 mm there
    floor, lowest = float(AREA.lower[2]), float(contacts[:, 2].min())

    def sides(above):
        body = Open(above)
        return low_sides(contacts, Y, np.array([0.0]), AREA, PITCH, body, lambda away: [DOWN], lambda line: True)

    for line in sides(floor):
        assert line.height == floor, "there may be a foot"
        assert line.expected == (None if depth is None else pytest.approx(max(lowest - depth, floor), abs=1.5e-3))
    assert len(sides(floor)) == 2
    assert len(sides(lowest - 0.012)) == (0 if depth == 0.0 else 2), "no foot is sought there, and nothing expected"


def two_walls():
    """Contacts of a line along y up both sides of two walls, over a gap in which nothing was touched."""
    rows = []
    for wall in (-0.02, 0.02):
        for side in (-1.0, 1.0):
            for z in np.arange(LOW, TALL, 0.001):
                centre, out = np.array([0.0, wall + 0.007 * side, z]), np.array([0.0, side, 0.0])
                rows.append([*centre, *(centre - 0.005 * out), *out, 0.0])
    return np.array(rows)


def test_each_wall_has_its_own_sides_and_a_line_up_an_inner_one_begins_in_the_gap():
    body = Open(0.03)

    def sides(contacts, held=(DOWN,)):
        lines = low_sides(contacts, Y, np.array([0.0]), AREA, PITCH, body, lambda away: held, lambda line: True)
        return sorted((line.begin, line.end) for line in lines)

    assert len(sides(two_walls(), [leaning(20.0)])) == 2, "the gap is known to be free for an upright stick"
    assert sides(two_walls()) == pytest.approx([(-0.06, -0.023), (0.0, -0.017), (0.0, 0.017), (0.06, 0.023)])
    hollow = two_walls()
    floor = hollow[np.argmin(np.abs(hollow[:, :3] - [0.0, 0.013, LOW]).sum(axis=1))]
    bottom = np.tile(floor, (27, 1))
    bottom[:, 1] = bottom[:, 4] = np.linspace(-0.013, 0.013, 27)
    bottom[:, 6:9] = (0.0, 0.0, 1.0)
    assert len(sides(np.concatenate([hollow, bottom]))) == 2, "below a hollow that was followed there is nothing"


@pytest.mark.parametrize(("reach", "begins"), [(0.06, 0.06), (0.055, 0.05), (0.02, None)])
def test_a_line_begins_nearer_where_the_arm_does_not_reach_the_border(reach, begins):
    found = space(np.arange(-0.075, 0.0751, PITCH))

    def leans(away):
        return [leaning(angle, away) for angle in np.arange(2.5, 40.1, 2.5)]

    lines = low_sides(touched(), Y, np.array([0.0]), AREA, PITCH, found, leans, lambda line: abs(line.begin) <= reach)
    assert [line.begin for line in lines] == ([] if begins is None else pytest.approx([-begins, begins]))


def test_a_side_that_lines_beside_went_up_already_is_not_driven_again():
    found = space(np.arange(-0.075, 0.0751, PITCH))

    def leans(away):
        return [leaning(angle, away) for angle in np.arange(2.5, 40.1, 2.5)]

    def lines(*beside):
        known = np.concatenate([touched(xs=(0.0,)), *(touched(0.008, xs=(x,)) for x in beside)])
        return low_sides(known, Y, np.array([0.0]), AREA, PITCH, found, leans, lambda line: True)

    assert len(lines()) == len(lines(-PITCH)) == len(lines(-PITCH, PITCH)) == 2
    assert lines(-0.4 * PITCH, 0.4 * PITCH) == []


@pytest.mark.parametrize("degrees", [-35.0, 0.0, 35.0])
def test_the_probe_leans_off_the_side_as_it_stands_and_not_along_the_line(degrees):
    found, contacts, asked = space(np.arange(-0.075, 0.0751, PITCH)), touched(xs=(0.0,)), []
    turn = np.radians(degrees)
    contacts[:, 6:8] = contacts[:, 7:8] * [np.sin(turn), np.cos(turn)]

    def leans(away):
        asked.append(away)
        return []

    low_sides(contacts, Y, np.array([0.0]), AREA, PITCH, found, leans, lambda line: True)
    expected = np.array([np.sin(turn), np.cos(turn), 0.0])
    np.testing.assert_allclose(asked, [-expected, expected], atol=1e-12)


def test_the_body_may_come_back_the_way_it_went_whatever_is_known_beside_it():
    found = space()
    way = [pose(0.0, y, 0.0075, leaning(20.0)) for y in np.arange(-0.055, -0.0349, 0.001)]
    assert not found.allows(pose(0.0, -0.055, 0.1), way[-1])
    for there in way:
        found.note(there, None)
    found.survey()
    assert found.depth(np.array(way)).max() <= 0.002
    assert found.allows(way[-1], way[0])
    assert not found.allows(way[-1], pose(0.0, -0.02, 0.0075, leaning(20.0)))


def test_a_turn_is_looked_at_all_along_it():
    found = space(np.arange(-0.075, 0.0751, PITCH))
    outwards, inwards = leaning(25.0, (0.0, -1.0, 0.0)), leaning(25.0, (0.0, 1.0, 0.0))
    assert found.allows(pose(0.0, -0.04, 0.02, outwards), pose(0.0, -0.04, 0.02, leaning(17.5)))
    assert not found.allows(pose(0.0, -0.04, 0.02, outwards), pose(0.0, -0.04, 0.02, inwards))


def test_what_was_touched_on_the_border_goes_on_beyond_it():
    inside = space(np.arange(-0.075, 0.0751, PITCH))
    cut = Area(np.array([0.0, -0.06, 0.006]), AREA.upper)
    through = space(np.arange(0.0, 0.0751, PITCH), area=cut)
    beyond = np.array([pose(-0.02, 0.0, 0.02)])
    assert through.depth(beyond)[0] > 0.03
    assert inside.depth(np.array([pose(-0.11, 0.0, 0.02)]))[0] < 0.0, "nothing stands beside the area"


@pytest.mark.parametrize(("strategy", "leans"), [(OrientationChange(), True), (GridVersion(), False)])
def test_a_strategy_tells_how_it_would_touch_a_place_and_whether_the_body_would_be_in_known_space(strategy, leans):
    strategy.start(replace(task(links=LINKS, area=AREA), tallest=TALLEST))
    low, out = np.array([0.0, -0.03, 0.0075]), np.array([0.0, -1.0, 0.0])
    poses = strategy.touching_poses(low, out)
    assert len(poses) > 10 if leans else len(poses) == 1
    assert not any(known for _, known in poses), "nothing is known yet"
    strategy.tip.body = space(np.arange(-0.075, 0.0751, PITCH))
    known = [pose for pose, known in strategy.touching_poses(low, out) if known]
    assert bool(known) == leans, "upright the body would meet the wall"
    for touching in known:
        np.testing.assert_array_equal(touching[:3, 3], low)
        assert touching[1, 2] > 0.1, "the stick comes from the free side"
    ((upright, on_top),) = strategy.touching_poses(np.array([0.0, 0.0, TALL]), UP)
    np.testing.assert_array_equal(upright[:3, :3], DOWN)
    assert on_top
    strategy.tip.body = None
    assert all(known for _, known in strategy.touching_poses(low, out)), "nothing is as tall as the stick is long"


class Nowhere:
    """Lets the body go nowhere."""

    def note(self, pose, touches):
        """Nothing is kept."""

    def survey(self):
        """Nothing is known."""

    def clears(self, begin, turned, shift):
        return False

    def allows(self, begin, end):
        return False


def test_a_last_way_back_that_is_refused_does_not_undo_what_was_done():
    strategy = GridVersion()
    strategy.start(task())
    strategy.lines.next = lambda here: None
    strategy.tip.body = Nowhere()
    done = strategy.step(Observation(0.008, pose(0.0, -0.1, 0.06), np.zeros(3), np.zeros(3)))
    assert isinstance(done, Done)
    assert done.complete, done.reason


def test_a_motion_is_judged_by_the_depth_of_the_body_on_its_path():
    found, chance, allowed = space(np.arange(-0.085, 0.0851, PITCH)), np.random.default_rng(5), []
    for _ in range(300):
        rotation = (DOWN, leaning(10.0))[chance.integers(2)]
        begin = pose(*chance.uniform((-0.1, -0.08, 0.006), (0.1, 0.08, 0.15)), rotation)
        end = begin.copy()
        end[:3, 3] += chance.uniform(-0.01, 0.01, 3)
        on_path = np.array([begin + share * (end - begin) for share in np.linspace(0.0, 1.0, 41)])
        depths = found.depth(on_path)
        if abs(depths.max() - max(depths[0], 0.001)) < 0.0005:
            continue  # between two poses that are looked at
        expected = depths.max() <= max(depths[0], 0.001)
        assert found.allows(begin, end) == expected
        allowed.append(expected)
    assert sum(allowed) > 50
    assert len(allowed) - sum(allowed) > 10


@pytest.mark.parametrize("aside", [-0.0008, 0.0008])
def test_a_line_may_be_driven_at_its_height_a_little_beside_it_too(aside):
    found = space(np.arange(-0.075, 0.0751, PITCH), half=(0.022, 0.025))
    for x in np.arange(0.028, 0.04, 0.0004):
        line, held = Line(Y, float(x), -0.06, 0.0, LOW), leaning(10.0)
        places, heights = found.lowest(line, held)
        poses = [pose(line.place + aside, y, z, held) for y, z in zip(places, heights, strict=True)]
        assert found.depth(np.array(poses)).max() <= 1e-9


def test_an_object_that_may_be_taller_fills_what_was_above_it():
    found = space(np.arange(-0.075, 0.0751, PITCH))
    unknown, known = space(), [pose(0.0, -0.06, 0.006, leaning(17.5)), pose(0.0, -0.03, 0.0075, leaning(17.5))]
    above = pose(0.0, 0.0, TALLEST - 0.05 + 0.001)
    assert unknown.knows(above)
    for space_ in (found, unknown):
        space_.raise_top(replace(task(links=LINKS), area=AREA.raised(0.005)))
    assert not unknown.knows(above)
    assert unknown.knows(pose(0.0, 0.0, TALLEST - 0.05 + 0.006))
    assert found.allows(*known), "lines have shown how tall it is"


def test_a_touch_on_the_border_is_known_where_the_sphere_came_down_to_it():
    """The place just above, passed before, had made it forgotten: the body might go down beside it."""
    found, border = BodySpace(replace(task(links=LINKS, area=AREA)), PITCH), AREA.lower[Y]
    for z in np.arange(TALL, LOW, -0.0005):
        found.note(pose(0.0, border, z), None)
    found.survey()
    assert np.isneginf(found._body.heights[:, 0]).all()
    found.note(pose(0.0, border, LOW - 0.0001), np.array([0.0, border + 0.005, LOW]))
    found.survey()
    assert np.isfinite(found._body.heights[:, 0]).any()


@pytest.mark.parametrize(("plate", "on_surface"), [(0.0115, False), (LOW + 0.001, True)])
def test_a_line_across_begins_above_a_floor_that_only_a_leaning_probe_could_touch(plate, on_surface):
    """The upright body may not come down to the floor, and each line that began there had been given up."""
    beside, over = 0.06, 0.045
    known, memory = space((beside, over)), ContactMemory()
    for x, height in ((beside, plate), (over, TALL)):
        for y in np.arange(-0.02, 0.0201, 0.0005):
            place = np.array([x, y, height])
            memory.passed(place, x)
            memory.add(place, place - [0.0, 0.0, 0.005], UP, x)
    given = replace(task(links=LINKS, area=AREA))
    options = CoverageConfig(step=PITCH)
    planner = GapPlanner(given, memory, options, np.array([over, beside]), lambda line: 0.07, known, lambda away: ())
    lines = planner._lines_across()
    assert lines
    for line in lines:
        assert (line.begin, line.on_surface) == (beside, on_surface)
        assert line.height == pytest.approx(plate if on_surface else 0.07)
        assert line.fallback.on_surface, "the probe has been upright on the top"
