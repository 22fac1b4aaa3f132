"""The rises of force of a run's touches, kept for what is learnt of the stiffness after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contact.wrench import Wrench

LONGEST = 0.5
"""s, after which a rise is over."""
PATIENCE = 6
"""Samples without a new largest force after which a rise is over."""
FREE = 0.25
"""Share of the threshold below which nothing is touched."""
FEWEST = 5
"""Samples of one rise."""


@dataclass(slots=True, frozen=True)
class TouchRise:
    """One touch from the first sign of a force to its first maximum.

    Attributes
    ----------
    time : s of the run at its end
    places : (m, 3) m, of the unloaded tip
    forces : (m, 3) N, world frame
    """

    time: float
    places: np.ndarray
    forces: np.ndarray


class TouchRises:
    """Collects one rise for each touch: a force that goes on is no new one.

    Parameters
    ----------
    threshold : N, above it a touch is declared
    """

    def __init__(self, threshold: float) -> None:
        self._free = FREE * threshold
        self._rows: list[tuple[float, np.ndarray, np.ndarray]] = []
        self._top, self._not_risen, self._over = 0.0, 0, False
        self.found: list[TouchRise] = []

    def update(self, wrench: Wrench, place: np.ndarray, time: float) -> None:
        """One sample, the unloaded tip (3,) m at its instant and its time [s] in the run."""
        size = wrench.magnitude
        if size < self._free:
            self._close()
            self._over = False
            return
        if self._over or not wrench.usable:
            return
        self._rows.append((time, place.copy(), wrench.world_force.copy()))
        self._not_risen = 0 if size > self._top else self._not_risen + 1
        self._top = max(size, self._top)
        if self._not_risen >= PATIENCE or time - self._rows[0][0] > LONGEST:
            self._close()
            self._over = True

    def _close(self) -> None:
        rows, self._rows = self._rows[: len(self._rows) - self._not_risen], []
        self._top, self._not_risen = 0.0, 0
        if len(rows) >= FEWEST:
            times, places, forces = zip(*rows)
            self.found.append(TouchRise(times[-1], np.array(places), np.array(forces)))
