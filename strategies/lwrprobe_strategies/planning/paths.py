"""Paths through free space, and how fast each piece of them may be driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto
from math import cos

import numpy as np

from lwrprobe.contracts import Area, Task
from lwrprobe_strategies.planning.free_space import BORDER, GAP, FreeSpace
from lwrprobe_strategies.planning.lines import Line, X, Y, Z

THERE = 2e-4
"""m, within which a place is reached."""
HELD = 1.0 + 2.0 * cos(0.02)
"""Trace of the turn between two orientations that are alike to a degree."""
OFF = 0.002
"""m off a surface, where it has been left."""
OWN_COLUMN = 0.0025
"""m sideways, within which a place above lies in the probe's own column: half of the sphere's radius."""
BESIDE = 0.02
"""m from a place on the return path to the start of a line at the same height, up to which that is a path to it."""
STOP = 0.15
"""s, that a stop between two pieces of a path costs: braking and accelerating at the limits."""
NEARER = 0.0005
"""m that the nearest of the contacts of one wall differ in distance."""
RISE = 0.0015
"""m by which something may reach further than what was touched of it."""
DEEP = 5.0
"""Metres sideways that take as long as one down into the unknown."""
BEFORE = 0.006
"""m before the end of a level path, up to which it is fast where it ends at a wall."""
FARTHEST = 0.3
"""m sideways, as which the rest of a path from a known column may count at most; more is no gain."""
HOVER = 0.0005
"""m above a known contact, down to which a descent is fast: the stick has filled the column there."""
SOUGHT = 0.003
"""m below a known contact, down to which the surface is sought: it may fall by twice the distance from that contact to
the line, which is up to 1.5 mm away."""


Clear = Callable[[np.ndarray, np.ndarray], bool]
"""Whether the straight path may be taken from one place (3,) to another, or from one tip pose (4, 4) to another."""


class SpeedLimit(Enum):
    """How fast a piece of a path may be driven."""

    FREE = auto()
    """Nothing is there: the part of the probe that moves there has been there, or it lies above all that may be."""
    COLUMN = auto()
    """The stick has been there, and the sphere may meet something with its flank."""
    GUARDED = auto()
    """Something may be there: as slow as the stiffness in that direction demands."""


@dataclass(slots=True, frozen=True)
class Speeds:
    """How fast a motion may be.

    Attributes
    ----------
    free : m/s, where nothing is
    column : m/s along the stick, where the stick has been and the sphere has not
    guarded : m/s at which something may be met, from a unit direction (3,)
    """

    free: float
    column: float
    guarded: Callable[[np.ndarray], float]

    def at(self, speed_limit: SpeedLimit, along: np.ndarray) -> float:
        """m/s along a unit direction (3,)."""
        if speed_limit is SpeedLimit.FREE:
            return self.free
        return self.column if speed_limit is SpeedLimit.COLUMN else self.guarded(along)


@dataclass(slots=True)
class Waypoint:
    """Go there on a straight line.

    Attributes
    ----------
    place : (3,) m, of the sphere's centre
    speed_limit : how fast
    rotation : (3, 3) of the tip to turn to meanwhile, None = as it is
    """

    place: np.ndarray
    speed_limit: SpeedLimit = SpeedLimit.FREE
    rotation: np.ndarray | None = None

    def reached(self, pose: np.ndarray) -> bool:
        """Whether the tip's pose (4, 4) is there."""
        (x, y, z), (tx, ty, tz) = pose[:3, 3].tolist(), self.place.tolist()
        there = abs(x - tx) < THERE and abs(y - ty) < THERE and abs(z - tz) < THERE
        return there and (self.rotation is None or held(pose, self.rotation))


