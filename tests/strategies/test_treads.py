"""Lines over what goes on beside a tread, against passes and contacts drawn by hand."""

import numpy as np
import pytest

from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.floor_lines import FAR, floor_lines
from lwrprobe_strategies.planning.lines import X, Y
from lwrprobe_strategies.planning.treads import hollow_floors, treads
from strategy_task import AREA, task

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


class Beside:
    """A body that may be anywhere above a height, and elsewhere than within `off` m of y = 0 as low as it likes."""

    def __init__(self, off=0.0, above=1.0):
        self.off, self.above = off, above

    def lowest_at(self, line, rotation):
        places = np.linspace(line.begin, line.end, 101)
        y = places if line.axis == Y else np.full(101, line.place)
        return places, np.where(np.abs(y) < self.off, self.above, 0.0)

    def lowest(self, line, rotation):
        places, needed = self.lowest_at(line, rotation)
        return places, np.maximum.accumulate(needed)


def lines_of(memory, axis=Y, places=XS, body=None):
    return treads(memory.contacts(), memory.trail(), axis, places, task(), PITCH, body or Beside())


def test_a_tread_that_was_touched_is_sought_on_the_lines_beside_it():
    lines = lines_of(plate())
    assert sorted({line.place for line in lines}) == pytest.approx([-PITCH, PITCH])
    for line in lines:
        assert line.height == pytest.approx(PLATE + RADIUS, abs=0.004)
        assert line.begin in (AREA.lower[1], AREA.upper[1])
        assert not line.on_surface, "from the border nothing stands before the tread"
        assert line.ceiling < WALL


def test_where_something_stands_before_it_a_line_comes_down_on_the_tread_far_from_the_wall():
    memory = plate()
    for y in (-0.07, 0.07):
        for x in XS:
            memory.add(np.array([x, 1.07 * y, WALL]), np.array([x, y, WALL]), np.array([0.0, np.sign(y), 0.0]), x)
    lines = lines_of(memory)
    assert sorted({line.place for line in lines}) == pytest.approx([-PITCH, PITCH])
    for line in lines:
        assert line.on_surface
        assert line.free_to == pytest.approx(HEIGHT)
        assert abs(line.begin) > abs(line.end) or line.begin * line.end < 0.0
        assert 0.004 + RADIUS < abs(line.begin) < 0.07 - RADIUS


def test_no_line_leads_over_a_tread_to_which_the_body_may_not_come():
    assert lines_of(plate(), body=Beside(off=0.2)) == []
    for line in lines_of(plate(), body=Beside(off=0.02)):
        assert min(abs(line.begin), abs(line.end)) >= 0.018


def test_what_no_line_along_y_comes_to_is_crossed_along_x():
    memory = ContactMemory()
    for y in np.arange(-0.03, 0.0301, 0.001):
        touch(memory, -0.031, y, PLATE, -0.031)
    lines = lines_of(memory, X, np.array([0.0]))
    assert [(line.axis, line.place, line.begin) for line in lines] == [(X, 0.0, AREA.lower[0])]


def test_a_line_that_passed_low_close_by_shows_that_the_tread_ends():
    memory = ContactMemory()
    for y in np.arange(-0.03, 0.0301, 0.001):
        touch(memory, -0.031, y, PLATE, -0.031)
    for x in (-0.021, -0.041):
        for y in np.arange(-0.1, 0.1001, 0.001):
            memory.passed(np.array([x, y, RADIUS + 0.001]), x)
    assert lines_of(memory, X, np.array([-0.02, 0.0, 0.02])) == []


def floors(memory, body, across=(), plate=()):
    places, plate = (np.array(across), XS), np.array(plate).reshape(-1, 2)
    return floor_lines(memory.contacts(), memory.trail(), places, task(), HEIGHT, PITCH, body, plate)


