"""Ways to a line: nothing unknown is driven through fast, what is known is used, and the quicker way is taken."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import Area, LinkShape
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.approaches import BEFORE, FAR_BELOW, HOVER, SOUGHT, Departure, up_from
from lwrprobe_strategies.planning.free_space import GAP, LIFT, LOWER, SIDE, SPACING, FreeSpace
from lwrprobe_strategies.planning.lean import UP, turned
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import THERE, SpeedLimit, Speeds, seconds
from lwrprobe_strategies.planning.upright_body import DEEP, RISE, clear_of, line_height, lowest_beside
from strategy_task import AREA, DOWN, task

LINKS = load_scene("block").probe.as_probe().links
CUBE = load_scene("block").map.resolution
TOP = float(AREA.upper[2])
BORDER = float(AREA.upper[1])
RADIUS = 0.005


SPEEDS = Speeds(free=1.0, column=0.012, guarded=lambda along: 0.007 if abs(along[2]) > 0.5 else 0.03)


def way(line, here, free=None):
    return Departure(np.array(here), DOWN, AREA, nowhere() if free is None else free, SPEEDS).path_to(line)


def nowhere():
    return FreeSpace(AREA)


def stand(free, *places, rotation=DOWN, normal=None):
    for place in places:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, place
        free.note(pose, None if normal is None else np.array(normal))
    return free


def column(x, y, low):
    """What is known to be free for a probe that came straight down in one place to `low`."""
    return stand(nowhere(), *([x, y, z] for z in np.linspace(TOP, low, max(int((TOP - low) / 0.0011), 1) + 1)))


def test_the_way_back_does_not_touch_again_what_was_touched_where_it_turned():
    """The place before a touch is nearer to the surface than two places that are remembered are apart."""
    free, wall = (
        stand(nowhere(), *([0.0, y, 0.02] for y in np.arange(-0.0399, 0.0, 0.0011))),
        np.array([0.0, -1, 0.0]),
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, [0.0, 0.0, 0.02]
    for up in np.arange(0.0, 0.02, 0.0005):
        pose[2, 3] = 0.02 + up
        free.note(pose, wall)
    back = np.array([place for place, _ in free.return_path(0.05)])
    assert len(back)
    assert back[:, 1].max() <= -0.9 * LIFT


@pytest.mark.parametrize("opening", [60.0, 90.0, 130.0])
def test_the_way_back_to_the_column_cuts_an_inner_edge(opening):
    """Along a floor and up a wall: off the wall, the sphere would still touch the floor in the edge between them."""
    steps, angle = np.arange(0.0, 0.0201, 0.0005), np.radians(opening)
    up, out = np.array([-np.cos(angle), 0.0, np.sin(angle)]), np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    edge = np.array([0.0, 0.0, 0.02])
    free = stand(column(-0.021, 0.0, 0.02 + 1e-4))
    stand(free, *(edge - [s, 0.0, 0.0] for s in steps[::-1]), normal=UP)
    stand(free, *(edge + s * up for s in steps[1:]), normal=out)
    back = np.array([place for place, _ in free.back_to_column()])
    between = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(back)])
    off_floor, off_wall = between[:, 2] - edge[2], (between - edge) @ out
    assert np.minimum(off_floor, off_wall)[:-50].min() > 0.6 * LIFT, "all but the foot of the column"
    assert back[0] == pytest.approx(edge + 0.02 * up + LIFT * out, abs=1e-3)
    assert back[-1][:2] == pytest.approx([-0.021, 0.0], abs=SIDE)


def test_the_way_back_around_an_outer_edge_keeps_to_it():
    """What lies behind a face there is free: nothing of the path is left out."""
    steps = np.arange(0.0, 0.0201, 0.0005)
    free = stand(column(-0.02, 0.0, 0.02))
    stand(free, *([-s, 0.0, 0.02] for s in steps[::-1]), normal=UP)
    stand(free, *([0.0, 0.0, 0.02 - s] for s in steps[1:]), normal=[1.0, 0.0, 0.0])
    back = np.array([place for place, _ in free.back_to_column()])
    between = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(back)])
    assert np.maximum(between[:, 0], between[:, 2] - 0.02).min() > 0.3 * LIFT


def test_a_surface_that_was_touched_is_come_to_beside_it_where_the_stick_has_been():
    """From the foot of a known column and level is quicker than down what only the stick has filled."""
    free = stand(column(0.02, 0.03, 0.02), *([x, 0.03, 0.02] for x in np.arange(0.02, -0.0099, -0.0011)))
    line = Line(1, 0.0, 0.03, 0.05, 0.012, on_surface=True, free_to=0.02)
    *path, touch = way(line, [0.0, -0.05, TOP], free)
    assert {piece.speed_limit for piece in path} == {SpeedLimit.FREE}
    assert path[-2].place == pytest.approx([0.02, 0.03, 0.02], abs=SIDE)
    assert path[-1].place == pytest.approx([0.0, 0.03, 0.02 + HOVER], abs=1e-3)
    assert (touch.speed_limit, touch.place[2]) == (SpeedLimit.GUARDED, pytest.approx(line.height - SOUGHT))


def test_an_unknown_column_is_come_down_slowly_below_what_may_be_there():
    line = Line(1, 0.03, BORDER, -BORDER, 0.006)
    *over, down, last = way(line, [0.0, 0.0, 0.058])
    assert [piece.speed_limit for piece in over] == [SpeedLimit.FREE] * len(over)
    assert all(piece.place[2] == TOP for piece in over)
    assert (down.speed_limit, down.place[2]) == (SpeedLimit.FREE, pytest.approx(TOP))
    assert last.speed_limit is SpeedLimit.GUARDED
    assert tuple(last.place) == tuple(line.start)


def test_a_column_the_probe_has_stood_in_is_come_down_fast_and_left_sideways():
    line = Line(1, 0.03, BORDER, -BORDER, 0.006)
    *_, over, down, last = way(line, [0.0, 0.0, 0.05], column(0.02, BORDER, 0.006))
    assert over.place == pytest.approx([0.02, BORDER, TOP])
    assert (down.speed_limit, last.speed_limit) == (SpeedLimit.FREE, SpeedLimit.GUARDED)
    assert down.place == pytest.approx([0.02, BORDER, 0.006])
    assert tuple(last.place) == tuple(line.start)


def test_up_from_under_an_overhang_that_only_the_stick_has_passed_is_slow():
    here, there = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, TOP])
    along = stand(column(0.0, -0.05, 0.02), *([0.0, y, 0.02] for y in np.arange(-0.05, 0.0001, 0.0011)))
    slow, fast = up_from(here, there, along)
    assert (slow.speed_limit, slow.place[2]) == (SpeedLimit.COLUMN, pytest.approx(TOP))
    assert (fast.speed_limit, fast.place[2]) == (SpeedLimit.FREE, TOP)
    (up,) = up_from(np.array([0.0, -0.05, 0.02]), there, along)
    assert up.speed_limit is SpeedLimit.FREE, "where the sphere came down"
    beside = up_from(np.array([1.1 * SIDE, -0.05, 0.02]), there, along)
    assert beside[0].speed_limit is SpeedLimit.COLUMN, "the sphere is wider than the stick"


def test_a_probe_that_turns_under_something_may_not_go_straight_up_any_more():
    leaning = turned(UP, np.array([0.0, 1.0, 0.0]), 0.3) @ DOWN
    free = column(0.0, 0.0, 0.03)
    opened = len(free.open_places(0, 0.0))
    stand(free, *([0.0, 0.0, z] for z in np.arange(0.028, 0.01, -0.0011)), rotation=leaning)
    assert opened > 10
    assert len(free.open_places(0, 0.0)) == opened
    assert not stand(nowhere(), [0.0, 0.0, 0.02], [0.004, 0.0, 0.02], rotation=leaning).swept(
        np.array([0.0, 0.0, 0.02]), np.array([0.004, 0.0, 0.02])
    )


def test_a_level_line_is_free_where_the_upright_probe_has_been_all_along_it():
    free = stand(nowhere(), *([0.0, y, 0.02] for y in np.arange(0.0, 0.0401, 0.002)))
    begin, end = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.04, 0.02])
    assert free.swept(begin, end)
    assert free.swept(end, begin)
    beside = np.array([0.002, 0.0, 0.0])
    assert not free.swept(begin, end + 5.0 * beside[[1, 0, 2]])
    assert not free.swept(begin + beside, end + beside)
    broken = stand(nowhere(), *([0.0, y, 0.02] for y in np.arange(0.0, 0.0401, 0.002) if abs(y - 0.02) > GAP))
    assert not broken.swept(begin, end)


def test_a_level_line_is_not_free_where_the_sphere_has_been_no_lower_than_above_it():
    """It passed just above a surface; half a millimetre lower the probe had flown into that with 5 N."""
    free = stand(nowhere(), *([0.0, y, 0.0206] for y in np.arange(0.0, 0.0401, 0.002)))
    begin, end = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.04, 0.02])
    assert not free.swept(begin, end)
    lag = np.array([0.0, 0.0, 0.00055])
    assert free.swept(begin + lag, end + lag)


def test_a_level_line_up_to_a_surface_that_was_touched_is_not_free():
    """Its end may lie in the surface: the probe had flown into it, and braked only in contact."""
    free = stand(nowhere(), *([0.0, y, 0.02] for y in np.arange(0.0, 0.0381, 0.002)))
    begin, end = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.039, 0.02])
    assert free.swept(begin, end)
    wall = np.eye(4)
    wall[:3, :3], wall[:3, 3] = DOWN, (0.0, 0.0395, 0.02)
    free.note(wall, np.array([0.0, -1.0, 0.0]))
    assert not free.swept(begin, end)
    assert free.swept(begin, np.array([0.0, 0.03, 0.02]))


def test_where_a_path_has_met_something_no_path_leads_again():
    free = column(0.0, -0.02, 0.03)
    line, here = Line(0, 0.0, 0.0, 0.05, 0.03), np.array([0.03, 0.03, TOP])
    foot = np.array([0.0, -0.02, 0.03])
    usual = Departure(here, DOWN, AREA, free, SPEEDS)
    assert any(np.allclose(waypoint.place, foot) for waypoint in usual.path_to(line))
    warned = Departure(here, DOWN, AREA, free, SPEEDS, met=foot[None])
    assert not any(np.allclose(waypoint.place, foot) for waypoint in warned.path_to(line))
    above = np.array([0.0, -0.02, 0.04])
    rising = Departure(foot, DOWN, AREA, free, SPEEDS, met=foot[None]).path_to(Line(0, -0.02, 0.0, 0.05, above[2]))
    assert [waypoint.place.tolist() for waypoint in rising] == [above.tolist()], "it may be left"


def test_lines_across_come_down_where_the_grid_has_been():
    line = Line(0, 0.01, -0.06, -0.05, 0.006)
    *_, down, last = way(line, [0.0, 0.0, 0.05], column(-0.06, 0.005, 0.006))
    assert down.place == pytest.approx([-0.06, 0.005, 0.006])
    assert (down.speed_limit, last.speed_limit) == (SpeedLimit.FREE, SpeedLimit.GUARDED)


@pytest.mark.parametrize(("distance", "above"), [(0.01, False), (0.15, True)])
def test_along_the_border_or_over_the_top_whatever_is_quicker(distance, above):
    here = np.array([0.08, BORDER, 0.006])
    line = Line(1, 0.08 - distance, BORDER, -BORDER, 0.006)
    free = stand(column(line.place, BORDER, 0.006), here)
    pieces = way(line, here, free)
    assert any(piece.place[2] == TOP for piece in pieces) is above
    along = abs(distance) / SPEEDS.guarded(np.array([1.0, 0.0, 0.0]))
    assert seconds(pieces, here, SPEEDS) <= along + 0.5


def test_no_path_leads_sideways_through_what_was_touched():
    line, free = Line(0, -0.03, 0.02, 0.03, 0.006), column(0.02, 0.05, 0.006)
    here, asked = np.array([0.0, 0.0, 0.05]), []

    def clear(begin, end):
        asked.append((begin, end))
        return False

    assert way(line, here, free)[-2].place == pytest.approx([0.02, 0.05, 0.006])
    around = Departure(here, DOWN, AREA, free, SPEEDS, clear).path_to(line)
    begin, end = asked[0]
    assert begin == pytest.approx([0.02, 0.05, 0.006])
    assert end == pytest.approx(line.start)
    before = here
    for piece in around:
        sideways = np.abs(piece.place - before)[:2].max() > THERE
        assert not sideways or piece.place[2] == TOP
        before = piece.place
    assert tuple(before) == tuple(line.start)


def test_a_way_is_clear_where_neither_stick_nor_body_passes_what_was_touched():
    body_bottom, half = 0.05, 0.0125
    pose = np.eye(4)
    pose[2, 3] = -body_bottom - 0.02
    t = task(links=(LinkShape("holder", "cylinder", (half, 0.04), pose),))
    begin, end = np.array([0.0, -0.05, 0.01]), np.array([0.0, 0.05, 0.01])

    def clear(x, y, z):
        return clear_of(np.array([[x, y, z]]), t)(begin, end)

    assert not clear(0.0, 0.0, 0.03), "in the stick's way"
    assert clear(0.0, 0.0, 0.005), "below the sphere"
    assert clear(0.01, 0.0, 0.03), "beside the stick"
    assert not clear(0.01, 0.0, 0.08), "in the body's way"
    assert clear(0.02, 0.0, 0.08)
    assert clear(0.01, -0.05, 0.08), "near already"
    assert not clear(0.0, 0.0, 0.007), "the sphere goes through it"
    assert not clear(0.0035, 0.0, 0.01), "beside the stick as well"
    assert clear(0.0, 0.0, 0.0055), "it rests on it"
    assert clear(0.002, -0.05, 0.0095), "it is there already"


def test_the_sphere_goes_through_nothing_that_was_touched():
    """Against the distance of each place on the path, of a probe that has a sphere and no body."""
    t = task()
    rng = np.random.default_rng(3)
    for _ in range(300):
        begin, end = rng.uniform(-0.02, 0.02, (2, 3))
        point = rng.uniform(-0.02, 0.02, 3)
        path = begin + np.linspace(0.0, 1.0, 4001)[:, None] * (end - begin)
        near, first = np.linalg.norm(path - point, axis=1).min(), float(np.linalg.norm(point - begin))
        deep = t.probe.radius - DEEP
        if abs(near - deep) < 1e-5 or abs(first - deep) < 1e-5 or point[2] > min(begin[2], end[2]) + RISE:
            continue
        assert clear_of(point[None], t)(begin, end) == (near > deep or first < deep)


def test_back_down_the_wall_that_was_climbed_to_the_foot_of_the_next_line():
    free = stand(nowhere(), *([x, 0.0, 0.006] for x in np.arange(-0.05, -0.0399, 0.001)))
    stand(free, *([-0.04, 0.0, z] for z in np.arange(0.007, 0.0451, 0.001)))
    here, line = np.array([-0.04, 0.0, 0.045]), Line(0, 0.01, -0.05, -0.04, 0.006)
    *back, last = way(line, here, free)
    assert {piece.speed_limit for piece in back} == {SpeedLimit.FREE}
    assert max(piece.place[2] for piece in back) < 0.046, "not over the top"
    assert back[-1].place == pytest.approx([-0.05, 0.0, 0.006], abs=0.011)
    assert (last.speed_limit, tuple(last.place)) == (SpeedLimit.GUARDED, tuple(line.start))
    far = Line(0, 0.05, -0.05, -0.04, 0.006)
    assert any(piece.place[2] == TOP for piece in way(far, here, free)), "too far beside"
    leaning = turned(UP, np.array([0.0, 1.0, 0.0]), 0.3) @ DOWN
    stand(free, [-0.04, 0.0, 0.046], rotation=leaning)
    assert free.back_to(line.start, 0.02) is None, "it leaned on the way"


def test_the_way_back_does_not_lead_into_what_a_reliable_normal_shows():
    """The stick touched a wall, and the sphere then met an underside: the wall's normal led up, into that."""
    free, up = stand(nowhere(), *([0.0, y, 0.02] for y in np.arange(-0.03, 0.0, 0.0011))), np.array([0.0, 0.0, 1.0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, [0.0, 0.0, 0.02]
    free.note(pose, np.array([0.0, -0.6, 0.8]))
    pose[2, 3] += 0.0012
    free.note(pose, np.array([0.0, -0.6, -0.8]), reliable=False)
    free.note(pose, -up)
    back = np.array([place for place, _ in free.return_path(0.05)])
    assert back[0] == pytest.approx(pose[:3, 3] - LIFT * up)
    assert back[:, 2].max() < 0.0203
    assert back[-1, 1] < -0.025


@pytest.mark.parametrize("down", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("upwards", [True, False])
def test_the_way_back_along_an_underside_leads_no_lower_than_the_sphere_has_been(down, upwards):
    """A floor may be below, on which the sphere would come down along the stick; off the surface it leads sideways."""
    normal, foot = np.array([np.sqrt(1.0 - down**2), 0.0, -down]), np.array([0.0, 0.0, 0.01])
    up = np.array([down, 0.0, normal[0]])
    side = [foot + s * up for s in np.arange(0.0, 0.0151, 0.0005)]
    free = nowhere()
    if upwards:
        stand(free, *([x, 0.0, 0.01] for x in np.arange(0.03, 0.0, -0.0011)))
    stand(free, *(side if upwards else side[::-1]), normal=normal)
    back = np.array([place for place, _ in free.return_path(0.014)])
    between = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(back)])
    assert between[:, 2].min() >= 0.01 - LOWER - 1e-9
    assert ((between - foot) @ normal).min() > (0.9 * LIFT if down < 0.9 else 0.0), "under a steep one there is no room"


def test_the_way_back_under_a_ceiling_cuts_no_corner_into_it():
    """A ceiling rises to both sides of a place, and the path may not lead off it; 0.1 mm would press with 2 N more."""
    free = stand(nowhere(), [0.0, -0.03, 0.03])
    for y in np.arange(-0.03, 0.0, 0.0005):
        normal = np.array([0.0, -0.05 * np.sign(y + 0.01), -1.0]) / np.hypot(0.05, 1.0)
        stand(free, [0.0, y, 0.02 + 0.05 * abs(y + 0.01)], normal=normal)
    back = np.array([place for place, _ in free.return_path(0.025, wedged=True)])
    between = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(back)])
    assert (between[:, 2] - 0.02 - 0.05 * np.abs(between[:, 1] + 0.01)).max() < 3e-5
    assert between[:, 2].min() >= 0.02 - LOWER - 1e-9


