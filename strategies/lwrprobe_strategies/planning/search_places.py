"""Where to search for an object of which nothing is known: places in the plan view, from coarse to fine."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.lines import X, Y

CELL = 0.004
"""m, between the places that are considered."""
FINER = 0.7
"""Ratio of one size that is searched for to the last."""


class SearchPlaces:
    """Places such that objects of one size after the other, down to the smallest, are met wherever they are.

    An object counts by the largest level circle that fits over it, which lies in the area.

    Parameters
    ----------
    area : in which the object is
    reach : m, as far from a place as the search meets something there
    smallest : m, diameter of the smallest object
    keep : m, from the border of the area to a place
    """

    def __init__(self, area: Area, reach: float, smallest: float, keep: float) -> None:
        low, high = area.lower[:2], area.upper[:2]
        self._reach, self._smallest = reach, smallest
        self._candidates = _grid(low + keep, high - keep)
        self._centres = _grid(low + 0.5 * smallest, high - 0.5 * smallest)
        self._middle = 0.5 * (low + high)
        self._nearest = np.full(len(self._centres), np.inf)

    def places(self) -> list[tuple[float, float]]:
        """x and y of each, m, in the order in which they are to be visited."""
        found: list[tuple[float, float]] = []
        nearest = np.full(len(self._centres), np.inf)
        apart = np.hypot(*(self._candidates[:, None, :] - self._centres[None]).transpose(2, 0, 1))
        off = np.hypot(*(self._candidates - self._middle).T)
        size = float(min(np.ptp(self._centres, axis=0))) + self._smallest
        while True:
            within = self._reach + 0.5 * size
            while (open_ := nearest > within).any():
                # The one that leaves least; of equal ones that nearest to the middle, where most objects reach.
                new = (apart[:, open_] <= within).sum(axis=1)
                best = int(np.lexsort((off, -new))[0])
                if not new[best]:
                    break
                found.append((float(self._candidates[best, X]), float(self._candidates[best, Y])))
                nearest = np.minimum(nearest, apart[best])
            if size <= self._smallest:
                return found
            size = max(FINER * size, self._smallest)

    def searched(self, place: tuple[float, float]) -> None:
        """Nothing was met at a place."""
        self._nearest = np.minimum(self._nearest, np.hypot(*(self._centres - place).T))

    def missed(self) -> float:
        """m, diameter of the largest object that can have been missed; infinite before the first place."""
        return 2.0 * max(float(self._nearest.max()) - self._reach, 0.0)


def _grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n, 2) m, places evenly over a rectangle, and its middle among them."""
    axes = [np.linspace(a, b, 2 * max(int(np.ceil(0.5 * (b - a) / CELL)), 1) + 1) for a, b in zip(low, high)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
