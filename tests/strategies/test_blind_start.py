"""A blind start against analytic surfaces, without robot and simulator: found, bounded, missed, and how it ends."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from fake_surface import FakeSurface, box

from lwrprobe.contracts import Area, Done, InputError
from lwrprobe.scene.scene import ProbeTable
from lwrprobe_strategies.active import Active
from lwrprobe_strategies.blind_start import to_front
from lwrprobe_strategies.object_search import ObjectSearch
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.search_places import SearchPlaces
from lwrprobe_strategies.skills.presses import PRESSED, PRESSES
from lwrprobe_strategies.supervisor import SkillStrategy
from strategy_task import task

AREA = Area(np.array([-0.075, -0.065, 0.006]), np.array([0.075, 0.065, 0.13]))
SMALL = Area(np.array([-0.05, -0.045, 0.006]), np.array([0.05, 0.045, 0.13]))
TASK = replace(
    task(approach=0.03, area=AREA, links=ProbeTable().as_probe().links),
    free_speed=0.2, search_for=0.05, start=np.array([0.0, -0.065, 0.13]),
)  # fmt: skip


class Nothing(SkillStrategy):
    """Ends as soon as the object is bounded."""

    def program(self):
        return Done("bounded")
        yield


def at(distance, x, y, angle=0.0):
    """A surface, turned about the vertical and moved."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return lambda p: distance(turn @ (p - [x, y, 0.0]))


class Told(Active):
    """Ends before its first stroke."""

    def scheduler(self):
        lines = super().scheduler()
        lines.next = lambda here: None
        return lines


class GoesOn(SkillStrategy):
    """Its first program touches the object on the right side of what was bounded, `height` m above the table."""

    def __init__(self, height):
        self.height, self.explored = height, []

    def program(self):
        area = self.task.area
        self.explored.append(area)
        for y in (0.0, 0.01, 0.02) if len(self.explored) == 1 else ():
            centre = np.array([area.upper[0], y, self.height + TASK.probe.radius])
            self.tip.memory.add(centre, centre - [0.0, 0.0, TASK.probe.radius], np.array([0.0, 0.0, 1.0]), np.nan)
        return Done("explored")
        yield


def explore(distance, area=AREA, samples=100_000, score=lambda seen: None, strategy=None):
    """The strategy after its end, how it ended, the surface, and where the tip was.

    `score` gives the confidence score of a contact, None for the surface's own.
    """
    given = replace(TASK, area=area, start=np.array([0.0, area.lower[1], area.upper[2]]))
    strategy, surface, places = strategy or Nothing(), FakeSurface(distance, given, given.start, stiffness=2000.0), []
    strategy.start(given)
    seen = surface.look()
    for _ in range(samples):
        motion = strategy.step(seen)
        if isinstance(motion, Done):
            return strategy, motion, surface, np.array(places)
        seen = surface.obey(motion)
        if seen.contact is not None and score(seen) is not None:
            seen.contact.confidence_score = score(seen)
        places.append(seen.pose[:3, 3].copy())
    raise AssertionError(f"still {strategy.tip.trace.state}")


def inside(strategy, half, x, y, angle):
    """The corners of a turned block lie in the bounds, as far from their border as the sphere needs; m to spare."""
    c, s = np.cos(angle), np.sin(angle)
    corners = np.array([[i * half[0], j * half[1]] for i in (-1, 1) for j in (-1, 1)]) @ [[c, s], [-s, c]] + [x, y]
    area = strategy.bounds.area
    return min((corners - area.lower[:2]).min(), (area.upper[:2] - corners).min())


@pytest.mark.parametrize(
    ("half", "height", "x", "y", "angle"),
    [
        ((0.04, 0.025), 0.05, 0.0, 0.0, 0.4),
        ((0.03, 0.02), 0.1, 0.0, 0.0, 0.8),
        ((0.025, 0.025), 0.04, -0.03, -0.02, 0.0),
    ],
)
@pytest.mark.slow
def test_a_block_is_found_and_bounded_wherever_it_is(half, height, x, y, angle):
    strategy, done, surface, places = explore(at(box(half, height), x, y, angle))
    assert done.reason == "bounded"
    assert done.complete
    assert 0.0 < strategy.bounds.found_at < strategy.bounds.bounded_at
    assert strategy.task.tallest == pytest.approx(height, abs=0.001)
    assert inside(strategy, half, x, y, angle) > 2.0 * TASK.probe.radius
    assert strategy.bounds.area.upper[2] == AREA.upper[2]
    assert surface.peak <= TASK.force_limit
    assert (places >= AREA.lower - 1e-3).all()
    assert (places <= AREA.upper + 1e-3).all()


