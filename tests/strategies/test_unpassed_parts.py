"""Lines between two parts of the object that no line has passed, from what a probe drawn by hand has shown."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.lines import X
from lwrprobe_strategies.planning.unpassed_parts import unpassed_parts
from strategy_task import DOWN, task

LINKS = load_scene("block").probe.as_probe().links
AREA = Area(np.array([-0.06, -0.06, 0.006]), np.array([0.06, 0.06, 0.108]))
PITCH, HEIGHT, TOP = 0.01, 0.056, 0.09
XS = np.arange(-0.06, 0.0601, PITCH)


def pose(x, y, z):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = DOWN, (x, y, z)
    return found


def space(width, slant=0.0, over=False):
    """A slot of a `width` between two walls along x, to which lines along y come from both borders.

    They come down into the slot and lead on level, along both walls, or go `over` it. It leads `slant` m in y for each
    m in x.
    """
    found = BodySpace(replace(task(links=LINKS, area=AREA)), PITCH)
    for x in XS:
        middle = slant * x
        for y in np.arange(-0.06, 0.0601, 0.0005):
            off = abs(y - middle) - 0.5 * width
            if off > 0.01:
                found.note(pose(x, y, HEIGHT), False)
            elif off > 0.0:
                found.note(pose(x, y, TOP), True)
            elif over:
                found.note(pose(x, y, TOP), False)
        for z in np.arange(HEIGHT, TOP, 0.001) if not over else ():
            found.note(pose(x, middle - 0.5 * width, z), True)
            found.note(pose(x, middle + 0.5 * width, z), True)
    for x in np.arange(-0.06, 0.0601, 0.0005) if not over else ():
        found.note(pose(x, slant * x - 0.5 * width, HEIGHT), True)
        found.note(pose(x, slant * x + 0.5 * width, HEIGHT), True)
    found.survey()
    return found


def drive(body, lines):
    for line in lines:
        for x in np.arange(-0.06, 0.0601, 0.0005):
            body.note(pose(x, line.place, HEIGHT), False)
    body.survey()


@pytest.mark.parametrize(("width", "count"), [(0.018, 1), (0.028, 2), (0.038, 3)])
def test_as_many_lines_are_driven_through_a_slot_as_it_takes_to_know_all_of_it(width, count):
    body, places = space(width), []
    while lines := unpassed_parts(body, AREA, HEIGHT, PITCH):
        assert all((line.axis, line.height, abs(line.begin)) == (X, HEIGHT, 0.06) for line in lines)
        places += [line.place for line in lines]
        drive(body, lines)
    assert len(places) == count
    apart = np.diff(np.sort([-0.5 * width, *places, 0.5 * width]))
    assert (apart < PITCH + 0.0031).all(), "squares beside the stick are known, on both sides"
    assert not body.between_touched()[5:-5].any()


def test_a_slot_that_lines_have_passed_over_needs_none():
    assert unpassed_parts(space(0.028, over=True), AREA, HEIGHT, PITCH) == []


@pytest.mark.parametrize("slant", [0.3, -0.5])
def test_beside_the_lines_through_a_slot_that_stands_aslant_nothing_is_left(slant):
    """Naive twin: every square of which nothing is known has a line within a pitch along y, or few beside it."""
    body = space(0.02, slant)
    lines = unpassed_parts(body, AREA, HEIGHT, PITCH)
    assert lines
    xs, ys = body.places(*np.nonzero(body.between_touched())).T
    assert len(xs) > 500
    shown = np.zeros(len(xs), dtype=bool)
    for line in lines:
        low, high = sorted((line.begin, line.end))
        shown |= (np.abs(ys - line.place) < PITCH + 0.0011) & (xs > low - 0.0005) & (xs < high + 0.0005)
    assert shown.mean() > 0.9


def test_what_such_a_line_has_shown_lets_the_body_come_down():
    body = space(0.018)
    lines = unpassed_parts(body, AREA, HEIGHT, PITCH)
    above = pose(0.0, lines[0].place, HEIGHT - 0.02)
    assert not body.knows(above)
    before = body.depth(above[None])[0]
    drive(body, lines)
    assert body.depth(above[None])[0] < before - 0.005
