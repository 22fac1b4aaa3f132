"""Packet filter: which measurements are used, in order, and with joint angles reachable since the last one."""

from __future__ import annotations

from collections.abc import Sequence

from lwrprobe_fri.wire import Measurement

_LARGEST_GAP = 100
_SLACK = 0.02  # rad; measurement noise and the first cycles of a brake
_CONVINCING = 3  # doubtful measurements in a row that agree with each other: the controller has begun anew


class PacketFilter:
    """Accepts new measurements, refuses repeated, late and implausible ones, and recovers after a restart.

    Parameters
    ----------
    speed : (7) rad/s, twice of which no joint exceeds
    """

    def __init__(self, speed: Sequence[float]) -> None:
        self._fastest = [2.0 * v for v in speed]
        self._last: Measurement | None = None
        self._doubtful: list[Measurement] = []
        self.lost = 0
        self.repeated = 0
        self.old = 0
        self.implausible = 0
        self.restarts = 0

    def forget(self) -> None:
        """The next measurement is taken as a first one (after a silence)."""
        self._last = None
        self._doubtful = []

    def steps(self, measurement: Measurement) -> int:
        """Cycles since the last admitted measurement, 0 when this one is not to be used."""
        if self._last is None:
            self._last = measurement
            return 1
        ahead = (measurement.sequence - self._last.sequence) & 0xFFFF
        if ahead == 0:
            self.repeated += 1
            return 0
        if self._follows(self._last, measurement):
            self.lost += ahead - 1
            self._accept(measurement)
            return ahead
        if ahead >= 0x8000:
            self.old += 1
        else:
            self.implausible += 1
        return self._doubt(measurement)

    def _doubt(self, measurement: Measurement) -> int:
        if self._doubtful and not self._follows(self._doubtful[-1], measurement):
            self._doubtful = []
        self._doubtful.append(measurement)
        if len(self._doubtful) < _CONVINCING:
            return 0
        self.restarts += 1
        self._accept(measurement)
        return 1

    def _accept(self, measurement: Measurement) -> None:
        self._last = measurement
        self._doubtful = []

    def _follows(self, earlier: Measurement, later: Measurement) -> bool:
        ahead = (later.sequence - earlier.sequence) & 0xFFFF
        if not 1 <= ahead <= _LARGEST_GAP:
            return False
        time = ahead * later.cycle
        for a, b, speed in zip(earlier.measured, later.measured, self._fastest):
            if abs(b - a) > speed * time + _SLACK:
                return False
        return True