def test_no_way_back_leads_to_a_place_next_to_a_light_touch():
    """An exploration had ended with an IndexError where that was the only place near the start of the next line."""
    free = stand(nowhere(), [0.0, 0.0, 0.02], normal=[0.0, -1.0, 0.0])
    lost = np.array([0.0, -0.002, 0.02])
    stand(free, lost)
    assert free.back_to(lost, 0.0005) is None
    beside = lost - [0.0, 0.002, 0.0]
    stand(free, beside)
    assert free.back_to(lost, 0.0005) is None
    ((end, _),) = free.back_to(beside, 0.0005)
    assert end == pytest.approx(beside)


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-0.09, 0.09), y=st.sampled_from([-BORDER, BORDER]), z=st.floats(0.006, 0.06),
    known=st.floats(-0.09, 0.09), low=st.floats(0.006, 0.05), height=st.floats(0.006, 0.04),
)  # fmt: skip
def test_only_known_or_high_places_are_driven_to_fast(x, y, z, known, low, height):
    free = column(known, y, low)
    line = Line(1, x, y, -y, height)
    here = np.array([0.0, 0.0, z])
    before = here
    for piece in way(line, here, free):
        if piece.speed_limit is SpeedLimit.FREE and np.abs(piece.place - before).max() > 1e-9:
            lowest = min(piece.place[2], before[2])
            high, level = lowest >= TOP - RADIUS - GAP, lowest >= low - GAP - 1e-9
            in_column = np.abs(np.array([before, piece.place])[:, :2] - [known, y]).max() < SIDE + 2.0 * SPACING
            assert high or (in_column and level)
        before = piece.place
    assert np.abs(before - line.start).max() < THERE


