"""Poses on a straight motion step (kernels, private)."""

from __future__ import annotations

import numpy as np

from lwrprobe.collision.shape_kernels import CARRIER, reach
from lwrprobe.compiled import kernel


@kernel
def turn_between(a, b, turn):
    """Rotation vector of a^T b for two poses, at most pi long, written to `turn`."""
    r = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]
    turn[0], turn[1], turn[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    sine = 0.5 * np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-9:
        for i in range(3):
            turn[i] *= 0.5 * angle / sine
    elif cosine > 0.0:
        turn[:] = 0.0
    else:
        # Half a turn: the antisymmetric part has vanished; the axis is left in the symmetric one.
        k = 0
        for i in range(1, 3):
            if r[i, i] > r[k, k]:
                k = i
        length = np.sqrt(max(0.5 * (r[k, k] + 1.0), 0.25))
        for i in range(3):
            turn[i] = angle * (length if i == k else 0.25 * (r[i, k] + r[k, i]) / length)


@kernel
def pose_between(a, b, turn, t, pose):
    """Pose a fraction t of the travel from a to b: origin on the line, orientation turning about one axis."""
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2) * t
    first = t if angle < 1e-9 else np.sin(angle) / angle * t
    second = 0.5 * t * t if angle < 1e-4 else (1.0 - np.cos(angle)) / (angle * angle) * t * t
    x, y, z = turn[0], turn[1], turn[2]
    q = np.empty((3, 3))
    q[0, 0], q[0, 1], q[0, 2] = 1.0 - second * (y * y + z * z), second * x * y - first * z, second * x * z + first * y
    q[1, 0], q[1, 1], q[1, 2] = second * x * y + first * z, 1.0 - second * (x * x + z * z), second * y * z - first * x
    q[2, 0], q[2, 1], q[2, 2] = second * x * z - first * y, second * y * z + first * x, 1.0 - second * (x * x + y * y)
    for i in range(3):
        for j in range(3):
            pose[i, j] = a[i, 0] * q[0, j] + a[i, 1] * q[1, j] + a[i, 2] * q[2, j]
        pose[i, 3] = a[i, 3] + t * (b[i, 3] - a[i, 3])


@kernel
def prepare(rows, first, last, turns):
    """Rotation vectors (1 + m, 3) of all carriers, into `turns`, and an upper bound of any link point's travel.

    No point moves farther than its carrier's shift plus its turn times the link's reach.
    """
    travel = 0.0
    for i in range(first.shape[0]):
        turn_between(first[i], last[i], turns[i])
    for i in range(rows.shape[0]):
        carrier = np.int64(rows[i, CARRIER])
        shift, angle = 0.0, 0.0
        for k in range(3):
            shift += (last[carrier, k, 3] - first[carrier, k, 3]) ** 2
            angle += turns[carrier, k] ** 2
        travel = max(travel, np.sqrt(shift) + np.sqrt(angle) * reach(rows[i]))
    return travel


@kernel
def poses_between(first, last, turns, t, poses):
    """All carriers' poses a fraction t of the travel."""
    for i in range(first.shape[0]):
        pose_between(first[i], last[i], turns[i], t, poses[i])
