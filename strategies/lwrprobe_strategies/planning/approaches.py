"""Approaches: paths to where a line begins, through what is known to be free, or over the top of the area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.free_space import BORDER, GAP, UPRIGHT, FreeSpace
from lwrprobe_strategies.planning.lines import DOWN, Line, X, Y, Z
from lwrprobe_strategies.planning.paths import HELD, THERE, SpeedLimit, Speeds, Waypoint, seconds, tip_pose
from lwrprobe_strategies.planning.upright_body import Clear

OWN_COLUMN = 0.0025
"""m sideways, within which a place above lies in the probe's own column: half of the sphere's radius."""
BESIDE = 0.02
"""m from a place on the return path to the start of a line at the same height, up to which that is a path to it."""
DEEP = 5.0
"""Metres sideways that take as long as one down into the unknown."""
BEFORE = 0.006
"""m before the end of a level path, up to which it is fast where it ends at a wall."""
FARTHEST = 0.3
"""m sideways, as which the rest of a path from a known column may count at most; more is no gain."""
AROUND = 0.1
"""m along x and y, within which a place from which the probe may go straight up is worth a level path through the
unknown: across the stick the probe gives way, so that it goes several times as fast there as down."""
FAR_BELOW = 0.02
"""m from the highest touch up to the area's top, from which on the path over the top is a detour."""
HOVER = 0.0005
"""m above a known contact, down to which a descent is fast: the stick has filled the column there."""
SOUGHT = 0.003
"""m below a known contact, down to which the surface is sought: it may fall by twice the distance from that contact to
the line, which is up to 1.5 mm away."""


