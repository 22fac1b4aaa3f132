"""Walls are climbed rather than descended, where that is quicker.

A foot that has not been touched yet is met stick first, and the stick is stiffest along its axis: F = K v tau allows
some 5 mm/s downwards where it allows 20 mm/s upwards, since above the sphere there is the probe's own column. A contour
that comes to a wall leading down is left there; the same line is driven from its other end, up that wall, to where it
was left. The thesis descends (Rau 2017, section 4.2.5). What lies in a valley is descended into once, from one side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import sqrt

import numpy as np

from lwrprobe.contracts import Observation, Task
from lwrprobe.control import ContourControl
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.free_space import FreeSpace
from lwrprobe_strategies.planning.lines import Line, X, Y, Z
from lwrprobe_strategies.planning.paths import OFF, Speeds, Waypoint, seconds
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame

STEEP = 0.9
"""Share of the direction onward along z, downwards, from which on a contour descends a wall."""
FLAT = sqrt(1.0 - STEEP * STEEP)
"""Share of the normal along z, from which on no direction along the surface is that steep."""
WALL = 0.002
"""m under its upper edge, after which a descent is one of a wall and not one over a rounded edge."""
OVERLAP = 0.0025
"""m along the line that both contours have in common."""


class DescentWatch:
    """Notices that one contour descends, and decides whether to come from the other side instead.

    Parameters
    ----------
    task : speeds, area, the probe's links
    control : the tracked normal, and how fast a descent may be
    lowest : m, height at which a line may be driven
    free : what the probe has shown to be free
    """

    def __init__(self, task: Task, control: ContourControl, lowest: Callable[[Line], float], free: FreeSpace) -> None:
        self._task, self._control, self._lowest, self._free = task, control, lowest, free
        self._edge: np.ndarray | None = None
        self._decided = False

    def climb(self, seen: Observation, frame: TrackingFrame, rotation: np.ndarray) -> Line | None:
        """The line from the other end, where the present one descends and that one is quicker; decided once a descent.

        `rotation` (3, 3) is how the tip would be held on it.
        """
        here = seen.pose[:3, 3]
        # Called with every sample: mostly the normal alone shows that nothing is that steep.
        if abs(self._control.normal[Z]) > FLAT or self._control.tangent(frame.binormal)[Z] > -STEEP:
            self._edge, self._decided = None, False
            return None
        if self._edge is None:
            self._edge = here.copy()
        if self._decided or self._edge[Z] - here[Z] < WALL:
            return None
        self._decided = True
        line = frame.line
        end = float(self._edge[line.axis]) - line.sign * OVERLAP
        # Down the wall from here, should its foot turn out not to be within reach.
        height = float(here[Z])
        begin = float(here[line.axis])
        down = Line(line.axis, line.place, begin, line.end, height, on_surface=True, free_to=height)
        up = Line(line.axis, line.place, line.end, end, height, fallback=down)
        up = replace(up, height=self._lowest(up))
        return up if self._quicker(seen, up, rotation) else None

    def _quicker(self, seen: Observation, up: Line, rotation: np.ndarray) -> bool:
        task, here, held = self._task, seen.pose[:3, 3], seen.pose[:3, :3]

        def speed(along: np.ndarray) -> float:
            return self._control.approach_speed(along, held)

        speeds = Speeds(task.free_speed, self._control.column_speed, speed)
        height = here[Z] - up.height
        departure = Departure(here + OFF * self._control.normal, rotation, task.area, self._free, speeds)
        top = float(task.area.upper[Z])
        over = np.array([up.start[X], up.start[Y], top])
        back = [Waypoint(np.array([here[X], here[Y], top])), Waypoint(over), Waypoint(up.start)]
        climb = height / task.contour_speed + seconds(departure.path_to(up), here, speeds) + seconds(back, here, speeds)
        return climb < height / min(self._control.descent_speed(held), task.contour_speed)
