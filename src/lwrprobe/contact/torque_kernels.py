"""Kernels of what learns the disagreement of torque and force (see `torque_agreement`).

E (3, 3) is the matrix found, in m; its covariance (3, 3), in m^2, holds for each row of E.
"""

from __future__ import annotations

from math import sqrt

from lwrprobe.compiled import allocation_free_kernel as kernel

# parameters
P_RADIUS = 0  # m
P_LEVER = 1  # m, from the sensor to the sphere
P_COMPLIANCE = 2  # 3, m/N
P_ZERO = 5  # N m, standard deviation by the wandering zero
P_NORMAL = 6  # rad, standard deviation of a normal that follows from force and path
P_GAP = 7  # s between two samples, from which on the earlier one says nothing
PARAMS = 8

# state
S_TIME = 0  # s, of the last sample, negative infinity before the first
S_FORCE = 1  # N, its magnitude
S_SINCE = 2  # s of usable samples since the matrix was found last
S_MISFIT = 3  # running mean of the squared residuals over those expected
STATE = 4

MIN_SPEED = 0.004  # m/s, below it the sphere may stick
MIN_FORCE = 0.4  # N, below it the zero decides
STEADY = 0.1  # relative change of the force between two samples above which the tip lands or lifts off
OBLIQUE = 0.8  # least sine between force and path: friction is below 0.75
WANDER = 2.0  # s over which the wandering of the zero is one and the same: samples within it count as one
OUTLIER = 3.0  # standard deviations from which on a residual counts with less weight
RUN = 0.05  # weight of a reading in the running mean of the residuals


@kernel
def quadratic(matrix, force):
    """f' M f."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += force[i] * matrix[i, j] * force[j]
    return total


@kernel
def correct(matrix, covariance, excess, force, torque, out):
    """out (3,) = torque - E f; returns the standard deviation in m of the rest over the force, for its direction."""
    for i in range(3):
        out[i] = torque[i] - (matrix[i, 0] * force[0] + matrix[i, 1] * force[1] + matrix[i, 2] * force[2])
    square = force[0] * force[0] + force[1] * force[1] + force[2] * force[2]
    return excess * sqrt(quadratic(covariance, force) / square) if square > 0.0 else 0.0


@kernel
def learn(params, state, information, sums, matrix, covariance, time, force, torque, rotation, velocity):
    """Add one usable reading in contact to `information` (4, 4) and `sums` (4, 3); whether it could be used.

    Force and torque (3,) are in the sensor frame, rotation (3, 3) of the sensor and velocity (3,) in the world frame.
    """
    size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    speed = sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2])
    passed, change = time - state[S_TIME], abs(size - state[S_FORCE])
    state[S_TIME], state[S_FORCE] = time, size
    if speed < MIN_SPEED or size < MIN_FORCE or not 0.0 < passed < params[P_GAP] or change > STEADY * size:
        return False
    px = (rotation[0, 0] * velocity[0] + rotation[1, 0] * velocity[1] + rotation[2, 0] * velocity[2]) / speed
    py = (rotation[0, 1] * velocity[0] + rotation[1, 1] * velocity[1] + rotation[2, 1] * velocity[2]) / speed
    pz = (rotation[0, 2] * velocity[0] + rotation[1, 2] * velocity[1] + rotation[2, 2] * velocity[2]) / speed
    fx, fy, fz = force[0], force[1], force[2]
    along = fx * px + fy * py + fz * pz
    if along > 0.0 or along * along > (1.0 - OBLIQUE * OBLIQUE) * size * size:
        return False
    nx, ny, nz = fx - along * px, fy - along * py, fz - along * pz
    length = params[P_RADIUS] / sqrt(nx * nx + ny * ny + nz * nz)
    cx = params[P_COMPLIANCE] * fx - length * nx
    cy = params[P_COMPLIANCE + 1] * fy - length * ny
    cz = params[P_COMPLIANCE + 2] * fz + params[P_LEVER] - length * nz
    left = (torque[0] - (cy * fz - cz * fy), torque[1] - (cz * fx - cx * fz), torque[2] - (cx * fy - cy * fx))
    square = 0.0
    for i in range(3):
        square += (left[i] - (matrix[i, 0] * fx + matrix[i, 1] * fy + matrix[i, 2] * fz)) ** 2
    variance = params[P_ZERO] ** 2 + (params[P_RADIUS] * size * params[P_NORMAL]) ** 2
    expected = variance + quadratic(covariance, force)
    state[S_MISFIT] += RUN * (square / (3.0 * expected) - state[S_MISFIT])
    weight = min(passed / WANDER, 1.0) / variance
    weight *= min(1.0, OUTLIER * sqrt(3.0 * expected) / max(sqrt(square), 1e-12))
    row = (fx, fy, fz, 1.0)
    for i in range(4):
        for j in range(4):
            information[i, j] += weight * row[i] * row[j]
        for j in range(3):
            sums[i, j] += weight * row[i] * left[j]
    state[S_SINCE] += passed
    return True
