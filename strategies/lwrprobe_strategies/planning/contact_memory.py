"""Where the tip touched, and where it has been."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan, nan

import numpy as np

SPACING = 0.0005
"""m between two places that are remembered: a quarter of the smallest feature that is planned with."""
NOT_TOUCHED = (nan,) * 6

Row = tuple[float, ...]


@dataclass(slots=True)
class ContactMemory:
    """Places as rows: sphere's centre (3), contact point (3), normal (3), x of the grid line or NaN off the grid.

    Point and normal are NaN where nothing was touched. All in m, world frame.
    """

    _contacts: list[Row] = field(default_factory=list)
    _trail: list[Row] = field(default_factory=list)
    _contact_rows: np.ndarray = field(default_factory=lambda: np.empty((0, 10)))
    _trail_rows: np.ndarray = field(default_factory=lambda: np.empty((0, 10)))

    def add(self, centre: np.ndarray, point: np.ndarray, normal: np.ndarray, grid_x: float) -> None:
        """Remember a contact, unless the last one was in the same place."""
        place = centre.tolist()
        if _elsewhere(self._contacts, place, grid_x):
            self._contacts.append((*place, *point.tolist(), *normal.tolist(), grid_x))
        if _elsewhere(self._trail, place, grid_x):
            self._trail.append((*place, *NOT_TOUCHED, grid_x))

    def passed(self, centre: np.ndarray, grid_x: float) -> None:
        """Remember that the sphere has been at a place (3,), in contact or not."""
        place = centre.tolist()
        if _elsewhere(self._trail, place, grid_x):
            self._trail.append((*place, *NOT_TOUCHED, grid_x))

    def __len__(self) -> int:
        return len(self._contacts)

    def contacts(self) -> np.ndarray:
        """(n, 10) all contacts; not to be written to."""
        self._contact_rows = _grown(self._contact_rows, self._contacts)
        return self._contact_rows

    def trail(self) -> np.ndarray:
        """(m, 10) all places, in contact or not; not to be written to."""
        self._trail_rows = _grown(self._trail_rows, self._trail)
        return self._trail_rows


def _grown(known: np.ndarray, rows: list[Row]) -> np.ndarray:
    """`known` with the rows that are new since it was made: it is asked for while the tip moves."""
    new = rows[len(known) :]
    return np.concatenate([known, np.array(new, dtype=np.float64)]) if new else known


def _elsewhere(rows: list[Row], place: list[float], grid_x: float) -> bool:
    """Whether a place differs from the last row's; called with every sample, so without numpy."""
    if not rows:
        return True
    last, (x, y, z) = rows[-1], place
    if abs(last[0] - x) >= SPACING or abs(last[1] - y) >= SPACING or abs(last[2] - z) >= SPACING:
        return True
    return not (last[9] == grid_x or (isnan(last[9]) and isnan(grid_x)))