def naive_lowest(line, points, t):
    """Raise the probe in steps of 0.1 mm until its body clears every point, wherever on the line it stands."""
    body = [link for link in t.probe.links if link.name != "stick"]
    height = float(t.area.lower[2])
    while height < t.area.upper[2]:
        if not any(hits(line, height, link, point, t.clearance_threshold) for link in body for point in points):
            return height
        height += 1e-4
    return float(t.area.upper[2])


def hits(line, height, link, point, keep):
    half = link.size[:2] if link.kind == "box" else (2.0 * link.size[0], 2.0 * link.size[0])
    length = link.size[2] if link.kind == "box" else link.size[1]
    reach = [0.5 * edge + abs(off) + keep for edge, off in zip(half, link.pose[:2, 3], strict=True)]
    low, high = sorted((line.begin, line.end))
    inside = low - reach[line.axis] < point[line.axis] < high + reach[line.axis]
    beside = abs(point[line.aside] - line.place) < reach[line.aside]
    bottom = height - link.pose[2, 3] - 0.5 * length
    return inside and beside and bottom < point[2] + RISE + keep


@pytest.mark.parametrize("seed", range(4))
def test_the_lowest_height_beside_what_was_touched(seed):
    random = np.random.default_rng(seed)
    t = task(links=LINKS, area=Area(np.array([-0.1, -0.1, 0.006]), np.array([0.1, 0.1, 0.2])))
    points = np.column_stack([*random.uniform(-0.08, 0.08, (2, 40)), random.uniform(0.0, 0.15, 40)])
    for axis, begin in itertools.product((0, 1), (-0.09, 0.09)):
        line = Line(axis, float(random.uniform(-0.05, 0.05)), begin, 0.0, 0.05)
        found = lowest_beside(line, points, t)
        assert found == pytest.approx(naive_lowest(line, points, t), abs=1.1e-4)
        assert RISE > CUBE, "the map's cubes are what the clearance sees"
        assert found <= line_height(t) + 0.15, "what was touched is no higher than what may be there"
    assert lowest_beside(line, np.empty((0, 3)), t) == t.area.lower[2]


