"""Lines over what goes on beside a tread, against passes and contacts drawn by hand."""

import numpy as np
import pytest

from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.treads import treads
from strategy_task import AREA

PITCH, RADIUS, PLATE, WALL, HEIGHT = 0.01, 0.005, 0.010, 0.050, 0.030
XS = np.round(np.arange(-0.04, 0.0401, PITCH), 6)
UP = np.array([0.0, 0.0, 1.0])


def touch(memory, x, y, z, grid_x):
    point = np.array([x, y, z])
    memory.add(point + RADIUS * UP, point, UP, grid_x)


def plate(led=(0.0,)):
    """What lines at HEIGHT make of a plate with a wall across them at y = 0, which has led some down to the plate."""
    memory = ContactMemory()
    for x in XS:
        for y in np.arange(-0.05, 0.0501, 0.001):
            if abs(y) < 0.004:
                touch(memory, x, y, WALL, x)
            elif x in led and 0.009 < y < 0.03:
                touch(memory, x, y, PLATE, x)
            else:
                memory.passed(np.array([x, y, HEIGHT]), x)
    return memory


def lines_of(memory):
    return treads(memory.contacts(), memory.trail(), XS, AREA, RADIUS, PITCH)


def test_a_tread_that_was_touched_is_sought_on_the_lines_beside_it():
    lines = lines_of(plate())
    assert sorted({line.place for line in lines}) == pytest.approx([-PITCH, 0.0, PITCH])
    for line in lines:
        assert line.height == pytest.approx(PLATE + RADIUS, abs=0.004)
        assert line.on_surface
        assert line.free_to == pytest.approx(HEIGHT)
        assert abs(line.begin) > abs(line.end) or line.begin * line.end < 0.0, "it comes down far from the wall"
        assert abs(line.begin) > 0.004 + RADIUS
        assert line.ceiling < WALL


def test_each_round_leads_on_until_all_of_the_plate_was_touched():
    led = (0.0,)
    for count in (3, 5, 7, 9):
        lines = lines_of(plate(led))
        assert lines
        led = tuple(XS[np.abs(XS) < (0.5 + count // 2) * PITCH])
    memory = plate(led)
    for x in XS:
        for y in np.arange(-0.05, 0.0501, 0.001):
            touch(memory, x, y, PLATE, x)
        for y in (*np.arange(-0.07, -0.05, 0.001), *np.arange(0.051, 0.07, 0.001)):
            memory.passed(np.array([x, y, RADIUS]), x)
    assert lines_of(memory) == [], "beyond its ends lines have passed as low"


def test_without_a_tread_there_is_nothing_to_do():
    assert lines_of(ContactMemory()) == []
    assert lines_of(plate(led=())) == [], "only the wall's top was touched"


def test_a_tread_does_not_go_on_beyond_its_side():
    memory, before = plate(), {(line.place, line.begin) for line in lines_of(plate())}
    for y in np.arange(-0.05, 0.0501, 0.001):
        point, normal = np.array([0.004, y, PLATE - 0.002]), np.array([1.0, 0.0, 0.0])
        memory.add(point + RADIUS * normal, point, normal, np.nan)
    after = {(line.place, line.begin) for line in lines_of(memory)}
    assert after == {start for start in before if start[0] <= 0.0} != before
