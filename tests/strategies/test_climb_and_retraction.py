"""Walls that lead down are climbed from the line's other end where that is quicker, and nowhere else."""

import numpy as np
import pytest

from lwrprobe.contracts import Contact, Observation
from lwrprobe.control import ContourControl
from lwrprobe.scene import load_scene
from lwrprobe_strategies.planning.climb import WALL, DescentWatch
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import OFF, Pace
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.shaft import WARY, ShaftMemory
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from strategy_task import AREA, DOWN, task

LINKS = load_scene("block").probe.as_probe().links
BORDER = float(AREA.upper[1])


def descend(height, travel=1.0, known=True, normal=None, first=0.0):
    """Follow a wall at y = 0.03 down from `height`; the line offered instead, or None, and where it was offered."""
    t = task(approach=0.03, links=LINKS)
    touched = ContactMemory()
    if known:
        for z in np.arange(0.006, 0.06, 0.001):
            touched.passed(np.array([-0.01, travel * BORDER, z]), -0.01)
    control = ContourControl(t)
    watch = DescentWatch(t, control, touched)
    line = Line(1, 0.0, -travel * BORDER, travel * BORDER, 0.006, free_end=True)
    frame = TrackingFrame(line, AREA)
    wall = np.array([0.0, travel, 0.0]) if normal is None else normal
    control.begin(wall)
    for z in np.arange(height - first, 0.006, -0.0005):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = DOWN, (0.0, 0.03 * travel, z)
        seen = Observation(0.0, pose, np.zeros(3), 0.8 * wall)
        offered = watch.climb(seen, frame, DOWN)
        if offered is not None:
            return offered, z
    return None, None


@pytest.mark.parametrize("travel", [1.0, -1.0])
def test_a_high_wall_is_left_under_its_edge_and_climbed_from_the_border(travel):
    up, left_at = descend(0.055, travel)
    assert left_at == pytest.approx(0.055 - WALL, abs=6e-4)
    assert up.begin == travel * BORDER
    assert travel * up.end < 0.03, "past the edge where the wall was left"
    assert up.height == 0.006
    down = up.fallback
    assert down.on_surface
    assert (down.begin, down.end, down.height) == (pytest.approx(0.03 * travel), travel * BORDER, left_at)


def test_a_low_wall_is_descended():
    assert descend(0.015) == (None, None)


def test_without_a_known_column_beside_the_way_around_is_not_worth_it():
    assert descend(0.055, known=False) == (None, None)


def test_a_slope_is_no_wall():
    slope = np.array([0.0, 0.8, 0.6])
    assert descend(0.055, normal=slope) == (None, None)


def test_a_line_is_driven_with_care_only_where_the_shaft_may_be_met():
    shaft = ShaftMemory(0.015)
    line = Line(1, 0.0, -BORDER, BORDER, 0.006)
    assert shaft.stretch(line, line.start) == (BORDER, False)
    shaft.add(Line(1, 0.01, -BORDER, BORDER, 0.006), np.array([0.01, -0.03, 0.006]))
    end, careful = shaft.stretch(line, line.start)
    assert (end, careful) == (pytest.approx(-0.03 - WARY), False)
    end, careful = shaft.stretch(line, line.at(end))
    assert careful
    assert -0.03 < end < 0.0
    assert shaft.stretch(line, line.at(end)) == (BORDER, False), "behind it as fast as ever"
    turned = line.turned()
    assert shaft.stretch(turned, turned.start)[1], "what stands out on one side may do so on the other"
    aside = Line(1, 0.03, -BORDER, BORDER, 0.006)
    assert shaft.stretch(aside, aside.start) == (BORDER, False)


def test_a_line_is_never_cut_into_pieces_without_end():
    shaft = ShaftMemory(0.015)
    line = Line(0, 0.0, 0.09, -0.09, 0.006)
    shaft.add(line, np.array([0.02, 0.0, 0.006]))
    here, pieces = line.start, 0
    while here[0] > line.end + 1e-9:
        end, _ = shaft.stretch(line, here)
        assert end < here[0] - 1e-4
        here, pieces = line.at(end), pieces + 1
    assert pieces <= 4


def test_a_surface_is_left_along_its_normal_and_an_undercut_sideways():
    touched = ContactMemory()
    touched.add(np.array([0.03, 0.0, 0.024]), np.array([0.024, 0.0, 0.024]), np.array([1.0, 0.0, 0.0]), np.nan)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, (0.026, 0.0, 0.011)

    def seen(trust):
        normal = np.array([0.0, 0.0, 1.0])
        contact = Contact(0.0, pose[:3, 3], normal, normal, pose[:3, 3], trust)
        return Observation(0.0, pose, np.zeros(3), np.zeros(3), contact)

    up = off_surface(seen(1.0), np.array([0.0, 0.0, 1.0]), 0.01, touched)
    assert (up.pace, up.place[2]) == (Pace.FREE, pytest.approx(0.011 + OFF)), "the probe's own column"
    wall = off_surface(seen(1.0), np.array([1.0, 0.0, 0.0]), 0.01, touched)
    assert (wall.pace, wall.place[0]) == (Pace.GUARDED, pytest.approx(0.026 + OFF))
    doubted = off_surface(seen(0.0), np.array([1.0, 0.0, 0.0]), 0.01, touched)
    assert doubted.place[0] == pytest.approx(0.036), "further where nobody knows what is touched"
    for contact in (seen(1.0), Observation(0.0, pose, np.zeros(3), np.zeros(3))):
        out = off_surface(contact, np.array([0.6, 0.0, -0.8]), 0.01, touched)
        assert out.place[2] == pose[2, 3]
        assert out.place[0] > 0.03, "past all that was touched there"
    assert (
        off_surface(Observation(0.0, pose, np.zeros(3), np.zeros(3)), np.array([0.0, 0.0, 1.0]), 0.01, touched) is None
    )
