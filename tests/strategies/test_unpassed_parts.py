"""Lines between two parts of the object that no line has passed, from what a probe drawn by hand has shown."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.body_space import CELL, BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import X
from lwrprobe_strategies.planning.unpassed_parts import unknown_between, unpassed_parts
from strategy_task import DOWN, task

LINKS = load_scene("block").probe.as_probe().links
AREA = Area(np.array([-0.06, -0.06, 0.006]), np.array([0.06, 0.06, 0.108]))
PITCH, HEIGHT, TOP, RADIUS = 0.01, 0.056, 0.09, 0.005
REACH = round(PITCH / CELL)
XS = np.arange(-0.06, 0.0601, PITCH)


def pose(x, y, z):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = DOWN, (x, y, z)
    return found


def space(width, slant=0.0, over=False, facing=1.0):
    """A slot of a `width` between two walls along x, to which lines along y come from both borders; and the contacts.

    They come down into the slot and lead on level, along both walls, or go `over` it. It leads `slant` m in y for each
    m in x. The walls are each other's other side, of something solid, where they have their normals the other way
    round (`facing` = -1).
    """
    found, memory = BodySpace(replace(task(links=LINKS, area=AREA)), PITCH), ContactMemory()

    def touch(x, y, z, normal):
        place = np.array([x, y, z])
        found.note(pose(x, y, z), place - RADIUS * normal)
        memory.add(place, place - RADIUS * normal, normal, x)

    on = facing * np.array([0.0, 1.0, 0.0])
    for x in XS:
        middle = slant * x
        for y in np.arange(-0.06, 0.0601, 0.0005):
            off = abs(y - middle) - 0.5 * width
            if off > 0.01:
                found.note(pose(x, y, HEIGHT), None)
            elif off > 0.0:
                touch(x, y, TOP, np.array([0.0, 0.0, 1.0]))
            elif over:
                found.note(pose(x, y, TOP), None)
        for z in np.arange(HEIGHT, TOP, 0.001) if not over else ():
            touch(x, middle - 0.5 * width, z, on)
            touch(x, middle + 0.5 * width, z, -on)
    for x in np.arange(-0.06, 0.0601, 0.0005) if not over else ():
        touch(x, slant * x - 0.5 * width, HEIGHT, on)
        touch(x, slant * x + 0.5 * width, HEIGHT, -on)
    found.survey()
    return found, memory.contacts()


def drive(body, lines):
    for line in lines:
        for x in np.arange(-0.06, 0.0601, 0.0005):
            body.note(pose(x, line.place, HEIGHT), None)
    body.survey()


@pytest.mark.parametrize(("width", "count"), [(0.018, 1), (0.028, 2), (0.038, 3)])
def test_as_many_lines_are_driven_through_a_slot_as_it_takes_to_know_all_of_it(width, count):
    (body, contacts), places = space(width), []
    while lines := unpassed_parts(contacts, body, AREA, HEIGHT, PITCH):
        assert all((line.axis, line.height, abs(line.begin)) == (X, HEIGHT, 0.06) for line in lines)
        places += [line.place for line in lines]
        drive(body, lines)
    assert len(places) == count
    apart = np.diff(np.sort([-0.5 * width, *places, 0.5 * width]))
    assert (apart < PITCH + 0.0031).all(), "squares beside the stick are known, on both sides"
    assert not unknown_between(contacts, body, REACH)[5:-5].any()


def test_a_slot_that_lines_have_passed_over_needs_none():
    body, contacts = space(0.028, over=True)
    assert unpassed_parts(contacts, body, AREA, HEIGHT, PITCH) == []


def test_no_line_is_driven_through_something_solid():
    """A line of the grid that turned level on both sides of a tall block had left its middle unknown."""
    body, contacts = space(0.028, facing=-1.0)
    assert unpassed_parts(contacts, body, AREA, HEIGHT, PITCH) == []


@pytest.mark.parametrize("slant", [0.3, -0.5])
def test_beside_the_lines_through_a_slot_that_stands_aslant_nothing_is_left(slant):
    """Naive twin: every square of which nothing is known has a line within a pitch along y, or few beside it."""
    body, contacts = space(0.02, slant)
    lines = unpassed_parts(contacts, body, AREA, HEIGHT, PITCH)
    assert lines
    xs, ys = body.places(*np.nonzero(unknown_between(contacts, body, REACH))).T
    assert len(xs) > 500
    shown = np.zeros(len(xs), dtype=bool)
    for line in lines:
        low, high = sorted((line.begin, line.end))
        shown |= (np.abs(ys - line.place) < PITCH + 0.0011) & (xs > low - 0.0005) & (xs < high + 0.0005)
    assert shown.mean() > 0.9


def test_what_such_a_line_has_shown_lets_the_body_come_down():
    body, contacts = space(0.018)
    lines = unpassed_parts(contacts, body, AREA, HEIGHT, PITCH)
    above = pose(0.0, lines[0].place, HEIGHT - 0.02)
    assert not body.knows(above)
    before = body.depth(above[None])[0]
    drive(body, lines)
    assert body.depth(above[None])[0] < before - 0.005
