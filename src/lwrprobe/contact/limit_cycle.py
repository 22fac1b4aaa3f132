"""A force loop that swings: seen by the sign of the force error, answered by more damping and less speed."""

from __future__ import annotations

from collections import deque

import numpy as np

from lwrprobe.contracts import InputError

_SWINGS = 4  # half periods that make a limit cycle
_HALF_PERIOD = 6.0  # delays, at most
_RECOVERY = 20.0  # delays without oscillation after which one step of backing off is taken back


class LimitCycle:
    """Watches F - F_target and says by how much to back off.

    An integrating loop with delay tau swings with a period of about 4 tau at its limit of stability (w tau = pi/2),
    faster surfaces aside; a clamp on the velocity keeps the amplitude bounded. Four crossings from beyond one side of
    a dead band to beyond the other, each within 6 tau of the last (or three samples, where those are longer), are
    taken for it: noise stays inside the band, and bumps of the surface come one at a time.
    Play of the gears, and a swing that takes the sphere off the surface, make half of a period longer than 2 tau.

    Parameters
    ----------
    target : N
    delay : s, total reaction delay
    period : s between samples
    band : N, half width of the dead band, a tenth of the target unless given
    """

    def __init__(self, target: float, delay: float, period: float, band: float | None = None) -> None:
        band = 0.1 * target if band is None else band
        for name, value in (("target", target), ("period", period), ("band", band)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"limit_cycle.{name}", value, "a positive number")
        if not (np.isfinite(delay) and delay >= 0.0):
            raise InputError("limit_cycle.delay", delay, "zero seconds or more")
        self._target, self._band = target, band
        self._longest = max(_HALF_PERIOD * delay, 3.0 * period)
        self._recover_after = _RECOVERY * max(delay, period)
        self._side = 0
        self._crossings: deque[float] = deque(maxlen=_SWINGS)
        self._changed = -np.inf
        self.detections = 0
        self.scale = 1.0
        """Share of speed, and of 1 / damping, to go on with: 1, 1/2, 1/4, ... 1/16."""

    def update(self, time: float, force: float) -> float:
        """One force reading while in contact; returns `scale`."""
        error = force - self._target
        side = 1 if error > self._band else -1 if error < -self._band else 0
        if side and side != self._side:
            if self._side:
                self._cross(time)
            self._side = side
        if self.scale < 1.0 and time - max(self._changed, self._last()) > self._recover_after:
            self.scale = min(1.0, 2.0 * self.scale)
            self._changed = time
        return self.scale

    def lose(self, time: float) -> None:
        """No contact at this instant: a swing takes the sphere off for half of a period, anything else for longer."""
        if self._side > 0:
            self._cross(time)
            self._side = -1
        elif time - self._last() > self._longest:
            self.reset()

    def reset(self) -> None:
        """What was seen no longer counts, the backing off stays."""
        self._side = 0
        self._crossings.clear()

    def _cross(self, time: float) -> None:
        if self._crossings and time - self._crossings[-1] > self._longest:
            self._crossings.clear()
        self._crossings.append(time)
        if len(self._crossings) == _SWINGS:
            self.detections += 1
            self.scale = max(0.5 * self.scale, 1.0 / 16.0)
            self._changed = time
            self._crossings.clear()

    def _last(self) -> float:
        return self._crossings[-1] if self._crossings else -np.inf
