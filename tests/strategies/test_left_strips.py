"""Lines up what was left between two touched strips of a steep face."""

import numpy as np
import pytest

from lwrprobe_strategies.planning.left_strips import left_strips
from strategy_task import AREA

RADIUS, PITCH, TOP = 0.005, 0.015, 0.05
HEIGHTS = np.arange(0.006, TOP, 0.001)


def wall(angle, places, heights=HEIGHTS):
    """Touches up a wall through the origin, at `places` m along it; it faces at an angle [rad] from x."""
    out, along = (np.array([np.cos(a), np.sin(a), 0.0]) for a in (angle, angle + 0.5 * np.pi))
    points = np.array([s * along + [0.0, 0.0, z] for s in places for z in heights])
    out = np.tile(out, (len(points), 1))
    return np.column_stack([points + RADIUS * out, points, out, np.full(len(points), np.nan)])


def strips(contacts, height=0.006):
    return left_strips(contacts, AREA, PITCH, lambda line: height)


@pytest.mark.parametrize("angle", [0.7, -0.9, 2.3, -2.5, 0.0, 1.5])
def test_a_strip_farther_than_half_a_spacing_from_both_its_neighbours_gets_a_line(angle):
    (line,) = strips(wall(angle, [-0.0106, 0.0106]))
    out = np.array([np.cos(angle), np.sin(angle)])
    assert abs(out[line.axis]) == abs(out).max(), "it meets the face as squarely as it can"
    assert line.sign == -np.sign(out[line.axis])
    middle = RADIUS * out
    assert line.place == pytest.approx(middle[line.aside], abs=0.001)
    assert min(line.begin, line.end) < middle[line.axis] < max(line.begin, line.end)
    assert (line.height, line.low) == (0.006, True)
    assert TOP - 0.003 < line.ceiling < TOP + 0.002


def test_what_was_touched_in_between_is_not_left():
    assert strips(wall(0.7, [-0.0106, 0.0106, 0.0])) == []
    assert strips(wall(0.7, [-0.0075, 0.0075])) == []
    assert strips(np.empty((0, 10))) == []


def test_no_line_is_worth_little_or_leads_between_two_faces():
    assert strips(wall(0.7, [-0.0106, 0.0106], HEIGHTS[:8])) == []
    assert strips(wall(0.7, [-0.0106, 0.0106]), height=TOP - 0.005) == [], "the body does not let it come lower"
    apart = wall(0.7, [0.0106])
    apart[:, :3] += 0.004 * apart[:, 6:9]
    apart[:, 3:6] += 0.004 * apart[:, 6:9]
    assert strips(np.concatenate([wall(0.7, [-0.0106]), apart])) == []
    assert strips(np.concatenate([wall(0.7, [-0.0106]), wall(1.4, [0.0106])])) == []
