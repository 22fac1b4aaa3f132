"""Paths through free space, and how fast each piece of them may be driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from math import cos

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line, X, Y, Z

THERE = 2e-4
"""m, within which a place is reached."""
HELD = 1.0 + 2.0 * cos(0.02)
"""Trace of the turn between two orientations that are alike to a degree."""
OFF = 0.003
"""m off a surface, where it has been left."""
BORDER = 0.001
"""m, within which a place is one on the border."""
COLUMN = 0.0025
"""m sideways, within which a place above lies in the probe's own column: half of the sphere's radius."""
STOP = 0.15
"""s, that a stop between two pieces of a path costs: braking and accelerating at the limits."""
RISE = 0.0015
"""m by which something may be higher than what was touched of it."""
DEEP = 5.0
"""Metres sideways that take as long as one down into the unknown."""
FARTHEST = 0.3
"""m sideways, as which the rest of a path from a known column may count at most; more is no gain."""
HOVER = 0.0005
"""m above a known contact, down to which a descent is fast: the stick has filled the column there."""


SafeSpeed = Callable[[np.ndarray], float]
"""Speed, m/s, at which something may be met along a unit direction (3,)."""


class Pace(Enum):
    """How fast a piece of a path may be driven."""

    FREE = auto()
    """Nothing is there: the probe has been there, or its column has, or it lies above the area."""
    GUARDED = auto()
    """Something may be memory: as slow as the stiffness in that direction demands."""


@dataclass(slots=True)
class Waypoint:
    """Go there on a straight line.

    Attributes
    ----------
    place : (3,) m, of the sphere's centre
    pace : how fast
    rotation : (3, 3) of the tip to turn to meanwhile, None = as it is
    """

    place: np.ndarray
    pace: Pace = Pace.FREE
    rotation: np.ndarray | None = None

    def reached(self, pose: np.ndarray) -> bool:
        """Whether the tip's pose (4, 4) is there."""
        (x, y, z), (tx, ty, tz) = pose[:3, 3].tolist(), self.place.tolist()
        there = max(abs(x - tx), abs(y - ty), abs(z - tz)) < THERE
        return there and (self.rotation is None or held(pose, self.rotation))


