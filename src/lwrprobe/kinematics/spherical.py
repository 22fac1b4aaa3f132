"""Arms with a spherical shoulder, an elbow and a spherical wrist, recognised from their DH table."""

from __future__ import annotations

import numpy as np

from lwrprobe.kinematics import srs_kernels as srs
from lwrprobe.kinematics.robot import Array, Robot

CLOSE = 1e-7
"""How near to an exact quarter turn or zero an entry has to be; model files write pi/2 with few digits, and what the
closed form then misses, a Newton step makes good."""


def spherical_shape(robot: Robot) -> Array | None:
    """What the closed form needs of an arm, (3, 16) (see srs_kernels), None where the arm is of another kind.

    Seven revolute joints, quarter-turn twists between them, no offset but the upper arm's (behind joint 3) and the
    forearm's (behind joint 5); what lies before joint 1 and behind joint 7 is free.
    """
    if robot.n != 7 or robot.prismatic.any():
        return None
    lead, a, alpha = _as_standard(robot)
    offset = CLOSE * robot.length
    twists = np.sin(alpha[:6])
    elsewhere = np.concatenate([a[:6], robot.d[[1, 3, 5]]])
    if np.abs(elsewhere).max() > offset or np.abs(np.cos(alpha[:6])).max() > CLOSE:
        return None
    if min(robot.d[2], robot.d[4]) <= offset:
        return None
    shoulder = lead @ _screw_z(robot.d[0])
    tail = np.linalg.inv(_screw_z(robot.d[6]) @ _screw_x(a[6], alpha[6]) @ robot.tool)
    shape = np.zeros((3, 16))
    shape[0, :12] = shoulder[:3].ravel()
    shape[1, :12] = tail[:3].ravel()
    shape[2, srs.SIGN : srs.SIGN + 6] = np.round(twists)
    shape[2, srs.UPPER_ARM], shape[2, srs.FOREARM] = robot.d[2], robot.d[4]
    elbow = robot.chain[4]
    shape[2, srs.NEAREST] = srs.nearest_reach(shape, elbow, 0.0)
    shape[2, srs.FARTHEST] = srs.nearest_reach(shape, elbow, 2.0 * (robot.d[2] + robot.d[4]))
    return shape


def _as_standard(robot: Robot) -> tuple[Array, Array, Array]:
    """Base, a and alpha with the offsets behind their joints: a modified table holds them one row late."""
    if robot.convention == "standard":
        return robot.base, robot.a, robot.alpha
    lead = robot.base @ _screw_x(robot.a[0], robot.alpha[0])
    return lead, np.append(robot.a[1:], 0.0), np.append(robot.alpha[1:], 0.0)


def _screw_z(d: float) -> Array:
    out = np.eye(4)
    out[2, 3] = d
    return out


def _screw_x(a: float, alpha: float) -> Array:
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, 0.0], [0.0, 0.0, 0.0, 1.0]])
