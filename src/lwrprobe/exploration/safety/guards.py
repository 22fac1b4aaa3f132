"""What stands between sensor and arm, whatever the strategy asks for. Set points have a guard of their own."""

from __future__ import annotations

from math import hypot

import numpy as np

from lwrprobe.contact.wrench import UNUSABLE
from lwrprobe.contracts import SafetyStop, SampleStatus, VelocityCommand
from lwrprobe.contracts.samples import Vector

_SATURATED = int(SampleStatus.SATURATED)
_SATURATED_RUN = 3  # samples in a row; one alone may be a spike


class SensorLost(SafetyStop):
    """Nothing is known of the forces any more: stop, then go back where it is known to be free."""


class ForceGuard:
    """Moves the tip along the acting force as soon as force or torque is above its limit, until it is released.

    Parameters
    ----------
    limit : N, never to be exceeded
    release_below : N, where the strategy gets the arm back
    speed : m/s, of the release
    torque : (3,) N·m an axis of the sensor; it ends before the force does where the stick is long
    patience : s, after which a force that does not fall stops the run
    """

    def __init__(
        self,
        limit: float,
        release_below: float,
        speed: float,
        torque: Vector | None = None,
        patience: float = 1.0,
    ) -> None:
        self.limit = limit
        self.release_below = release_below
        self.speed = speed
        self.patience = patience
        self._torque = [np.inf] * 3 if torque is None else torque.tolist()
        self.interventions = 0
        self._since: float | None = None

    def check(
        self, time: float, force: Vector, torque: Vector | None = None, confirmed: bool = True
    ) -> VelocityCommand | None:
        """A motion that overrides the strategy's, or None; raises SafetyStop when releasing does not help.

        An overload that one sample alone tells of may be a spike, and yielding to a spike may be pushing: the tip
        stops, and the next sample says in which direction to yield, if at all.
        """
        size = hypot(*force.tolist())
        twisted = False
        if torque is not None:
            (x, y, z), (most_x, most_y, most_z) = torque.tolist(), self._torque
            twisted = abs(x) > most_x or abs(y) > most_y or abs(z) > most_z
        if self._since is None:
            if size <= self.limit and not twisted:
                return None
            if not confirmed:
                return VelocityCommand(np.zeros(3), reason="force limit, unconfirmed")
            self._since = time
            self.interventions += 1
        elif size < self.release_below and not twisted:
            self._since = None
            return None
        elif time - self._since > self.patience:
            raise SafetyStop(f"force {size:.2f} N stays above {self.release_below:.2f} N for {self.patience:.1f} s")
        reason = "torque limit" if twisted else "force limit"
        return VelocityCommand(force * (self.speed / max(size, 1e-9)), reason=reason)


class SilenceGuard:
    """Stops the run when the sensor has told nothing usable for too long.

    The time that counts is the arm's, at most two of its cycles a look: where arm, sensor and this host stood still
    together, nothing has moved meanwhile.

    Parameters
    ----------
    allowed : s
    cycle : s, of the arm
    """

    def __init__(self, allowed: float, cycle: float) -> None:
        self.allowed = allowed
        self._most = 2.0 * cycle
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
        return int((self.allowed - self._silent) / self._most)

    def check(self, time: float, looks: int = 1) -> None:
        """Raises SensorLost after `allowed` seconds of silence; `looks` are those that this one stands for."""
        if self._last is not None:
            self._silent += min(time - self._last, looks * self._most)
        self._last = time
        if self._silent > self.allowed:
            raise SensorLost(f"no usable wrench sample for {self._silent:.3f} s (allowed {self.allowed:.3f} s)")
