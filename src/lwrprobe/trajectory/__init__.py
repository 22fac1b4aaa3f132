"""Jerk-limited online trajectories in Cartesian and joint space."""

from lwrprobe.trajectory.bow import Bow, bow
from lwrprobe.trajectory.cartesian import CartesianTrajectory
from lwrprobe.trajectory.governor import SpeedGovernor
from lwrprobe.trajectory.joint import JointTrajectory
from lwrprobe.trajectory.limits import CartesianLimits
from lwrprobe.trajectory.status import TrajectoryStatus

__all__ = [
    "Bow",
    "CartesianLimits",
    "CartesianTrajectory",
    "JointTrajectory",
    "SpeedGovernor",
    "TrajectoryStatus",
    "bow",
]
