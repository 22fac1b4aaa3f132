"""The smallest distance along a motion step, before the step is made."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.collision import sweep_kernels as kernels

FINEST = 2000
"""Smallest part of the path that is resolved: no step, however long, takes longer than this to look at."""


class MotionStep:
    """A straight step of the tip and of the arm's link frames.

    Origins go straight and orientations turn about one axis, each carrier by itself.

    Attributes
    ----------
    travel : m, upper bound of how far any point of a link moves
    """

    __slots__ = ("_first", "_last", "_poses", "_turns", "travel")

    def __init__(self, rows: np.ndarray, first: np.ndarray, last: np.ndarray) -> None:
        """`rows` of links; carrier poses (1 + m, 4, 4), the tip's first, at both ends."""
        self._first, self._last = first, last
        self._poses = np.zeros(first.shape)
        self._poses[:, 3, 3] = 1.0
        self._turns = np.empty((len(first), 3))
        self.travel: float = kernels.prepare(rows, first, last, self._turns)

    def at(self, fraction: float) -> tuple[np.ndarray, np.ndarray]:
        """Tip (4, 4) and link frames (m, 4, 4) there; overwritten by the next call."""
        kernels.poses_between(self._first, self._last, self._turns, fraction, self._poses)
        return self._poses[0], self._poses[1:]


def smallest_along(
    distance_at: Callable[[float], float], travel: float, tolerance: float, enough: float
) -> tuple[float, float]:
    """Lower bound of a distance along a step, and the fraction 0..1 where the smallest value was seen.

    The distance changes by no more than `travel` over the whole step (a Lipschitz bound), so between two values it
    cannot fall far: intervals are halved until none can hide more than `tolerance` below the smallest value seen, or
    until none can fall below `enough` (Piyavskii 1972, Shubert 1972).
    """
    tolerance = max(tolerance, travel / FINEST)
    first, last = distance_at(0.0), distance_at(1.0)
    smallest, where = (first, 0.0) if first <= last else (last, 1.0)
    bound = smallest
    pending = [(0.0, 1.0, first, last)] if smallest < np.inf else []
    while pending and smallest > 0.0:
        begin, end, first, last = pending.pop()
        low = 0.5 * (first + last - travel * (end - begin))
        if low >= min(smallest - tolerance, enough):
            bound = min(bound, low)
            continue
        middle = 0.5 * (begin + end)
        value = distance_at(middle)
        if value < smallest:
            smallest, where = value, middle
        pending += [(begin, middle, first, value), (middle, end, value, last)]
    return max(min(bound, smallest), 0.0), where
