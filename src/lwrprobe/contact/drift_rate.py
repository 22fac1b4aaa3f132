"""How fast the sensor's zero drifts, from the zeros that were taken.

A zero is taken in free space, and a contact may last for minutes after it. Warming up moves a zero at a rate that
changes slowly, so the line through the last zeros says where it goes on meanwhile. It is fitted by least squares with
the stated drift as prior (Bishop, Pattern Recognition and Machine Learning, 2006, section 3.3).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.contracts.samples import Vector

MEMORY = 300.0
"""s, of the zeros that count: a sensor warms up in a quarter of an hour."""
SURE = 2.0
"""Standard deviations from which on a rate is used: a smaller one is as likely to be the wandering zero."""
CHANGING = 0.25
"""Of the stated drift, that remains unknown however many zeros were taken: the rate itself changes."""
TURNED = 0.9994
"""Cosine (2 degrees) between directions of the stick, below which a wrong payload moves the zero as well."""


class DriftRate:
    """Regression of the zero on time, for all axes of a sensor.

    Parameters
    ----------
    stated : N/s, one standard deviation of the drift of a force axis; 0 = the zero does not drift
    force, torque : N and N·m, one standard deviation of a single zero of a force and of a torque axis

    Raises
    ------
    InputError : for a value that is negative or not finite
    """

    def __init__(self, stated: float, force: float, torque: float) -> None:
        for name, value in (("stated", stated), ("force", force), ("torque", torque)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"drift_rate.{name}", value, "a finite number, zero or more")
        self._scale = np.repeat([force, torque], 3)  # a torque axis drifts as much in its own noise
        self._first = stated / force if stated > 0.0 and force > 0.0 else 0.0  # 1/s
        self._mean, self._sd = np.zeros(6), self._first  # in standard deviations of a zero a second
        self._before = self._mean, self._sd  # what is known without the zeros in memory
        self._axis: Vector | None = None
        self._zeros: deque[tuple[float, Vector]] = deque()

    def add(self, time: float, zero: Vector, axis: Vector) -> None:
        """A zero (6,) N and N·m was taken at a time [s] with the stick along `axis` (3,), a unit vector."""
        if self._first == 0.0:
            return
        if self._axis is not None and float(axis @ self._axis) < TURNED:
            self._zeros.clear()
            self._before = self._mean, max(self._sd, CHANGING * self._first)
        self._axis = axis.copy()
        self._zeros.append((time, zero / self._scale))
        while self._zeros[0][0] < time - MEMORY:
            self._zeros.popleft()
        times = np.array([at for at, _ in self._zeros])
        zeros = np.array([value for _, value in self._zeros])
        times -= times.mean()
        mean, sd = self._before
        weight = 1.0 / sd**2
        precision = float(times @ times) + weight
        self._mean = (times @ zeros + weight * mean) / precision
        self._sd = 1.0 / np.sqrt(precision)

    @property
    def _used(self) -> np.ndarray:
        return np.abs(self._mean) > SURE * self._sd

    @property
    def value(self) -> Vector:
        """(6,) N/s and N·m/s; 0 on the axes that have not shown one."""
        return np.where(self._used, self._mean, 0.0) * self._scale

    @property
    def unknown(self) -> float:
        """Share of the stated drift by which the zero still goes another way than is known, 0 .. 1."""
        if self._first == 0.0:
            return 1.0
        left = float(np.abs(self._mean[:3][~self._used[:3]]).max(initial=0.0))
        return float(np.clip(np.hypot(self._sd, left) / self._first, CHANGING, 1.0))
