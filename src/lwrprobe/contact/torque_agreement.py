"""Whether torque and force of the sensor agree: the matrix by which they do not, learnt while the sphere slides.

A contact on the sphere has the torque `t = c x f + r u x f`. While the sphere slides, its normal n = -u follows from
force and path alone: friction opposes the path, so n lies along the rest of the force. What the torque shows beyond
that, `E f + t0`, is an error of gain, crosstalk or lever (E, always the same) and of the zero (t0, which wanders).
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector

LEAST_SPEED = 0.004
"""m/s, below it the sphere may stick."""
LEAST_FORCE = 0.4
"""N, below it the zero decides."""
STEADY = 0.1
"""Relative change of the force between two samples above which the tip lands or lifts off."""
OBLIQUE = 0.8
"""Least sine between force and path: friction is below 0.75."""
GAP = 0.05
"""s between two samples, from which on the earlier one says nothing."""
WANDER = 2.0
"""s over which the wandering of the zero is one and the same: samples within it count as one."""
OUTLIER = 3.0
"""Standard deviations from which on a residual counts with less weight."""
SURPRISE = 2.0
"""Ratio of found to expected disagreement from which on more is expected."""
LARGEST = 10.0
"""That ratio at most: without a prior, readings with a wrong normal would decide what forces have not shown."""
RUN = 0.05
"""Weight of a reading in the running mean of the residuals."""


class TorqueAgreement:
    """Recursive least squares for E (3, 3), m, in the sensor frame, with a prior for each of its columns.

    Parameters
    ----------
    probe : lever and radius
    expected : (3,) m, standard deviation of E's entries for force along the sensor's x, y, z
    zero : N·m, standard deviation of the torque about the sphere through the wandering zero of all axes
    normal_error : rad, standard deviation of a normal that follows from force and path
    """

    def __init__(self, probe: Probe, expected: Vector, zero: float, normal_error: float) -> None:
        self._radius, self._lever = probe.radius, probe.sensor_distance
        self._compliance = probe.compliance
        self._expected, self._scale = np.array(expected, dtype=np.float64), 1.0
        self._zero, self._normal_error = zero, normal_error
        self._information, self._sums = np.zeros((4, 4)), np.zeros((4, 3))
        self._matrix: Vector = np.zeros((3, 3))
        self._covariance: Vector = np.diag(self._expected**2)
        self._last: tuple[float, float] | None = None
        self._since = 0.0
        self._misfit = 1.0

    @property
    def _excess(self) -> float:
        """Ratio of the residuals to what is expected of them, 1 where they are as expected or smaller."""
        return max(sqrt(self._misfit) / SURPRISE, 1.0)

    def corrected(self, wrench: Wrench) -> Wrench:
        """The wrench without the torque that is known to be wrong."""
        return replace(wrench, torque=wrench.torque - self._matrix @ wrench.force)

    def lever_error(self, force: Vector) -> float:
        """m, standard deviation of the torque over the force (3,) N that remains, for its direction, sensor frame."""
        square = float(force @ force)
        return self._excess * sqrt(float(force @ self._covariance @ force) / square) if square > 0.0 else 0.0

    @property
    def disagreement(self) -> float:
        """Largest torque error that was found, over the lever: 0.03 means that torque and force disagree by 3 %."""
        return float(np.sqrt((self._matrix**2).sum(axis=0)).max()) / self._lever

    @property
    def surprise(self) -> float:
        """Ratio of the disagreement found to the one expected, 1 where it is as expected or less."""
        return max(self._scale, self._excess)

    def learn(self, wrench: Wrench, rotation: np.ndarray, velocity: Vector) -> None:
        """One reading in contact; rotation (3, 3) of the sensor and velocity (3,) m/s of the centre, world frame."""
        size, speed = wrench.magnitude, sqrt(float(velocity @ velocity))
        before, self._last = self._last, (wrench.time, size)
        if before is None or not wrench.usable or speed < LEAST_SPEED or size < LEAST_FORCE:
            return
        passed = wrench.time - before[0]
        if not 0.0 < passed < GAP or abs(size - before[1]) > STEADY * size:
            return
        path = rotation.T @ velocity / speed
        force = wrench.force
        along = float(force @ path)
        if along > 0.0 or along * along > (1.0 - OBLIQUE**2) * size * size:
            return
        normal = force - along * path
        normal = normal / sqrt(float(normal @ normal))
        centre = self._compliance * force
        centre[2] += self._lever
        left = wrench.torque - np.cross(centre - self._radius * normal, force)
        row = np.append(force, 1.0)
        rest = left - self._matrix @ force
        variance = self._zero**2 + (self._radius * size * self._normal_error) ** 2
        expected = sqrt(variance + float(force @ self._covariance @ force))
        self._misfit += RUN * (float(rest @ rest) / (3.0 * expected * expected) - self._misfit)
        weight = min(passed / WANDER, 1.0) / variance
        weight *= min(1.0, OUTLIER * expected * sqrt(3.0) / max(sqrt(float(rest @ rest)), 1e-12))
        self._information += weight * np.outer(row, row)
        self._sums += weight * np.outer(row, left)
        self._since += passed
        if self._since > 0.1:
            self._since = 0.0
            self._solve()

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
        self._matrix, self._covariance = found[:3].T.copy(), covariance[:3, :3].copy()

    def report(self) -> dict[str, float]:
        """For the summary: disagreement found, and its ratio to what was expected."""
        return {"disagreement": round(self.disagreement, 5), "over_expected": round(self.surprise, 3)}
