"""Where the tip touched, and where it has been."""

from __future__ import annotations

from math import isnan, nan

import numpy as np

from lwrprobe_strategies.planning.growing_table import GrowingTable, Row

SPACING = 0.0005
"""m between two places that are remembered: a quarter of the smallest feature that is planned with."""
NOT_TOUCHED = (nan,) * 6

POINT, NORMAL = slice(3, 6), slice(6, 9)
"""Columns of a row: the contact point, and the surface's normal there. The sphere's centre is in the first three."""
POINT_X, POINT_Y, POINT_Z = 3, 4, 5
NORMAL_X, NORMAL_Y, NORMAL_Z = 6, 7, 8
GRID_X = 9
"""x of the grid line on which the contact lies, NaN off the grid."""


class ContactMemory:
    """Places as rows: sphere's centre (3), contact point (3), normal (3), x of the grid line or NaN off the grid.

    Point and normal are NaN where nothing was touched. All in m, world frame.
    """

    __slots__ = ("_contacts", "_trail")

    def __init__(self) -> None:
        self._contacts, self._trail = GrowingTable(10), GrowingTable(10)

    def add(self, centre: np.ndarray, point: np.ndarray, normal: np.ndarray, grid_x: float) -> None:
        """Remember a contact, unless the last one was in the same place."""
        place = centre.tolist()
        if _elsewhere(self._contacts.last, place, grid_x):
            self._contacts.add((*place, *point.tolist(), *normal.tolist(), grid_x))
        if _elsewhere(self._trail.last, place, grid_x):
            self._trail.add((*place, *NOT_TOUCHED, grid_x))

    def passed(self, centre: np.ndarray, grid_x: float) -> None:
        """Remember that the sphere has been at a place (3,), in contact or not."""
        place = centre.tolist()
        if _elsewhere(self._trail.last, place, grid_x):
            self._trail.add((*place, *NOT_TOUCHED, grid_x))

    def __len__(self) -> int:
        return len(self._contacts)

    def contacts(self) -> np.ndarray:
        """(n, 10) all contacts; not to be written to."""
        return self._contacts.rows()

    def trail(self) -> np.ndarray:
        """(m, 10) all places, in contact or not; not to be written to."""
        return self._trail.rows()


def _elsewhere(last: Row | None, place: list[float], grid_x: float) -> bool:
    """Whether a place differs from the last row's; called with every sample, so without numpy."""
    if last is None:
        return True
    x, y, z = place
    if abs(last[0] - x) >= SPACING or abs(last[1] - y) >= SPACING or abs(last[2] - z) >= SPACING:
        return True
    return not (last[GRID_X] == grid_x or (isnan(last[GRID_X]) and isnan(grid_x)))