def test_a_known_touch_is_come_down_to_at_the_pace_of_a_column_that_the_stick_has_filled():
    line = Line(0, 0.0, 0.05, 0.06, 0.03, on_surface=True, free_to=0.031)
    *_, known, last = way(line, [0.0, 0.0, 0.05])
    assert known.place[2] == pytest.approx(0.031 + HOVER)
    assert (known.speed_limit, last.speed_limit) == (SpeedLimit.COLUMN, SpeedLimit.GUARDED)
    assert last.place[2] == pytest.approx(line.height - SOUGHT), "on a slope the surface may be lower than beside"
    *_, known, last = way(line, [0.0, 0.0, 0.05], column(0.05, 0.0, 0.03))
    assert (known.speed_limit, last.speed_limit) == (SpeedLimit.FREE, SpeedLimit.GUARDED)


def climbed_wall():
    """A probe that came down at (-0.05, 0), went level to a wall at x = -0.04 and up that."""
    free = stand(column(-0.05, 0.0, 0.006), *([x, 0.0, 0.006] for x in np.arange(-0.049, -0.0399, 0.001)))
    return stand(free, *([-0.04, 0.0, z] for z in np.arange(0.007, 0.0301, 0.001))), np.array([-0.04, 0.0, 0.030])


def test_up_from_a_wall_that_was_climbed_leads_back_to_where_the_probe_came_down():
    """Straight up only the stick has been, and the sphere would have to go slowly."""
    free, here = climbed_wall()
    pieces = way(Line(1, 0.07, BORDER, -BORDER, 0.006), here, free)
    first_at_top = next(i for i, piece in enumerate(pieces) if piece.place[2] == TOP)
    assert {piece.speed_limit for piece in pieces[: first_at_top + 1]} == {SpeedLimit.FREE}
    assert pieces[first_at_top].place[:2] == pytest.approx([-0.05, 0.0], abs=SIDE)
    departure = Departure(here, DOWN, AREA, free, SPEEDS, allows=lambda begin, end: False)
    refused = departure.path_to(Line(1, 0.07, BORDER, -BORDER, 0.006))
    assert refused[0].place == pytest.approx([*here[:2], TOP], abs=0.01), "where the body may not go back"


