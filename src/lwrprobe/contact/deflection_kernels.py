"""Kernels of deflection: displacement of the sphere under force from its place by forward kinematics."""

from __future__ import annotations

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def stick_shift(rotation, compliance, force, out):
    """out (3,) = R diag(c) R' f, world frame."""
    out[0] = out[1] = out[2] = 0.0
    for k in range(3):
        along = rotation[0, k] * force[0] + rotation[1, k] * force[1] + rotation[2, k] * force[2]
        along *= compliance[k]
        for i in range(3):
            out[i] += along * rotation[i, k]


@kernel
def add_arm_shift(jacobian, joint_compliance, force, out):
    """out (3,) += J diag(c) J' f with J the first three rows of the tip's Jacobian (m, n), world frame."""
    for k in range(joint_compliance.size):
        torque = jacobian[0, k] * force[0] + jacobian[1, k] * force[1] + jacobian[2, k] * force[2]
        turn = joint_compliance[k] * torque
        for i in range(3):
            out[i] += jacobian[i, k] * turn
