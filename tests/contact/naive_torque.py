"""Textbook form of `torque_kernels`: the same formulas with numpy's algebra."""

import numpy as np

from lwrprobe.contact import torque_kernels as k


def correct(matrix, covariance, excess, force, torque):
    """Corrected torque (3,), and the standard deviation of the rest over the force."""
    size = np.linalg.norm(force)
    return torque - matrix @ force, excess * np.sqrt(force @ covariance @ force) / size if size > 0.0 else 0.0


def learn(params, state, information, sums, matrix, covariance, time, force, torque, rotation, velocity):
    """(whether used, state, information, sums) after one reading."""
    radius, lever, zero, normal_error = (params[i] for i in (k.P_RADIUS, k.P_LEVER, k.P_ZERO, k.P_NORMAL))
    size, speed = np.linalg.norm(force), np.linalg.norm(velocity)
    passed, change = time - state[k.S_TIME], abs(size - state[k.S_FORCE])
    after = np.array([time, size, state[k.S_SINCE], state[k.S_MISFIT]])
    if speed < k.MIN_SPEED or size < k.MIN_FORCE or not 0.0 < passed < params[k.P_GAP] or change > k.STEADY * size:
        return False, after, information, sums
    path = rotation.T @ velocity / speed
    along = force @ path
    if along > 0.0 or np.linalg.norm(np.cross(force, path)) < k.OBLIQUE * size:
        return False, after, information, sums
    normal = force - along * path
    normal /= np.linalg.norm(normal)
    compliance = params[k.P_COMPLIANCE : k.P_COMPLIANCE + 3]
    centre = np.array([0.0, 0.0, lever]) + compliance * force
    left = torque - np.cross(centre - radius * normal, force)
    rest = left - matrix @ force
    variance = zero**2 + (radius * size * normal_error) ** 2
    expected = variance + force @ covariance @ force
    after[k.S_MISFIT] = (1.0 - k.RUN) * state[k.S_MISFIT] + k.RUN * np.mean(rest**2) / expected
    deviations = np.sqrt(np.mean(rest**2) / expected)
    weight = min(passed / k.WANDER, 1.0) / variance * min(1.0, k.OUTLIER / max(deviations, 1e-12))
    row = np.append(force, 1.0)
    after[k.S_SINCE] += passed
    return True, after, information + weight * np.outer(row, row), sums + weight * np.outer(row, left)