def test_back_to_the_column_and_up_in_it_to_the_same_line_higher_up():
    free, here = climbed_wall()
    pieces = way(Line(0, 0.0, -0.05, -0.03, 0.025), here, free)
    assert max(piece.place[2] for piece in pieces) < 0.035, "not over the top"
    assert {piece.speed_limit for piece in pieces} == {SpeedLimit.FREE}
    assert pieces[-1].place == pytest.approx([-0.05, 0.0, 0.025])
    leaning = turned(UP, np.array([0.0, 1.0, 0.0]), 0.3) @ DOWN
    pieces = Departure(here, leaning, AREA, free, SPEEDS).path_to(Line(0, 0.0, -0.05, -0.03, 0.025))
    assert any(piece.place[2] == TOP for piece in pieces), "it turns above all there is"


@pytest.mark.parametrize(("y", "z"), [(-0.06, 0.006), (0.03, 0.03)])
def test_where_one_column_is_barred_another_one_is_taken_and_not_the_unknown(y, z):
    """From the nearest and lowest the object is in the way; not from the other side, and not where a line has led."""
    free = stand(column(-0.05, 0.03, 0.006), *([-0.05, y, height] for height in np.linspace(TOP, z, 60)))
    stand(free, *([-0.05, beside, z] for beside in np.linspace(y, 0.0, 60)))

    def clear(begin, end):
        return bool(np.abs(begin - end)[:2].max() < SIDE)

    start = Line(0, 0.0, -0.05, -0.04, 0.006)
    pieces = Departure(np.array([0.05, 0.05, TOP]), DOWN, AREA, free, SPEEDS, clear).path_to(start)
    over = next(i for i, piece in enumerate(pieces) if piece.place[2] < TOP - RADIUS)
    assert pieces[over].place == pytest.approx([-0.05, y, z], abs=SIDE)
    assert pieces[over + 1].speed_limit is SpeedLimit.FREE


