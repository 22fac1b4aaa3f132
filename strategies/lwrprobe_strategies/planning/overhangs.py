"""Where a motion sideways may meet something with the stick before the sphere meets it.

That takes an overhang: something that reaches further out above the sphere than beside it. It may be anywhere near
what was touched above the sphere's height, as soon as a touch has shown that the object overhangs up there. It is not
where the upright stick itself has stood.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area, Confidence, Contact, Doubt, Probe
from lwrprobe_strategies.planning.free_space import UPRIGHT

CELL = 0.001
"""m, edge of the squares in the plan view for which heights are kept."""
LEANS = -0.15
"""Share of the normal along z, below which a touch is one of an overhang (9 degrees)."""
WITNESSES = 4
"""Touches in a row that lean so, from which on it is no noise."""
TWICE = 2
"""Contacts of the stick in a row, from which on it is one: the first alone may be too weak to decide."""
AHEAD = 0.003
"""m by which a place ahead is checked: the stick's radius, and the way of braking."""
FAR = 2.0
"""Times the distance within which an unknown part of the object may be met: how far overhangs are evidence for it."""


class Overhangs:
    """Heights in the plan view: of what was touched, of what overhangs, and down to where the stick has stood.

    Parameters
    ----------
    area, probe : as in the task
    beside : m sideways from what was touched, within which more of the object may be
    """

    def __init__(self, area: Area, probe: Probe, beside: float) -> None:
        self._low = area.lower[:2] - beside
        shape = tuple(np.ceil((area.upper[:2] + beside - self._low) / CELL).astype(int) + 1)
        self._touched, self._overhang = np.full(shape, -np.inf), np.full(shape, -np.inf)
        self._stood = np.full(shape, np.inf)
        self._probe, self._tallest = probe, float(area.upper[2]) - probe.radius
        self._cells = round(beside / CELL)
        self._leaning, self._above, self._found = 0, 0, False

    def note(self, pose: np.ndarray, contact: Contact | None) -> None:
        """The tip is at a pose (4, 4) and touches something or nothing; called with every sample."""
        x, y, z = pose[:3, 3].tolist()
        i, j = self._cell(x, y)
        if contact is None:
            if -pose.item(2, 2) > UPRIGHT:
                stood = self._stood[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
                np.minimum(stood, z, out=stood)
            return
        if contact.confidence is Confidence.RELIABLE:
            px, py, pz = contact.point.tolist()
            k, m = self._cell(px, py)
            self._touched[k, m] = max(self._touched.item(k, m), pz)
            self._leaning = self._leaning + 1 if contact.normal.item(2) < LEANS else 0
            if self._leaning >= WITNESSES:
                self._add(k, m, pz)
        above = contact.reason is Doubt.AXIS_MISSES and contact.point.item(2) > z + self._probe.radius
        self._above = self._above + 1 if above else 0
        if self._above >= TWICE:
            self._add(i, j, contact.point.item(2))

    def stick_met(self, place: np.ndarray) -> None:
        """Something touches the stick, at a height that is not known, while the sphere is at a place (3,)."""
        self._add(*self._cell(place.item(0), place.item(1)), self.reach(place) + place.item(2))

    def _add(self, i: int, j: int, height: float) -> None:
        self._found = True
        self._overhang[i, j] = max(self._overhang.item(i, j), height)
        self._touched[i, j] = max(self._touched.item(i, j), height)

    def reach(self, place: np.ndarray) -> float:
        """m above the sphere's centre, at a place (3,), up to which something may meet the stick."""
        return min(max(self._tallest - place.item(2), 0.0), self._probe.sensor_distance)

    def ahead(self, place: np.ndarray, along: np.ndarray) -> bool:
        """Whether the upright stick may meet one, for a sphere that goes from a place (3,) along a unit vector (3,)."""
        if not self._found:
            return False
        z = place.item(2)
        i, j = self._cell(place.item(0) + AHEAD * along.item(0), place.item(1) + AHEAD * along.item(1))
        if self._stood.item(i, j) < z + CELL:
            return False
        return self._highest(self._touched, i, j, self._cells) > z + self._probe.radius and (
            self._highest(self._overhang, i, j, round(FAR * self._cells)) > z
        )

    @staticmethod
    def _highest(heights: np.ndarray, i: int, j: int, cells: int) -> float:
        return float(heights[max(i - cells, 0) : i + cells + 1, max(j - cells, 0) : j + cells + 1].max())

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        """Indices of the square of a place; the nearest one where it is outside."""
        i, j = int((x - self._low.item(0)) / CELL), int((y - self._low.item(1)) / CELL)
        return min(max(i, 0), self._touched.shape[0] - 1), min(max(j, 0), self._touched.shape[1] - 1)
