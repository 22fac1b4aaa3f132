"""What a strategy answers: a goal to reach, a velocity to keep, or the end."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from lwrprobe.contracts.samples import Vector
from lwrprobe.errors import InputError


def as_pose(value: object, field: str = "pose") -> np.ndarray:
    """(4, 4) float64 array from a `spatialmath.SE3` or anything array-like; refuses what is no rigid motion.

    Raises InputError naming `field` for a wrong shape, a NaN, or a rotation that is not orthonormal to 1e-6 or
    is left-handed.
    """
    try:
        pose = np.asarray(getattr(value, "A", value), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(field, value, "an SE3 or a (4, 4) homogeneous matrix") from error
    if pose.shape != (4, 4):
        raise InputError(field, pose.shape, "an SE3 or a (4, 4) homogeneous matrix")
    if not np.isfinite(pose).all():
        raise InputError(field, pose.tolist(), "finite numbers only")
    r = pose[:3, :3]
    if np.abs(r.T @ r - np.eye(3)).max() > 1e-6 or np.linalg.det(r) < 0.0:
        raise InputError(field, r.tolist(), "a right-handed orthonormal rotation")
    if np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:
        raise InputError(field, pose[3].tolist(), "a last row of 0 0 0 1")
    return pose


@dataclass(slots=True)
class Goal:
    """Move the tip to a pose on a straight, jerk-limited line and stop there.

    Attributes
    ----------
    pose : (4, 4) world frame; a `spatialmath.SE3` is accepted and converted
    speed : m/s, upper bound of the tip's speed on the path
    reason : a few words for the run's trace
    """

    pose: np.ndarray
    speed: float
    reason: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.pose, np.ndarray):
            self.pose = as_pose(self.pose, "goal.pose")


@dataclass(slots=True)
class VelocityCommand:
    """Keep the tip moving at a velocity until the next step; after `hold` seconds without one, stop.

    Attributes
    ----------
    velocity : (3,) m/s, world frame, of the sphere's centre
    hold : s, after which the tip stops by itself; several samples
    reason : a few words for the run's trace
    pose : (4, 4) world frame, whose orientation is held or turned to meanwhile, None = keep the present orientation
    """

    velocity: Vector
    hold: float = 0.05
    reason: str = ""
    pose: np.ndarray | None = None


@dataclass(slots=True)
class Done:
    """The strategy has nothing left to do.

    Attributes
    ----------
    reason : one sentence for the summary
    complete : False when it gave up
    """

    reason: str
    complete: bool = True


Motion = Goal | VelocityCommand | Done


def check_motion(motion: object, fastest: float) -> None:
    """Raise InputError for an answer of a strategy that is no motion, or faster than `fastest` m/s."""
    if isinstance(motion, VelocityCommand):
        velocity = motion.velocity
        if getattr(velocity, "shape", None) != (3,):
            raise InputError("velocity", velocity, "an array of three numbers, m/s")
        speed = hypot(*velocity.tolist())
        if not speed <= fastest:  # also of a velocity that is not finite
            raise InputError("velocity", velocity.tolist(), f"at most {fastest:g} m/s, which motion.free_speed permits")
        if motion.pose is not None:
            as_pose(motion.pose, "velocity.pose")
    elif isinstance(motion, Goal):
        as_pose(motion.pose, "goal.pose")
        if not motion.speed > 0.0:
            raise InputError("goal.speed", motion.speed, "a positive number, m/s")
    elif not isinstance(motion, Done):
        raise InputError("motion", motion, "a Goal, a VelocityCommand or Done")