def test_a_deep_start_beside_a_known_column_is_come_to_level_and_not_down_through_the_unknown():
    """16 s of 4 mm/s straight down on the border, where the probe had come down 40 mm beside it."""
    free, line = column(-0.05, 0.03, 0.006), Line(1, -0.02, 0.02, 0.05, 0.006)
    pieces = way(line, [0.05, 0.05, TOP], free)
    assert seconds(pieces, np.array([0.05, 0.05, TOP]), SPEEDS) < 3.0
    assert [piece.speed_limit for piece in pieces[-2:]] == [SpeedLimit.FREE, SpeedLimit.GUARDED]
    assert pieces[-1].place == pytest.approx(line.start)
    barred = Departure(np.array([0.05, 0.05, TOP]), DOWN, AREA, free, SPEEDS, lambda begin, end: False).path_to(line)
    assert barred[-1].place[:2] == pytest.approx(barred[-2].place[:2]), "what was touched on the way bars it"
    leaning = turned(UP, np.array([0.0, 1.0, 0.0]), 0.3) @ DOWN
    down = Departure(np.array([0.05, 0.05, TOP]), leaning, AREA, free, SPEEDS).path_to(line)
    assert down[-1].place[:2] == pytest.approx(down[-2].place[:2]), "what the upright stick has shown is not asked for"


