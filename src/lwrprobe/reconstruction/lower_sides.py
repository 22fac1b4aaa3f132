"""Sides below the lowest contacts on them, where the probe's body, the stick or a line's end let nothing be touched.

A side is taken to go on as it was seen to bend over the last lines: the bend fades over the length on which it was
seen. One that stands upright and is straight goes straight down, one that recedes goes on inwards. Without this, the
surface ran half way between the object and the nearest place that was passed freely, which below the probe's reach is
far beside the object.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.lower_ends import IN_PLANE, OF_A_SIDE, LowerEnds
from lwrprobe.reconstruction.lower_side import FINE, LEVEL, LowerSide
from lwrprobe.reconstruction.touches import Touches

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_STEP = 0.5  # of the pitch, between places
_DEEP = 1.0  # of the pitch: so far the contacts themselves show how a side goes on
_ACROSS = 0.75  # of the pitch: so far beside a place contacts on a floor tell of it
_FOOT_ON = 2.0, 1.0  # of the pitch: so far aside, and so little below the end of a side, is the floor it stands on
_PASSED = 0.9  # radii: so near to where the sphere's centre passed freely nothing is
_UNDER = -0.97  # z of the normal at which a side has become an underside
_CUT = 3.0  # radii: so far below its end free space shows that a side does not go on
_TURNED = -0.3  # z of the normal, from which on the end of a side is its lower edge
_MOST = 0.5  # share of the sides that end at such an edge, or are cut off, from which on all are taken to end there
_FOOT = 0.5  # of the way to the middle: so far sides lean in above a foot that nobody has touched
_OPPOSITE = 0.5  # cosine between a side's direction inwards and the normals on the object's other side
_NORMAL_SD = 0.1  # rad
_OWN = 0.25  # of the deviation of the field of the contacts: what it is off below these on random solids


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
    ends = LowerEnds(touches, clusters, pitch)
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
    around = places[:, None] + np.vstack([np.zeros(3), FINE * np.eye(3), -FINE * np.eye(3)])
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


def _with_foot(ends: LowerEnds, passed: cKDTree, touches: Touches, clusters: Clusters, pitch: float) -> list[LowerSide]:
    """The sides that show how they bend, changed so that they lead to a foot where none of them reaches the table.

    An upright side does not where free space cuts it off: where the sphere `passed` there. If all are upright and cut
    off, or there is none, the places where other sides were touched last count as well.
    """
    sides = ends.sides()

    def is_cut(side: LowerSide) -> bool:
        return _free_from(side, passed, touches.radius, _CUT * touches.radius) < np.inf

    if not all(side.straight and is_cut(side) for side in sides):
        return _feet(sides, touches, clusters, pitch) or sides
    edges = ends.edges()
    lower = sum(side.normal[2] < _TURNED or is_cut(side) for side in edges) + len(sides)
    edges = sides + edges
    if lower > _MOST * len(edges):
        edges = [side.underside(touches.radius) for side in edges]
    return _feet(edges, touches, clusters, pitch) or sides


def _free_from(side: LowerSide, passed: cKDTree, radius: float, length: float) -> float:
    """m below the end of a side, at most `length`, from where it does not go on: the sphere `passed` freely there; inf
    where it does."""
    down = np.arange(FINE, length + FINE, FINE)
    below, normals = side.below(down)
    free = passed.query(below - radius * normals)[0] < _PASSED * radius
    return float(down[np.argmax(free)]) if free.any() else np.inf


def _feet(sides: list[LowerSide], touches: Touches, clusters: Clusters, pitch: float) -> list[LowerSide]:
    """The sides, so that they become upright around a foot, where all of them would meet above the table; else none."""
    feet = []
    for side in sides:
        ahead, aside = side.plan_view(clusters.points)
        middle = 0.5 * float(ahead[aside < pitch].max(initial=0.0))
        down = np.arange(0.0, 2.0 * (side.end[2] - touches.table) + FINE, FINE)
        places, _ = side.below(down)
        met = side.plan_view(places)[0] > middle
        if -side.normal[2] < LEVEL and not (met & (places[:, 2] > touches.table)).any():
            return []
        lean = float(np.arcsin(np.clip(-side.normal[2], 0.0, 1.0)))
        along = max(_FOOT * middle, FINE) / max(lean, IN_PLANE)
        feet.append(replace(side, bend=-lean / along, seen=along, foot=True))
    return feet


def _stopped(side: LowerSide, row: np.ndarray, clusters: Clusters, pitch: float) -> np.ndarray:
    """(n,) bool: a floor lies above the place (n, 3), or the middle between the side and one that goes lower before."""
    (ahead, aside), height = side.plan_view(clusters.points), clusters.points[:, 2]
    top = clusters.normals[:, 2] > OF_A_SIDE[1]
    other = ~top & (clusters.normals[:, :2] @ side.inward > _OPPOSITE) & (ahead > 0.0) & (aside < pitch)
    floor = top & (height < side.end[2])
    run, _ = side.plan_view(row)
    middle = (ahead[other] < 2.0 * run[:, None]) & (height[other] < row[:, 2:])
    apart = np.linalg.norm(row[:, None, :2] - clusters.points[floor, :2], axis=2)
    just_below = side.end[2] - height[floor] < _FOOT_ON[1] * pitch
    over = (apart < _ACROSS * pitch) | (just_below & (apart < _FOOT_ON[0] * pitch))
    return middle.any(axis=1) | (over & (height[floor] > row[:, 2:])).any(axis=1)
