"""The tip is where it is, not where the joints say: stick and arm give way under force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contact import deflection_kernels as kernels
from lwrprobe.contracts import InputError, Probe
from lwrprobe.contracts.samples import Vector


class Deflection:
    """Shift of the sphere's centre under a force, linear in the force.

    Parameters
    ----------
    probe : its `compliance` (3,) m/N of the tip against the sensor, along the tip frame's axes
    joint_compliance : (n,) rad/(N·m) of the arm's joints, None = a rigid arm
    """

    def __init__(self, probe: Probe, joint_compliance: Sequence[float] | None = None) -> None:
        self.compliance = _compliance("probe.compliance", probe.compliance)
        if self.compliance.shape != (3,):
            raise InputError("probe.compliance", self.compliance.shape, "three numbers")
        self.joint_compliance = None if joint_compliance is None else _compliance("joint_compliance", joint_compliance)
        self.rigid = not self.compliance.any() and (self.joint_compliance is None or not self.joint_compliance.any())
        self._rotation = np.eye(3)
        self._force = np.zeros(3)
        self._stick_shift = entry(kernels.stick_shift, self._rotation, self.compliance, self._force, self._force)

    def shift(self, rotation: np.ndarray, force: Vector, jacobian: np.ndarray | None = None) -> Vector:
        """(3,) m by which the sphere gives way, world frame.

        The map is linear: fed with the force's rate [N/s] it gives the velocity to add to the nominal one.

        Parameters
        ----------
        rotation : (3, 3) of the tip
        force : (3,) N on the sphere, world frame
        jacobian : (6, n) or (3, n) of the tip in the world, needed for a compliant arm only
        """
        out = np.zeros(3)
        self._rotation[:] = rotation
        self._force[:] = force
        self._stick_shift(self._rotation, self.compliance, self._force, out)
        if self.joint_compliance is not None:
            joints = self.joint_compliance.size
            if jacobian is None:
                raise InputError("jacobian", jacobian, f"(6, {joints}), the tip's")
            if np.shape(jacobian)[1] != joints:
                raise InputError("jacobian", np.shape(jacobian), f"(6, {joints}), the tip's")
            kernels.add_arm_shift(
                np.ascontiguousarray(jacobian, dtype=np.float64), self.joint_compliance, self._force, out
            )
        return out

    def centre(
        self, nominal: Vector, rotation: np.ndarray, force: Vector, jacobian: np.ndarray | None = None
    ) -> Vector:
        """(3,) m, the sphere's centre: what forward kinematics says, plus `shift`."""
        if self.rigid:
            return nominal
        return nominal + self.shift(rotation, force, jacobian)

    def along(self, rotation: np.ndarray, direction: Vector, jacobian: np.ndarray | None = None) -> float:
        """m/N of give along a unit direction: what the probe adds to the surface's own compliance there."""
        return float(np.dot(direction, self.shift(rotation, direction, jacobian)))


@dataclass(slots=True, frozen=True)
class Compliance:
    """Result of a calibration touch.

    Attributes
    ----------
    values : (3,) m/N along the tip frame's axes, 0 where `determined` is False
    determined : (3,) whether the presses loaded that axis
    sigma : (3,) m/N, standard deviation of the values
    residual : m, root mean square of what is left
    """

    values: Vector
    determined: np.ndarray
    sigma: Vector
    residual: float


def identify_compliance(positions: np.ndarray, forces: np.ndarray, touches: Sequence[int] | None = None) -> Compliance:
    """Compliance of everything between the joints and a rigid surface, from presses along the surface normal.

    During a press the sphere stays on the surface, so along the direction n of the mean force the nominal position
    moves by what gives way: `n . x = a - sum_j n_j c_j f_j`, one a per touch. Three touches, along and across the
    stick, determine all three axes; one touch determines what it loads.

    Parameters
    ----------
    positions : (n, 3) m, nominal centre of the sphere in the tip frame's axes
    forces : (n, 3) N on the sphere in the same axes
    touches : (n,) number of the touch each row belongs to, None = one touch

    Raises
    ------
    InputError : shapes, NaN, fewer than 3 rows a touch, or forces that hardly change (under 0.05 N)
    """
    x, f = _rows("positions", positions), _rows("forces", forces)
    labels = np.zeros(len(x), dtype=int) if touches is None else np.asarray(touches)
    if len(f) != len(x) or labels.shape != (len(x),):
        raise InputError("forces", f.shape, f"one row and one touch number for each of {len(x)} positions")
    rows, seen = [], []
    for label in np.unique(labels):
        mine = labels == label
        size = np.linalg.norm(f[mine], axis=1)
        if mine.sum() < 3 or np.ptp(size) < 0.05:
            raise InputError(
                "forces", f"{mine.sum()} rows, {np.ptp(size):.3g} N", "3 rows and 0.05 N of change a touch"
            )
        n = f[mine].mean(axis=0)
        n /= np.linalg.norm(n)
        displacement, load = x[mine] @ n, f[mine] * n
        rows.append(-(load - load.mean(axis=0)))
        seen.append(displacement - displacement.mean())
    a, b = np.concatenate(rows), np.concatenate(seen)
    return _solve_compliance(a, b)


def _solve_compliance(a: np.ndarray, b: Vector) -> Compliance:
    loaded = np.sqrt((a**2).sum(axis=0)) > 0.02 * np.sqrt((a**2).sum())
    part = a[:, loaded]
    singular = np.linalg.svd(part, compute_uv=False)
    if singular[-1] < 1e-3 * singular[0]:
        raise InputError("forces", "directions too alike", "one press for each axis that is loaded")
    found, *_ = np.linalg.lstsq(part, b, rcond=None)
    error = b - part @ found
    freedom = max(len(b) - part.shape[1] - 1, 1)
    spread = np.sqrt(np.diag(np.linalg.inv(part.T @ part)) * (error @ error) / freedom)
    values, sigma = np.zeros(3), np.zeros(3)
    values[loaded], sigma[loaded] = found, spread
    return Compliance(values, loaded, sigma, float(np.sqrt(np.mean(error**2))))


def _compliance(field: str, value: Sequence[float] | Vector) -> Vector:
    array = np.array(value, dtype=np.float64)
    if array.ndim != 1 or not (np.isfinite(array).all() and (array >= 0.0).all()):
        raise InputError(field, value, "finite numbers, zero or more")
    return array


def _rows(field: str, value: np.ndarray) -> np.ndarray:
    array = np.array(value, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise InputError(field, array.shape, "an (n, 3) array of finite numbers")
    return array
