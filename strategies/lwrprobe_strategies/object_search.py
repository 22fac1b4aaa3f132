"""Search for an object of which nothing is known: one place after the other, each from the top of the area down.

Along the stick everything is stiff, and near the sensor the stick is. A motion sideways through a space of which
nothing is known would have to be as slow as one downwards. On a helix the stick goes where the sphere was a turn
before: only its soft end can meet something. Below the helix the probe goes straight down, as low as the body may. What
is lower than that is sought last: then nothing taller is there.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from lwrprobe.contracts import Motion, Observation
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.lines import X, Z
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.search_descent import SearchDescent
from lwrprobe_strategies.planning.search_places import SearchPlaces
from lwrprobe_strategies.planning.shaft import UNEXPECTED
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import Procedure, guarded_move, retract, spiral_down, transit, tried
from lwrprobe_strategies.tip import Tip

Place = tuple[float, float]
ALONG = 0.8
"""Share of a force along the stick, for which a touch on its side would need friction with a coefficient of 1.3."""
LIFT = 0.002
"""m off what is touched, and above where the probe has been."""


class ObjectSearch:
    """Seeks an object in the task's area.

    Parameters
    ----------
    tip : what the skills share

    Attributes
    ----------
    missed : m, diameter of the largest object that can have been missed so far
    found_at : s of the run, when something was touched that turned out to be the object
    """

    def __init__(self, tip: Tip) -> None:
        task = tip.task
        assert task.search_for is not None
        self._tip, self._area, self._descent = tip, task.area, SearchDescent.of(task)
        self._floor, self._top = float(task.area.lower[Z]), float(task.area.upper[Z])
        keep = max(self._descent.helix, self._descent.ring)
        self._places = SearchPlaces(task.area, task.probe.radius, task.search_for, keep)
        self._clear: set[Place] = set()  # where the probe came down in the first pass
        self.found_at = 0.0

    @property
    def missed(self) -> float:
        return self._places.missed()

    def program(self) -> Generator[Motion, Observation, np.ndarray | None]:
        """(3,) normal of what the sphere touches at the end, None where nothing is found."""
        visited, low = self._places.places(), self._descent.deep
        passes = [self._down] if low <= self._floor else [self._down, self._to_floor]
        for descend in passes:
            for place in visited:
                end = yield from tried(descend(place))
                self.found_at = self._tip.seen.time
                if end is Ended.CONTACT or (end is Ended.SHAFT_CONTACT and (yield from self._settled())):
                    return self._tip.normal().copy()
                if end is Ended.NO_CONTACT:
                    self._clear.add(place)
                    if descend is passes[-1]:
                        self._places.searched(place)
        return None

    def _down(self, place: Place) -> Procedure:
        """Down at a place, as far as the body is clear of what sphere and stick have not met around it."""
        tip, descent, (x, y) = self._tip, self._descent, place
        end = yield from self._over(x + descent.helix, y)
        if end is not Ended.ARRIVED:
            return end
        if descent.helix > 0.0:
            end = yield from spiral_down(tip, place, descent.clear)
            if end is not Ended.NO_CONTACT:
                return end
            # What stands within the helix and was not met by it is thinner than the sphere is.
            end = yield from self._sideways(np.array([x, y, float(tip.here[Z])]), UNEXPECTED)
            if end is not Ended.NO_CONTACT:
                return end
        end = yield from guarded_move(tip, np.array([x, y, descent.low]))
        if end is not Ended.NO_CONTACT or descent.ring <= 0.0:
            return end
        return (yield from self._lower(place))

    def _lower(self, place: Place) -> Procedure:
        """Around the widest part of the body near the top of the area, and down again, lower than before."""
        tip, descent, (x, y) = self._tip, self._descent, place
        axis = np.array([x, y, descent.ring_height])
        end = yield from transit(tip, [Waypoint(axis)])
        if end is Ended.ARRIVED:
            end = yield from self._sideways(np.array([x + descent.ring, y, descent.ring_height]))
        if end is Ended.NO_CONTACT:
            end = yield from spiral_down(tip, place, descent.ring_height, self._top - descent.ring_height)
        if end is Ended.NO_CONTACT:
            end = yield from transit(tip, [Waypoint(axis)])
        return end if end is not Ended.ARRIVED else (yield from self._further(place, descent.low, descent.deep))

    def _sideways(self, end: np.ndarray, times: float = 1.0) -> Procedure:
        """Level to a place (3,), so many times as fast as the stick may meet what is as high as the area."""
        return (yield from guarded_move(self._tip, end, stretch=lambda _: (end, times)))

    def _to_floor(self, place: Place) -> Procedure:
        """Down to the floor at a place, fast where the probe was before."""
        if place not in self._clear:
            end = yield from self._down(place)
            if end is not Ended.NO_CONTACT:
                return end
        end = yield from self._over(*place)
        return end if end is not Ended.ARRIVED else (yield from self._further(place, self._descent.deep, self._floor))

    def _further(self, place: Place, known: float, low: float) -> Procedure:
        """Down to a height [m] at a place, where the probe was down to another one before."""
        x, y = place
        down = Waypoint(np.array([x, y, known + LIFT]))
        end = yield from transit(self._tip, [down])
        if end is not Ended.ARRIVED:
            return end
        return (yield from guarded_move(self._tip, np.array([x, y, low])))

    def _over(self, x: float, y: float) -> Procedure:
        """Off what is touched, up, and over the top of the area to a place there."""
        tip = self._tip
        away = off_surface(tip.seen, tip.normal(), LIFT, tip.column_is_free) if tip.seen.contact is not None else []
        tip.leave()
        here = away[-1].place if away else tip.here
        path = [*away, Waypoint(np.array([*here[:2], self._top])), Waypoint(np.array([x, y, self._top]))]
        return (yield from transit(tip, path))

    def _settled(self) -> Generator[Motion, Observation, bool]:
        """Whether the sphere touches after all, or what the stick has met is touched from above."""
        tip, contact, force = self._tip, self._tip.seen.contact, self._tip.seen.force
        if contact is None:
            return False
        normal, off = tip.normal(), tip.task.probe.radius
        if -(force @ tip.seen.pose[:3, Z]) > ALONG * np.sqrt(force @ force):
            tip.control.begin(normal)
            return True
        x, y, _ = (contact.point + off * -normal).tolist()
        yield from tried(retract(tip, TrackingFrame.through(tip.here, X, 1.0, self._area), normal, off))
        if (yield from tried(self._over(x, y))) is not Ended.ARRIVED:
            return False
        return (yield from tried(guarded_move(tip, np.array([x, y, self._floor])))) is Ended.CONTACT
