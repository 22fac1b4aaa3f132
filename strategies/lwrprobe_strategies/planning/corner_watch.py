"""Beyond a convex corner of a level contour the stick may meet what stands out above, before the sphere does."""

from __future__ import annotations

from math import cos, radians

import numpy as np

TURN = cos(radians(40.0))
"""Cosine of the turn of the normal, from which on a corner is rounded: the stick meets what is flush at 66 degrees."""
BEYOND = 0.005
"""m along the contour, after which a corner has been rounded: a quarter turn of the sphere, its path off an edge."""


class CornerWatch:
    """Notices that a contour rounds a corner. One object serves one contour."""

    def __init__(self) -> None:
        self._normal: np.ndarray | None = None
        self._corner: np.ndarray | None = None

    def rounds(self, here: np.ndarray, normal: np.ndarray) -> bool:
        """Whether the tip, at `here` (3,) on a surface with this normal (3,), has just come around a corner."""
        if self._normal is None:
            self._normal = normal.copy()
        if self._corner is None:
            if float(normal @ self._normal) > TURN:
                return False
            self._corner = here.copy()
        if np.abs(here - self._corner).max() < BEYOND:
            return True
        self._normal, self._corner = normal.copy(), None
        return False