def test_floor_that_lines_passed_above_is_looked_at_as_far_in_as_the_body_may_go():
    lines = floors(plate(led=()), Beside(off=0.015))
    assert {line.begin for line in lines} == {AREA.lower[1], AREA.upper[1]}
    for line in lines:
        assert line.height == AREA.lower[2]
        assert 0.015 <= abs(line.end) <= 0.019
        assert line.begin * line.end > 0.0
    apart = np.diff(sorted(line.place for line in lines if line.begin < 0.0))
    assert len(apart) > 1
    assert apart.min() > PITCH + 1e-6, "a line shows what is beside it"


def test_far_from_the_object_lines_on_the_floor_are_as_far_apart_as_what_else_may_stand_there_is_wide():
    memory = ContactMemory()
    for y in np.arange(-0.05, -0.0399, 0.001):
        touch(memory, -0.04, y, WALL, -0.04)
    lines = floors(memory, Beside())
    along = np.sort([line.place for line in lines if line.axis == Y])
    far = along[along > -0.04 + 2.5 * PITCH]
    assert (np.diff(far) > 2.0 * PITCH).all()
    assert far.max() > XS.max() - FAR - 1e-6, "no floor is left out"


def test_where_the_body_may_come_nearly_to_the_floor_far_from_the_object_a_line_leads_as_low():
    memory = ContactMemory()
    for y in np.arange(-0.05, -0.0399, 0.001):
        touch(memory, -0.04, y, WALL, -0.04)
    low = AREA.lower[2] + 0.3 * PITCH
    lines = floors(memory, Beside(off=0.05, above=low))
    assert any(line.height == pytest.approx(low) and line.place > 0.0 for line in lines)
    assert all(line.height == AREA.lower[2] for line in floors(memory, Beside(off=0.05, above=low + PITCH)))


def test_far_from_the_object_each_floor_is_looked_at_once_by_as_few_lines_as_it_takes():
    """A hull had 18 lines on the floor around it, a quarter of the run: along both axes, 20 mm apart, on the border."""
    memory = ContactMemory()
    for y in np.arange(-0.05, -0.0399, 0.001):
        touch(memory, -0.04, y, WALL, -0.04)
    low = AREA.lower[2] + 0.3 * PITCH
    everywhere, body = np.arange(AREA.lower[0], AREA.upper[0] + 1e-9, PITCH), Beside(off=0.05, above=low)
    known = memory.contacts(), memory.trail(), (everywhere, everywhere), task(), HEIGHT, PITCH, body, np.empty((0, 2))
    far = [line for line in floor_lines(*known) if line.height == pytest.approx(low)]
    assert {line.axis for line in far} == {Y}
    places = np.unique(np.round([line.place for line in far], 6))
    places = places[places > -0.04 + 2.5 * PITCH + FAR]
    assert np.diff(places) == pytest.approx(2.0 * FAR)
    assert places.max() == pytest.approx(AREA.upper[0] - FAR)


class Around(Beside):
    """A body that may be as low as it likes where it is farther than `off` m from x = 0."""

    def lowest_at(self, line, rotation):
        places = np.linspace(line.begin, line.end, 101)
        x = places if line.axis == X else np.full(101, line.place)
        return places, np.where(np.abs(x) < self.off, self.above, 0.0)


def test_a_side_beside_which_the_grid_has_passed_is_met_along_x_unless_its_foot_was_touched():
    memory = plate(led=())
    for x in (-0.085, -0.05, 0.05, 0.085):  # the grid has passed there, as low as the floor
        for y in np.arange(-0.1, 0.1001, 0.001):
            memory.passed(np.array([x, y, RADIUS + 0.001]), x)
    across = [line for line in floors(memory, Around(off=0.03), across=(0.0,)) if line.axis == X]
    assert sorted((line.begin, np.sign(line.end)) for line in across) == [
        (AREA.lower[0], -1.0), (AREA.upper[0], 1.0),
    ]  # fmt: skip
    assert all(0.03 <= abs(line.end) <= 0.034 and line.height == AREA.lower[2] for line in across)
    point = np.array([0.03, 0.0, RADIUS])
    memory.add(point + RADIUS * np.array([1.0, 0.0, 0.0]), point, np.array([1.0, 0.0, 0.0]), np.nan)
    again = [line for line in floors(memory, Around(off=0.03), across=(0.0,)) if line.axis == X]
    assert [line.begin for line in again] == [AREA.lower[0]]