@dataclass(frozen=True, eq=False)
class Departure:
    """From where, and with what, the probe sets out: paths lead from there to where lines begin.

    Attributes
    ----------
    here : (3,) m, place of the sphere's centre
    turn : (3, 3), the orientation in which the line is to be driven
    area : of the sphere's centre
    free : what the probe has shown to be free
    speeds : how fast it may be
    clear : whether a path may lead sideways through the unknown, from one place (3,) to another
    allows : whether a path may lead from one pose (4, 4) to another, anywhere
    body : where all of the probe is known to fit; None = nowhere
    held : (3, 3), the orientation in which the probe sets out; None = as it is to be driven
    met : (n, 3) m, where paths have met something on the way: no path leads there again
    """

    here: np.ndarray
    turn: np.ndarray
    area: Area
    free: FreeSpace
    speeds: Speeds
    clear: Clear = lambda begin, end: True
    allows: Clear = lambda begin, end: True
    body: BodySpace | None = None
    held: np.ndarray | None = None
    met: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))

    def path_to(self, line: Line) -> list[Waypoint]:
        """To the start of a line, along what is known to be free, else over the top of the area: the quickest."""
        here, turn, area, free = self.here, self.turn, self.area, self.free
        if not line.on_surface and abs(line.start[Z] - here[Z]) < BORDER and free.swept(here, line.start):
            return [Waypoint(line.start, rotation=turn)]
        if not line.on_surface and _above(here, line.start):
            return [replace(waypoint, rotation=turn) for waypoint in up_from(here, line.start, free)]
        start, touch = _touched_at(line, area) if line.on_surface else (line.start, [])
        up, top = self._up, float(area.upper[Z])
        above = Waypoint(np.array([start[X], start[Y], top]), rotation=turn)
        upright = _upright(turn)
        if line.on_surface:
            down = _down_to(start, free, SpeedLimit.COLUMN)
        elif upright or _on_border(start, area):
            down = _down_at(start, top, free)
        else:  # what the upright stick has shown to be free is not where a leaning one goes
            fits = self.body is not None and self.body.fits(tip_pose(above.place, turn), tip_pose(start, turn))
            down = [Waypoint(start, SpeedLimit.KNOWN if fits else SpeedLimit.GUARDED)]
        straight_down = [*up, above, *down]
        columns = [one for one in _known_columns(free, start, line.axis) if upright or _on_border(one, area)]
        paths = [[*up, *_beside(column, start, turn, top, free)] for column in columns]
        if line.on_surface or not columns:
            paths.append(straight_down)
        if not line.on_surface and upright:
            around = _columns_around(start, free, self.speeds)
            paths += [[*up, *_beside(column, start, turn, top, free)] for column in around]
        paths += _as_it_came(start, here, turn, free)
        paths += _up_to(start, turn, self._to_column, free)
        paths += _along_border(line, here, turn, free)
        if self.body is not None and not upright:
            paths += self._through_known(start, self.body)
            paths += [] if _on_border(start, area) else self._leaning_at_last(line, self.body)
        paths = [[*path, *touch] for path in paths]
        if upright and free.upright:
            paths += _level_over(line, here, turn, top, free)
        for path in sorted(paths, key=lambda path: seconds(path, here, self.speeds)):
            if self._may_take(path):
                return path
        return [*straight_down, *touch]

    def _through_known(self, start: np.ndarray, body: BodySpace) -> Iterator[list[Waypoint]]:
        """To where a leaning line begins, straight or around a corner, where all of the probe is known to fit."""
        here, turn = self.here, self.turn
        level, over = np.array([*start[:2], here[Z]]), np.array([*here[:2], start[Z]])
        for corner in ([], [level], [over]):
            places = [*corner, start]
            poses = [tip_pose(here, turn if self.held is None else self.held), *(tip_pose(p, turn) for p in places)]
            if all(body.fits(*leg) for leg in pairwise(poses)):
                yield [Waypoint(place, SpeedLimit.KNOWN, turn) for place in places]

    def _leaning_at_last(self, line: Line, body: BodySpace) -> Iterator[list[Waypoint]]:
        """Upright from the border along a line, as far as the probe is known to fit, and leaning from there on."""
        border, top = float((self.area.lower if line.sign > 0.0 else self.area.upper)[line.axis]), self.area.upper[Z]
        before = replace(line, begin=border, end=line.begin, rotation=None)
        known = body.fits_to(before)
        if line.sign * (known - border) > 0.0:
            over = Waypoint(np.array([*before.start[:2], top]), rotation=body.upright)
            along = Waypoint(before.at(known), SpeedLimit.KNOWN, body.upright)
            down = _down_at(before.start, float(top), self.free)
            yield [*self._up, over, *down, along, Waypoint(line.start, SpeedLimit.GUARDED, self.turn)]

    @cached_property
    def _to_column(self) -> list[Waypoint]:
        """Back to where the upright probe may go straight up; nothing where no path is known."""
        back = self.free.back_to_column()
        if not back or np.abs(back[0][0] - self.here).max() > OWN_COLUMN:
            return []
        return [Waypoint(place, rotation=rotation) for place, rotation in back]

    @cached_property
    def _up(self) -> list[Waypoint]:
        """To the top of the area: straight up, or first to a column from which that is quicker.

        Above a place to which the sphere did not come down it might meet something with its flank. To a column the
        probe goes back on its own path, or level.
        """
        here, free, top = self.here, self.free, float(self.area.upper[Z])
        up = up_from(here, np.array([here[X], here[Y], top]), free)
        paths = []
        if self._to_column:
            column = self._to_column[-1].place
            paths.append([*self._to_column, *up_from(column, np.array([*column[:2], top]), free)])
        for column in _columns_around(here, free, self.speeds) if free.upright else []:
            own = np.array([here[X], here[Y], max(here[Z], column[Z])])
            rise = up_from(here, own, free) if own[Z] - here[Z] > THERE else []
            foot = np.array([*column[:2], own[Z]])
            paths.append([*rise, *_level(own, foot, free), Waypoint(np.array([*column[:2], top]))])
        slowest = seconds(up, here, self.speeds)
        timed = [(time, path) for path in paths if (time := seconds(path, here, self.speeds)) < slowest]
        for _, path in sorted(timed, key=lambda one: one[0]):
            if self._may_take(path):
                return path
        return up

    def _may_take(self, path: list[Waypoint]) -> bool:
        if len(self.met) and _leads_to(path, self.here, self.met):
            return False
        return _clear_sideways(path, self.here, self.clear) and _allowed(path, self.here, self.turn, self.allows)