def held(pose: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether the orientation of a pose (4, 4) is the wanted one (3, 3)."""
    return bool(np.vdot(rotation, pose[:3, :3]) > HELD)


def path_to(
    line: Line,
    here: np.ndarray,
    turn: np.ndarray,
    area: Area,
    free: FreeSpace,
    speeds: Speeds,
    clear: Clear = lambda begin, end: True,
    allows: Clear = lambda begin, end: True,
) -> list[Waypoint]:
    """From `here` (3,) to the start of a line: along what is known to be free, else over the top of the area.

    `turn` (3, 3) is the orientation in which the line is to be driven. Sideways the path leads where `clear` says so,
    which is given places, and everywhere where `allows` says so, which is given poses.
    """
    start, top = line.start, float(area.upper[Z])
    if not line.on_surface and abs(start[Z] - here[Z]) < BORDER and free.swept(here, start):
        return [Waypoint(start, rotation=turn)]
    if not line.on_surface and _above(here, start):
        return [replace(waypoint, rotation=turn) for waypoint in up_from(here, start, free)]
    to_column = _back_to_column(here, free)
    up = _to_top(here, turn, top, to_column, free, speeds, allows)
    above = Waypoint(np.array([start[X], start[Y], top]), rotation=turn)
    if line.on_surface:
        known = np.array([start[X], start[Y], max(line.free_to, start[Z]) + HOVER])
        deep = min(max(start[Z] - SOUGHT, float(area.lower[Z])), start[Z] - HOVER)
        touch = Waypoint(np.array([start[X], start[Y], deep]), SpeedLimit.GUARDED)
        return [*up, above, *_down_to(known, free, SpeedLimit.COLUMN), touch]
    straight_down = [*up, above, *_down_to(start, free, SpeedLimit.GUARDED)]
    stood = free.stood_down_to(start)
    if stood < top - THERE:
        known = np.array([*start[:2], max(stood, start[Z])])
        foot = [Waypoint(start, SpeedLimit.GUARDED)] if stood > start[Z] else []
        straight_down = [*up, above, *_down_to(known, free, SpeedLimit.COLUMN), *foot]
    paths = []
    columns = _known_columns(free, start, line.axis)
    if not columns:
        paths.append(straight_down)
    for column in columns:
        over = Waypoint(np.array([*column[:2], top]), rotation=turn)
        level = np.array([*start[:2], column[Z]])
        foot = [Waypoint(start, SpeedLimit.GUARDED)] if column[Z] - start[Z] > THERE else []
        paths.append([*up, over, Waypoint(column), *_level(column, level, free), *foot])
    back = free.back_to(start, BESIDE)
    if back is not None and np.abs(back[0][0] - here).max() < OWN_COLUMN and np.vdot(turn, back[-1][1]) > HELD:
        paths.append([*(Waypoint(place, rotation=turn) for place, _ in back), Waypoint(start, SpeedLimit.GUARDED)])
    if to_column and _above(to_column[-1].place, start) and np.vdot(turn, to_column[-1].rotation) > HELD:
        paths.append([*to_column, *up_from(to_column[-1].place, start, free)])
    if line.axis == Y and abs(here[Y] - line.begin) <= BORDER:
        # Nothing should stand on the border; where something does, the area is cut through an object.
        level = np.array([start[X], start[Y], here[Z]])
        along = [Waypoint(here, rotation=turn), Waypoint(level, SpeedLimit.GUARDED)]
        along += [Waypoint(start, SpeedLimit.GUARDED)] if here[Z] > start[Z] + BORDER else up_from(level, start, free)
        paths.append(along)
    for path in sorted(paths, key=lambda path: seconds(path, here, speeds)):
        if _clear_sideways(path, here, clear) and _allowed(path, here, turn, allows):
            return path
    return straight_down


def _above(low: np.ndarray, high: np.ndarray) -> bool:
    """Whether a place (3,) lies above another one, in the probe's own column."""
    return bool(np.abs(high[:2] - low[:2]).max() < OWN_COLUMN and high[Z] > low[Z])


def clear_of(points: np.ndarray, task: Task) -> Clear:
    """Whether the upright probe keeps its distance from the points (n, 3), or comes no nearer than at its ends."""
    parts = [(float(half.max()), bottom - task.clearance_threshold) for half, bottom in body(task)]
    parts = [(wide + task.clearance_threshold, low) for wide, low in [*parts, (task.probe.stick_radius, RISE)]]

    def clear(begin: np.ndarray, end: np.ndarray) -> bool:
        step, there = (end - begin)[:2], points[:, :2] - begin[:2]
        share = np.clip(there @ step / max(float(step @ step), 1e-12), 0.0, 1.0)
        height = points[:, Z] - min(begin[Z], end[Z])
        near = np.hypot(*(there - share[:, None] * step).T)
        ends = np.minimum(np.hypot(*there.T), np.hypot(*(there - step).T))
        for wide, low in parts:
            beside = height > low
            if beside.any() and near[beside].min() < min(wide, float(ends[beside].min()) - NEARER):
                return False
        return True

    return clear


def _clear_sideways(path: list[Waypoint], here: np.ndarray, clear: Clear) -> bool:
    """Whether a path from `here` (3,) leads sideways through the unknown only where that is clear."""
    for waypoint in path:
        sideways = np.abs(waypoint.place - here)[:2].max() > OWN_COLUMN
        if waypoint.speed_limit is SpeedLimit.GUARDED and sideways and not clear(here, waypoint.place):
            return False
        here = waypoint.place
    return True


def _allowed(path: list[Waypoint], here: np.ndarray, turn: np.ndarray, allows: Clear) -> bool:
    """Whether a path from `here` (3,), for a tip held by `turn` (3, 3) until a waypoint has another one, is allowed."""
    begin = np.eye(4)
    begin[:3, :3], begin[:3, 3] = turn, here
    for waypoint in path:
        end = begin.copy()
        end[:3, 3] = waypoint.place
        if waypoint.rotation is not None:
            end[:3, :3] = waypoint.rotation
        if not allows(begin, end):
            return False
        begin = end
    return True


def up_from(here: np.ndarray, there: np.ndarray, free: FreeSpace) -> list[Waypoint]:
    """Straight up from a place (3,) of the upright probe to another one: fast from where the sphere fits."""
    level = free.clear_from(here)
    if level - here[Z] < GAP or level > there[Z]:
        return [Waypoint(there, SpeedLimit.FREE if level - here[Z] < GAP else SpeedLimit.COLUMN)]
    return [Waypoint(np.array([here[X], here[Y], level]), SpeedLimit.COLUMN), Waypoint(there)]


def _back_to_column(here: np.ndarray, free: FreeSpace) -> list[Waypoint]:
    """From a place (3,) of the upright probe back to where it may go straight up; nothing where no path is known."""
    back = free.back_to_column()
    if not back or np.abs(back[0][0] - here).max() > OWN_COLUMN:
        return []
    return [Waypoint(place, rotation=rotation) for place, rotation in back]


def _to_top(
    here: np.ndarray,
    turn: np.ndarray,
    top: float,
    to_column: list[Waypoint],
    free: FreeSpace,
    speeds: Speeds,
    allows: Clear,
) -> list[Waypoint]:
    """From a place (3,) to the top of the area: straight up, or first along a path to a column where that is quicker.

    Above a place to which the sphere did not come down it might meet something with its flank.
    """
    up = up_from(here, np.array([here[X], here[Y], top]), free)
    if not to_column:
        return up
    column = to_column[-1].place
    path = [*to_column, *up_from(column, np.array([*column[:2], top]), free)]
    quicker = seconds(path, here, speeds) < seconds(up, here, speeds)
    return path if quicker and _allowed(path, here, turn, allows) else up


def _down_to(there: np.ndarray, free: FreeSpace, below: SpeedLimit) -> list[Waypoint]:
    """Straight down to a place (3,): fast as far as the sphere fits, at the limit `below` from there on."""
    level = max(free.clear_down_to(float(there[X]), float(there[Y])), float(there[Z]))
    fast = Waypoint(np.array([there[X], there[Y], level]))
    return [fast] if level - there[Z] < THERE else [fast, Waypoint(there, below)]


def _known_columns(free: FreeSpace, start: np.ndarray, axis: int) -> list[np.ndarray]:
    """(3,) m, places beside the start (3,) of a line, from which the sphere fits straight up.

    On each side of it the cheapest of all, and the cheapest of those as high as the stick has stood at the start,
    counting what is left to be driven slowly from there: there the level path is most likely known. Empty where none
    is of use.
    """
    stood, aside = free.open_places(axis, float(start[axis])), 1 - axis
    deep = np.maximum(stood[:, Z], start[Z])
    cost = np.abs(stood[:, aside] - start[aside]) + DEEP * (deep - start[Z])
    level = free.stood_down_to(start, BORDER)
    found: list[np.ndarray] = []
    for side in (stood[:, aside] < start[aside], stood[:, aside] >= start[aside]):
        for low in (-np.inf, level):
            left = side & (cost <= FARTHEST) & (deep > low - BORDER)
            if left.any():
                best = int(np.argmin(np.where(left, cost, np.inf)))
                found.append(np.array([*stood[best, :2], deep[best]]))
    return found


def _level(begin: np.ndarray, end: np.ndarray, free: FreeSpace) -> list[Waypoint]:
    """Level from one place (3,) to another: fast as far as the probe has been there, also where that ends at a wall."""
    motion = end - begin
    length = float(np.sqrt(motion @ motion))
    if free.swept(begin, end):
        return [Waypoint(end)]
    if length > 2.0 * BEFORE and free.swept(begin, before := end - BEFORE / length * motion):
        return [Waypoint(before), Waypoint(end, SpeedLimit.GUARDED)]
    return [Waypoint(end, SpeedLimit.GUARDED)]


def seconds(path: list[Waypoint], here: np.ndarray, speeds: Speeds) -> float:
    """How long a path from `here` (3,) takes."""
    time = 0.0
    for waypoint in path:
        step = waypoint.place - here
        length = float(np.sqrt(step @ step))
        if length > THERE:
            time += length / speeds.at(waypoint.speed_limit, step / length) + STOP
        here = waypoint.place
    return time


def line_height(task: Task) -> float:
    """m, lowest height of the sphere's centre at which the body above the stick clears whatever the area may hold.

    The area's top bounds the sphere's centre, so nothing that can be crossed is higher than that less the radius.
    """
    tallest = min(float(task.area.upper[Z]) - task.probe.radius, task.tallest)
    lowest = max((tallest - bottom for _, bottom in body(task)), default=-np.inf) + task.clearance_threshold
    return float(min(max(lowest, task.area.lower[Z]), task.area.upper[Z]))


def lowest_beside(line: Line, points: np.ndarray, task: Task) -> float:
    """m, lowest height of the sphere's centre at which the upright body clears what was touched, (n, 3) `points`,
    wherever on the line it is.
    """
    low, high = sorted((line.begin, line.end))
    lowest = float(task.area.lower[Z])
    for half, bottom in body(task):
        along, aside = half[line.axis] + task.clearance_threshold, half[line.aside] + task.clearance_threshold
        near = (points[:, line.axis] > low - along) & (points[:, line.axis] < high + along)
        near &= np.abs(points[:, line.aside] - line.place) < aside
        tallest = float(points[near, Z].max(initial=-np.inf))
        lowest = max(lowest, tallest + RISE + task.clearance_threshold - bottom)
    return min(lowest, float(task.area.upper[Z]))


def body(task: Task) -> list[tuple[np.ndarray, float]]:
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
