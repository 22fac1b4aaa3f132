"""Looking ahead along a Cartesian path: how far the arm can follow it, and what stops it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import InputError, as_pose
from lwrprobe.kinematics.robot import Array, Robot
from lwrprobe.kinematics.solver import IKSolver, IKStatus

if TYPE_CHECKING:
    from spatialmath import SE3

NUDGE = 1e-4
"""m"""


@dataclass(frozen=True, slots=True)
class FollowReport:
    """How far a path can be followed without a jump, and what it asks of the arm on the path.

    Attributes
    ----------
    complete : the whole path can be followed
    reached : number of poses reached
    status : why it ended, CONVERGED when complete
    reason : the same in words, with the joint or the distance; empty when complete
    q : (reached, n) joint values
    manipulability : (reached,) Yoshikawa's measure, 0 at a singularity
    limit_margin : (reached,) distance to the nearest joint limit [rad; m for prismatic joints]
    speed_use : (reached,) share of the joints' speed limits that the step to each pose takes, 0 for the first and
        throughout where no time was given
    """

    complete: bool
    reached: int
    status: IKStatus
    reason: str
    q: Array
    manipulability: Array
    limit_margin: Array
    speed_use: Array


def follow(
    robot: Robot,
    poses: Array | Sequence[SE3],
    q0: Array,
    *,
    seconds: float | None = None,
    solver: IKSolver | None = None,
) -> FollowReport:
    """Follow a path of tip poses (m, 4, 4) from joint values q0 (n,), which hold the tip at the first or close to it.

    `seconds` is the time between two poses and gives `speed_use`; `solver` brings its own tolerances, bound on jumps
    and preference. Raises InputError naming `poses[k]` or `q0`.
    """
    solver = solver or IKSolver(robot)
    path = as_poses(poses)
    qs = np.empty((len(path), robot.n))
    seed = robot.joint_values(q0, "q0")
    status, reason, reached = IKStatus.CONVERGED, "", len(path)
    for k, pose in enumerate(path):
        status = IKStatus(solver.track(pose, seed, qs[k]))
        if status != IKStatus.CONVERGED:
            reason, reached = why(robot, status, pose, seed, qs[k]), k
            break
        seed = qs[k]
    qs = qs[:reached].copy()
    return FollowReport(
        complete=reached == len(path),
        reached=reached,
        status=status,
        reason=reason,
        q=qs,
        manipulability=robot.manipulability_batch(qs),
        limit_margin=np.minimum(qs - robot.lower, robot.upper - qs).min(axis=1),
        speed_use=_speed_use(robot, qs, seconds),
    )


def sensitivity(solver: IKSolver, pose: Array, q: Array) -> float:
    """rad/m (m/m for prismatic joints), how far the most affected joint moves for each m of the tip, whichever way.

    The tip is at a pose (4, 4), held by q (n,). It is large near a stretched elbow, inf at the end of the reach.
    """
    moved, found, squares = pose.copy(), np.empty_like(q), np.zeros_like(q)
    for axis in range(3):
        moved[:3, 3] = pose[:3, 3]
        moved[axis, 3] += NUDGE
        if solver.track(moved, q, found) != IKStatus.CONVERGED:
            return np.inf
        squares += (found - q) ** 2
    return float(np.sqrt(squares.max())) / NUDGE


def why(robot: Robot, status: IKStatus, pose: Array, q_from: Array, q: Array) -> str:
    """In words, why a pose (4, 4) could not be followed from q_from (n,), of which q (n,) is the best found."""
    tip = np.empty((4, 4))
    robot.fk_into(q, tip)
    gap = np.linalg.norm(tip[:3, 3] - pose[:3, 3])
    if status == IKStatus.UNREACHABLE:
        return f"{gap:.4g} m out of reach"
    if status == IKStatus.LIMITED:
        held = [_end(robot, q, i) for i in range(robot.n)]
        names = ", ".join(text for text in held if text)
        return f"held {gap:.4g} m short by {names or 'joint limits'}"
    if status == IKStatus.JUMP:
        busiest = int(np.argmax(np.abs(q - q_from)))
        return f"only by a jump to another posture, first of joint {busiest + 1}"
    return f"{gap:.4g} m short when the search ended"


def straight_line(start: SE3 | Array, end: SE3 | Array, step: float = 0.005, turn: float = 0.02) -> Array:
    """(m, 4, 4) poses on the straight line from start to end, turning evenly about one axis, both ends included.

    Neighbours are at most `step` m and `turn` rad apart. Raises InputError naming `start`, `end`, `step` or `turn`.
    """
    start, end = as_pose(start, "start"), as_pose(end, "end")
    for name, value in (("step", step), ("turn", turn)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(name, value, "a positive number")
    shift = end[:3, 3] - start[:3, 3]
    axis, angle = axis_angle(start[:3, :3].T @ end[:3, :3])
    pieces = max(1, int(np.ceil(np.linalg.norm(shift) / step)), int(np.ceil(angle / turn)))
    share = np.linspace(0.0, 1.0, pieces + 1)
    poses = np.tile(np.eye(4), (len(share), 1, 1))
    poses[:, :3, 3] = start[:3, 3] + share[:, None] * shift
    poses[:, :3, :3] = start[:3, :3] @ rotations(axis, share * angle)
    poses[-1] = end
    return poses


def axis_angle(rotation: Array) -> tuple[Array, float]:
    """Unit axis (3,) and angle 0..pi of a rotation (3, 3)."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = np.linalg.norm(skew), 0.5 * (np.trace(rotation) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-6:
        return skew / sine, angle
    # near no turn any axis will do; near half a turn the symmetric part holds it
    symmetric = 0.5 * (rotation + rotation.T) + np.eye(3)
    column = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    return column / np.linalg.norm(column), angle


