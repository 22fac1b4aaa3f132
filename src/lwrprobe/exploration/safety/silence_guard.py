"""A sensor that no longer says anything usable ends the run. Set points have a guard of their own."""

from __future__ import annotations

from lwrprobe.contact.wrench import UNUSABLE
from lwrprobe.contracts import SafetyStop, SampleStatus

_SATURATED = int(SampleStatus.SATURATED)
_SATURATED_RUN = 3  # samples in a row; one alone may be a spike


class SensorLost(SafetyStop):
    """The forces are no longer measured: stop, then retreat to where nothing was touched."""


class SilenceGuard:
    """Stops the run when the sensor has sent nothing usable for too long.

    The time that counts is the arm's, at most two of its cycles a look: where arm, sensor and this host stood still
    together, nothing has moved meanwhile.

    Parameters
    ----------
    allowed : s
    cycle : s, of the arm
    """

    def __init__(self, allowed: float, cycle: float) -> None:
        self.allowed = allowed
        self._max_step = 2.0 * cycle
        self._last: float | None = None
        self._silent = 0.0
        self._saturated = 0

    def heard(self, status: int) -> None:
        """A sample of this status came, the driver's and the conditioner's.

        Raises SensorLost for one in a row too many that is at the end of the sensor's range.
        """
        if status & UNUSABLE:
            return
        self._silent = 0.0
        self._saturated = self._saturated + 1 if status & _SATURATED else 0
        if self._saturated >= _SATURATED_RUN:
            raise SensorLost(f"the sensor is at the end of its range, {self._saturated} samples in a row")

    @property
    def looks_left(self) -> int:
        """How many looks, one a cycle, may follow before there is anything to be seen."""
        return int((self.allowed - self._silent) / self._max_step)

    def check(self, time: float, looks: int = 1) -> None:
        """Raises SensorLost after `allowed` seconds of silence; `looks` are those that this one stands for."""
        if self._last is not None:
            self._silent += min(time - self._last, looks * self._max_step)
        self._last = time
        if self._silent > self.allowed:
            raise SensorLost(f"no usable wrench sample for {self._silent:.3f} s (allowed {self.allowed:.3f} s)")
