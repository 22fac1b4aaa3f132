"""The places where the contacts with the sides end below, and the sides that go on from there."""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.lower_side import LOOKED_UP, SHOWN, LowerSide, fitted_side, steepest_down
from lwrprobe.reconstruction.touches import Touches

OF_A_SIDE = -0.9, 0.35  # z of its normals: lower it is an underside, higher a top
_BESIDE = 0.6  # of the pitch: contacts of the same line, or of another that shows the side there
_AS_LOW = 0.3  # of the pitch: so much higher than the lowest contact nearby one still ends a side
_HANDS = 1.3, 0.3  # of the pitch: so far aside at most and at least, lines beside show how a side goes on between them
_ALIKE = 0.5  # cosine between the normals of one side
_SAME = 0.9  # the same between those of places that a side's end nearby tells of
_APART = 0.3  # of the pitch: rows of one side closer than that tell the same
_PLANE = 14.0  # radii: so far along it a wall may be plane
IN_PLANE = 0.07  # rad between the normals of places in one plane, and between that of an upright wall and the level
_OFF, _OFF_FARTHER = 3e-4, 0.02  # m, and share of the distance between such places, that one is off the other's plane


class LowerEnds:
    """Places where each line's contacts with a side end below, the lowest first, and which of them are taken.

    An upright wall ends in other contacts as well that are about as low: the lowest may not show how it goes on, and
    between rows that are far apart the field leaves the wall.
    """

    def __init__(self, touches: Touches, clusters: Clusters, pitch: float) -> None:
        from scipy.spatial import cKDTree

        self._touches, self._pitch = touches, pitch
        self._points, self._normals = clusters.points, clusters.normals
        self._tree, self._level = cKDTree(clusters.points), cKDTree(clusters.points[:, :2])
        self._beside = max(_BESIDE * pitch, touches.radius)
        self._taken = np.zeros(len(clusters.points), dtype=bool)

    def sides(self) -> list[LowerSide]:
        """The sides that show how they bend."""
        found, ends = [], self._ends()
        near = self._tree.query_ball_point(self._points[ends], 1.5 * LOOKED_UP[0] * self._pitch)
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

    def edges(self) -> list[LowerSide]:
        """The lowest places of sides that do not show how they bend, as if they went on straight; they stay untaken."""
        found, ends, taken = [], self._ends(), self._taken.copy()
        for i, others in zip(ends.tolist(), self._around(ends, max(self._pitch, self._beside))):
            if self._lowest(i, others) and not self._told(i, others):
                found.append(LowerSide(self._points[i], self._normals[i], 0.0, SHOWN * self._touches.radius))
                self._taken[i] = True
        self._taken = taken
        return found

    def upright(self, found: list[LowerSide], walls: tuple[np.ndarray, np.ndarray]) -> list[LowerSide]:
        """Those that lie in one plane with a straight side that was `found`, or with one of the `walls`."""
        straight = [side for side in found if side.straight]
        places = np.vstack([walls[0], *(side.end for side in straight)])
        facing = np.vstack([walls[1], *(side.normal for side in straight)])
        more, ends, radius = [], self._ends(), self._touches.radius
        for i, others in zip(ends.tolist(), self._around(ends, max(self._pitch, self._beside))):
            level = self._normals[i] * [1.0, 1.0, 0.0]
            if self._taken[i] or abs(self._normals[i, 2]) > IN_PLANE or self._told(i, others):
                continue
            if _coplanar(self._points[i], level, places, facing, radius).any():
                more.append(LowerSide(self._points[i], level / np.linalg.norm(level), 0.0, SHOWN * radius))
                self._taken[i] = True
        return more

    def _ends(self) -> np.ndarray:
        """(n,) rows of the contacts with sides, the lowest first."""
        height = self._normals[:, 2]
        ends = np.flatnonzero((height > OF_A_SIDE[0]) & (height < OF_A_SIDE[1]))
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

    def _bent(self, i: int, near: list[int]) -> LowerSide | None:
        """The side as the contacts `near` and above its end show it."""
        normal = self._normals[i]
        down, offset = steepest_down(normal), self._points[near] - self._points[i]
        across = offset @ np.cross(normal, down)
        of_it = (np.abs(across) < self._beside) & (offset @ down < 1e-9) & (self._normals[near] @ normal > _ALIKE)
        above = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - across**2, 0.0))[of_it]
        facing = self._normals[near][of_it]
        turn = np.arctan2(-facing @ down, facing @ normal)
        return fitted_side(self._points[i], normal, above, turn, self._touches, self._pitch)


def _coplanar(
    place: np.ndarray, normal: np.ndarray, places: np.ndarray, normals: np.ndarray, radius: float
) -> np.ndarray:
    """(n,) bool: a place lies in the planes at `places` (n, 3) that have these `normals` (n, 3), not far from them."""
    away = places - place
    apart = np.linalg.norm(away, axis=1)
    off = np.abs(np.einsum("ij,ij->i", away, normals))
    one = (apart < _PLANE * radius) & (off < _OFF + _OFF_FARTHER * apart)
    return one & (normals @ normal > np.cos(IN_PLANE))
