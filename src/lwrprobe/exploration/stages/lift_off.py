"""A long contact is interrupted: the probe is lifted off, and the sensor's zero is taken anew."""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.contact import DriftWatch, Wrench
from lwrprobe.contact.drift import DOWN
from lwrprobe.contracts import Motion, VelocityCommand

LIFT = 0.0004
"""m off the surface."""
OFF = 1.5
"""Times what gives way under the force, which is taken back first: for a normal that is half a radian off."""
PATIENCE = 2.0
"""s, after which a lift that has not led into free space is given up."""
AGAIN = 10.0
"""s until the next attempt after that."""
STEADY = 0.2
"""m/s^2, below it the weight of the tip does not show as a force (3 g: 0.6 mN)."""


class LiftOff:
    """Takes the zero where the strategy does not leave a surface for long.

    The strategy loses the contact and seeks it again. Free is what lies `LIFT` off the surface, where the force has not
    changed over the second half of the way. Little farther is the way back, which is slow: a tip that does not come on
    for seconds counts as stuck.

    Parameters
    ----------
    drift : takes the zero
    due : s since the zero was taken, after which a contact is interrupted; longer where it is known how fast it drifts
    gentle : N, above it the force law comes first
    unchanged : N, by which the force may change in free space
    speed : m/s, of the lift

    Attributes
    ----------
    taken : how often a zero was taken
    """

    def __init__(self, drift: DriftWatch, due: float, gentle: float, unchanged: float, speed: float) -> None:
        self._drift, self._due, self._gentle, self._unchanged, self._speed = drift, due, gentle, unchanged, speed
        self._next = math.nan
        self.taken = 0
        self._begin: tuple[float, np.ndarray, np.ndarray] | None = None  # s, place on the surface and normal
        self._half: np.ndarray | None = None

    def motion(
        self,
        asked: Motion,
        wrench: Wrench,
        place: np.ndarray,
        normal: np.ndarray | None,
        compliance: float,
        acceleration: float,
        axis: np.ndarray = DOWN,
    ) -> VelocityCommand | None:
        """What to do in place of the strategy's motion, None while that counts.

        Parameters
        ----------
        place : (3,) m, of the tip; normal : (3,) of what is touched, None where nothing is
        compliance : m/N of all that gives way along it
        acceleration : m/s^2, of the tip; axis : (3,) unit, of its stick
        """
        now = wrench.time
        if self._begin is None:
            if math.isnan(self._next):
                self._next = now + self._due
            if self._drift.changes:
                last = self._drift.changes[-1]
                self._next = max(self._next, last.time + self._due / last.unknown)
            touching = normal is not None and wrench.magnitude < self._gentle
            if now < self._next or not touching or not isinstance(asked, VelocityCommand):
                return None
            assert normal is not None
            surface = place + OFF * compliance * wrench.magnitude * normal
            self._begin, self._half = (now, surface, normal.copy()), None
        begun, begin, away = self._begin
        gone = float((place - begin) @ away)
        if self._half is None and gone > 0.5 * LIFT:
            self._half = wrench.force.copy()
        half, lifted = self._half, gone >= LIFT and self._half is not None
        pressed = lifted and half is not None and float(np.linalg.norm(wrench.force - half)) > self._unchanged
        if pressed or now - begun > PATIENCE:
            self._begin, self._next = None, now + AGAIN
            return None
        self._drift.observe(wrench, lifted and acceleration < STEADY, place, lifted, axis)
        if self._drift.ready:
            change = self._drift.rezero()
            self._begin, self._next = None, now + self._due / (change.unknown if change is not None else 1.0)
            self.taken += 1
            return None
        return VelocityCommand(np.zeros(3) if lifted else self._speed * away, reason="zero of the sensor")
