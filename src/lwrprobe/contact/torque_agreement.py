"""Whether torque and force of the sensor agree: the matrix by which they do not, learnt while the sphere slides.

A contact on the sphere has the torque `t = c x f + r u x f`. While the sphere slides, its normal n = -u follows from
force and path alone: friction opposes the path, so n lies along the rest of the force. What the torque shows beyond
that, `E f + t0`, is an error of gain, crosstalk or lever (E, always the same) and of the zero (t0, which wanders).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contact import torque_kernels as kernels
from lwrprobe.contact.stick_contact import stick_contact
from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector

SOLVE_EVERY = 0.1
"""s of usable samples after which the matrix is found anew."""
SURPRISE = 2.0
"""Ratio of found to expected disagreement from which on more is expected."""
LARGE = 0.05
"""Disagreement from which on normals are wrong for its sake, expected or not: half a radius with a lever of ten."""
GAP = 6.25
"""Periods of the sensor between two samples, from which on the earlier one says nothing."""
BEHIND = 2.0
"""Radii behind the sphere's centre, from which on a force acts on the stick: no error of torque or lever that is to be
learnt moves a touch of the sphere so far."""
LARGEST = 10.0
"""That ratio at most: without a prior, readings with a wrong normal would decide what forces have not shown."""

_ORIGIN, _SENSOR_FRAME = np.zeros(3), np.eye(3)


class TorqueAgreement:
    """Recursive least squares for E (3, 3), m, in the sensor frame, with a prior for each of its columns.

    Parameters
    ----------
    probe : lever and radius
    expected : (3,) m, standard deviation of E's entries for force along the sensor's x, y, z
    zero : N·m, standard deviation of the torque about the sphere through the wandering zero of all axes
    normal_error : rad, standard deviation of a normal that follows from force and path
    rate : Hz, of the sensor

    Attributes
    ----------
    disagreement : largest torque error that was found, over the lever: 0.03 means that torque and force disagree by 3 %
    """

    def __init__(self, probe: Probe, expected: Vector, zero: float, normal_error: float, rate: float = 125.0) -> None:
        self._probe, self._lever = probe, probe.sensor_distance
        self._params = np.array([probe.radius, self._lever, *probe.compliance, zero, normal_error, GAP / rate])
        self._expected, self._scale, self._zero = np.array(expected, dtype=np.float64), 1.0, zero
        self._state = np.array([-np.inf, 0.0, 0.0, 1.0])
        self._information, self._sums = np.zeros((4, 4)), np.zeros((4, 3))
        self._matrix: Vector = np.zeros((3, 3))
        self._covariance: Vector = np.diag(self._expected**2)
        self.disagreement = 0.0
        found, three, rotation = (self._matrix, self._covariance), np.zeros(3), np.eye(4)[:3, :3]  # a part of a pose
        self._correct = entry(kernels.correct, *found, 1.0, three, three, three)
        self._learn = entry(
            kernels.learn, self._params, self._state, self._information, self._sums, *found, 0.0, three, three,
            rotation, three,
        )  # fmt: skip

    def corrected(self, wrench: Wrench) -> tuple[Wrench, float]:
        """The wrench without the torque that is known to be wrong, and what remains.

        That is the standard deviation [m] of the torque over the force, for the force's direction.
        """
        w, torque = wrench, np.empty(3)
        error = self._correct(self._matrix, self._covariance, self._excess, w.force, w.torque, torque)
        return Wrench(w.time, w.force, torque, w.world_force, w.sequence, w.status, w.zeroing), error

    @property
    def surprise(self) -> float:
        """Ratio of the disagreement found to the one expected, 1 where it is as expected or less."""
        return max(self._scale, self._excess)

    @property
    def doubt(self) -> float:
        """The disagreement where normals rest on it, else 0: more than expected, or large, as that of a sensor that was
        never calibrated. What was touched before it was learnt has wrong normals."""
        return self.disagreement if self.surprise > 1.0 or self.disagreement > LARGE else 0.0

    @property
    def _excess(self) -> float:
        """Ratio of the residuals to what is expected of them, 1 where they are as expected or smaller."""
        return max(sqrt(self._state.item(kernels.S_MISFIT)) / SURPRISE, 1.0)

    def learn(self, wrench: Wrench, rotation: np.ndarray, velocity: Vector) -> None:
        """One reading in contact; rotation (3, 3) of the sensor and velocity (3,) m/s of the centre, world frame.

        One of the stick says nothing about the torque of the sphere.
        """
        state = self._state
        if not wrench.usable or self._on_stick(wrench):
            state[kernels.S_TIME], state[kernels.S_FORCE] = wrench.time, wrench.magnitude
            return
        used = self._learn(
            self._params, state, self._information, self._sums, self._matrix, self._covariance,
            wrench.time, wrench.force, wrench.torque, rotation, velocity,
        )  # fmt: skip
        if used and state.item(kernels.S_SINCE) > SOLVE_EVERY:
            state[kernels.S_SINCE] = 0.0
            self._solve()

    def _on_stick(self, wrench: Wrench) -> bool:
        """Whether the force surely acts on the stick."""
        place = stick_contact(self.corrected(wrench)[0], _ORIGIN, _SENSOR_FRAME, self._probe)
        return place is not None and -place.item(2) > BEHIND * self._probe.radius

    def _solve(self) -> None:
        """Matrix and covariance; where more disagrees than expected, more is expected."""
        for _ in range(3):
            prior = np.append(1.0 / np.maximum(self._scale * self._expected, 1e-7) ** 2, 1.0 / self._zero**2)
            covariance = np.asarray(np.linalg.inv(self._information + np.diag(prior)), dtype=np.float64)
            found = covariance @ self._sums
            seen = np.abs(found[:3]).max(axis=1) / np.maximum(self._expected, 1e-7)
            wanted = min(float(seen.max()) / SURPRISE, LARGEST)
            if wanted <= self._scale:
                break
            self._scale = wanted
        self._matrix[:], self._covariance[:] = found[:3].T, covariance[:3, :3]
        self.disagreement = float(np.sqrt((self._matrix**2).sum(axis=0)).max()) / self._lever

    def report(self) -> dict[str, float]:
        """For the summary: disagreement found, and its ratio to what was expected."""
        return {"disagreement": round(self.disagreement, 5), "over_expected": round(self.surprise, 3)}