def rotations(axis: Array, angles: Array) -> Array:
    """(m, 3, 3) rotations about one unit axis by angles (m,) (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def as_poses(poses: Array | Sequence[SE3], field: str = "poses") -> Array:
    """(m, 4, 4) float64 in C order. Raises InputError naming `poses[k]`, the first that is no rigid motion."""
    if not isinstance(poses, np.ndarray):
        poses = np.array([getattr(pose, "A", pose) for pose in poses], dtype=np.float64)
    path = np.ascontiguousarray(poses, dtype=np.float64)
    if path.ndim != 3 or path.shape[1:] != (4, 4) or len(path) == 0:
        raise InputError(field, path.shape, "an (m, 4, 4) array of at least one pose")
    turned = path[:, :3, :3]
    with np.errstate(invalid="ignore"):
        skew = np.abs(turned.transpose(0, 2, 1) @ turned - np.eye(3)).max(axis=(1, 2))
        good = np.isfinite(path).all(axis=(1, 2)) & (skew <= 1e-6) & (np.linalg.det(turned) > 0.0)
        good &= np.abs(path[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1) <= 1e-9
    if not good.all():
        first = int(np.argmin(good))
        as_pose(path[first], f"{field}[{first}]")
    return path


def _end(robot: Robot, q: Array, i: int) -> str:
    unit = "m" if robot.prismatic[i] else "deg"
    scale = 1.0 if robot.prismatic[i] else 180.0 / np.pi
    for name, limit in (("lower", robot.lower[i]), ("upper", robot.upper[i])):
        if abs(q[i] - limit) < 1e-6:
            return f"joint {i + 1} at its {name} limit {scale * limit:.4g} {unit}"
    return ""


def _speed_use(robot: Robot, qs: Array, seconds: float | None) -> Array:
    use = np.zeros(len(qs))
    if seconds is not None and len(qs) > 1:
        if not (np.isfinite(seconds) and seconds > 0.0):
            raise InputError("seconds", seconds, "a positive number")
        use[1:] = np.max(np.abs(np.diff(qs, axis=0)) / robot.speed, axis=1) / seconds
    return use
