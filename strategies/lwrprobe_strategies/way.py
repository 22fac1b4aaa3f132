"""Ways through free space, and how much is known about each piece of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from math import cos

import numpy as np

from lwrprobe.contracts import LinkShape, Task
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.touched import Touched

X, Y = 0, 1
THERE = 2e-4
"""m, from which on a place counts as reached."""
HELD = 1.0 + 2.0 * cos(0.02)
"""Trace of the turn between two orientations that are alike, to a degree."""
HOVER = 0.0005
"""m above a known touch, down to which a descent is fast: the probe has stood there, its stick filled the column."""


class Pace(Enum):
    """How fast a piece of way may be driven."""

    FREE = auto()
    """Nothing is there: the probe has been there, or its column has, or it lies above the area."""
    FEELING = auto()
    """Something may be touched: as slow as the series of probe and object demands in that direction."""


@dataclass(slots=True)
class Waypoint:
    """Go there on a straight line.

    Attributes
    ----------
    place : (3,) m, of the sphere's centre
    pace : of the way there
    rotation : (3, 3) of the tip to turn to on the way there, None = as it is
    """

    place: np.ndarray
    pace: Pace = Pace.FREE
    rotation: np.ndarray | None = None

    def reached(self, pose: np.ndarray) -> bool:
        """Whether the tip's pose (4, 4) is as good as there."""
        (x, y, z), (tx, ty, tz) = pose[:3, 3].tolist(), self.place.tolist()
        there = max(abs(x - tx), abs(y - ty), abs(z - tz)) < THERE
        return there and (self.rotation is None or held(pose, self.rotation))


def held(pose: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether the orientation of a pose (4, 4) is the wanted one (3, 3)."""
    return bool(np.vdot(rotation, pose[:3, :3]) > HELD)


def way_to(line: Line, here: np.ndarray, turn: np.ndarray, task: Task, touched: Touched) -> list[Waypoint]:
    """From `here` (3,) to the start of a line: along what is known to be free, else over the top of the area.

    `turn` (3, 3) is the orientation in which the line is to be driven.
    """
    start, top = line.start, float(task.area.upper[Z])
    if line.axis == Y and not line.on_surface and abs(here[Y] - line.begin) <= 1e-3:  # along the border of the area
        # Nothing should stand on the border; where something does, the area is cut through an object.
        beside = np.array([start[X], start[Y], here[Z]])
        down = Pace.FEELING if here[Z] > start[Z] + 1e-3 else Pace.FREE
        return [Waypoint(here, rotation=turn), Waypoint(beside, Pace.FEELING), Waypoint(start, down)]
    if line.axis == X and not line.on_surface and _met_nothing(touched, here, start, task.probe.radius):
        return [Waypoint(start, rotation=turn)]
    way = [Waypoint(np.array([here[X], here[Y], top]))]
    if line.on_surface:
        way.append(Waypoint(np.array([start[X], start[Y], top]), rotation=turn))
        known = np.array([start[X], start[Y], max(line.free_to, start[Z]) + HOVER])
        return [*way, Waypoint(known), Waypoint(start - (0.0, 0.0, HOVER), Pace.FEELING)]
    if line.axis == Y:
        way += [Waypoint(np.array([here[X], line.begin, top]), rotation=turn)]
        way += [Waypoint(np.array([start[X], line.begin, top]))]
        return [*way, Waypoint(start, Pace.FEELING)]
    return [*way, Waypoint(np.array([start[X], start[Y], top]), rotation=turn), Waypoint(start)]


def _met_nothing(touched: Touched, here: np.ndarray, there: np.ndarray, spare: float) -> bool:
    """Whether both places lie on one line of the grid that met nothing between them, at its height."""
    if np.abs(here[[X, Z]] - there[[X, Z]]).max() > 1e-3:
        return False
    touches = touched.table()
    low, high = sorted((here[Y], there[Y]))
    on_line = np.abs(touches[:, 9] - there[X]) < 1e-3
    return not (on_line & (touches[:, Y] > low - spare) & (touches[:, Y] < high + spare)).any()


def line_height(task: Task) -> float:
    """m, lowest height of the sphere's centre at which the body above the stick clears whatever the area may hold.

    The area's top bounds the sphere's centre, so nothing that can be crossed is higher than that less the radius.
    """
    body = [-float(link.pose[2, 3]) - _half_length(link) for link in task.probe.links if link.name != "stick"]
    reach = min(body, default=0.0)
    tallest = float(task.area.upper[Z]) - task.probe.radius
    lowest = tallest + task.clearance_threshold - reach
    return float(min(max(lowest, task.area.lower[Z]), task.area.upper[Z]))


def _half_length(link: LinkShape) -> float:
    return link.size[2] / 2.0 if link.kind == "box" else link.size[1] / 2.0
