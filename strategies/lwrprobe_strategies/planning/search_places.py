"""Where to search for an object of which nothing is known: places in the plan view, the likeliest first."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from lwrprobe.contracts import Area, InputError
from lwrprobe_strategies.planning.lines import X, Y

CELL, CELLS = 0.004, 60
"""m between the places that are considered, and how many there may be along a side: in a large area they are farther
apart."""
FINE = 5
"""Places along a cell at which it is asked what is missed."""
SLACK = 0.7
"""Share of half a cell's diagonal, by which objects in its middle are to be met better: of 0, 0.3, 0.5, 0.7 and 1 the
one with the fewest places in the end."""
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

    Raises
    ------
    InputError : the area has no place that is as far from its border, or no room for the smallest object
    """

    def __init__(self, area: Area, reach: float, smallest: float, keep: float) -> None:
        low, high = area.lower[:2], area.upper[:2]
        narrowest = float((high - low).min())
        if narrowest < 2.0 * keep:
            raise InputError("area", narrowest, f"at least {2.0 * keep:g} m wide, for the search to keep within it")
        if narrowest < smallest:
            raise InputError("area.search_for", smallest, f"at most {narrowest:g} m, the area's width")
        self._reach, self._smallest, self._keep = reach, smallest, keep
        self._low, self._high = low, high
        cell = max(CELL, float((high - low).max()) / CELLS)
        self._fine, self._between = _grid(low + 0.5 * smallest, high - 0.5 * smallest, cell / FINE)
        self._candidates, _ = _grid(low + keep, high - keep, cell)
        self._centres, beside = _grid(low + 0.5 * smallest, high - 0.5 * smallest, cell)
        self._slack = SLACK * beside
        self._searched: list[tuple[float, float]] = []

    def places(self) -> list[tuple[float, float]]:
        """x and y of each, m, in the order in which they are to be visited.

        Each of them meets the largest share of what those before it have not met. The last ones are where between the
        cells the smallest object would still be missed.
        """
        apart = cdist(self._candidates, self._centres)
        off = np.hypot(*(self._candidates - 0.5 * (self._low + self._high)).T)
        room = np.minimum(self._centres - self._low, self._high - self._centres).min(axis=1) + 1e-9
        sizes = [self._smallest]
        while sizes[-1] < FINER * float((self._high - self._low).min()):
            sizes.append(sizes[-1] / FINER)
        within = [self._reach + 0.5 * size - self._slack for size in sizes]
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
        return self._complete(found)

    def _complete(self, found: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """The places, and more of them until the smallest object is met wherever it is; the border may be too near."""
        inner = self._low + self._keep, self._high - self._keep
        apart = self._from(found)
        while float(apart.max()) > self._reach + 0.5 * self._smallest - self._between:
            x, y = np.clip(self._fine[int(np.argmax(apart))], *inner).tolist()
            if (x, y) in found:
                break
            found.append((x, y))
            apart = np.minimum(apart, np.hypot(*(self._fine - (x, y)).T))
        return found

    def searched(self, place: tuple[float, float]) -> None:
        """Nothing was met at a place."""
        self._searched.append(place)

    def missed(self) -> float:
        """m, diameter of the largest object that can have been missed, or somewhat more; infinite before the first."""
        return 2.0 * max(float(self._from(self._searched).max()) + self._between - self._reach, 0.0)

    def _from(self, places: list[tuple[float, float]]) -> np.ndarray:
        """(n,) m, from each place at which it is asked what is missed to the nearest one of those given."""
        return cKDTree(places).query(self._fine)[0] if places else np.full(len(self._fine), np.inf)


def _grid(low: np.ndarray, high: np.ndarray, cell: float) -> tuple[np.ndarray, float]:
    """(n, 2) m, places evenly over a rectangle, its middle among them, and the most [m] by which one is off them."""
    axes = [np.linspace(a, b, 2 * max(int(np.ceil(0.5 * (b - a) / cell)), 1) + 1) for a, b in zip(low, high)]
    off = float(np.hypot(*(0.5 * (axis[1] - axis[0]) for axis in axes)))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2), off