@pytest.mark.parametrize("border", [False, True])
def test_a_leaning_probe_comes_down_with_care_where_only_an_upright_one_has_been(border):
    """Its stick leads through other space; between two walls it had struck one with 34 N."""
    begin = BORDER if border else 0.03
    leaning = turned(UP, np.array([1.0, 0.0, 0.0]), 0.3) @ DOWN
    free, line = column(0.0, begin, 0.006), Line(1, 0.0, begin, -0.05, 0.006)
    for turn, care in ((DOWN, False), (leaning, not border)):
        pieces = Departure(np.array([0.05, 0.05, TOP]), turn, AREA, free, SPEEDS).path_to(line)
        down = next(piece for piece in pieces if piece.place[2] < TOP - RADIUS)
        assert (down.speed_limit is SpeedLimit.GUARDED) == care


@pytest.mark.parametrize("level", [0.01, 0.03])
def test_up_through_what_the_stick_alone_has_passed_the_probe_goes_level_to_a_known_column_first(level):
    """Straight up at the speed at which the flank may be met it took 8 s; a column 30 mm beside was known."""
    free = column(0.0, 0.03, level)
    here = np.array([0.0, 0.0, 0.01])
    stand(free, [0.0, -0.05, 0.02], here)
    pieces = way(Line(1, 0.05, -0.05, 0.05, TOP), here, free)
    up = next(k for k, piece in enumerate(pieces) if piece.place[2] == pytest.approx(TOP))
    assert pieces[up].speed_limit is SpeedLimit.FREE
    assert pieces[up].place[:2] == pytest.approx([0.0, 0.03], abs=SIDE)
    assert pieces[up - 1].place == pytest.approx([0.0, 0.03, level], abs=SIDE)
    assert pieces[up - 1].speed_limit is SpeedLimit.GUARDED


def test_a_level_path_that_ends_at_a_wall_is_slow_for_its_last_millimetres_only():
    free = stand(column(-0.05, 0.05, 0.006), *([-0.05, y, 0.006] for y in np.arange(0.049, 0.0009, -0.001)))
    wall = np.eye(4)
    wall[:3, :3], wall[:3, 3] = DOWN, (-0.05, 0.0, 0.006)
    free.note(wall, np.array([0.0, 1.0, 0.0]))
    *_, fast, slow = way(Line(0, 0.002, -0.05, -0.04, 0.006), [0.05, 0.05, TOP], free)
    assert (fast.speed_limit, slow.speed_limit) == (SpeedLimit.FREE, SpeedLimit.GUARDED)
    assert fast.place == pytest.approx([-0.05, 0.002 + BEFORE, 0.006])
    assert slow.place == pytest.approx([-0.05, 0.002, 0.006])


