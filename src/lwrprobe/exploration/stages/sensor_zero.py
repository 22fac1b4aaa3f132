"""The zero of the sensor during a run: when it was taken, how far it may have drifted, and when it is taken anew."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lwrprobe.contact import DriftRate, DriftWatch, Wrench, WrenchConditioner
from lwrprobe.contracts import Goal, Motion, Probe
from lwrprobe.exploration.stages.lift_off import STEADY, LiftOff
from lwrprobe.exploration.stages.sensor_errors import zero_errors
from lwrprobe.scene import Scene

FREE_WINDOW = 0.5
"""s of even travel without a touch after which the zero may be moved."""
GUARD = 0.25
"""s before a touch that are not trusted to have been free."""
DRIFTED = 0.125
"""Of the threshold, that the zero may drift by in one standard deviation before a contact is interrupted for it."""
UNCHANGED = 0.25
"""Of the threshold, by which a force may change in free space."""
LIFT_SPEED = 0.01
"""m/s off a surface, at most."""


class SensorZero:
    """Follows the zero in free space, and lifts off a contact during which it may have drifted too far.

    Parameters
    ----------
    scene : contact and motion settings, and the drift that it states
    probe : whose sensor it is
    conditioner : whose zero is moved
    """

    def __init__(self, scene: Scene, probe: Probe, conditioner: WrenchConditioner) -> None:
        threshold = scene.contact.threshold
        self._drifting = drift = 1e-3 / 60.0 * scene.uncertainty.sigma("drift_mn_per_min")  # N/s
        self._drift = DriftWatch(
            conditioner,
            touch_force=0.5 * threshold,
            window=FREE_WINDOW,
            guard=GUARD,
            drift=DriftRate(drift, *zero_errors(scene, probe)),
        )
        self._lift = LiftOff(
            self._drift,
            due=DRIFTED * threshold / drift if drift > 0.0 else math.inf,
            gentle=1.5 * scene.contact.target,
            unchanged=UNCHANGED * threshold,
            speed=min(LIFT_SPEED, scene.motion.approach_speed),
        )
        self._taken = [(0.0, 1.0)]  # s of the run, and share of the drift that is unknown; at rest, before it
        self._error = math.sqrt(2.0) * zero_errors(scene, probe)[0]  # N, now, and when the bias was taken

    def note(self, ahead: float) -> None:
        """Take over when the zero was taken since the last call, on a clock that is `ahead` s of the run's."""
        changes = self._drift.changes[len(self._taken) - 1 :]
        self._taken += [(change.time - ahead, change.unknown) for change in changes]

    def error(self, time: float) -> float:
        """N, one standard deviation of an axis of the force's zero at a time [s]: it drifts until it is taken anew."""
        taken, unknown = self._taken[-1]
        return math.hypot(self._error, self._drifting * unknown * (time - taken))

    def age(self, times: np.ndarray) -> np.ndarray:
        """(n,) s from the last time the zero was taken to each of times (n,) s of the run.

        At 0 s it was taken at rest. Where the zeros have shown how fast it drifts, it is the shorter time in which the
        stated drift makes it as wrong as what of it is still unknown.
        """
        taken, unknown = np.array(self._taken).T
        last = np.maximum(np.searchsorted(taken, times) - 1, 0)
        return np.asarray((times - taken[last]) * unknown[last])

    def lift(
        self,
        motion: Motion,
        wrench: Wrench,
        place: np.ndarray,
        normal: np.ndarray | None,
        gives: float,
        acceleration: float,
        axis: np.ndarray,
    ) -> Motion | None:
        """The motion off a contact during which the zero may have drifted too far, None where none is due.

        Else the zero is followed on the path to a goal, at an `acceleration` [m/s^2] below `STEADY`, at which the tip's
        inertia does not show as a force: with a goal a strategy expects no contact before it.

        Parameters
        ----------
        motion, wrench : as asked for, and the latest sample
        place : (3,) m of the sphere's centre
        normal : (3,) of what is touched, None in free space
        gives : m/N of probe, arm and object along the normal
        axis : (3,) unit, along the stick
        """
        lift = self._lift.motion(motion, wrench, place, normal, gives, acceleration, axis)
        if lift is None:
            free = isinstance(motion, Goal) and acceleration < STEADY
            self._drift.observe(wrench, free, place, axis=axis)
            if self._drift.ready:
                self._drift.rezero()
        return lift

    def report(self) -> dict[str, Any]:
        """For the summary."""
        changes = self._drift.changes
        return {
            "zero_moved": len(changes),
            "lifted_off": self._lift.taken,
            "zero_moved_by_n": np.round(sum((c.change[:3] for c in changes), np.zeros(3)), 4).tolist(),
            "drift_suspicious": bool(self._drift.suspicious),
        }