def held(pose: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether the orientation of a pose (4, 4) is the wanted one (3, 3)."""
    return bool(np.vdot(rotation, pose[:3, :3]) > HELD)


def path_to(
    line: Line, here: np.ndarray, turn: np.ndarray, task: Task, memory: ContactMemory, safe_speed: SafeSpeed
) -> list[Waypoint]:
    """From `here` (3,) to the start of a line: along what is known to be free, else over the top of the area.

    `turn` (3, 3) is the orientation in which the line is to be driven, `safe_speed` as in `seconds`.
    """
    start, top = line.start, float(task.area.upper[Z])
    if line.axis == X and not line.on_surface and _met_nothing(memory, here, start, task.probe.radius):
        return [Waypoint(start, rotation=turn)]
    if not line.on_surface and np.abs(start[:2] - here[:2]).max() < COLUMN and start[Z] > here[Z]:
        return [Waypoint(start, rotation=turn)]  # up the probe's own column
    up = Waypoint(np.array([here[X], here[Y], top]))
    above = np.array([start[X], start[Y], top])
    if line.on_surface:
        known = np.array([start[X], start[Y], max(line.free_to, start[Z]) + HOVER])
        down = [Waypoint(known), Waypoint(start - (0.0, 0.0, HOVER), Pace.GUARDED)]
        return [up, Waypoint(above, rotation=turn), *down]
    column = _known_column(memory, start, line.axis)
    if column is None:
        over = [up, Waypoint(above, rotation=turn), Waypoint(start, Pace.GUARDED)]
    else:
        above[:2] = column[:2]
        over = [up, Waypoint(above, rotation=turn), Waypoint(column), Waypoint(start, Pace.GUARDED)]
    if line.axis == X or abs(here[Y] - line.begin) > BORDER:
        return over
    # Nothing should stand on the border; where something does, the area is cut through an object.
    beside = np.array([start[X], start[Y], here[Z]])
    pace = Pace.GUARDED if here[Z] > start[Z] + BORDER else Pace.FREE
    along = [Waypoint(here, rotation=turn), Waypoint(beside, Pace.GUARDED), Waypoint(start, pace)]
    return min(along, over, key=lambda way: seconds(way, here, task, safe_speed))


def _known_column(memory: ContactMemory, start: np.ndarray, axis: int) -> np.ndarray | None:
    """(3,) m, a place beside the start (3,) of a line, where the probe has stood: above it nothing is.

    The cheapest of them all, counting what is left to be driven slowly from there; None where none is of use.
    """
    way, aside = memory.trail(), 1 - axis
    stood = way[np.abs(way[:, axis] - start[axis]) < BORDER, :3]
    deep = np.maximum(stood[:, Z], start[Z])
    cost = np.abs(stood[:, aside] - start[aside]) + DEEP * (deep - start[Z])
    if not len(stood) or cost.min() > FARTHEST:
        return None
    best = int(np.argmin(cost))
    return np.array([*stood[best, :2], deep[best]])


def seconds(way: list[Waypoint], here: np.ndarray, task: Task, safe_speed: SafeSpeed) -> float:
    """How long a way from `here` (3,) takes; `safe_speed` tells the speed, m/s, along a unit direction (3,)."""
    time = 0.0
    for waypoint in way:
        step = waypoint.place - here
        length = float(np.sqrt(step @ step))
        if length > THERE:
            speed = task.free_speed if waypoint.pace is Pace.FREE else safe_speed(step / length)
            time += length / speed + STOP
        here = waypoint.place
    return time


def _met_nothing(memory: ContactMemory, here: np.ndarray, there: np.ndarray, spare: float) -> bool:
    """Whether both places lie on one line of the grid that met nothing between them, at its height."""
    if np.abs(here[[X, Z]] - there[[X, Z]]).max() > 1e-3:
        return False
    touches = memory.contacts()
    low, high = sorted((here[Y], there[Y]))
    on_line = np.abs(touches[:, 9] - there[X]) < 1e-3
    return not (on_line & (touches[:, Y] > low - spare) & (touches[:, Y] < high + spare)).any()


def line_height(task: Task) -> float:
    """m, lowest height of the sphere's centre at which the body above the stick clears whatever the area may hold.

    The area's top bounds the sphere's centre, so nothing that can be crossed is higher than that less the radius.
    """
    tallest = float(task.area.upper[Z]) - task.probe.radius
    lowest = max((tallest - bottom for _, bottom in _body(task)), default=-np.inf) + task.clearance_threshold
    return float(min(max(lowest, task.area.lower[Z]), task.area.upper[Z]))


def lowest_beside(line: Line, points: np.ndarray, task: Task) -> float:
    """m, lowest height of the sphere's centre at which the upright body clears what was touched, (n, 3) `points`,
    wherever on the line it is.
    """
    low, high = sorted((line.begin, line.end))
    lowest = float(task.area.lower[Z])
    for half, bottom in _body(task):
        along, aside = half[line.axis] + task.clearance_threshold, half[line.aside] + task.clearance_threshold
        near = (points[:, line.axis] > low - along) & (points[:, line.axis] < high + along)
        near &= np.abs(points[:, line.aside] - line.place) < aside
        tallest = float(points[near, Z].max(initial=-np.inf))
        lowest = max(lowest, tallest + RISE + task.clearance_threshold - bottom)
    return min(lowest, float(task.area.upper[Z]))


def _body(task: Task) -> list[tuple[np.ndarray, float]]:
    """What stands above the stick of an upright probe: how far it reaches along x and y, and how high its bottom is."""
    body = []
    for link in task.probe.links:
        if link.name == "stick":
            continue
        box = link.kind == "box"
        half = np.array(link.size[:2]) / 2.0 if box else np.full(2, link.size[0])
        length = link.size[2] if box else link.size[1]
        body.append((half + np.abs(link.pose[:2, 3]), -float(link.pose[2, 3]) - length / 2.0))
    return body
