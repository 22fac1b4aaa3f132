"""What the emulated controller moves: an arm on its own, or one in a simulated world."""

from __future__ import annotations

from math import exp
from typing import Protocol

import numpy as np


class Plant(Protocol):
    """Where set points go and measured joints come from."""

    def joints(self) -> np.ndarray:
        """(7,) rad, measured now."""

    def advance(self, begin: np.ndarray, end: np.ndarray, seconds: float) -> None:
        """Let time pass while the set point moves evenly from `begin` to `end` (7,) rad."""


class LaggingArm:
    """Joints that follow their set points with a first-order lag; gravity, load and contact do not exist.

    Parameters
    ----------
    start : (7,) rad
    lag : s, time constant
    """

    def __init__(self, start: np.ndarray, lag: float = 0.005) -> None:
        self._joints = np.array(start, dtype=np.float64)
        self._lag = lag

    def joints(self) -> np.ndarray:
        return self._joints.copy()

    def advance(self, begin: np.ndarray, end: np.ndarray, seconds: float) -> None:
        """Exact answer of the lag to a ramp: behind by speed times lag once it has settled."""
        speed = (end - begin) / seconds
        behind = begin - speed * self._lag - self._joints
        self._joints = end - speed * self._lag - behind * exp(-seconds / self._lag)