@pytest.mark.parametrize(("height", "seconds"), [(0.1, 5.2), (0.05, 19.5), (0.025, 33.0)])
def test_what_is_in_the_middle_is_found_at_the_first_place(height, seconds):
    """As long as helix, descent and circle take: 5 mm/s over 50 mm, 7 mm/s below, and 9 s around."""
    strategy, _, surface, _ = explore(at(box((0.02, 0.02), height), 0.0, 0.0, 0.3), SMALL)
    assert strategy.bounds.found_at < seconds
    assert surface.peak <= TASK.force_limit


@pytest.mark.parametrize(
    ("distance", "pressed"),
    [
        (box((0.02, 0.02), 0.05), True),
        (lambda p: np.linalg.norm(p - [-0.022, 0.0, 0.03]) - 0.03, False),  # met on its flank, across the stick
    ],
)
def test_what_is_touched_along_the_stick_is_pressed_several_times(distance, pressed):
    forces = []
    note = lambda seen: forces.append(float(seen.force[2]))  # noqa: E731
    _, _, surface, _ = explore(distance, SMALL, score=note)
    high = np.array(forces[:6000]) > 0.95 * PRESSED * TASK.force_target
    presses = np.count_nonzero(np.diff(high.astype(int)) == 1)
    assert (presses >= PRESSES) == pressed
    assert surface.peak <= TASK.force_limit


def test_strokes_begin_with_what_bounded_the_object():
    """The outline as low as the body may go, and the crossings of the top, are not driven again."""
    strategy, _, _, _ = explore(at(box((0.02, 0.02), 0.05), 0.0, 0.0, 0.3), SMALL, strategy=Told())
    strategy.estimate.update()
    faces = strategy.estimate.faces()
    walls = faces.axes != 2
    assert faces.areas[walls].sum() > 0.8 * 4.0 * 0.05 * 0.05
    assert np.average(faces.distances, weights=faces.areas) < Active.Config().step
    assert faces.centres[:, 2].max() < 0.05 + TASK.probe.radius + 0.006  # walls go no higher than what was touched


def test_a_touch_from_above_is_one_of_the_sphere_whatever_its_torque_says():
    high = 0.05 + TASK.probe.radius - 0.002
    never = lambda seen: 0.0 if seen.pose[2, 3] > high and seen.time < 30.0 else None  # noqa: E731
    strategy, _, surface, _ = explore(at(box((0.02, 0.02), 0.05), 0.0, 0.0, 0.3), SMALL, score=never)
    assert strategy.bounds.found_at < 19.5
    assert surface.peak <= TASK.force_limit


def test_an_outline_goes_on_over_contacts_that_are_imprecise():
    low = lambda seen: 0.3 if seen.pose[2, 3] < 0.04 else None  # noqa: E731
    strategy, _, _, _ = explore(at(box((0.015, 0.015), 0.04), 0.0, 0.0, 0.3), SMALL, score=low)
    assert inside(strategy, (0.015, 0.015), 0.0, 0.0, 0.3) > 2.0 * TASK.probe.radius
    assert (strategy.bounds.area.upper - strategy.bounds.area.lower)[0] < (SMALL.upper - SMALL.lower)[0] - 0.01


@pytest.mark.parametrize(("height", "times"), [(0.02, 2), (0.001, 1)])
def test_where_the_object_goes_on_beyond_what_was_bounded_more_of_the_area_is_explored(height, times):
    """An outline above the floor says nothing of what is lower; what is touched as low as the table is the table."""
    strategy, done, _, _ = explore(at(box((0.015, 0.015), 0.05), 0.0, 0.0), SMALL, strategy=GoesOn(height))
    assert done.reason == "explored"
    first, *more = strategy.explored
    assert len(more) == times - 1
    for area in more:
        assert area.upper[0] == pytest.approx(min(first.upper[0] + TASK.search_for, SMALL.upper[0]))
        assert (area.lower == first.lower).all()
        assert strategy.bounds.area.upper[0] == area.upper[0] == strategy.task.area.upper[0]