def _touched_at(line: Line, area: Area) -> tuple[np.ndarray, list[Waypoint]]:
    """(3,) m, right above where a line begins on a surface that was touched beside it, and down to that: it may have
    fallen until there.
    """
    start = line.start
    above = np.array([start[X], start[Y], max(line.free_to, start[Z]) + HOVER])
    deep = min(max(start[Z] - SOUGHT, float(area.lower[Z])), start[Z] - HOVER)
    return above, [Waypoint(np.array([start[X], start[Y], deep]), SpeedLimit.GUARDED)]


def _down_at(start: np.ndarray, top: float, free: FreeSpace) -> list[Waypoint]:
    """Down from the top to a place (3,): as far as the stick has stood there, and guarded from there on."""
    stood = free.stood_down_to(start)
    if stood >= top - THERE:
        return _down_to(start, free, SpeedLimit.GUARDED)
    known = np.array([*start[:2], max(stood, start[Z])])
    foot = [Waypoint(start, SpeedLimit.GUARDED)] if stood > start[Z] else []
    return [*_down_to(known, free, SpeedLimit.COLUMN), *foot]


def _upright(turn: np.ndarray) -> bool:
    """Whether the stick of a tip held by `turn` (3, 3) fills a vertical column."""
    return -turn.item(Z, Z) > UPRIGHT


def _on_border(place: np.ndarray, area: Area) -> bool:
    """Whether a place (3,) is on the area's border: nothing should stand there, and beyond it nothing does."""
    inside = np.minimum(place - area.lower, area.upper - place)[:Z]
    return bool(inside.min() < BORDER)


def _beside(column: np.ndarray, start: np.ndarray, turn: np.ndarray, top: float, free: FreeSpace) -> list[Waypoint]:
    """Down a known column, to its foot (3,), and level from there to above where the line begins."""
    over = Waypoint(np.array([*column[:2], top]), rotation=turn)
    level = np.array([*start[:2], column[Z]])
    foot = [Waypoint(start, SpeedLimit.GUARDED)] if column[Z] - start[Z] > THERE else []
    aside = _level(column, level, free) if _upright(turn) else [Waypoint(level, SpeedLimit.GUARDED)]
    return [over, Waypoint(column), *aside, *foot]


def _level_over(
    line: Line, here: np.ndarray, turn: np.ndarray, top: float, free: FreeSpace
) -> Iterator[list[Waypoint]]:
    """Level to above where a line begins, below the top of an area that reaches far above all that was touched.

    A little above that; and above the higher one of both places, beside the object.
    """
    start, highest = line.start, free.highest_touch()
    if not FAR_BELOW < top - highest < np.inf:
        return
    for known in (highest,) if line.on_surface else (highest, -np.inf):
        level = max(known, here[Z], start[Z]) + GAP
        own, over = np.array([*here[:2], level]), np.array([*start[:2], level])
        unknown = SpeedLimit.GUARDED if level > highest else SpeedLimit.LEVEL
        across = Waypoint(over, SpeedLimit.FREE if free.swept(own, over) else unknown, turn)
        fits = not line.on_surface and free.clear_down_to(start.item(X), start.item(Y)) < level
        down = _down_to(start, free, SpeedLimit.GUARDED) if fits else [Waypoint(start, SpeedLimit.GUARDED)]
        if level < top:
            yield [*up_from(here, own, free), across, *down]


def _as_it_came(start: np.ndarray, here: np.ndarray, turn: np.ndarray, free: FreeSpace) -> list[list[Waypoint]]:
    """Back on the probe's own path to near where the line begins."""
    back = free.back_to(start, BESIDE)
    if back is None or np.abs(back[0][0] - here).max() >= OWN_COLUMN or np.vdot(turn, back[-1][1]) <= HELD:
        return []
    return [[*(Waypoint(place, rotation=turn) for place, _ in back), Waypoint(start, SpeedLimit.GUARDED)]]


