"""Bound an object that is touched: over its top along both axes, then around it as low as the body may go."""

from __future__ import annotations

from collections.abc import Generator
from math import hypot

import numpy as np

from lwrprobe.contracts import Confidence, Motion, Observation
from lwrprobe_strategies.outcomes import Ended, Outcome
from lwrprobe_strategies.planning.approaches import HOVER
from lwrprobe_strategies.planning.circling_watch import CirclingWatch
from lwrprobe_strategies.planning.climb import STEEP
from lwrprobe_strategies.planning.contact_memory import POINT
from lwrprobe_strategies.planning.free_space import GAP
from lwrprobe_strategies.planning.lines import X, Y, Z
from lwrprobe_strategies.planning.outline_watch import OutlineWatch
from lwrprobe_strategies.planning.paths import SpeedLimit, Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.search_descent import outline_height
from lwrprobe_strategies.planning.touched_tops import LEVEL, crown, is_outer, lowest_top_since, middle_of
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import Procedure, follow_and_regain, guarded_move, transit, tried
from lwrprobe_strategies.tip import Tip

SOUGHT = 1.0
"""Radii of the sphere along which a lost contact is sought: around an edge, and not into what lies behind."""
DROP = 0.003
"""m below the highest place, from which on what leads down is an edge and no bump."""
UNDER = -0.15
"""Share of the normal along z, below which a wall recedes under the sphere."""
LIFT = 0.002
"""m above the highest place on the return path over a surface."""
HIGHER = 0.015
"""m between two heights at which an outline is tried."""

Step = Generator[Motion, Observation, bool]


class ObjectBounds:
    """Touches an object where it reaches furthest.

    Parameters
    ----------
    tip : what the skills share; it touches the object
    flank : (3,) unit, normal of what it touches
    """

    def __init__(self, tip: Tip, flank: np.ndarray) -> None:
        self._tip, self._flank, self._area = tip, flank, tip.task.area
        self._first = len(tip.memory)

    def program(self) -> Step:
        """Whether the outline has come around the object; else it is not known how far that reaches."""
        flank, begin = self._flank, self._tip.here.copy()
        axis = Y if abs(flank[Y]) > abs(flank[X]) else X
        steep = bool(flank[Z] < LEVEL)
        sign = -1.0 if steep and flank[axis] > 0.0 else 1.0
        yield from tried(self._across(axis, sign))
        if not steep and (yield from self._back_to(begin)):
            yield from tried(self._across(axis, -sign))
        tops = crown(self._contacts())
        if tops is None:
            return False
        middle = middle_of(tops)
        if (yield from self._back_to(middle)):
            yield from tried(self._across(1 - axis, 1.0))
        for attempt, (along, side) in enumerate(((1 - axis, -1.0), (axis, sign), (1 - axis, 1.0))):
            if (yield from self._back_to(middle)) and (yield from self._outlined(along, side, attempt * HIGHER)):
                return True
        return False

    def _outlined(self, axis: int, sign: float, higher: float) -> Step:
        """To the edge along an axis, down there, and around; whether that closes around the object."""
        tip = self._tip
        yield from tried(self._across(axis, sign))
        low = outline_height(tip.memory.contacts()[:, POINT], tip.task) + higher
        if (yield from tried(self._down_wall(axis, sign, low))) is not Ended.EDGE:
            return False
        begun = len(tip.memory)
        end = yield from tried(self._around())
        return end is Ended.END_FOUND and is_outer(tip.memory.contacts()[begun:])

    def _across(self, axis: int, sign: float) -> Procedure:
        """Along an axis, in contact, to the edge of what is touched."""
        tip, frame, highest = self._tip, TrackingFrame.through(self._tip.here, axis, sign, self._area), -np.inf
        circling = CirclingWatch(self._area)

        def edge() -> Outcome | None:
            nonlocal highest
            here = float(tip.here[Z])
            highest = max(highest, here)
            if circling.circles(frame, tip.here, tip.period * hypot(*tip.seen.velocity.tolist())):
                return Ended.CIRCLING
            leads_down = tip.control.tangent(frame.binormal)[Z] < -STEEP
            return Ended.EDGE if leads_down and highest - here > DROP else None

        return (yield from follow_and_regain(tip, frame, edge, SOUGHT * tip.task.probe.radius))

    def _down_wall(self, axis: int, sign: float, low: float) -> Procedure:
        """Down the wall that is touched, to a height [m], or to where it recedes."""
        tip, frame = self._tip, TrackingFrame.through(self._tip.here, axis, sign, self._area)

        def down() -> Outcome | None:
            return Ended.EDGE if tip.here[Z] <= low or tip.control.normal[Z] < UNDER else None

        return (yield from follow_and_regain(tip, frame, down, SOUGHT * tip.task.probe.radius))

    def _around(self) -> Procedure:
        """Around what is touched, at the present height."""
        tip, watch = self._tip, OutlineWatch()
        frame = TrackingFrame.through(tip.here, Y, 1.0, self._area).horizontal(1.0, float(tip.here[Z]))

        def closed() -> Outcome | None:
            contact = tip.seen.contact
            on_sphere = contact is not None and contact.confidence > Confidence.DOUBTFUL
            if not watch.ends(tip.here, tip.control.normal, on_sphere):
                return None
            return Ended.END_FOUND if watch.closed else Ended.UNDERSIDE

        return (yield from follow_and_regain(tip, frame, closed, SOUGHT * tip.task.probe.radius))

    def _back_to(self, place: np.ndarray) -> Step:
        """Over what was touched, and down on a place (3,) there; whether it touches."""
        tip, contacts = self._tip, self._contacts()
        over = float(contacts[:, Z].max(initial=place[Z])) + LIFT
        # The sphere was everywhere on that way, little lower: nothing fits in between.
        lowest = lowest_top_since(contacts, place)
        between = float(self._area.lower[Z]) if lowest is None else lowest
        along = SpeedLimit.FREE if over - LIFT - between < GAP else SpeedLimit.GUARDED
        away = off_surface(tip.seen, tip.normal(), LIFT, tip.column_is_free)
        tip.leave()
        here = away[-1].place if away else tip.here
        path = [
            *away,
            Waypoint(np.array([*here[:2], max(over, float(here[Z]))]), SpeedLimit.COLUMN),
            Waypoint(np.array([*place[:2], over]), along),
            Waypoint(np.array([*place[:2], place[Z] + HOVER]), SpeedLimit.COLUMN),
        ]
        end = yield from tried(transit(tip, path))
        if end is Ended.ARRIVED:
            end = yield from tried(guarded_move(tip, place - (0.0, 0.0, LIFT)))
        return end is Ended.CONTACT

    def _contacts(self) -> np.ndarray:
        return self._tip.memory.contacts()[self._first :]
