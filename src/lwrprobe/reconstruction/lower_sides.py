"""Sides below the lowest contacts on them, where the probe's body, the stick or a line's end let nothing be touched.

A side is taken to go on as it was seen to bend over the last lines: the bend fades over the length on which it was
seen. One that stands upright and is straight goes straight down, one that recedes goes on inwards. Without this, the
surface ran half way between the object and the nearest place that was passed freely, which below the probe's reach is
far beside the object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.touches import Touches

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_OF_A_SIDE = -0.9, 0.35  # z of its normals: lower it is an underside, higher a top
_BESIDE = 0.6  # of the pitch: contacts of the same line, or of another that shows the side there
_LOOKED_UP = 2.0, 1.5  # of the pitch: so far above its end a side is looked at; the less where it does not bend evenly
_AS_LOW = 0.3  # of the pitch: so much higher than the lowest contact nearby one still ends a side
_HANDS = 1.3, 0.3  # of the pitch: so far aside at most and at least, lines beside show how a side goes on between them
_SHOWN = 2.0  # radii: over so much of that at least it has been touched
_FEWEST = 4  # contacts that show how a side bends
_ALIKE = 0.5  # cosine between the normals of one side
_SAME = 0.9  # the same between those of places that a side's end nearby tells of
_APART = 0.3  # of the pitch: rows of one side closer than that tell the same
_EVENLY = 0.1  # rad, root mean square: so far normals lie off an even bend
_STRAY = 0.05  # share of the normals that may be wrong
_SURE = 2.5  # standard deviations from which on a side bends or leans
_CLOSEST = 2.0  # radii of the sphere: what the centres' surface bends around more closely is an edge
_STEP = 0.5  # of the pitch, between places
_DEEP = 1.0  # of the pitch: so far the contacts themselves show how a side goes on
_ACROSS = 0.75  # of the pitch: so far beside a place contacts on a floor tell of it
_PASSED = 0.9  # radii: so near to where the sphere's centre passed freely nothing is
_UNDER = -0.97  # z of the normal at which a side has become an underside
_CUT = 3.0  # radii: so far below its end free space shows that a side does not go on
_TURNED = -0.3  # z of the normal, from which on the end of a side is its lower edge
_MOST = 0.5  # share of the sides that end at such an edge, or are cut off, from which on all are taken to end there
_LEVEL = 0.9  # -z of the normal that an underside has beside its edge: rows lead down as well
_FOOT = 0.5  # of the way to the middle: so far sides lean in above a foot that nobody has touched
_OPPOSITE = 0.5  # cosine between a side's direction inwards and the normals on the object's other side
_GROWTH = 0.03  # m of standard deviation a metre below the last contact, of an upright wall as a whole
_APIECE = 0.005  # the same of the wall's places beside each other: what was wrong of it is so everywhere
_GROWTH_BENT = 0.15  # the same of a side that leans or bends, seen on random solids
_NORMAL_SD = 0.1  # rad
_OWN = 0.25  # of the deviation of the field of the contacts: what it is off below these on random solids
_FINE = 1e-3  # m, steps in which a bend is followed
_PLANE = 14.0  # radii: so far along it a wall may be plane
_IN_PLANE = 0.07  # rad between the normals of places in one plane, and between that of an upright wall and the level
_OFF, _OFF_FARTHER = 3e-4, 0.02  # m, and share of the distance between such places, that one is off the other's plane


@dataclass(slots=True, frozen=True)
class _Side:
    """The lower end of what was touched of a side, on the centres' surface.

    Attributes
    ----------
    end, normal : (3,) m and unit
    bend : 1/m, how fast the normal turns down, downwards
    seen : m, length over which it was seen
    foot : whether it leads to a foot of which no contact tells
    """

    end: np.ndarray
    normal: np.ndarray
    bend: float
    seen: float
    foot: bool = False

    @property
    def inward(self) -> np.ndarray:
        """(2,) unit, level."""
        return -self.normal[:2] / np.linalg.norm(self.normal[:2])

    @property
    def straight(self) -> bool:
        """Whether it is an upright wall."""
        return self.bend == 0.0 and self.normal[2] == 0.0

    @property
    def growth(self) -> tuple[float, float]:
        """m of standard deviation a metre below the end: of each place, and what all places have in common."""
        if self.foot:
            return _APIECE, _GROWTH_BENT
        return (_APIECE, _GROWTH) if self.straight else (_GROWTH_BENT, 0.0)

    def underside(self, radius: float) -> _Side:
        """What leads inwards where the side has an edge at its end, around which the sphere has this radius [m]."""
        normal = np.array([*(-np.sqrt(1.0 - _LEVEL**2) * self.inward), -_LEVEL])
        return replace(self, end=self.end + radius * (normal - self.normal), normal=normal, bend=0.0)

    def plan_view(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) m each, how far points (n, 3) lie inwards of the end, and aside of that direction."""
        offset = points[:, :2] - self.end[:2]
        return offset @ self.inward, np.abs(offset[:, 0] * self.inward[1] - offset[:, 1] * self.inward[0])

    def below(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, 3) on the side at distances (n,) m below its end, and the normals there.

        A hollow goes on until it stands upright: below that it would have been touched.
        """
        fine = np.arange(0.0, along[-1] + 2.0 * _FINE, _FINE)
        turn = self.bend * self.seen * (1.0 - np.exp(-fine / self.seen))
        if self.bend < 0.0:
            turn = np.maximum(turn, min(np.arcsin(self.normal[2]), 0.0))
        down = _down(self.normal)
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        course = cosine * down - sine * self.normal
        steps = 0.5 * _FINE * (course[1:] + course[:-1])
        places = self.end + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        normals = cosine * self.normal + sine * down
        at = [np.column_stack([np.interp(along, fine, column) for column in rows.T]) for rows in (places, normals)]
        return at[0], at[1] / np.linalg.norm(at[1], axis=1, keepdims=True)


def find_lower_sides(
    touches: Touches, clusters: Clusters, pitch: float, walls: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[HermiteData, np.ndarray]:
    """Where the sphere's centre would be if it touched the sides lower down, and the surface's normals there.

    With them the standard deviation (n,) m that each place has in common with those beside it.

    `clusters` are those of the touches' centres, `pitch` [m] lies between their lines. Each row goes down from the
    lowest contacts of a side to where its foot is as low as the sphere's centre may come, to a floor, to where the
    sphere passed freely, or to the object's middle where its other side was touched lower down.

    `walls` are places (k, 3) on walls that are known to be upright, and their normals (k, 3). An outline at constant
    height does not show how a side bends: with `walls` its contacts go straight down where they lie in one plane with
    such a place, or with a straight side.
    """
    from scipy.spatial import cKDTree

    if touches.table is None:
        return _data(np.empty((0, 3)), np.empty((0, 3)), np.empty(0)), np.empty(0)
    passed = cKDTree(touches.visited)
    places, normals, apiece, common = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)], [np.empty(0)]
    ends = _LowerEnds(touches, clusters, pitch)
    sides = _with_foot(ends, passed, touches, clusters, pitch)
    for side in sides + (ends.upright(sides, walls) if walls is not None else []):
        if side.end[2] <= touches.lowest + _DEEP * pitch:
            continue
        down = np.arange(_STEP * pitch, 2.0 * (side.end[2] - touches.lowest + touches.radius), _STEP * pitch)
        row, facing = side.below(down)
        lean = np.clip(-facing[:, 2], 0.0, 1.0)
        ended = row[:, 2] < touches.lowest - touches.radius * lean - 0.5 * _STEP * pitch
        ended |= (lean > -_UNDER) | _stopped(side, row, clusters, pitch)
        ended |= down > _free_from(side, passed, touches.radius, down[-1])
        kept = ~np.logical_or.accumulate(ended)
        places.append(row[kept])
        normals.append(facing[kept])
        growth, shared = side.growth
        apiece.append(np.hypot(touches.noise, growth * down[kept]))
        common.append(shared * down[kept])
    return _data(np.concatenate(places), np.concatenate(normals), np.concatenate(apiece)), np.concatenate(common)


def moved_to_field(lower: HermiteData, common: np.ndarray, touched: HermiteField) -> HermiteData:
    """The sides with those that lean or bend moved and turned towards where the field of the contacts has them.

    `lower` and `common` (n,) are those of `find_lower_sides`. A side is seen along one line; contacts beside that, and
    how they bend, are in the field. Each counts by its deviation, for the place and for the normal.
    """
    bent = np.flatnonzero(common == 0.0)
    if not len(bent):
        return lower
    points, normals = lower.points.copy(), lower.normals.copy()
    places, facing = points[bent], normals[bent]
    around = places[:, None] + np.vstack([np.zeros(3), _FINE * np.eye(3), -_FINE * np.eye(3)])
    values = touched.values_near(places, around)
    guessed, own = lower.value_sd[bent] ** 2, (_OWN * touched.deviations(places)) ** 2
    share = (guessed / (guessed + own))[:, None]
    slope = values[:, 1:4] - values[:, 4:]
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    points[bent] -= share * values[:, :1] * facing
    normals[bent] = (1.0 - share) * facing + share * slope
    normals[bent] /= np.linalg.norm(normals[bent], axis=1, keepdims=True)
    return replace(lower, points=points, normals=normals)


def _data(centres: np.ndarray, normals: np.ndarray, deviation: np.ndarray) -> HermiteData:
    return HermiteData(centres, normals, deviation, np.full(len(centres), _NORMAL_SD))


def _down(normal: np.ndarray) -> np.ndarray:
    """(3,) unit, steepest way down on a surface with a normal (3,) that is not upright."""
    down = normal * normal[2] - [0.0, 0.0, 1.0]
    return down / np.linalg.norm(down)


def _with_foot(ends: _LowerEnds, passed: cKDTree, touches: Touches, clusters: Clusters, pitch: float) -> list[_Side]:
    """The sides that show how they bend, changed so that they lead to a foot where none of them reaches the table.

    An upright side does not where free space cuts it off: where the sphere `passed` there. If all are upright and cut
    off, or there is none, the places where other sides were touched last count as well.
    """
    sides = ends.sides()

    def is_cut(side: _Side) -> bool:
        return _free_from(side, passed, touches.radius, _CUT * touches.radius) < np.inf

    if not all(side.straight and is_cut(side) for side in sides):
        return _feet(sides, touches, clusters, pitch) or sides
    edges = ends.edges()
    lower = sum(side.normal[2] < _TURNED or is_cut(side) for side in edges) + len(sides)
    edges = sides + edges
    if lower > _MOST * len(edges):
        edges = [side.underside(touches.radius) for side in edges]
    return _feet(edges, touches, clusters, pitch) or sides


def _free_from(side: _Side, passed: cKDTree, radius: float, length: float) -> float:
    """m below the end of a side, at most `length`, from where it does not go on: the sphere `passed` freely there; inf
    where it does."""
    down = np.arange(_FINE, length + _FINE, _FINE)
    below, normals = side.below(down)
    free = passed.query(below - radius * normals)[0] < _PASSED * radius
    return float(down[np.argmax(free)]) if free.any() else np.inf


def _feet(sides: list[_Side], touches: Touches, clusters: Clusters, pitch: float) -> list[_Side]:
    """The sides, so that they become upright around a foot, where all of them would meet above the table; else none."""
    feet = []
    for side in sides:
        ahead, aside = side.plan_view(clusters.points)
        middle = 0.5 * float(ahead[aside < pitch].max(initial=0.0))
        down = np.arange(0.0, 2.0 * (side.end[2] - touches.table) + _FINE, _FINE)
        places, _ = side.below(down)
        met = side.plan_view(places)[0] > middle
        if -side.normal[2] < _LEVEL and not (met & (places[:, 2] > touches.table)).any():
            return []
        lean = float(np.arcsin(np.clip(-side.normal[2], 0.0, 1.0)))
        along = max(_FOOT * middle, _FINE) / max(lean, _IN_PLANE)
        feet.append(replace(side, bend=-lean / along, seen=along, foot=True))
    return feet


def _stopped(side: _Side, row: np.ndarray, clusters: Clusters, pitch: float) -> np.ndarray:
    """(n,) bool: a floor lies above the place (n, 3), or the middle between the side and one that goes lower before."""
    (ahead, aside), height = side.plan_view(clusters.points), clusters.points[:, 2]
    top = clusters.normals[:, 2] > _OF_A_SIDE[1]
    other = ~top & (clusters.normals[:, :2] @ side.inward > _OPPOSITE) & (ahead > 0.0) & (aside < pitch)
    floor = top & (height < side.end[2])
    run, _ = side.plan_view(row)
    middle = (ahead[other] < 2.0 * run[:, None]) & (height[other] < row[:, 2:])
    over = np.linalg.norm(row[:, None, :2] - clusters.points[floor, :2], axis=2) < _ACROSS * pitch
    return middle.any(axis=1) | (over & (height[floor] > row[:, 2:])).any(axis=1)


class _LowerEnds:
    """Places where each line's contacts with a side end below, the lowest first, and which of them are taken.

    An upright wall ends in other contacts as well that are about as low: the lowest may not show how it goes on, and
    between rows that are far apart the field leaves the wall.
    """

    def __init__(self, touches: Touches, clusters: Clusters, pitch: float) -> None:
        from scipy.spatial import cKDTree

        self._touches, self._clusters, self._pitch = touches, clusters, pitch
        self._points, self._normals = clusters.points, clusters.normals
        self._tree, self._level = cKDTree(clusters.points), cKDTree(clusters.points[:, :2])
        self._beside = max(_BESIDE * pitch, touches.radius)
        self._taken = np.zeros(len(clusters.points), dtype=bool)

    def sides(self) -> list[_Side]:
        """The sides that show how they bend."""
        found, ends = [], self._ends()
        near = self._tree.query_ball_point(self._points[ends], 1.5 * _LOOKED_UP[0] * self._pitch)
        around = self._around(ends, max(self._pitch, self._beside))
        wide = self._around(ends, _HANDS[0] * self._pitch)
        for i, above, others, aside in zip(ends.tolist(), near, around, wide):
            lowest = self._lowest(i, others)
            if self._lower_on_both_hands(i, aside) if lowest else self._told(i, others):
                continue
            side = self._bent(i, above)
            if side is not None and (lowest or side.straight):
                found.append(side)
                self._taken[i] = True
        return found

    def edges(self) -> list[_Side]:
        """The lowest places of sides that do not show how they bend, as if they went on straight; they stay untaken."""
        found, ends, taken = [], self._ends(), self._taken.copy()
        for i, others in zip(ends.tolist(), self._around(ends, max(self._pitch, self._beside))):
            if self._lowest(i, others) and not self._told(i, others):
                found.append(_Side(self._points[i], self._normals[i], 0.0, _SHOWN * self._touches.radius))
                self._taken[i] = True
        self._taken = taken
        return found

    def upright(self, found: list[_Side], walls: tuple[np.ndarray, np.ndarray]) -> list[_Side]:
        """Those that lie in one plane with a straight side that was `found`, or with one of the `walls`."""
        straight = [side for side in found if side.straight]
        places = np.vstack([walls[0], *(side.end for side in straight)])
        facing = np.vstack([walls[1], *(side.normal for side in straight)])
        more, ends, radius = [], self._ends(), self._touches.radius
        for i, others in zip(ends.tolist(), self._around(ends, max(self._pitch, self._beside))):
            level = self._normals[i] * [1.0, 1.0, 0.0]
            if self._taken[i] or abs(self._normals[i, 2]) > _IN_PLANE or self._told(i, others):
                continue
            if _coplanar(self._points[i], level, places, facing, radius).any():
                more.append(_Side(self._points[i], level / np.linalg.norm(level), 0.0, _SHOWN * radius))
                self._taken[i] = True
        return more

    def _ends(self) -> np.ndarray:
        """(n,) rows of the contacts with sides, the lowest first."""
        height = self._normals[:, 2]
        ends = np.flatnonzero((height > _OF_A_SIDE[0]) & (height < _OF_A_SIDE[1]))
        return ends[np.argsort(self._points[ends, 2], kind="stable")]

    def _around(self, ends: np.ndarray, reach: float) -> list[list[int]]:
        """Of each end the contacts near it in the plan view."""
        near: list[list[int]] = self._level.query_ball_point(self._points[ends, :2], reach).tolist()
        return near

    def _lowest(self, i: int, others: list[int]) -> bool:
        """Whether no contact of the line, or of another that shows the side there, lies lower."""
        close = np.linalg.norm(self._points[others, :2] - self._points[i, :2], axis=1) < self._beside
        lower = self._points[i, 2] - self._points[others, 2] > 1e-9
        return not (close & lower & (self._normals[others] @ self._normals[i] > 0.0)).any()

    def _told(self, i: int, others: list[int]) -> bool:
        """Whether the end of this side is known nearby, or is lower there."""
        alike, above = self._normals[others] @ self._normals[i], self._points[i, 2] - self._points[others, 2]
        gap = np.linalg.norm(self._points[others, :2] - self._points[i, :2], axis=1)
        known = (gap < _APART * self._pitch) & self._taken[others] & (alike > _SAME)
        return bool((known | (above > _AS_LOW * self._pitch) & (alike > 0.0)).any())

    def _lower_on_both_hands(self, i: int, others: list[int]) -> bool:
        """Whether the same side was touched lower down on either hand of a place: the surface in between follows."""
        offset, facing = self._points[others] - self._points[i], self._normals[i]
        lower = (offset[:, 2] < -_AS_LOW * self._pitch) & (self._normals[others] @ facing > _SAME)
        along = offset[lower, :2] @ [-facing[1], facing[0]] / np.linalg.norm(facing[:2])
        far = _HANDS[1] * self._pitch
        return bool((along > far).any() and (along < -far).any())

    def _bent(self, i: int, near: list[int]) -> _Side | None:
        """The side as the contacts `near` and above its end show it."""
        normal = self._normals[i]
        down, offset = _down(normal), self._points[near] - self._points[i]
        across = offset @ np.cross(normal, down)
        of_it = (np.abs(across) < self._beside) & (offset @ down < 1e-9) & (self._normals[near] @ normal > _ALIKE)
        above = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - across**2, 0.0))[of_it]
        facing = self._normals[near][of_it]
        turn = np.arctan2(-facing @ down, facing @ normal)
        return _side(self._points[i], normal, above, turn, self._touches, self._pitch)


def _coplanar(
    place: np.ndarray, normal: np.ndarray, places: np.ndarray, normals: np.ndarray, radius: float
) -> np.ndarray:
    """(n,) bool: a place lies in the planes at `places` (n, 3) that have these `normals` (n, 3), not far from them."""
    away = places - place
    apart = np.linalg.norm(away, axis=1)
    off = np.abs(np.einsum("ij,ij->i", away, normals))
    one = (apart < _PLANE * radius) & (off < _OFF + _OFF_FARTHER * apart)
    return one & (normals @ normal > np.cos(_IN_PLANE))


def _side(
    end: np.ndarray, normal: np.ndarray, above: np.ndarray, turn: np.ndarray, touches: Touches, pitch: float
) -> _Side | None:
    """The side whose normals `turn` (n,) rad up from `normal` at places (n,) m `above` its end.

    None where too little of it was touched, where it does not bend evenly, or where it is an edge.
    """
    for share in _LOOKED_UP:
        rows = above < share * pitch
        if np.count_nonzero(rows) < _FEWEST or above[rows].max() < min(_SHOWN * touches.radius, 0.9 * share * pitch):
            continue
        x, y = above[rows], turn[rows]
        bend, start, off = _line(x, y)
        if off < _EVENLY:
            break
    else:
        return None
    noise = max(off, touches.normal_noise) / np.sqrt(len(x))
    if abs(bend) * x.std() < _SURE * noise:
        bend, start = 0.0, float(np.median(y))
    if bend * _CLOSEST * touches.radius > 1.0:
        return None
    facing = np.cos(start) * normal - np.sin(start) * _down(normal)
    if bend <= 0.0 and facing[2] > -_SURE * noise:
        level = facing * [1.0, 1.0, 0.0]
        return _Side(end, level / np.linalg.norm(level), 0.0, x.max())
    if bend > 0.0:  # what stands on a table reaches down to it
        bend = min(bend, (1.0 + min(facing[2], 0.0)) / (end[2] - touches.table + touches.radius))
    return _Side(end, facing, bend, x.max())


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, value at 0 and root mean square residual of the line through (n,) values that single ones do not sway.

    Theil and Sen: the median of the slopes between all pairs. The residual is that without the share of stray values.
    """
    one, other = np.triu_indices(len(x), 1)
    apart = x[other] - x[one]
    kept = np.abs(apart) > 1e-9
    slope = float(np.median((y[other] - y[one])[kept] / apart[kept])) if kept.any() else 0.0
    start = float(np.median(y - slope * x))
    squares = np.sort((y - start - slope * x) ** 2)
    return slope, start, float(np.sqrt(np.mean(squares[: len(x) - int(_STRAY * len(x))])))
