"""A contour that leads on and on around the same place, as it does beside the end of a round object."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame

ADVANCE = 0.001
"""m further along the line than ever before, which is progress."""
SPARE = 0.05
"""m of path beyond that down a wall as high as the area and up the next one."""


class CirclingWatch:
    """Measures the path along contours since a line has last led further. One object serves one line.

    Parameters
    ----------
    area : no wall is higher, and no outline is longer than around it
    """

    def __init__(self, area: Area) -> None:
        dx, dy, dz = (area.upper - area.lower).tolist()
        self._upright, self._level = 2.0 * dz + SPARE, 2.0 * (dx + dy)
        self._farthest, self._path = -np.inf, 0.0

    def circles(self, frame: TrackingFrame, here: np.ndarray, step: float) -> bool:
        """Whether the contour leads nowhere; `here` (3,) is the tip, `step` m since the last call."""
        self._path += step
        along = frame.line.sign * float(here[frame.line.axis])
        if not frame.level and along > self._farthest + ADVANCE:
            self._farthest, self._path = along, 0.0
        return self._path > (self._level if frame.level else self._upright)
