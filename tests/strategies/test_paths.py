"""Ways to a line: nothing unknown is driven through fast, what is known is used, and the quicker way is taken."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import Area
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import HOVER, RISE, Pace, line_height, lowest_beside, path_to, seconds
from strategy_task import AREA, DOWN, task

LINKS = load_scene("block").probe.as_probe().links
TOP = float(AREA.upper[2])
BORDER = float(AREA.upper[1])


def safe_speed(along):
    return 0.007 if abs(along[2]) > 0.5 else 0.03


def way(line, here, touched=None):
    return path_to(line, np.array(here), DOWN, task(), ContactMemory() if touched is None else touched, safe_speed)


def column(x, y, low):
    """The memory of a probe that has stood in one place down to `low`."""
    touched = ContactMemory()
    for z in np.arange(low, 0.0601, 0.001):
        touched.passed(np.array([x, y, z]), x)
    return touched


def test_an_unknown_column_is_felt_all_the_way_down():
    line = Line(1, 0.03, BORDER, -BORDER, 0.006)
    pieces = way(line, [0.0, 0.0, 0.05])
    assert [piece.pace for piece in pieces[:-1]] == [Pace.FREE] * (len(pieces) - 1)
    assert all(piece.place[2] == TOP for piece in pieces[:-1])
    assert pieces[-1].pace is Pace.GUARDED
    assert tuple(pieces[-1].place) == tuple(line.start)


def test_a_column_the_probe_has_stood_in_is_come_down_fast_and_left_sideways():
    line = Line(1, 0.03, BORDER, -BORDER, 0.006)
    pieces = way(line, [0.0, 0.0, 0.05], column(0.02, BORDER, 0.006))
    *_, over, down, last = pieces
    assert over.place == pytest.approx([0.02, BORDER, TOP])
    assert (down.pace, last.pace) == (Pace.FREE, Pace.GUARDED)
    assert down.place == pytest.approx([0.02, BORDER, 0.006])
    assert tuple(last.place) == tuple(line.start)


def test_lines_across_come_down_where_the_grid_has_been():
    line = Line(0, 0.01, -0.06, -0.05, 0.006)
    *_, down, last = way(line, [0.0, 0.0, 0.05], column(-0.06, 0.005, 0.006))
    assert down.place == pytest.approx([-0.06, 0.005, 0.006])
    assert (down.pace, last.pace) == (Pace.FREE, Pace.GUARDED)


@pytest.mark.parametrize(("distance", "above"), [(0.01, False), (0.15, True)])
def test_along_the_border_or_over_the_top_whatever_is_quicker(distance, above):
    here = np.array([0.08, BORDER, 0.006])
    line = Line(1, 0.08 - distance, BORDER, -BORDER, 0.006)
    touched = column(line.place, BORDER, 0.006)
    pieces = way(line, here, touched)
    assert any(piece.place[2] == TOP for piece in pieces) is above
    along = abs(distance) / safe_speed(np.array([1.0, 0.0, 0.0]))
    assert seconds(pieces, here, task(), safe_speed) <= along + 0.5


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-0.09, 0.09), y=st.sampled_from([-BORDER, BORDER]), z=st.floats(0.006, 0.06),
    known=st.floats(-0.09, 0.09), low=st.floats(0.006, 0.05), height=st.floats(0.006, 0.04),
)  # fmt: skip
def test_only_known_or_high_places_are_driven_to_fast(x, y, z, known, low, height):
    touched = column(known, y, low)
    line = Line(1, x, y, -y, height)
    here = np.array([0.0, 0.0, z])
    stood = touched.trail()[:, :3]
    before = here
    for piece in way(line, here, touched):
        if piece.pace is Pace.FREE and np.abs(piece.place - before).max() > 1e-9:
            straight_up = np.abs(piece.place[:2] - before[:2]).max() < 1e-9 and piece.place[2] > before[2]
            high = min(piece.place[2], before[2]) >= TOP
            beside = np.abs(stood[:, :2] - piece.place[:2]).max(axis=1) < 1e-9
            been = beside.any() and piece.place[2] >= stood[beside, 2].min() - 1e-9
            assert straight_up or high or been
        before = piece.place
    assert np.abs(before - line.start).max() < 1e-9


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
        assert found <= line_height(t) + 0.15, "what was touched is no higher than what may be there"
    assert lowest_beside(line, np.empty((0, 3)), t) == t.area.lower[2]


def test_a_known_touch_is_come_down_to_fast_but_for_the_last_half_millimetre():
    line = Line(0, 0.0, 0.05, 0.06, 0.055, True, 0.056)
    *_, known, last = way(line, [0.0, 0.0, 0.05])
    assert known.place[2] == pytest.approx(0.056 + HOVER)
    assert (known.pace, last.pace) == (Pace.FREE, Pace.GUARDED)
    assert last.place[2] < line.height
