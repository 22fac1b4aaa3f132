"""Textbook forms, slow and obviously right, that the kernels are held against."""

import itertools

import numpy as np
from numba.core.runtime import _nrt_python as numba_runtime
from scipy.spatial.transform import Rotation


def rot_z(angle):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
    return out


def rot_x(angle):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("x", angle).as_matrix()
    return out


def shift(x=0.0, z=0.0):
    out = np.eye(4)
    out[0, 3], out[2, 3] = x, z
    return out


def naive_frames(robot, q):
    """Base and link frames as dense matrix products, one row of the DH table after another."""
    frames = [robot.base]
    for i in range(robot.n):
        theta = robot.theta[i] + (0.0 if robot.prismatic[i] else q[i])
        d = robot.d[i] + (q[i] if robot.prismatic[i] else 0.0)
        joint = rot_z(theta) @ shift(z=d)
        link = shift(x=robot.a[i]) @ rot_x(robot.alpha[i])
        frames.append(frames[-1] @ (link @ joint if robot.convention == "modified" else joint @ link))
    return np.array(frames)


def naive_tip(robot, q):
    return naive_frames(robot, q)[-1] @ robot.tool


def naive_jacobian(robot, q, h=1e-6):
    """Central differences of the tip."""
    out = np.empty((6, robot.n))
    for i in range(robot.n):
        step = np.zeros(robot.n)
        step[i] = h
        ahead, behind = naive_tip(robot, q + step), naive_tip(robot, q - step)
        out[:3, i] = (ahead[:3, 3] - behind[:3, 3]) / (2 * h)
        out[3:, i] = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec() / (2 * h)
    return out


def pose_error(pose, target):
    """m and rad between two poses."""
    turn = Rotation.from_matrix(pose[:3, :3] @ target[:3, :3].T).magnitude()
    return np.linalg.norm(pose[:3, 3] - target[:3, 3]), turn


def naive_lwr_solutions(robot, pose, arm_angle):
    """All eight solutions of the LWR 4+ at one arm angle, limits ignored: {signs: q}.

    Law of cosines for the elbow, the elbow put on its circle, then shoulder and wrist by Euler angles.
    """
    upper, fore = robot.d[2], robot.d[4]
    flange = np.linalg.inv(robot.base) @ pose @ np.linalg.inv(robot.tool)
    wrist = flange[:3, 3]
    reach = np.linalg.norm(wrist)
    n = wrist / reach
    vertical = np.array([0.0, 0.0, 1.0]) if abs(n[2]) < 0.95 else np.array([1.0, 0.0, 0.0])
    e1 = vertical - (vertical @ n) * n
    e1 /= np.linalg.norm(e1)
    out = {}
    bend = np.arccos(np.clip((reach**2 - upper**2 - fore**2) / (2 * upper * fore), -1.0, 1.0))
    high = (reach**2 + upper**2 - fore**2) / (2 * reach)
    wide = np.sqrt(max(upper**2 - high**2, 0.0))
    radial = Rotation.from_rotvec(arm_angle * n).apply(e1)
    elbow = high * n + wide * radial
    for signs in itertools.product((1, -1), repeat=3):
        q4 = signs[0] * bend
        # columns of frame 3: z along the upper arm, y opposite to the elbow joint's axis
        z = elbow / upper
        y = -signs[0] * np.cross(n, radial)
        r03 = np.column_stack([np.cross(y, z), y, z])
        r34 = (rot_x(-np.pi / 2) @ rot_z(q4) @ rot_x(np.pi / 2))[:3, :3]
        r47 = (r03 @ r34).T @ flange[:3, :3]
        # Rz(a) Rx(90) Rz(b) Rx(-90) Rz(c) = Rz(a) Ry(-b) Rz(c)
        q1, q2, q3 = zyz(r03, -signs[1])
        q5, q6, q7 = zyz(r47, -signs[2])
        out[signs] = np.array([q1, -q2, q3, q4, q5, -q6, q7])
    return out


def zyz(r, sign):
    """Euler angles of r = Rz(a) Ry(b) Rz(c) with sin b of the given sign."""
    b = sign * np.arccos(np.clip(r[2, 2], -1.0, 1.0))
    return np.arctan2(sign * r[1, 2], sign * r[0, 2]), b, np.arctan2(sign * r[2, 1], -sign * r[2, 0])


def allocations():
    """How often compiled code has asked for memory."""
    numba_runtime.memsys_enable_stats()
    return numba_runtime.memsys_get_stats_alloc()
