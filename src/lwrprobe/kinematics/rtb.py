"""Exchange of DH robots with Corke's Robotics Toolbox for Python."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.kinematics.robot import Array, Robot

if TYPE_CHECKING:
    from roboticstoolbox import DHLink, DHRobot


def from_roboticstoolbox(robot: DHRobot, speed: Array | None = None) -> Robot:
    """The same arm as a `Robot`; a `DHRobot` holds no joint speeds, so they may be given (n,), else are unlimited.

    Raises InputError for anything but a DHRobot, and naming the link for a joint that counts backwards.
    """
    from roboticstoolbox import DHRobot

    if not isinstance(robot, DHRobot):
        raise InputError("robot", type(robot).__name__, "a roboticstoolbox DHRobot")
    for i, link in enumerate(robot.links):
        if link.isflip:
            raise InputError(f"robot.links[{i}].flip", True, "joints that count forwards")
    sliding = np.array([link.isprismatic for link in robot.links])
    offset = np.array([link.offset for link in robot.links], dtype=float)
    limits = np.array([_limits(link) for link in robot.links])
    return Robot(
        name=robot.name,
        a=np.array([link.a for link in robot.links], dtype=float),
        alpha=np.array([link.alpha for link in robot.links], dtype=float),
        d=np.array([link.d for link in robot.links], dtype=float) * ~sliding + offset * sliding,
        theta=np.array([link.theta for link in robot.links], dtype=float) * sliding + offset * ~sliding,
        lower=limits[:, 0],
        upper=limits[:, 1],
        speed=np.full(len(robot.links), np.inf) if speed is None else speed,
        prismatic=sliding,
        convention="modified" if robot.mdh else "standard",
        base=robot.base.A,
        tool=robot.tool.A,
    )


def to_roboticstoolbox(robot: Robot) -> DHRobot:
    """The same arm as a roboticstoolbox `DHRobot`, with joint limits, base and tool."""
    import roboticstoolbox as toolbox
    from spatialmath import SE3

    modified = robot.convention == "modified"
    turning = toolbox.RevoluteMDH if modified else toolbox.RevoluteDH
    sliding = toolbox.PrismaticMDH if modified else toolbox.PrismaticDH
    links = []
    for i in range(robot.n):
        ends = np.array([robot.lower[i], robot.upper[i]])
        common = {"a": robot.a[i], "alpha": robot.alpha[i], "qlim": ends if np.isfinite(ends).all() else None}
        if robot.prismatic[i]:
            links.append(sliding(theta=robot.theta[i], offset=robot.d[i], **common))
        else:
            links.append(turning(d=robot.d[i], offset=robot.theta[i], **common))
    return toolbox.DHRobot(links, name=robot.name, base=SE3(robot.base), tool=SE3(robot.tool))


def _limits(link: DHLink) -> tuple[float, float]:
    limits = link.qlim
    return (-np.inf, np.inf) if limits is None else (float(limits[0]), float(limits[1]))