def _up_to(start: np.ndarray, turn: np.ndarray, to_column: list[Waypoint], free: FreeSpace) -> list[list[Waypoint]]:
    """Straight up from the foot of the probe's own column, where the line begins above it."""
    if not to_column or not _above(to_column[-1].place, start) or np.vdot(turn, to_column[-1].rotation) <= HELD:
        return []
    return [[*to_column, *up_from(to_column[-1].place, start, free)]]


def _along_border(line: Line, here: np.ndarray, turn: np.ndarray, free: FreeSpace) -> list[list[Waypoint]]:
    """Level along the border to a line that begins on it, from a place there.

    Nothing should stand on the border; where something does, the area is cut through an object.
    """
    if line.axis != Y or abs(here[Y] - line.begin) > BORDER:
        return []
    start = line.start
    level = np.array([start[X], start[Y], here[Z]])
    along = [Waypoint(here, rotation=turn), Waypoint(level, SpeedLimit.GUARDED)]
    lower = here[Z] > start[Z] + BORDER
    return [along + ([Waypoint(start, SpeedLimit.GUARDED)] if lower else up_from(level, start, free))]


def _above(low: np.ndarray, high: np.ndarray) -> bool:
    """Whether a place (3,) lies above another one, in the probe's own column."""
    return bool(np.abs(high[:2] - low[:2]).max() < OWN_COLUMN and high[Z] > low[Z])


def _leads_to(path: list[Waypoint], here: np.ndarray, places: np.ndarray) -> bool:
    """Whether a path from `here` (3,) comes to one of the places (n, 3) from elsewhere."""
    away = np.abs(places - here).max(axis=1) > OWN_COLUMN
    for waypoint in path:
        motion, apart = waypoint.place - here, places - here
        share = np.clip(apart @ motion / max(float(motion @ motion), 1e-18), 0.0, 1.0)
        near = np.abs(apart - share[:, None] * motion).max(axis=1) < OWN_COLUMN
        if (away & near).any():
            return True
        here = waypoint.place
        away |= np.abs(places - here).max(axis=1) > OWN_COLUMN
    return False


def _clear_sideways(path: list[Waypoint], here: np.ndarray, clear: Clear) -> bool:
    """Whether a path from `here` (3,) leads sideways through the unknown only where that is clear."""
    for waypoint in path:
        sideways = np.abs(waypoint.place - here)[:2].max() > OWN_COLUMN
        unknown = waypoint.speed_limit in (SpeedLimit.GUARDED, SpeedLimit.LEVEL)
        if unknown and sideways and not clear(here, waypoint.place):
            return False
        here = waypoint.place
    return True


def _allowed(path: list[Waypoint], here: np.ndarray, turn: np.ndarray, allows: Clear) -> bool:
    """Whether a path from `here` (3,), for a tip held by `turn` (3, 3) until a waypoint has another one, is allowed."""
    begin = tip_pose(here, turn)
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
                found.append(np.array([*stood[best, :2], max(deep[best], low)]))
    return found


def _columns_around(place: np.ndarray, free: FreeSpace, speeds: Speeds) -> list[np.ndarray]:
    """(3,) m, places around one (3,), from which the sphere fits straight up.

    To each side along x and y the one between which and the place an upright probe goes soonest: level, and with care.
    """
    stood = free.open_around(place, AROUND)
    apart, rise = stood[:, :2] - place[:2], np.maximum(stood[:, Z] - place[Z], 0.0)
    level = min(speeds.guarded(np.eye(3)[axis]) for axis in (X, Y))
    time = np.hypot(*apart.T) / level + rise / speeds.guarded(DOWN)
    found = []
    for right, back in product((False, True), repeat=2):
        side = ((apart[:, X] > 0.0) == right) & ((apart[:, Y] > 0.0) == back)
        if side.any():
            best = int(np.argmin(np.where(side, time, np.inf)))
            found.append(np.array([*stood[best, :2], max(stood[best, Z], place[Z])]))
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
