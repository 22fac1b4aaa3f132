"""The sensor's zero wanders: watched, and corrected, in free space; in between it goes on as it was seen to drift."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from lwrprobe.contact.conditioner import WrenchConditioner
from lwrprobe.contact.drift_rate import DriftRate
from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import InputError
from lwrprobe.contracts.samples import Vector

PUSHED = 0.005
"""m along a constant force, after which it is no surface's: one at rest does no work on the probe."""
CONSTANT = 0.5
"""Of `touch_force`, by which such a force may change."""
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(slots=True, frozen=True)
class BiasChange:
    """One correction of the zero.

    Attributes
    ----------
    time : s; change : (6,) N and N·m added to the bias; rate : N/min of the force part since the last correction
    unknown : share of the stated drift by which the zero may move from now on otherwise than is known
    """

    time: float
    change: Vector
    rate: float
    unknown: float


class DriftWatch:
    """Follows the mean of what the sensor reads while the probe is free, and moves the zero there when asked.

    A slow contact must not be taken for drift: samples above `touch_force`, or marked in any way, are left out; what
    was gathered is dropped when a contact begins, together with the `guard` seconds before it; and a drift faster
    than `max_rate` is not corrected but reported as `suspicious`. A zero that has moved by more than `touch_force`
    during a long contact is told from a touch by its work: nothing at rest pushes the probe along for `PUSHED`.

    Parameters
    ----------
    conditioner : whose bias is corrected
    touch_force : N, above it the probe is not free
    window : s of free space needed for a correction
    guard : s before a contact that are not trusted
    max_rate : N/min, faster than any sensor drifts (0.05 N/min is much; a warm-up may reach ten times that)
    drift : what is known of how fast the zero moves, None = it stays where it was taken
    """

    def __init__(
        self,
        conditioner: WrenchConditioner,
        *,
        touch_force: float = 0.1,
        window: float = 1.0,
        guard: float = 0.25,
        max_rate: float = 0.5,
        drift: DriftRate | None = None,
    ) -> None:
        for name, value in (("touch_force", touch_force), ("window", window), ("max_rate", max_rate)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"drift.{name}", value, "a positive number")
        self._conditioner = conditioner
        self._touch_force, self._window, self._guard, self._max_rate = touch_force, window, guard, max_rate
        self._rate, self._axis = drift or DriftRate(0.0, 0.0, 0.0), DOWN
        self._begin: float | None = None
        self._recent: deque[tuple[float, Vector]] = deque()
        self._sum, self._count = np.zeros(6), 0
        self._last_time: float | None = None
        self._held: tuple[Vector, Vector] | None = None  # force and place from which on it has been constant
        self._least = 0.0
        self.changes: list[BiasChange] = []
        self.suspicious = False

    def observe(self, wrench: Wrench, free: bool, place: Vector, lifted: bool = False, axis: Vector = DOWN) -> None:
        """One conditioned wrench with the tip at `place` (3,) m and the stick along `axis` (3,); `free` is what the
        caller knows of the motion (away from any surface), `lifted` that the tip was just taken off a surface, so that
        any force is the zero's.
        """
        self._axis = axis
        small = lifted or wrench.magnitude <= self._touch_force
        if small or not free or not wrench.usable:
            self._held = None  # the next force begins anew, however alike it is
        if not free or not wrench.usable or not (small or self._pushed(wrench.world_force, place)):
            self._forget()
            return
        if self._begin is None:
            self._begin = wrench.time
        if self._last_time is None:
            self._last_time = wrench.time
            self._rate.add(wrench.time, self._conditioner.bias, axis)
        self._recent.append((wrench.time, np.concatenate([wrench.force, wrench.torque])))
        while self._recent and self._recent[0][0] < wrench.time - self._guard:
            self._sum += self._recent.popleft()[1]
            self._count += 1

    def _pushed(self, force: Vector, place: Vector) -> bool:
        """Whether the tip has gone along a constant force (3,) farther than a surface at rest could push it."""
        if self._held is None or float(np.linalg.norm(force - self._held[0])) > CONSTANT * self._touch_force:
            self._held, self._least = (force.copy(), place.copy()), 0.0
            return False
        held, begin = self._held
        along = float((place - begin) @ held) / float(np.linalg.norm(held))
        self._least = min(self._least, along)
        return along - self._least > PUSHED

    @property
    def drift(self) -> Vector:
        """(6,) N and N·m, mean reading of the present stretch of free space, zero before the guard has passed."""
        return self._sum / self._count if self._count else np.zeros(6)

    @property
    def ready(self) -> bool:
        """Free for long enough that `rezero` may be called."""
        return self._begin is not None and self._count > 0 and self._recent[-1][0] - self._begin >= self._window

    def rezero(self) -> BiasChange | None:
        """Move the conditioner's zero to the mean reading; None when not `ready` or when the drift is suspicious."""
        if not self.ready or self._last_time is None:
            return None
        now, change = self._recent[-1][0], self.drift
        minutes = max(now - self._last_time, self._window) / 60.0
        rate = float(np.linalg.norm(change[:3])) / minutes
        noise = 3.0 * self._conditioner.probe.force_resolution / np.sqrt(self._count) / minutes
        self.suspicious = bool(rate > self._max_rate + noise)
        self._forget()
        if self.suspicious:
            return None
        self._conditioner.shift_bias(change)
        self._last_time = now
        self._rate.add(now, self._conditioner.bias, self._axis)
        self._conditioner.set_drift(self._rate.value)
        self.changes.append(BiasChange(now, change, rate, self._rate.unknown))
        return self.changes[-1]

    def _forget(self) -> None:
        self._begin = None
        self._recent.clear()
        self._sum[:] = 0.0
        self._count = 0
