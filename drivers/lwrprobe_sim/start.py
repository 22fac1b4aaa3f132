"""Where a simulated arm stands at first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene

READY_POSTURE = (0.0, 0.5, 0.0, -1.4, 0.0, 1.2415926535897932, 0.0)
"""rad, of a seven-joint arm: probe pointing straight down."""


def start_joints(scene: Scene, robot: Robot, given: Sequence[float] | np.ndarray | None) -> np.ndarray:
    """(n,) rad: as given, else the scene's `arm.start_deg`, else a posture of readiness. Raises InputError."""
    if given is not None:
        return robot.joint_values(np.array(given), "sim.start_q")
    if scene.arm.start_deg is not None:
        return robot.joint_values(np.radians(scene.arm.start_deg), "arm.start_deg")
    return np.array(READY_POSTURE) if robot.n == 7 else np.zeros(robot.n)