@pytest.mark.slow
def test_a_flat_object_is_found_last():
    strategy, _, _, places = explore(at(box((0.02, 0.02), 0.008), 0.0, 0.0), SMALL)
    low = places[:, 2] < 0.02
    assert strategy.bounds is not None
    assert strategy.task.tallest == pytest.approx(0.008, abs=0.001)
    assert not low[: len(low) // 2].any()  # all places were searched for what is taller before


def test_an_empty_table_is_said_to_be_empty_with_what_may_have_been_missed():
    strategy, done, _, _ = explore(lambda p: 1.0, SMALL)
    assert done.complete
    assert strategy.bounds is None
    assert done.reason.startswith("nothing found; nothing was missed over which a level circle of ")
    assert float(done.reason.split()[-3]) <= 1e3 * TASK.search_for


@pytest.mark.slow
def test_the_same_surface_gives_the_same_motions():
    once, again = (explore(at(box((0.02, 0.02), 0.05), 0.0, 0.0, 0.4), SMALL)[3] for _ in range(2))
    assert np.array_equal(once, again)


def test_the_body_goes_nowhere_beside_what_may_be_taller():
    """Above the stick the probe is wider than its sphere: below the helix it stays within what that has swept."""
    _, _, _, places = explore(lambda p: 1.0, SMALL)
    sensor_bottom, body_radius = 0.05, 0.0125
    first = places[: np.flatnonzero((np.diff(places[:, 2]) > 0.0) & (places[:-1, 2] < 0.05))[0]]
    low = first[first[:, 2] < SMALL.upper[2] - TASK.probe.radius - sensor_bottom]
    swept = first[first[:, 2] > SMALL.upper[2] - TASK.probe.radius - sensor_bottom]
    reach = np.hypot(*swept[:, :2].T).max() + TASK.probe.radius
    assert np.hypot(*low[:, :2].T).max() + body_radius < reach


@pytest.mark.parametrize("smallest", [0.03, 0.04, 0.06])
def test_what_is_said_to_be_missed_bounds_what_a_search_misses(smallest):
    reach = 0.01
    search = SearchPlaces(AREA, reach, smallest, 0.012)
    places = search.places()
    assert search.missed() == np.inf
    for place in places:
        search.searched(place)
    assert search.missed() <= smallest
    random = np.random.default_rng(1)
    low, high = AREA.lower[:2] + 0.5 * smallest, AREA.upper[:2] - 0.5 * smallest
    centres = random.uniform(low, high, (5000, 2))
    apart = np.hypot(*(centres[:, None] - np.array(places)[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() <= reach + 0.5 * search.missed()


@pytest.mark.parametrize(("smallest", "keep", "field"), [(0.2, 0.01, "search_for"), (0.03, 0.08, "area")])
def test_an_area_without_room_for_the_search_or_for_what_is_sought_is_refused(smallest, keep, field):
    with pytest.raises(InputError, match=field):
        SearchPlaces(AREA, 0.01, smallest, keep)


def test_a_large_area_is_searched_without_much_memory():
    """All pairs of places 4 mm apart had been 1.6 GB in an area of 400 mm."""
    wide = Area(np.array([-0.2, -0.2, 0.006]), np.array([0.2, 0.2, 0.13]))
    tracemalloc.start()
    places = SearchPlaces(wide, 0.005, 0.06, 0.0205).places()
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 3e8
    assert len(places) < 120


def test_where_the_first_pass_was_interrupted_the_second_one_does_not_dive(monkeypatch):
    """It had gone at 200 mm/s to where nothing had been."""
    passes, dived, interrupted = [], [], []

    def down(self, place):
        passes.append(place)
        if place not in interrupted and len(passes) % 3 == 1:
            interrupted.append(place)
            return None
        return Ended.NO_CONTACT
        yield

    def further(self, place, known, low):
        dived.append(place)
        return Ended.NO_CONTACT
        yield

    monkeypatch.setattr(ObjectSearch, "_down", down)
    monkeypatch.setattr(ObjectSearch, "_further", further)
    explore(lambda p: 1.0, SMALL)
    assert interrupted
    assert set(interrupted) < set(dived)
    assert all(passes.count(place) == (2 if place in interrupted else 1) for place in dived)


def test_the_first_places_meet_most_objects_wherever_they_are():
    """Of objects 60 to 80 mm wide the first six places meet 86 %; one size after the other it was 73 %."""
    wide = Area(np.array([-0.12, -0.1, 0.006]), np.array([0.12, 0.1, 0.13]))
    places = np.array(SearchPlaces(wide, 0.005, 0.04, 0.0205).places()[:6])
    random = np.random.default_rng(2)
    half = random.uniform(0.03, 0.04, 5000)
    centres = random.uniform(-1.0, 1.0, (5000, 2)) * (wide.upper[:2] - half[:, None])
    apart = np.hypot(*(centres[:, None] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert (apart <= half + 0.005).mean() > 0.84


def test_places_lead_from_coarse_to_fine_and_begin_in_the_middle():
    fine, coarse = (SearchPlaces(AREA, 0.01, size, 0.012).places() for size in (0.03, 0.06))
    assert np.allclose(fine[0], 0.0, atol=1e-9)
    assert len(coarse) < len(fine)


@pytest.mark.parametrize(
    ("place", "way"),
    [
        ((0.01, -0.065), []),
        ((0.075, 0.02), [(0.075, 0.02), (0.075, -0.065)]),
        ((-0.03, 0.065), [(-0.075, 0.065), (-0.075, -0.065)]),
    ],
)
def test_the_side_where_lines_begin_is_reached_along_the_border(place, way):
    here = np.array([*place, 0.01])
    assert np.allclose(
        np.array(to_front(here, AREA)).reshape(-1, 3), [(*there, 0.01) for there in way] or np.empty((0, 3))
    )
