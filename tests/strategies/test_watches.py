"""What is noticed while a contour goes on: that it leads in a circle, and that it rounds a corner."""

from itertools import pairwise

import numpy as np
import pytest

from lwrprobe_strategies.planning.circling_watch import CirclingWatch
from lwrprobe_strategies.planning.corner_watch import BEYOND, CornerWatch
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from strategy_task import AREA

STEP = 0.0005
FRAME = TrackingFrame(Line(1, 0.0, -0.1, 0.1, 0.006), AREA)


def first(watch, frame, places):
    """Number of the step with which the contour is said to circle, None = never."""
    for k, (before, here) in enumerate(pairwise(places)):
        if watch.circles(frame, here, float(np.linalg.norm(here - before))):
            return k
    return None


def test_a_contour_around_one_place_is_ended_after_a_few_turns():
    angle = np.arange(0.0, 400.0, STEP / 0.01)
    circle = np.column_stack([0.0 * angle, 0.01 * np.cos(angle), 0.03 + 0.01 * np.sin(angle)])
    found = first(CirclingWatch(AREA), FRAME, circle)
    assert found is not None
    assert found * STEP < 0.25


@pytest.mark.parametrize("depth", [0.02, 0.054])
def test_a_contour_over_wall_after_wall_leads_on(depth):
    up, over = np.arange(0.006, 0.006 + depth, STEP), np.arange(0.0, 0.02, STEP)
    places, y = [], -0.1
    for _ in range(4):
        places += [[0.0, y, z] for z in up] + [[0.0, y + o, 0.006 + depth] for o in over]
        places += [[0.0, y + 0.02, z] for z in up[::-1]] + [[0.0, y + 0.02 + o, 0.006] for o in over]
        y += 0.04
    assert first(CirclingWatch(AREA), FRAME, np.array(places)) is None


def test_a_level_contour_may_go_once_around_what_fills_the_area():
    level = FRAME.horizontal(1.0)
    x, y = 0.09 * np.array([-1, 1, 1, -1, -1]), 0.09 * np.array([-1, -1, 1, 1, -1])
    at = np.arange(0.0, 4.0, STEP / 0.18)
    around = np.column_stack([np.interp(at, range(5), x), np.interp(at, range(5), y), 0.01 + 0.0 * at])
    assert first(CirclingWatch(AREA), level, around) is None
    assert first(CirclingWatch(AREA), level, np.concatenate([around, around])) is not None


def test_a_corner_is_rounded_for_a_few_millimetres():
    watch = CornerWatch()
    rounding, place = [], np.zeros(3)
    for turn in np.concatenate([np.zeros(40), np.linspace(0.0, np.pi / 2.0, 16), np.full(60, np.pi / 2.0)]):
        place = place + STEP * np.array([np.cos(turn), -np.sin(turn), 0.0])
        rounding.append(watch.rounds(place, np.array([np.sin(turn), np.cos(turn), 0.0])))
    assert not any(rounding[:46]), "straight on"
    assert any(rounding[46:56]), "before the stick can meet what is flush"
    assert not any(rounding[-30:]), "around it"
    assert BEYOND / STEP <= sum(rounding) <= 2.0 * BEYOND / STEP
