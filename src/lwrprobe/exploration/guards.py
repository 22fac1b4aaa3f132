"""What stands between strategy and arm, whatever the strategy asks for."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Feed, SafetyStop
from lwrprobe.contracts.samples import Vector


class ForceGuard:
    """Moves the tip along the acting force as soon as that is above the limit, until it is released.

    Parameters
    ----------
    limit : N, never to be exceeded
    release_below : N, where the strategy gets the arm back
    patience : s, after which a force that does not fall stops the run
    """

    def __init__(self, limit: float, release_below: float, speed: float, patience: float = 1.0) -> None:
        self.limit = limit
        self.release_below = release_below
        self.speed = speed
        self.patience = patience
        self.interventions = 0
        self._since: float | None = None

    def check(self, time: float, force: Vector) -> Feed | None:
        """A motion that overrides the strategy's, or None; raises SafetyStop when releasing does not help."""
        size = float(np.sqrt(force @ force))
        if self._since is None:
            if size <= self.limit:
                return None
            self._since = time
            self.interventions += 1
        elif size < self.release_below:
            self._since = None
            return None
        elif time - self._since > self.patience:
            raise SafetyStop(f"force {size:.2f} N stays above {self.release_below:.2f} N for {self.patience:.1f} s")
        return Feed(force * (self.speed / size), reason="force limit")


class SilenceGuard:
    """Stops the run when the sensor has sent nothing for too long."""

    def __init__(self, allowed: float) -> None:
        self.allowed = allowed
        self._last: float | None = None

    def heard(self, time: float) -> None:
        """A sample came."""
        self._last = time

    def check(self, time: float) -> None:
        """Raises SafetyStop after `allowed` seconds of silence."""
        if self._last is None:
            self._last = time
        elif time - self._last > self.allowed:
            raise SafetyStop(f"no wrench sample for {time - self._last:.3f} s (allowed {self.allowed:.3f} s)")
