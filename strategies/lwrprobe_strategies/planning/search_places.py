"""Where to search for an object of which nothing is known: places in the plan view, the likeliest first."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.lines import X, Y

CELL = 0.004
"""m, between the places that are considered."""
FINER = 0.7
"""Ratio of one size that is searched for to the last: all of them are alike likely, wherever in the area they fit."""

ALIKE = 0.02
"""Share of what the best place meets, within which others meet as much: cells count no finer. That nearest to the
middle is taken."""


class SearchPlaces:
    """Places such that objects down to the smallest are met wherever they are, and most of them early.

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
        self._low, self._high = low, high
        self._candidates = _grid(low + keep, high - keep)
        self._centres = _grid(low + 0.5 * smallest, high - 0.5 * smallest)
        self._nearest = np.full(len(self._centres), np.inf)

    def places(self) -> list[tuple[float, float]]:
        """x and y of each, m, in the order in which they are to be visited.

        Each of them meets the largest share of what those before it have not met.
        """
        apart = np.hypot(*(self._candidates[:, None, :] - self._centres[None]).transpose(2, 0, 1))
        off = np.hypot(*(self._candidates - 0.5 * (self._low + self._high)).T)
        room = np.minimum(self._centres - self._low, self._high - self._centres).min(axis=1) + 1e-9
        sizes = [self._smallest]
        while sizes[-1] < FINER * float((self._high - self._low).min()):
            sizes.append(sizes[-1] / FINER)
        within = [self._reach + 0.5 * size for size in sizes]
        left = [room >= 0.5 * size for size in sizes]
        shares = [1.0 / max(int(open_.sum()), 1) for open_ in left]
        meets = np.zeros(len(self._candidates))
        for far, share, open_ in zip(within, shares, left):
            meets += share * (apart[:, open_] <= far).sum(axis=1)
        found: list[tuple[float, float]] = []
        while left[0].any():
            most = float(meets.max())
            if most < 1e-9:
                break
            alike = np.flatnonzero(meets >= (1.0 - ALIKE) * most)
            best = int(alike[np.argmin(off[alike])])
            found.append((float(self._candidates[best, X]), float(self._candidates[best, Y])))
            for far, share, open_ in zip(within, shares, left):
                met = open_ & (apart[best] <= far)
                meets -= share * (apart[:, met] <= far).sum(axis=1)
                open_ &= ~met
        return found

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
