"""A sensor that says nothing usable: the tip stands still, then it gives way, then it retreats, at last the run ends.

Set points have a guard of their own.
"""

from __future__ import annotations

from enum import IntEnum
from math import ceil

from lwrprobe.contact.wrench import UNUSABLE
from lwrprobe.contracts import SafetyStop, SampleStatus

_SATURATED = int(SampleStatus.SATURATED)
_SATURATED_RUN, _SATURATED_FOR = 3, 0.02  # samples in a row, and s; less is a spike, or over before the arm yields
_OVERDUE, _MISSING = 1.5, 2.5  # periods of the sensor; one lost sample alone is two of them


class SensorLost(SafetyStop):
    """The forces are no longer measured: stop, then retreat to where nothing was touched."""


class SensorSilent(SensorLost):
    """No usable sample comes just now; the stream may come back."""


class Silence(IntEnum):
    """What a look at the sensor's silence has found to begin."""

    NOTHING = 0
    OVERDUE = 1
    """A sample has not come in time: a tip that may touch something stands still until the next one."""
    MISSING = 2
    """Two have not come: the tip gives way."""


class SilenceGuard:
    """Says for how long the sensor has sent nothing usable, and raises when that is too long.

    The time that counts is the arm's, at most one of its cycles a look: without a look there is no set point, and
    without one the arm brakes.

    Parameters
    ----------
    allowed : s
    cycle : s, of the arm
    period : s, between two samples

    Attributes
    ----------
    yields : how often samples were missing so long that the tip had to give way
    """

    def __init__(self, allowed: float, cycle: float, period: float) -> None:
        self.allowed = allowed
        self._begins = tuple(min(share * period + 0.9 * cycle, allowed) for share in (_OVERDUE, _MISSING))
        self.late = self._begins[0] - period
        """s by which the tip reacts later to a force than with all samples, at worst, before it stands still."""
        self.yields = 0
        self._max_step = cycle
        self._last: float | None = None
        self._silent = 0.0
        self._stage = Silence.NOTHING
        self._saturated = 0
        self._saturated_run = max(_SATURATED_RUN, ceil(_SATURATED_FOR / period))

    def update(self, status: int) -> None:
        """A sample of this status came, the driver's and the conditioner's.

        Raises SensorLost for one in a row too many that is at the end of the sensor's range.
        """
        if status & UNUSABLE:
            return
        self._silent, self._stage = 0.0, Silence.NOTHING
        self._saturated = self._saturated + 1 if status & _SATURATED else 0
        if self._saturated >= self._saturated_run:
            raise SensorLost(f"the sensor is at the end of its range, {self._saturated} samples in a row")

    @property
    def looks_left(self) -> int:
        """How many looks, one a cycle, may follow before there is anything to be seen."""
        return int(((*self._begins, self.allowed)[self._stage] - self._silent) / self._max_step)

    @property
    def silent(self) -> float:
        """s since the last usable sample."""
        return self._silent

    def forget(self) -> None:
        """Begin anew: the arm stood still meanwhile, or moved without need of the sensor."""
        self._last, self._silent, self._stage = None, 0.0, Silence.NOTHING

    def check(self, time: float, looks: int = 1) -> Silence:
        """What has just begun; `looks` are those that this one stands for.

        Raises SensorSilent after `allowed` seconds of silence.
        """
        if self._last is not None:
            self._silent += min(time - self._last, looks * self._max_step)
        self._last = time
        if self._silent > self.allowed:
            raise SensorSilent(f"no usable wrench sample for {self._silent:.3f} s (allowed {self.allowed:.3f} s)")
        if self._stage is Silence.MISSING or self._silent <= self._begins[self._stage]:
            return Silence.NOTHING
        self._stage = Silence(self._stage + 1)
        self.yields += self._stage is Silence.MISSING
        return self._stage
