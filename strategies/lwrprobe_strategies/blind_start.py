"""A start that knows nothing of the object: find it, bound it, and leave it to the strategy's own program.

Nothing is met faster than the force law allows, whatever the object's shape. That decides how it is searched for:

- Along the stick everything is stiff, and near the sensor the stick is. A motion sideways through a space of which
  nothing is known would have to be as slow as one downwards. On a helix the stick goes where the sphere was a turn
  before: only its soft end can meet something.
- The body above the stick is wider than the sphere, and feels nothing. A first helix, around the place, comes down to
  where the body is above all that may be there. Within that one the probe goes lower.
- What is lower than the probe may so come is sought last: then nothing taller is there.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from lwrprobe.contracts import Area, Confidence, Motion, Observation, Task
from lwrprobe_strategies.outcomes import Ended, Interruption, Lost, Outcome
from lwrprobe_strategies.planning.circling_watch import CirclingWatch
from lwrprobe_strategies.planning.climb import STEEP
from lwrprobe_strategies.planning.free_space import GAP
from lwrprobe_strategies.planning.lines import Line, X, Y, Z
from lwrprobe_strategies.planning.outline_watch import OutlineWatch
from lwrprobe_strategies.planning.paths import HOVER, RISE, SpeedLimit, Waypoint, body, line_height
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.search_places import SearchPlaces
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import follow_contour, guarded_move, reapproach, retract, spiral_down, transit
from lwrprobe_strategies.tip import Tip

BESIDE = 0.001
"""m between the body above the stick and what the first helix has shown to be free."""
AROUND = 3.0
"""Radii of the sphere from what was touched to the border of what is explored."""
SOUGHT = 1.0
"""Radii of the sphere of way, along which a lost contact is sought: around an edge, and not into what lies behind."""
LEVEL = 0.7
"""Share of the normal along z, from which on a touch is one of a top."""
DROP = 0.003
"""m below the highest place, from which on what leads down is an edge and no bump."""
UNDER = -0.15
"""Share of the normal along z, below which a wall recedes under the sphere."""
LIFT = 0.002
"""m above the highest place on the way back over a surface."""
HIGHER = 0.015
"""m between two heights at which an outline is tried."""

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
        task = tip.task
        assert task.search_for is not None
        self._tip, self._task, self._area = tip, task, task.area
        self._floor, self._top = float(task.area.lower[Z]), float(task.area.upper[Z])
        self._clear = line_height(task)
        radius = task.probe.radius
        self._inner = radius
        needed = [float(half.max()) for half, bottom in body(task)]
        narrow = [wide for wide in needed if wide < 2.0 * min(needed)]
        self._outer = self._inner + max(narrow, default=0.0) + BESIDE - radius
        self._low = _lowest_inside(task, self._clear, self._outer + radius, self._inner)
        self._places = SearchPlaces(task.area, self._inner + radius, task.search_for, self._outer)
        self._normal = np.zeros(3)

    @property
    def missed(self) -> float:
        return self._places.missed()

    def program(self) -> Generator[Motion, Observation, Found | None]:
        """Search, and bound what was found; None where nothing was."""
        tip = self._tip
        if not (yield from self._search()):
            yield from self._lift()
            return None
        found_at = tip.seen.time
        closed = yield from self._bound()
        points = tip.memory.contacts()[:, 3:6]
        if not len(points):
            points = tip.here[None]
        beside = AROUND * self._task.probe.radius
        lower, upper = self._area.lower.copy(), self._area.upper.copy()
        if closed:  # else nobody knows how far it reaches, and all of the area is explored
            lower[:2] = np.maximum(lower[:2], points[:, :2].min(axis=0) - beside)
            upper[:2] = np.minimum(upper[:2], points[:, :2].max(axis=0) + beside)
        area = Area(lower, upper)
        yield from self._leave(area)
        return Found(found_at, area, float(points[:, Z].max()))

    # Search

    def _search(self) -> Generator[Motion, Observation, bool]:
        """Whether something is touched: place after place, and then the same places down to the floor."""
        visited = self._places.places()
        for place in visited:
            end = yield from self._tried(self._down(place))
            if end in (Ended.CONTACT, Ended.SHAFT_CONTACT) and (yield from self._settled()):
                return True
            if end is Ended.NO_CONTACT and self._low <= self._floor:
                self._places.searched(place)
        if self._low <= self._floor:
            return False
        for place in visited:
            end = yield from self._tried(self._to_floor(place))
            if end in (Ended.CONTACT, Ended.SHAFT_CONTACT) and (yield from self._settled()):
                return True
            if end is Ended.NO_CONTACT:
                self._places.searched(place)
        return False

    def _down(self, place: tuple[float, float]) -> Step:
        """Down at a place, as far as the body is clear of what the helix around it has not met."""
        tip, (x, y), height = self._tip, place, self._top
        if self._clear < self._top and self._outer > 0.0 and self._clear > self._low:
            yield from self._over(np.array([x + self._outer, y, self._top]))
            end = yield from spiral_down(tip, place, self._clear)
            if end is not Ended.NO_CONTACT:
                return end
            height = float(tip.here[Z])
            end = yield from guarded_move(tip, np.array([x + self._inner, y, height]))
            if end is not Ended.NO_CONTACT:
                return end
        else:
            yield from self._over(np.array([x + self._inner, y, self._top]))
        return (yield from spiral_down(tip, place, self._low))

    def _to_floor(self, place: tuple[float, float]) -> Step:
        """Down to the floor at a place where the probe was before."""
        x, y = place
        yield from self._over(np.array([x, y, self._top]))
        known = Waypoint(np.array([x, y, self._low + self._task.probe.radius]), SpeedLimit.COLUMN)
        end = yield from transit(self._tip, [known])
        if end is not Ended.ARRIVED:
            return end
        return (yield from guarded_move(self._tip, np.array([x, y, self._floor])))

    def _over(self, place: np.ndarray) -> Step:
        """Up, and over the top of the area to a place (3,) there."""
        tip = self._tip
        up = np.array([*tip.here[:2], self._top])
        return (yield from transit(tip, [Waypoint(up), Waypoint(place)]))

    def _settled(self) -> Generator[Motion, Observation, bool]:
        """Whether the sphere touches: what the stick has met is touched from above."""
        tip, contact = self._tip, self._tip.seen.contact
        if contact is None:
            return False
        if contact.confidence > Confidence.DOUBTFUL:
            self._normal = tip.normal().copy()
            return True
        met = contact.point + self._inner * -tip.normal()
        yield from self._tried(retract(tip, self._frame(X, 1.0), tip.normal(), self._inner))
        yield from self._over(np.array([*met[:2], self._top]))
        end = yield from self._tried(guarded_move(tip, np.array([*met[:2], self._floor])))
        self._normal = tip.normal().copy()
        return end is Ended.CONTACT

    # Bounds

    def _bound(self) -> Generator[Motion, Observation, bool]:
        """Over the top along both axes, then around at the lowest height at which the body is clear.

        Whether the outline has come around the object.
        """
        tip, flank = self._tip, self._normal
        axis = Y if abs(flank[Y]) > abs(flank[X]) else X
        steep = bool(flank[Z] < LEVEL)
        sign = -1.0 if steep and flank[axis] > 0.0 else 1.0
        first, begin = len(tip.memory), tip.here.copy()
        yield from self._tried(self._across(axis, sign))
        if not steep and (yield from self._back_to(begin, first)):
            yield from self._tried(self._across(axis, -sign))
        crown = self._crown(first)
        if crown is None:
            return False
        middle = 0.5 * (crown.min(axis=0) + crown.max(axis=0))
        middle = crown[int(np.argmin(np.hypot(*(crown - middle)[:, :2].T)))]
        if (yield from self._back_to(middle, first)):
            yield from self._tried(self._across(1 - axis, 1.0))
        ways = ((1 - axis, -1.0), (axis, sign), (1 - axis, 1.0))
        for attempt, (along, side) in enumerate(ways):
            if not (yield from self._back_to(middle, first)):
                continue
            yield from self._tried(self._across(along, side))
            low = self._outline_height() + attempt * HIGHER
            if (yield from self._tried(self._down_wall(self._frame(along, side), low))) is not Ended.EDGE:
                continue
            begun = len(tip.memory)
            end = yield from self._tried(self._around())
            if end is Ended.END_FOUND and self._is_outer(begun):
                return True
        return False

    def _across(self, axis: int, sign: float) -> Step:
        """Along an axis, in contact, to the edge of what is touched."""
        tip, frame, highest = self._tip, self._frame(axis, sign), -np.inf
        circling = CirclingWatch(self._area)

        def edge() -> Outcome | None:
            nonlocal highest
            here = float(tip.here[Z])
            highest = max(highest, here)
            if circling.circles(frame, tip.here, tip.period * hypot(*tip.seen.velocity.tolist())):
                return Ended.CIRCLING
            leads_down = tip.control.tangent(frame.binormal)[Z] < -STEEP
            return Ended.EDGE if leads_down and highest - here > DROP else None

        return (yield from self._followed(frame, edge))

    def _down_wall(self, frame: TrackingFrame, low: float) -> Step:
        """Down the wall that is touched, to a height [m], or to where it recedes."""
        tip = self._tip

        def down() -> Outcome | None:
            return Ended.EDGE if tip.here[Z] <= low or tip.control.normal[Z] < UNDER else None

        return (yield from self._followed(frame, down))

    def _around(self) -> Step:
        """Around what is touched, at the present height."""
        tip, watch = self._tip, OutlineWatch()
        frame = self._frame(Y, 1.0).horizontal(1.0, float(tip.here[Z]))

        def closed() -> Outcome | None:
            contact = tip.seen.contact
            reliable = contact is not None and contact.confidence is Confidence.RELIABLE
            if not watch.ends(tip.here, tip.control.normal, reliable):
                return None
            return Ended.END_FOUND if watch.closed else Ended.UNDERSIDE

        return (yield from self._followed(frame, closed))

    def _is_outer(self, first: int) -> bool:
        """Whether an outline, from contact `first` on, runs around the object and not around a hole in it."""
        rows = self._tip.memory.contacts()[first:]
        away = rows[:, :2] - rows[:, :2].mean(axis=0)
        return bool((away * rows[:, 6:8]).sum() > 0.0)

    def _followed(self, frame: TrackingFrame, until: Callable[[], Outcome | None]) -> Step:
        """A contour; a contact that was lost is sought again."""
        end: Outcome = yield from follow_contour(self._tip, frame, until)
        while isinstance(end, Lost):
            end = yield from reapproach(self._tip, frame, end.point, SOUGHT * self._task.probe.radius)
            if end is Ended.CONTACT:
                end = yield from follow_contour(self._tip, frame, until)
        return end

    def _back_to(self, place: np.ndarray, first: int) -> Generator[Motion, Observation, bool]:
        """Over what was touched since contact `first`, and down on a place (3,) there; whether it touches."""
        tip = self._tip
        over = float(tip.memory.contacts()[first:, Z].max(initial=place[Z])) + LIFT
        # The sphere was everywhere on that way, little lower: nothing fits in between.
        between = self._between(place, first)
        along = SpeedLimit.FREE if over - LIFT - between < GAP else SpeedLimit.GUARDED
        away = off_surface(tip.seen, tip.normal(), LIFT)
        tip.leave()
        here = away[-1].place if away else tip.here
        path = [
            *away,
            Waypoint(np.array([*here[:2], max(over, float(here[Z]))]), SpeedLimit.COLUMN),
            Waypoint(np.array([*place[:2], over]), along),
            Waypoint(np.array([*place[:2], place[Z] + HOVER]), SpeedLimit.COLUMN),
        ]
        end = yield from self._tried(transit(tip, path))
        if end is Ended.ARRIVED:
            end = yield from self._tried(guarded_move(tip, place - (0.0, 0.0, LIFT)))
        return end is Ended.CONTACT

    def _lift(self) -> Step:
        """Off what is touched, and up to the top of the area."""
        tip = self._tip
        away = off_surface(tip.seen, tip.normal(), LIFT)
        tip.leave()
        here = away[-1].place if away else tip.here
        up = Waypoint(np.array([*here[:2], self._top]), SpeedLimit.COLUMN)
        return (yield from self._tried(transit(tip, [*away, up])))

    def _leave(self, area: Area) -> Step:
        """Off what is touched: aside, to the border of the area, from a wall, and else up."""
        tip, normal = self._tip, self._tip.normal() if self._tip.seen.contact is not None else self._tip.control.normal
        if normal[Z] > LEVEL or not tip.touches:
            return (yield from self._lift())
        axis = Y if abs(normal[Y]) > abs(normal[X]) else X
        away = off_surface(tip.seen, normal, LIFT)
        tip.leave()
        border = tip.here.copy()
        border[axis] = (area.upper if normal[axis] > 0.0 else area.lower)[axis]
        return (yield from self._tried(transit(tip, [*away, Waypoint(border, SpeedLimit.GUARDED)])))

    def _tried(self, step: Step) -> Step:
        """What a step ends with; None where it was interrupted."""
        try:
            return (yield from step)
        except Interruption:
            return None

    def _between(self, place: np.ndarray, first: int) -> float:
        """m, lowest height of the sphere's centre on tops since it was at a place (3,), else that of the area."""
        rows = self._tip.memory.contacts()[first:]
        near = np.flatnonzero(np.abs(rows[:, :3] - place).max(axis=1) < DROP)
        if not len(near):
            return self._floor
        rows = rows[near[-1] :]
        return float(rows[rows[:, 8] > LEVEL, Z].min(initial=np.inf))

    def _crown(self, first: int) -> np.ndarray | None:
        """(n, 3) m, of the sphere's centre, on tops touched since the contact number `first`; else all that was."""
        rows = self._tip.memory.contacts()[first:]
        level = rows[rows[:, 8] > LEVEL]
        rows = level if len(level) else rows
        return rows[:, :3] if len(rows) else None

    def _outline_height(self) -> float:
        """m, lowest at which an upright body is clear of what was touched."""
        tallest = float(self._tip.memory.contacts()[:, 5].max())
        bottom = min((bottom for _, bottom in body(self._task)), default=np.inf)
        return max(self._floor, tallest + RISE + self._task.clearance_threshold - bottom)

    def _frame(self, axis: int, sign: float) -> TrackingFrame:
        """The upright plane along an axis, through where the tip is."""
        area, here = self._area, self._tip.here
        end = float((area.upper if sign > 0.0 else area.lower)[axis])
        return TrackingFrame(Line(axis, float(here[1 - axis]), float(here[axis]), end, float(here[Z])), area)


def _lowest_inside(task: Task, clear: float, swept: float, radius: float) -> float:
    """m, lowest height of an upright probe on a helix of a radius [m], within one that came down to a height.

    `swept` m from the axis nothing is above the height `clear` m less the sphere's radius.
    """
    lowest = float(task.area.lower[Z])
    for half, bottom in body(task):
        inside = radius + float(half.max()) <= swept
        tallest = clear if inside else float(task.area.upper[Z])
        lowest = max(lowest, tallest - task.probe.radius + task.clearance_threshold - bottom)
    return min(lowest, clear)


def bounded(task: Task, found: Found) -> Task:
    """The task of exploring what was found."""
    low, high = found.area.lower, found.area.upper
    start = np.array([0.5 * (low[X] + high[X]), low[Y], high[Z]])
    return replace(task, area=found.area, start=start, search_for=None, tallest=found.tallest)
