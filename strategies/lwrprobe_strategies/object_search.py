"""Search for an object of which nothing is known: one place after the other, each from the top of the area down.

Along the stick everything is stiff, and near the sensor the stick is. A motion sideways through a space of which
nothing is known would have to be as slow as one downwards. On a helix the stick goes where the sphere was a turn
before: only its soft end can meet something. What is lower than the probe may so come is sought last: then nothing
taller is there.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from lwrprobe.contracts import Confidence, Motion, Observation
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.lines import X, Z
from lwrprobe_strategies.planning.paths import SpeedLimit, Waypoint
from lwrprobe_strategies.planning.search_descent import SearchDescent
from lwrprobe_strategies.planning.search_places import SearchPlaces
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import Procedure, guarded_move, retract, spiral_down, transit, tried
from lwrprobe_strategies.tip import Tip

Place = tuple[float, float]
TOUCHED = (Ended.CONTACT, Ended.SHAFT_CONTACT)


class ObjectSearch:
    """Seeks an object in the task's area.

    Parameters
    ----------
    tip : what the skills share

    Attributes
    ----------
    missed : m, diameter of the largest object that can have been missed so far
    """

    def __init__(self, tip: Tip) -> None:
        task = tip.task
        assert task.search_for is not None
        self._tip, self._area, self._descent = tip, task.area, SearchDescent.of(task)
        self._floor, self._top = float(task.area.lower[Z]), float(task.area.upper[Z])
        reach = self._descent.inner + task.probe.radius
        self._places = SearchPlaces(task.area, reach, task.search_for, self._descent.outer)

    @property
    def missed(self) -> float:
        return self._places.missed()

    def program(self) -> Generator[Motion, Observation, np.ndarray | None]:
        """(3,) normal of what the sphere touches at the end, None where nothing is found."""
        visited, low = self._places.places(), self._descent.low
        passes = [self._down] if low <= self._floor else [self._down, self._to_floor]
        for descend in passes:
            for place in visited:
                end = yield from tried(descend(place))
                if end in TOUCHED and (yield from self._settled()):
                    return self._tip.normal().copy()
                if end is Ended.NO_CONTACT and descend is passes[-1]:
                    self._places.searched(place)
        return None

    def _down(self, place: Place) -> Procedure:
        """Down at a place, as far as the body is clear of what the helix around it has not met."""
        tip, descent, (x, y) = self._tip, self._descent, place
        if not (descent.twice and descent.clear < self._top):
            yield from self._over(x + descent.inner, y)
            return (yield from spiral_down(tip, place, descent.low))
        yield from self._over(x + descent.outer, y)
        end = yield from spiral_down(tip, place, descent.clear)
        if end is Ended.NO_CONTACT:
            end = yield from guarded_move(tip, np.array([x + descent.inner, y, float(tip.here[Z])]))
        return end if end is not Ended.NO_CONTACT else (yield from spiral_down(tip, place, descent.low))

    def _to_floor(self, place: Place) -> Procedure:
        """Down to the floor at a place where the probe was before."""
        x, y = place
        yield from self._over(x, y)
        known = Waypoint(np.array([x, y, self._descent.low + self._tip.task.probe.radius]), SpeedLimit.COLUMN)
        end = yield from transit(self._tip, [known])
        if end is not Ended.ARRIVED:
            return end
        return (yield from guarded_move(self._tip, np.array([x, y, self._floor])))

    def _over(self, x: float, y: float) -> Procedure:
        """Up, and over the top of the area to a place there."""
        up = np.array([*self._tip.here[:2], self._top])
        return (yield from transit(self._tip, [Waypoint(up), Waypoint(np.array([x, y, self._top]))]))

    def _settled(self) -> Generator[Motion, Observation, bool]:
        """Whether the sphere touches: what the stick has met is touched from above."""
        tip, contact = self._tip, self._tip.seen.contact
        if contact is None:
            return False
        if contact.confidence > Confidence.DOUBTFUL:
            return True
        normal, off = tip.normal(), self._descent.inner
        x, y, _ = (contact.point + off * -normal).tolist()
        yield from tried(retract(tip, TrackingFrame.through(tip.here, X, 1.0, self._area), normal, off))
        yield from self._over(x, y)
        return (yield from tried(guarded_move(tip, np.array([x, y, self._floor])))) is Ended.CONTACT
