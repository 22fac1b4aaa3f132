"""When an outline has come around to where it began, or leads on under something."""

from __future__ import annotations

from math import hypot

import numpy as np

CLOSED = 0.004
"""m from its beginning, within which an outline has come around."""
FAR = 0.04
"""m of path after which it may have."""
OVERHANG = -0.15
"""Share of the normal along z, below which the surface stands out over the sphere: the stick is about to touch it."""
BENEATH = 0.006
"""m of path under it, or without a reliable contact, after which the outline is given up."""


class OutlineWatch:
    """Measures the path along one outline. One object serves one outline.

    Attributes
    ----------
    closed : it has come around
    """

    def __init__(self) -> None:
        self.closed = False
        self._begin: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._path = self._beneath = 0.0

    def ends(self, here: np.ndarray, normal: np.ndarray, reliable: bool) -> bool:
        """Whether the outline ends with the tip at `here` (3,); called with every sample.

        `normal` (3,) is the tracked one; the contact is `reliable`, or maybe one of the stick.
        """
        if self._begin is None or self._last is None:
            self._begin = self._last = here.copy()
            return False
        step = here - self._last
        length = hypot(*step.tolist())
        self._path += length
        under = normal.item(2) < OVERHANG or not reliable
        self._beneath = self._beneath + length if under else 0.0
        self._last = here.copy()
        away = here - self._begin
        self.closed = self._path > FAR and hypot(float(away[0]), float(away[1])) < CLOSED
        return self.closed or self._beneath > BENEATH