def test_a_known_touch_beside_the_place_is_sought_as_deep_as_a_steep_surface_may_be():
    for height, deepest in ((0.03, 0.03 - SOUGHT), (0.0065, 0.006)):
        *_, touch = way(Line(0, 0.0, 0.05, 0.06, height, on_surface=True, free_to=0.031), [0.0, 0.0, 0.05])
        assert (touch.speed_limit, touch.place[2]) == (SpeedLimit.GUARDED, pytest.approx(deepest))


def test_the_unknown_is_come_down_to_faster_as_far_as_the_stick_has_stood_there():
    free = stand(nowhere(), *([0.05, y, 0.03] for y in np.arange(-0.02, 0.0201, 0.001)))
    line = Line(0, 0.0, 0.05, 0.06, 0.02)
    *_, known, foot = way(line, [0.0, 0.0, 0.05], free)
    assert (known.speed_limit, foot.speed_limit) == (SpeedLimit.COLUMN, SpeedLimit.GUARDED)
    assert known.place == pytest.approx([0.05, 0.0, 0.03])
    beside = Line(0, 0.003, 0.05, 0.06, 0.02)
    free = stand(nowhere(), [0.05, 0.0, 0.03])
    assert SpeedLimit.COLUMN not in [piece.speed_limit for piece in way(beside, [0.0, 0.0, TOP], free)]


@pytest.mark.parametrize("on_surface", [False, True])
def test_far_below_the_top_of_the_area_the_probe_goes_level_just_above_what_was_touched(on_surface):
    low = TOP - FAR_BELOW - 0.001
    free = stand(nowhere(), [0.0, 0.0, low], normal=[0.0, 0.0, 1.0])
    line = Line(0, 0.01, -0.05, 0.05, low - 0.01, on_surface=on_surface, free_to=TOP)
    up, over, down = way(line, [0.0, 0.0, low], free)
    assert (up.speed_limit, over.speed_limit, down.speed_limit) == (
        SpeedLimit.COLUMN, SpeedLimit.GUARDED, SpeedLimit.GUARDED,
    )  # fmt: skip
    assert up.place[2] == over.place[2] == pytest.approx(low + GAP)
    assert tuple(over.place[:2]) == tuple(line.start[:2])
    assert tuple(down.place) == tuple(line.start)


def test_below_what_was_touched_a_level_path_is_no_faster_than_all_of_the_stick_may_meet_something():
    low = TOP - FAR_BELOW - 0.001
    free = stand(nowhere(), [-0.04, 0.0, low], normal=[0.0, 0.0, 1.0])
    line = Line(0, 0.01, -0.02, 0.05, 0.01)
    path = way(line, [-0.02, -0.02, 0.02], free)
    assert [piece.speed_limit for piece in path[-2:]] == [SpeedLimit.LEVEL, SpeedLimit.GUARDED]
    assert path[-2].place[2] == pytest.approx(0.02 + GAP)


def test_an_object_nearly_as_high_as_the_area_is_crossed_over_the_top():
    low = TOP - FAR_BELOW + 0.001
    free = stand(nowhere(), [0.0, 0.0, low], normal=[0.0, 0.0, 1.0])
    path = way(Line(0, 0.01, -0.05, 0.05, low - 0.01), [0.0, 0.0, low], free)
    assert any(piece.place[2] == TOP for piece in path)


def test_what_was_swept_in_a_wide_area_stays_known_in_a_part_of_it():
    free = column(0.0, 0.0, 0.02)
    stand(free, *([x, 0.0, 0.02] for x in np.arange(0.0, 0.05, 0.0011)))
    part = Area(np.array([-0.02, -0.02, AREA.lower[2]]), np.array([0.02, 0.02, TOP]))
    before = free.swept(np.array([0.0, 0.0, 0.02]), np.array([0.01, 0.0, 0.02])), free.clear_down_to(0.0, 0.0)
    assert not free.open_places(1, 0.0)[:, 0].max() > 0.003, "only where it came down"
    free.confine(part)
    assert before == (free.swept(np.array([0.0, 0.0, 0.02]), np.array([0.01, 0.0, 0.02])), free.clear_down_to(0.0, 0.0))
    assert free.open_places(1, 0.0)[:, 0].max() == pytest.approx(0.049, abs=0.002), "on its border nothing stands"
