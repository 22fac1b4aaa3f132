"""The force limit: above it the tip yields, whatever the strategy asks for."""

from __future__ import annotations

from math import hypot

import numpy as np

from lwrprobe.contracts import SafetyStop, VelocityCommand
from lwrprobe.contracts.samples import Vector

CEILING = 0.5
"""Share of a force down the stick, from which on something above the sphere presses it. Less of it is friction, or what
the load aside shifts in a sensor that is not quite known: there the sphere may stand on something else."""


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

    def forget(self) -> None:
        """What pressed has been left meanwhile."""
        self._since = None

    def check(
        self,
        time: float,
        force: Vector,
        torque: Vector | None = None,
        confirmed: bool = True,
        axis: Vector | None = None,
    ) -> VelocityCommand | None:
        """A motion that overrides the strategy's, or None; raises SafetyStop when releasing does not help.

        An overload that one sample alone tells of may be a spike, and yielding to a spike may be pushing: the tip
        stops, and the next sample says in which direction to yield, if at all. Off a wall it does not yield down the
        stick, which gives way least, along `axis` (3,), a unit vector.
        """
        size = hypot(*force.tolist())
        twisted = False
        if torque is not None:
            (x, y, z), (max_x, max_y, max_z) = torque.tolist(), self._torque
            twisted = abs(x) > max_x or abs(y) > max_y or abs(z) > max_z
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
        away = force / max(size, 1e-9)
        if axis is not None and 0.0 < (down := float(away @ axis)) < CEILING:
            away = away - down * axis
        return VelocityCommand(self.speed * away, reason=reason)
