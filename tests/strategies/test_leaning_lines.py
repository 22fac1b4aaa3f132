"""Lines in under what stands out: as far as a leaning probe keeps clear of what was touched."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Area
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.lean import LeanPlanner
from lwrprobe_strategies.planning.leaning_lines import DEEPER, ONWARD, STEP, STICK, leaning_lines
from lwrprobe_strategies.planning.lines import X, Y, Z
from strategy_task import DOWN, task

PROBE = load_scene("block").probe.as_probe()
RIM, HEIGHT, FLOOR, PITCH = 0.04, 0.040, 0.006, 0.010


def table(side=0.0):
    """Contacts around the rim of a round table top, its sides down to `side` m below the rim; rows of the memory."""
    rows = []
    for turn in np.linspace(0.0, 2.0 * np.pi, 181):
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        for down in np.arange(0.0, side + 1e-9, 0.002):
            point = RIM * out + [0.0, 0.0, HEIGHT - down]
            rows.append([*(point + PROBE.radius * out), *point, *out, np.nan])
    return np.array(rows)


@pytest.fixture
def under():
    area = Area(np.array([-0.08, -0.08, FLOOR]), np.array([0.08, 0.08, 0.06]))
    return replace(task(links=PROBE.links), area=area)


def found(t, contacts, max_deg=40.0, reachable=lambda line: True, axis=Y):
    planner = LeanPlanner(t, DOWN, np.radians(max_deg))
    return leaning_lines(
        contacts, axis, np.array([0.0]), PITCH, t, lambda away: (DOWN, *planner.orientations(away)), reachable
    )


def gap(line, end, contacts):
    """m between the stick and what was touched, less what the stick keeps: by places along its axis."""
    stick = next(link for link in PROBE.links if link.name == "stick")
    half = 0.5 * stick.size[1]
    along = stick.pose[:3, 3] + np.linspace(-half, half, 200)[:, None] * stick.pose[:3, Z]
    places = line.at(end) + along @ line.rotation.T
    apart = np.linalg.norm(contacts[:, None, 3:6] - places, axis=2)
    return apart.min() - stick.size[0] - STICK


@pytest.mark.parametrize("axis", [X, Y])
def test_a_line_leads_in_from_both_sides_as_far_as_the_stick_keeps_clear(under, axis):
    contacts = table()
    lines = found(under, contacts, axis=axis)
    assert sorted(line.sign for line in lines) == [-1.0, 1.0]
    for line in lines:
        assert (line.axis, line.place, line.height, line.low) == (axis, 0.0, FLOOR, True)
        assert abs(line.begin) == pytest.approx(0.08)
        out = -line.sign * np.eye(3)[axis]
        assert -line.rotation[:, Z] @ out > 0.3, "the stick leans out, the sphere is in front"
        clear = line.end - line.sign * ONWARD
        assert abs(clear) < RIM - 0.01
        assert gap(line, clear, contacts) > -2e-4
        more = clear + line.sign * (2.0 * STEP + DEEPER)
        assert gap(line, more, contacts) < 2e-3 or abs(more) < STEP


def test_more_lean_leads_farther_in(under):
    ends = [max(abs(line.end) for line in found(under, table(), max_deg)) for max_deg in (20.0, 40.0)]
    assert ends[1] < ends[0] - DEEPER


def test_an_upright_probe_has_no_such_line(under):
    assert found(under, table(), max_deg=1.0) == []


def test_a_side_that_was_touched_down_to_its_foot_has_none(under):
    assert found(under, table(side=HEIGHT - FLOOR - 0.5 * PITCH)) == []


def test_a_foot_that_was_touched_leaves_the_waist_above_it(under):
    """As low as the foot was touched: farther down nothing is left."""
    foot = table()
    foot[:, [0, 1, 3, 4]] *= 0.7
    foot[:, [2, 5]] += FLOOR + 0.004 - HEIGHT
    lines = found(under, np.vstack([table(), foot]))
    assert [line.height for line in lines] == pytest.approx([FLOOR + 0.004] * 2)
    assert all(line.ceiling > HEIGHT for line in lines)


def test_a_line_begins_where_the_arm_reaches(under):
    def reachable(line):
        return abs(line.begin) < 0.08

    for line in found(under, table(), reachable=reachable):
        assert abs(line.begin) == pytest.approx(0.07)
    assert found(under, table(), reachable=lambda line: False) == []
