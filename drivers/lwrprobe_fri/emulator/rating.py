"""How the emulated controller rates the remote's timing: over the last 100 measurements, as the real one does."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

QUALITIES = ("unacceptable", "bad", "ok", "perfect")
_WINDOW = 100


@dataclass(slots=True, frozen=True)
class Thresholds:
    """Share of measurements answered within their cycle that a rating takes; the real ones are not published."""

    bad: float = 0.5
    ok: float = 0.8
    perfect: float = 0.97
    fewest: int = 20
    """Measurements to be seen before anything but UNACCEPTABLE."""


class Rating:
    """Answer rate, latency, jitter and misses of the last 100 measurements."""

    def __init__(self, thresholds: Thresholds) -> None:
        self._thresholds = thresholds
        self._answered: deque[bool] = deque(maxlen=_WINDOW)
        self._latencies: deque[float] = deque(maxlen=_WINDOW)
        self.misses = 0
        self.ceiling = 3

    def note(self, answered: bool, latency: float) -> None:
        """One cycle is over: was its measurement answered in time, after how many seconds."""
        self._answered.append(answered)
        if answered:
            self._latencies.append(latency)
        else:
            self.misses += 1

    @property
    def answer_rate(self) -> float:
        return sum(self._answered) / len(self._answered) if self._answered else 0.0

    @property
    def latency(self) -> float:
        return sum(self._latencies) / len(self._latencies) if self._latencies else 0.0

    @property
    def jitter(self) -> float:
        """Mean absolute deviation of the latencies, s."""
        return float(np.abs(np.array(self._latencies) - self.latency).mean()) if self._latencies else 0.0

    @property
    def quality(self) -> int:
        """0 UNACCEPTABLE .. 3 PERFECT, never above `ceiling`."""
        limits, rate = self._thresholds, self.answer_rate
        if len(self._answered) < limits.fewest:
            return 0
        return min(self.ceiling, (rate >= limits.bad) + (rate >= limits.ok) + (rate >= limits.perfect))
