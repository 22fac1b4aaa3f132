"""How late arm and sensor really are, measured while the start-up moves and rests, before anything is touched."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts.samples import Vector

MIN_MOTION = 1e-4
"""rad (m), length of a joint motion from which the arm's response can be measured."""


class LoopDelay:
    """Delay from a set point to the motion, and age of a wrench sample on arrival.

    From rest to rest, the area between the set points and the measured joints over the length of the motion is the mean
    delay of any linear response: dead time plus time constants. The joints are weighted by how far they move.
    """

    def __init__(self) -> None:
        self._ages: list[float] = []
        self._times: list[float] = []
        self._rows: list[tuple[Vector, Vector]] = []
        self._late = self._square = 0.0

    def note(self, time: float, set_point: Vector, q: Vector) -> None:
        """One state of the arm: its time [s], the last set point and the measured joints, (n,) rad."""
        self._times.append(time)
        self._rows.append((set_point.copy(), q.copy()))

    def note_age(self, seconds: float) -> None:
        """Age of one wrench sample when it was read."""
        self._ages.append(seconds)

    def rest(self) -> None:
        """The arm rests: what was noted since the last rest is one motion."""
        if len(self._times) > 1:
            sent, seen = np.array([row[0] for row in self._rows]), np.array([row[1] for row in self._rows])
            travel = sent[-1] - sent[0]
            behind = (sent - seen)[1:] @ travel
            self._late += float(behind @ np.diff(self._times))
            self._square += float(travel @ travel)
        self._times.clear()
        self._rows.clear()

    @property
    def sensor(self) -> float | None:
        """s, median age of the samples; None without any."""
        return float(np.median(self._ages)) if self._ages else None

    @property
    def arm(self) -> float | None:
        """s from a set point to the motion; None where the arm has not moved."""
        return self._late / self._square if self._square > MIN_MOTION**2 else None