def test_around_a_plate_that_was_met_lines_are_nearer_to_each_other():
    lines = floors(plate(led=()), Beside(off=0.015), plate=[(x, -0.03) for x in XS])
    assert np.diff(sorted(line.place for line in lines if line.begin < 0.0)) == pytest.approx(PITCH)
    assert np.diff(sorted(line.place for line in lines if line.begin > 0.0)).min() > PITCH + 1e-6, "none was met there"


def test_no_floor_is_looked_at_twice_or_where_the_body_may_not_go():
    assert floors(plate(led=()), Beside(off=1.0)) == []
    assert floors(ContactMemory(), Beside()) == []
    memory = plate(led=())
    for x in (*XS, -0.05, 0.05):
        for y in np.arange(-0.1, 0.1001, 0.001):
            memory.passed(np.array([x, y, RADIUS + 0.001]), x)
    assert floors(memory, Beside()) == []


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


@pytest.mark.parametrize(("lowest", "walls", "count"), [(0.0, (-0.03, 0.03), 1), (HEIGHT - 0.004, (-0.03, 0.03), 0),
                                                        (0.0, (-0.03,), 0)])  # fmt: skip
def test_between_walls_a_line_comes_down_to_the_floor_of_which_nothing_was_touched(lowest, walls, count):
    """The floor within a mug: lines had passed from wall to wall, and beside the walls nobody had come lower."""
    memory = ContactMemory()
    for y in np.arange(-0.1, 0.1001, 0.001):
        if min(abs(y - wall) for wall in walls) < 0.006:
            touch(memory, 0.0, y, WALL, 0.0)
        else:
            memory.passed(np.array([0.0, y, HEIGHT]), 0.0)

    class Above(Beside):
        def lowest_at(self, line, rotation):
            places, needed = super().lowest_at(line, rotation)
            return places, np.maximum(needed, lowest)

    given = memory.contacts(), memory.trail(), Y, np.zeros(1), task(), PITCH, Above()
    floors = hollow_floors(task(), PITCH)
    lines = treads(*given, floors)
    assert len(lines) == count
    for line in lines:
        assert line.on_surface
        assert line.free_to == pytest.approx(HEIGHT)
        assert line.height <= RADIUS + 0.001
        assert -0.03 < min(line.begin, line.end) < -0.01 < 0.01 < max(line.begin, line.end) < 0.03
        for y in np.arange(-0.02, 0.0201, 0.001):
            touch(memory, 0.0, y, 0.0, 0.0)
        assert not treads(memory.contacts(), memory.trail(), *given[2:], floors), "it has been touched"


def test_space_that_is_not_known_is_no_wall():
    """Beside two stacked blocks, where the body may come down here and there, such lines took 256 s."""
    memory = ContactMemory()
    for y in np.arange(-0.1, 0.1001, 0.001):
        memory.passed(np.array([0.0, y, HEIGHT]), 0.0)
        touch(memory, 0.02, y, WALL, 0.02)  # the top of what the line leads along

    class Here(Beside):
        def lowest_at(self, line, rotation):
            places, _ = super().lowest_at(line, rotation)
            return places, np.where(np.abs(places) < 0.02, 0.0, HEIGHT)

    given = memory.contacts(), memory.trail(), Y, np.zeros(1), task(), PITCH, Here()
    assert treads(*given, hollow_floors(task(), PITCH)) == []
