"""How far a move that is straight in joint space leaves the straight line of the tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lwrprobe.contracts import InputError


class Arm(Protocol):
    """What `bow` asks of a robot."""

    def fk_into(self, q: np.ndarray, out: np.ndarray) -> None:
        """Write the tip's pose (4, 4) at q (n,)."""


@dataclass(slots=True, frozen=True)
class Bow:
    """Where a joint-space move is farthest from the straight line between its ends.

    Attributes
    ----------
    distance : m, from the line segment
    turn : rad, largest angle between the tip's orientation and the one slerp would have at the same share of the path
    at : share of the path, 0 .. 1, of the largest distance
    point : (3,) m, the tip there
    length : m, of the straight line
    """

    distance: float
    turn: float
    at: float
    point: np.ndarray
    length: float


def bow(arm: Arm, start: np.ndarray, end: np.ndarray, samples: int = 201) -> Bow:
    """Measure the bow of the straight joint-space move from `start` to `end` (n,), which `JointTrajectory` makes.

    The path is sampled and the largest distance refined by a parabola through its neighbours; the error is of the
    order (distance / samples^2). Raises InputError.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if start.ndim != 1 or start.shape != end.shape or not np.isfinite(start + end).all():
        raise InputError("start, end", (start.tolist(), end.tolist()), "finite joint vectors of one length")
    if samples < 3:
        raise InputError("samples", samples, "3 or more")
    shares = np.linspace(0.0, 1.0, samples)
    poses = _poses(arm, start, end, shares)
    distances = _distances(poses)
    k = min(max(int(np.argmax(distances)), 1), samples - 2)
    at = _vertex(shares[k - 1 : k + 2], distances[k - 1 : k + 2])
    best = _poses(arm, start, end, np.array([0.0, at, 1.0]))
    if _distances(best)[1] < distances[k]:
        at, best = shares[k], poses[[0, k, -1]]
    return Bow(
        distance=float(max(_distances(best)[1], distances.max())),
        turn=_largest_turn(poses, shares),
        at=float(at),
        point=best[1, :3, 3].copy(),
        length=float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3])),
    )


def _poses(arm: Arm, start: np.ndarray, end: np.ndarray, shares: np.ndarray) -> np.ndarray:
    poses = np.empty((shares.size, 4, 4))
    for share, pose in zip(shares, poses):
        arm.fk_into(start + share * (end - start), pose)
    return poses


def _distances(poses: np.ndarray) -> np.ndarray:
    """Of each tip from the segment between the first and the last."""
    points = poses[:, :3, 3]
    line = points[-1] - points[0]
    square = line @ line
    along = np.clip((points - points[0]) @ line / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(points))
    return np.linalg.norm(points - points[0] - along[:, None] * line, axis=1)


def _vertex(x: np.ndarray, y: np.ndarray) -> float:
    bend = y[0] - 2.0 * y[1] + y[2]
    return float(x[1] + 0.5 * (x[2] - x[1]) * (y[0] - y[2]) / bend) if bend < 0.0 else float(x[1])


def _largest_turn(poses: np.ndarray, shares: np.ndarray) -> float:
    from scipy.spatial.transform import Rotation

    rotations = Rotation.from_matrix(poses[:, :3, :3])
    whole = (rotations[-1] * rotations[0].inv()).as_rotvec()
    slerp = Rotation.from_rotvec(shares[:, None] * whole) * rotations[0]
    return float((rotations * slerp.inv()).magnitude().max())
