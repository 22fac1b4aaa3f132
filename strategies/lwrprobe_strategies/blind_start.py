"""A start that knows nothing of the object: find it, bound it, and leave it to the strategy's own program.

The sphere meets nothing faster than the force law allows. No sensor measures a contact of the body above the stick:
around an object that overhangs it may press harder than the limit, so a real arm is not started blind.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from lwrprobe.contracts import Area, Motion, Observation, Task
from lwrprobe_strategies.object_bounds import LIFT, ObjectBounds
from lwrprobe_strategies.object_search import ObjectSearch
from lwrprobe_strategies.outcomes import Ended, Outcome
from lwrprobe_strategies.planning.contact_memory import POINT, POINT_Z
from lwrprobe_strategies.planning.lines import X, Y, Z
from lwrprobe_strategies.planning.paths import SpeedLimit, Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.touched_tops import LEVEL
from lwrprobe_strategies.skills import along_stick, press, transit, tried
from lwrprobe_strategies.tip import Tip

AROUND = 3.0
"""Radii of the sphere from what was touched to the border of what is explored."""

AT_BORDER, FEWEST = 0.001, 3
"""m from a side of the area, and contacts there, from which on the object goes on beyond it."""
TABLE = 0.002
"""m above the plane on which a sphere at the area's lower end would rest, up to which a touch is one of the table."""

Step = Generator[Motion, Observation, Outcome | None]


@dataclass(slots=True, frozen=True)
class Found:
    """An object.

    Attributes
    ----------
    found_at : s of the run
    area : around it, as high as the area that was searched
    tallest : m, height of what was touched
    """

    found_at: float
    area: Area
    tallest: float


class BlindStart:
    """Finds an object in the task's area and bounds it.

    Parameters
    ----------
    tip : what the skills share

    Attributes
    ----------
    missed : m, diameter of the largest object that can have been missed so far
    """

    def __init__(self, tip: Tip) -> None:
        self._tip, self._area, self._search = tip, tip.task.area, ObjectSearch(tip)

    @property
    def missed(self) -> float:
        return self._search.missed

    def program(self) -> Generator[Motion, Observation, Found | None]:
        """Search, and bound what was found; None where nothing was."""
        flank = yield from self._search.program()
        if flank is None:
            yield from self._lift()
            return None
        if along_stick(self._tip, flank):
            yield from press(self._tip, flank)
        closed = yield from ObjectBounds(self._tip, flank).program()
        found = self._found(self._search.found_at, closed)
        yield from self._leave(found.area)
        return found

    def _found(self, found_at: float, closed: bool) -> Found:
        """What was touched, with space around it where its outline is `closed`; else all of the area is explored."""
        points = self._tip.memory.contacts()[:, POINT]
        points = points if len(points) else self._tip.here[None]
        lower, upper = self._area.lower.copy(), self._area.upper.copy()
        if closed:
            beside = AROUND * self._tip.task.probe.radius
            lower[:2] = np.maximum(lower[:2], points[:, :2].min(axis=0) - beside)
            upper[:2] = np.minimum(upper[:2], points[:, :2].max(axis=0) + beside)
        return Found(found_at, Area(lower, upper), float(points[:, Z].max()))

    def _leave(self, area: Area) -> Step:
        """Off what is touched: from a wall aside, and along the border to the side where lines begin; else up."""
        tip = self._tip
        normal = tip.normal()
        if normal[Z] > LEVEL or not tip.touches:
            return (yield from self._lift())
        axis = Y if abs(normal[Y]) > abs(normal[X]) else X
        away = off_surface(tip.seen, normal, LIFT, tip.column_is_free)
        tip.leave()
        border = tip.here.copy()
        border[axis] = (area.upper if normal[axis] > 0.0 else area.lower)[axis]
        along = [Waypoint(place, SpeedLimit.GUARDED) for place in (border, *to_front(border, area))]
        end = yield from tried(transit(tip, [*away, *along]))
        return end if end is Ended.ARRIVED else (yield from self._lift())

    def _lift(self) -> Step:
        """Off what is touched, and up to the top of the area."""
        tip = self._tip
        away = off_surface(tip.seen, tip.normal(), LIFT, tip.column_is_free)
        tip.leave()
        here = away[-1].place if away else tip.here
        up = Waypoint(np.array([*here[:2], float(self._area.upper[Z])]), SpeedLimit.COLUMN)
        return (yield from tried(transit(tip, [*away, up])))


def to_front(place: np.ndarray, area: Area) -> list[np.ndarray]:
    """Places (3,), level along the border of the area from one on it to the side where y is smallest."""
    front = float(area.lower[Y])
    if place[Y] == front:
        return []
    nearer = area.lower if place[X] - area.lower[X] < area.upper[X] - place[X] else area.upper
    corner = np.array([nearer[X], place[Y], place[Z]])
    return [corner, np.array([nearer[X], front, place[Z]])]


def widened(area: Area, whole: Area, contacts: np.ndarray, radius: float, by: float) -> Area | None:
    """The area with those sides `by` m farther out, inside the `whole` one, on which contacts show that the object goes
    on; None where there is no such side.

    An outline above the floor says nothing of what is lower. `contacts` (n, 10) are rows of the contact memory; what
    was touched no higher than the table is taken for that.
    """
    centres = contacts[contacts[:, POINT_Z] > area.lower[Z] - radius + TABLE, :Z]
    low, high = area.lower.copy(), area.upper.copy()
    for axis in (X, Y):
        if np.count_nonzero(centres[:, axis] < low[axis] + AT_BORDER) >= FEWEST:
            low[axis] = max(low[axis] - by, whole.lower[axis])
        if np.count_nonzero(centres[:, axis] > high[axis] - AT_BORDER) >= FEWEST:
            high[axis] = min(high[axis] + by, whole.upper[axis])
    same = np.array_equal(low[:Z], area.lower[:Z]) and np.array_equal(high[:Z], area.upper[:Z])
    return None if same else Area(low, high)


def bounded(task: Task, found: Found) -> Task:
    """The task of exploring what was found."""
    low, high = found.area.lower, found.area.upper
    start = np.array([0.5 * (low[X] + high[X]), low[Y], high[Z]])
    return replace(task, area=found.area, start=start, search_for=None, tallest=found.tallest)
