"""What upright lines below the grid show, and how fast a leaning probe goes there afterwards."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area, Observation
from lwrprobe.scene import load_scene
from lwrprobe_strategies.orientation_change import OrientationChange
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.body_space import WORSE, BodySpace
from lwrprobe_strategies.planning.free_space import FreeSpace
from lwrprobe_strategies.planning.lean import UP, turned
from lwrprobe_strategies.planning.lines import Line, X
from lwrprobe_strategies.planning.paths import SpeedLimit, Speeds
from lwrprobe_strategies.planning.shaft import SHORT_OF, stick_led_to
from lwrprobe_strategies.planning.survey_lines import survey_lines
from lwrprobe_strategies.skills import follow_contour
from strategy_task import DOWN, task

LINKS = load_scene("block").probe.as_probe().links
AREA = Area(np.array([-0.085, -0.06, 0.0062]), np.array([0.085, 0.06, 0.108]))
PITCH, GRID, FLOOR = 0.015, 0.056, float(AREA.lower[2])
PLACES = (-0.015, 0.0, 0.015)
LEANING = turned(UP, np.array([-1.0, 0.0, 0.0]), np.radians(20.0)) @ DOWN
LINE = Line(X, 0.0, float(AREA.lower[0]), -0.02, FLOOR, low=True, ceiling=GRID, rotation=LEANING)
SPEEDS = Speeds(free=1.0, column=0.012, guarded=lambda along: 0.005, known=0.06)


def pose(place, rotation=DOWN):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, place
    return found


def space(surveyed=(), to=-0.045):
    """An object that overhangs to x = -30 mm, beside which the grid has passed; and floor lines as far as `to` m."""
    found = BodySpace(replace(task(links=LINKS, area=AREA)), PITCH)
    for x in np.arange(-0.085, -0.0349, 0.001):
        for y in np.arange(-0.06, 0.0601, 0.001):
            found.note(pose((x, y, GRID)), None)
    for y in np.arange(-0.06, 0.0601, 0.001):
        for z in np.arange(GRID, 0.1, 0.001):
            found.note(pose((-0.035, y, z)), np.array([-0.03, y, z]))
    for y in surveyed:
        for x in np.arange(-0.085, to + 1e-9, 0.0005):
            found.note(pose((x, y, FLOOR)), None)
    found.survey()
    return found


def test_below_the_grid_the_sphere_fits_where_floor_lines_have_led_and_between_them_and_nowhere_else():
    found, before = space(PLACES), space()
    far, inside = pose((-0.075, 0.0, FLOOR)), pose((-0.058, 0.0, FLOOR))
    assert found.fits(far, inside)
    assert found.fits(pose((-0.075, 0.0075, FLOOR), LEANING), pose((-0.058, 0.0075, FLOOR), LEANING))
    assert not before.fits(far, inside), "the grid has passed 50 mm higher"
    assert not found.fits(far, pose((-0.04, 0.0, FLOOR))), "nothing has been there"
    assert not found.fits(pose((-0.075, 0.03, FLOOR)), pose((-0.058, 0.03, FLOOR))), "15 mm beside the last line"


@pytest.mark.parametrize("rotation", [DOWN, LEANING])
def test_along_a_line_the_probe_fits_to_just_before_what_is_not_known(rotation):
    whole = replace(LINE, rotation=rotation)
    naive = [x for x in np.arange(-0.085, -0.0199, 0.001) if space_is_known(x, rotation)]
    assert SURVEYED.fits_to(whole) == pytest.approx(max(naive), abs=0.0015)
    assert space().fits_to(whole) == LINE.begin


SURVEYED = space(PLACES)


def space_is_known(x, rotation):
    there, lifted = (pose((x, 0.0, height), rotation) for height in (FLOOR, FLOOR + WORSE))
    return SURVEYED.fits(pose((-0.084, 0.0, FLOOR), rotation), there) and SURVEYED.keeps_clear(lifted)


def test_before_a_line_that_leans_an_upright_one_leads_as_far_in_as_the_body_may_go():
    lines = [replace(LINE, place=y, height=z) for y in PLACES for z in (FLOOR, 0.02)]
    found = survey_lines([*lines, replace(LINE, place=0.03, rotation=DOWN)], AREA, space(), lambda line: True)
    assert [line.place for line in found] == list(PLACES), "one for each place, and none for an upright line"
    for line in found:
        assert line.survey
        assert line.rotation is None
        assert line.height == FLOOR
        assert line.begin == AREA.lower[0]
        assert -0.06 < line.end < -0.04, "the body of an upright probe would come too near what overhangs"
    between = [replace(LINE, place=y) for y in (-0.006, 0.0, 0.006)]
    assert survey_lines(between, AREA, SURVEYED, lambda line: True) == [], "all of that is known already"
    assert survey_lines(lines, AREA, space(), lambda line: False) == [], "out of the arm's reach"


def departure(here, found, held=LEANING):
    free = FreeSpace(AREA)
    for z in np.arange(0.108, FLOOR, -0.001):  # where a survey line came down
        free.note(pose((LINE.begin, 0.0, z)), None)
    return Departure(np.array(here), LEANING, AREA, free, SPEEDS, body=found, held=held)


def test_from_one_known_place_to_another_the_leaning_probe_goes_straight_and_not_over_the_top():
    line = replace(LINE, begin=-0.06, place=0.0075)
    path = departure((-0.06, -0.0075, FLOOR), SURVEYED).path_to(line)
    assert [piece.speed_limit for piece in path] == [SpeedLimit.KNOWN]
    assert path[0].place == pytest.approx(line.start)
    unknown = departure((-0.06, -0.0075, FLOOR), space()).path_to(line)
    assert SpeedLimit.KNOWN not in {piece.speed_limit for piece in unknown}


def test_a_line_that_begins_beyond_what_is_known_is_come_to_upright_and_the_probe_leans_at_last():
    line = replace(LINE, begin=-0.04)
    path = departure((-0.06, -0.05, 0.108), SURVEYED).path_to(line)
    *_, along, last = path
    assert along.speed_limit is SpeedLimit.KNOWN
    assert np.array_equal(along.rotation, DOWN)
    assert along.place == pytest.approx([SURVEYED.fits_to(replace(LINE, end=-0.04, rotation=None)), 0.0, FLOOR])
    assert last.speed_limit is SpeedLimit.GUARDED
    assert last.rotation is LEANING
    assert last.place == pytest.approx(line.start)


@pytest.mark.parametrize(("towards", "led"), [((-1.0, 0.0, 0.0), True), ((-0.7, 0.714, 0.0), False)])
def test_where_a_line_met_nothing_its_stick_has_been_for_the_same_line_higher_up(towards, led):
    rotation = turned(UP, np.array(towards), np.radians(30.0)) @ DOWN
    below, reached, up = replace(LINE, rotation=rotation), -0.025, 0.012
    found = stick_led_to(replace(below, height=FLOOR + up), below, reached)
    if led:  # the stick's axis at that height, when the sphere was where the line ended
        stick = np.array([reached, 0.0, FLOOR]) - up / rotation[2, 2] * -rotation[:, 2]
        assert stick[2] == pytest.approx(FLOOR + up)
        assert found == pytest.approx(stick[0] - SHORT_OF)
    else:
        assert found is None, "the stick was 4 mm and more beside it"
    for other in (replace(below, height=FLOOR - up), replace(below, place=0.01), replace(below, rotation=DOWN)):
        assert stick_led_to(other, below, reached) is None


@pytest.mark.parametrize(("degrees", "turns"), [(20.0, True), (33.0, True), (37.5, False), (40.0, False)])
def test_at_a_threat_a_leaning_probe_turns_only_where_it_can_lean_notably_more(degrees, turns):
    """Turns about the vertical at the largest lean took 15 s each, and the next threat came 3 mm later."""
    strategy, away = OrientationChange(), np.array([-1.0, 0.0, 0.0])
    strategy.start(replace(task(links=LINKS, area=AREA), options=None))
    tip = strategy.tip
    tip.observe(Observation(0.0, pose((-0.05, 0.0, 0.02)), np.zeros(3), np.zeros(3)))
    strategy.step(Observation(0.008, pose((-0.05, 0.0, 0.02)), np.zeros(3), np.zeros(3)))
    strategy.approach(replace(LINE, rotation=turned(UP, away, np.radians(degrees)) @ DOWN)).close()
    tip.control.begin(np.array([-0.8, 0.6, 0.0]))
    tip.trace.ended = follow_contour
    assert (strategy.avoid() is not None) is turns
