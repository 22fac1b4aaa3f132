"""Walls are climbed rather than descended, where that is quicker.

A foot that nobody has felt is met stick first, and along its axis the stick is stiffest: F = K v tau leaves some
5 mm/s downwards where 20 mm/s are free upwards, since above the sphere there is the probe's own column. A contour that
comes to a wall leading down is left there; the same line is driven from its other end, up that wall, to where it was
left. The source descends (Rau 2017, section 4.2.5). What lies in a valley is descended into once, from one side.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np

from lwrprobe.contracts import Observation, Task
from lwrprobe_strategies.course import Course, Z
from lwrprobe_strategies.following import Follower
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.touched import Touched
from lwrprobe_strategies.way import OFF, Waypoint, lowest_beside, seconds, way_to

STEEP = 0.9
"""Share of the direction onward along z, downwards, from which on a contour descends a wall."""
FLAT = sqrt(1.0 - STEEP * STEEP)
"""Share of the normal along z, from which on no direction along the surface is that steep."""
FELT = 0.002
"""m of a wall under its upper edge, after which it is known to be one."""
OVERLAP = 0.0025
"""m, along the line, that both ways have in common."""


@dataclass(slots=True)
class Climbing:
    """Notices that a contour descends, and judges whether to come from the other side instead.

    Attributes
    ----------
    task : speeds, area, the probe's links
    follower : how fast a descent may be
    touched : where the probe has been
    """

    task: Task
    follower: Follower
    touched: Touched
    _edge: np.ndarray | None = field(default=None, init=False)
    _judged: bool = field(default=False, init=False)

    def forget(self) -> None:
        """The contour has been left."""
        self._edge, self._judged = None, False

    def instead(self, seen: Observation, course: Course, rotation: np.ndarray) -> Line | None:
        """The line from the other end, where the present one descends and that other one is quicker; once a descent.

        `rotation` (3, 3) is how the tip would be held on it.
        """
        here = seen.pose[:3, 3]
        # Asked with every sample: the normal alone tells most of the time that nothing is that steep.
        if abs(self.follower.normal[Z]) > FLAT or self.follower.tangent(course.across())[Z] > -STEEP:
            self.forget()
            return None
        if self._edge is None:
            self._edge = here.copy()
        if self._judged or self._edge[Z] - here[Z] < FELT:
            return None
        self._judged = True
        line = course.line
        end = float(self._edge[line.axis]) - line.sign * OVERLAP
        # Down the wall from here, should its foot turn out not to be within reach.
        down = Line(line.axis, line.place, float(here[line.axis]), line.end, float(here[Z]), True, float(here[Z]))
        up = Line(line.axis, line.place, line.end, end, float(here[Z]), instead=down)
        up = replace(up, height=lowest_beside(up, self.touched.table()[:, 3:6], self.task))
        return up if self._quicker(seen, up, rotation) else None

    def _quicker(self, seen: Observation, up: Line, rotation: np.ndarray) -> bool:
        task, here, axial = self.task, seen.pose[:3, 3], seen.pose[:3, :3]

        def speed(way: np.ndarray) -> float:
            return self.follower.approach_speed(way, axial)

        height = here[Z] - up.height
        there = way_to(up, here + OFF * self.follower.normal, rotation, task, self.touched, speed)
        top = float(task.area.upper[Z])
        over = np.array([up.start[0], up.start[1], top])
        back = [Waypoint(np.array([here[0], here[1], top])), Waypoint(over), Waypoint(up.start)]
        climb = height / task.contour_speed + seconds(there, here, task, speed) + seconds(back, here, task, speed)
        return climb < height / min(speed(np.array([0.0, 0.0, -1.0])), task.contour_speed)
