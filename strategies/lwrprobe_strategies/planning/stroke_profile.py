"""The error that a stroke along a straight line over the estimated surface is expected to remove, piece by piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LOST = 0.04
"""Share of a stroke's worth that may be clipped from each of its ends."""


@dataclass(slots=True, eq=False)
class StrokeProfile:
    """What the surface is like along one straight line over the area.

    Attributes
    ----------
    along : (n,) m, of the faces within reach, on the line's axis
    removed : (n,) m^3, of each of them by a stroke along the whole line
    wall : (n,) -1 and +1 for faces of the walls that look along the axis towards - and +, else 0
    path_along, lengths : (k,) m, of the faces under the line and how much of its path each is
    path_wall : (k,) -1 and +1 on these walls, else 0
    """

    along: np.ndarray
    removed: np.ndarray
    wall: np.ndarray
    path_along: np.ndarray
    lengths: np.ndarray
    path_wall: np.ndarray

    def beyond(self, end: float, sign: int) -> tuple[float, float]:
        """m^3 and m, of the walls that look towards a sign of the axis, on that side of `end` m."""
        gained = (self.wall == sign) & (sign * (self.along - end) > 0.0)
        passed = (self.path_wall == sign) & (sign * (self.path_along - end) > 0.0)
        return float(self.removed[gained].sum()), float(self.lengths[passed].sum())

    def between(self, begin: float, end: float) -> tuple[float, float, float]:
        """m^3 from `begin` to `end` m on the axis; m of the path level or up; m down walls on the way."""
        low, high = min(begin, end), max(begin, end)
        gained = (self.along >= low) & (self.along <= high)
        passed = (self.path_along >= low) & (self.path_along <= high)
        down = passed & (self.path_wall == (1 if begin <= end else -1))
        descended = float(self.lengths[down].sum())
        return float(self.removed[gained].sum()), float(self.lengths[passed].sum()) - descended, descended

    def top(self) -> tuple[float, float] | None:
        """m, from where to where on the axis there is more than walls under the line; None where there is not."""
        over = self.path_along[self.path_wall == 0]
        return (float(over.min()), float(over.max())) if len(over) else None

    def clipped(self, begin: float, end: float) -> tuple[float, float]:
        """m, `begin` and `end` on the axis without what is not worth its time at either end."""
        low, high = min(begin, end), max(begin, end)
        inside = (self.along >= low) & (self.along <= high) & (self.wall == 0)
        worth, along = self.removed[inside], self.along[inside]
        if not worth.sum() > 0.0:
            return begin, begin
        order = np.argsort(along)
        share = np.cumsum(worth[order]) / worth.sum()
        first, last = np.searchsorted(share, (LOST, 1.0 - LOST))
        low, high = float(along[order][first]), float(along[order][min(last, len(order) - 1)])
        return (low, high) if begin <= end else (high, low)
