"""What a strategy remembers of its own way: where it touched, and where it passed without a touch."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan, nan

import numpy as np

SPACING = 0.0005
"""m, between two places that are remembered."""
NOWHERE = (nan,) * 6

Row = tuple[float, ...]


@dataclass(slots=True)
class Touched:
    """Places as rows: sphere's centre (3), contact point (3), normal (3), x of the grid line or NaN off the grid.

    Point and normal are NaN where nothing was touched.
    """

    _touches: list[Row] = field(default_factory=list)
    _passes: list[Row] = field(default_factory=list)
    _table: np.ndarray = field(default_factory=lambda: np.empty((0, 10)))
    _way: np.ndarray = field(default_factory=lambda: np.empty((0, 10)))

    def add(self, centre: np.ndarray, point: np.ndarray, normal: np.ndarray, line_x: float) -> None:
        """Remember a touch unless the last one was as good as there."""
        place = centre.tolist()
        if _new(self._touches, place, line_x):
            self._touches.append((*place, *point.tolist(), *normal.tolist(), line_x))
        self._stood(place, line_x)

    def passed(self, centre: np.ndarray, line_x: float) -> None:
        """Remember that the probe has stood there, touching or not."""
        self._stood(centre.tolist(), line_x)

    def _stood(self, place: list[float], line_x: float) -> None:
        if _new(self._passes, place, line_x):
            self._passes.append((*place, *NOWHERE, line_x))

    def __len__(self) -> int:
        return len(self._touches)

    def table(self) -> np.ndarray:
        """(n, 10) all touches; not to be written to."""
        self._table = _grown(self._table, self._touches)
        return self._table

    def way(self) -> np.ndarray:
        """(m, 10) all places, touching or not; not to be written to."""
        self._way = _grown(self._way, self._passes)
        return self._way


def _grown(known: np.ndarray, rows: list[Row]) -> np.ndarray:
    """What has come since the last time, at the end of what was made then: it is asked for in mid-motion."""
    new = rows[len(known) :]
    return np.concatenate([known, np.array(new, dtype=np.float64)]) if new else known


def _new(rows: list[Row], place: list[float], line_x: float) -> bool:
    """Whether a place is another one than the last; asked with every sample, so without numpy."""
    if not rows:
        return True
    last = rows[-1]
    same_line = last[9] == line_x or (isnan(last[9]) and isnan(line_x))
    away = max(abs(last[0] - place[0]), abs(last[1] - place[1]), abs(last[2] - place[2]))
    return away >= SPACING or not same_line
