"""The tip is where it is, not where the joints say: stick and arm give way under force."""

from __future__ import annotations

from collections.abc import Sequence

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


def _compliance(field: str, value: Sequence[float] | Vector) -> Vector:
    array = np.array(value, dtype=np.float64)
    if array.ndim != 1 or not (np.isfinite(array).all() and (array >= 0.0).all()):
        raise InputError(field, value, "finite numbers, zero or more")
    return array
