"""Three straight axes that carry the probe: the physics of touch measured without an arm's geometry."""

from __future__ import annotations

import numpy as np

from lwrprobe.kinematics import Robot


def gantry() -> Robot:
    """Joint values are the tip's x, y, z in the world [m]; the probe points down."""
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    tool[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    zero, quarter, one = np.zeros(3), 0.5 * np.pi, np.ones(3)
    return Robot(
        name="gantry",
        a=zero,
        alpha=np.array([-quarter, -quarter, 0.0]),
        d=zero,
        theta=np.array([0.0, quarter, 0.0]),
        lower=-one,
        upper=one,
        speed=100.0 * one,
        prismatic=np.ones(3, bool),
        base=base,
        tool=tool,
    )
