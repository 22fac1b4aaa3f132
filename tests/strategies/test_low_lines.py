"""Lines below those of the grid, against passes and contacts drawn by hand."""

import numpy as np
import pytest

from lwrprobe.contracts import Area, LinkShape
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.low_lines import low_lines
from lwrprobe_strategies.planning.low_sides import left_below
from strategy_task import task

TALL = Area(np.array([-0.06, -0.06, 0.006]), np.array([0.06, 0.06, 0.1]))
HEIGHT, PITCH, HALF, TOP = 0.04, 0.01, 0.015, 0.08
BODY, BOTTOM = 0.012, 0.05
XS = np.arange(-0.06, 0.0601, PITCH)


def tall_task():
    pose = np.eye(4)
    pose[2, 3] = -BOTTOM - 0.05
    return task(area=TALL, links=(LinkShape("body", "cylinder", (BODY, 0.1), pose),))


def post(height=TOP, tread=0.01):
    """What lines at HEIGHT make of a square post: free up to it, and contacts over it and at its foot."""
    memory = ContactMemory()
    for x in XS:
        for y in np.arange(-0.06, 0.0601, 0.001):
            if abs(x) > HALF + 0.005 or abs(y) > HALF + 0.005:
                memory.passed(np.array([x, y, HEIGHT]), x)
            else:
                point = np.array([x, y, height])
                memory.add(point + np.array([0.0, 0.0, 0.005]), point, np.array([0.0, 0.0, 1.0]), x)
    if tread is not None:
        for x, y in ((-0.03, -0.03), (-0.03, 0.03), (0.03, -0.03), (0.03, 0.03)):
            point = np.array([x, y, tread])
            memory.add(point + np.array([0.0, 0.0, 0.005]), point, np.array([0.0, 0.0, 1.0]), np.nan)
    return memory


def lines_of(memory):
    return low_lines(memory.contacts(), memory.trail(), XS, PITCH, tall_task())


def test_nothing_is_passed_again_where_nothing_was_touched_or_all_was_passed_low():
    assert lines_of(ContactMemory()) == []
    assert lines_of(post(tread=None)) == [], "nothing says that there is anything low"
    memory = post()
    for x in XS:
        for y in np.arange(-0.06, 0.0601, 0.001):
            memory.passed(np.array([x, y, 0.006]), x)
    assert lines_of(memory) == []


def test_beside_a_tall_post_the_probe_passes_low_where_its_body_clears_the_post():
    lines = lines_of(post())
    assert lines
    for line in lines:
        ys = np.linspace(line.begin, line.end, 50)
        assert line.height < HEIGHT - 0.005
        beside = np.maximum(abs(line.place) - HALF, np.abs(ys) - HALF)
        if line.height + BOTTOM < TOP:
            assert (beside > BODY - 0.006).all(), "the body passes the post"
        assert abs(line.begin) == 0.06, "from the border, where nothing stands above the probe"
        assert abs(line.end - line.begin) >= PITCH
        assert line.low
    assert {round(line.place, 3) for line in lines} >= {-0.02, -0.01, 0.01, 0.02}


def test_where_a_line_was_given_up_the_rest_of_it_is_driven():
    memory = ContactMemory()
    for x in XS:
        for y in np.arange(-0.06, 0.0601, 0.001):
            if x == pytest.approx(0.01) and y > 0.0:
                continue
            memory.passed(np.array([x, y, 0.006]), x)
    point = np.array([0.01, 0.0, 0.006])
    memory.add(point, point, np.array([0.0, -1.0, 0.0]), XS[7])
    (line,) = lines_of(memory)
    assert line.place == pytest.approx(0.01)
    assert line.begin == 0.06, "from the other end"
    assert 0.004 > line.end > -0.002


def test_a_side_whose_touches_face_another_way_than_most_of_it_is_untouched():
    """A second wall on the line, aslant to the other side, decided the side's direction: the strategy had failed."""
    row = [0.0, -0.04, 0.05, 0.0, -0.04, 0.05, 0.95, 0.3, 0.0, 0.0]
    touch, away = np.array([0.0, -0.04, 0.05]), np.array([-0.95, 0.3, 0.0])
    line = Line(1, 0.0, -0.1, -0.04, 0.006, low=True, ceiling=0.05)
    assert left_below(line, touch, away, 0.0, np.array([row]), 0.01) == pytest.approx(0.01 * (0.044 + 0.005))
