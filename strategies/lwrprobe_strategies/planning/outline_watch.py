"""When an outline has come around to where it began."""

from __future__ import annotations

from math import hypot

import numpy as np

CLOSED = 0.004
"""m from its beginning, within which an outline has come around."""
FAR = 0.04
"""m of way after which it may have."""


class OutlineWatch:
    """Measures the way along one outline. One object serves one outline."""

    def __init__(self) -> None:
        self._begin: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._way = 0.0

    def closed(self, here: np.ndarray) -> bool:
        """Whether the outline has come around with the tip at `here` (3,); called with every sample in contact."""
        if self._begin is None or self._last is None:
            self._begin = self._last = here.copy()
            return False
        step = here - self._last
        self._way += hypot(*step.tolist())
        self._last = here.copy()
        away = here - self._begin
        return self._way > FAR and hypot(float(away[0]), float(away[1])) < CLOSED
