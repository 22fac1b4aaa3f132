"""Robot models by their Denavit-Hartenberg tables.

Each is a callable `(tool=None, base=None) -> Robot`, the form of an entry of the group `lwrprobe.robots`.
"""

from __future__ import annotations

from dataclasses import replace
from math import dist
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import LinkShape
from lwrprobe.kinematics.robot import Array, Robot

if TYPE_CHECKING:
    from spatialmath import SE3


def lwr4(tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """KUKA LWR 4+ (Gaz, Flacco, De Luca 2014). The base frame lies in the shoulder, 0.31 m above the mounting plane.

    The flange is 0.078 m beyond the last frame, which lies in the wrist; speeds are those with rated payload. The
    bodies are those of the model `lwr_description` (Centro E. Piaggio, Pisa): capsules 0.14 m thick that lie beside the
    joints' axes in turn, here without the foot.
    """
    upper = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0])
    robot = Robot(
        name="lwr4",
        a=np.zeros(7),
        alpha=np.deg2rad([90.0, -90.0, -90.0, 90.0, 90.0, -90.0, 0.0]),
        d=np.array([0.0, 0.0, 0.40, 0.0, 0.39, 0.0, 0.0]),
        theta=np.zeros(7),
        lower=-upper,
        upper=upper,
        speed=np.deg2rad([110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0]),
    )
    return _placed(replace(robot, links=_lwr4_links(robot)), tool, base)


def _lwr4_links(robot: Robot) -> tuple[LinkShape, ...]:
    """Capsules between two places [m] and with a radius, in the outstretched arm's base frame, each with its joint."""
    bodies = (
        ("shoulder", 1, (0.0, 0.0, -0.2), (0.0, 0.06, 0.0), 0.07),
        ("upper_arm", 2, (0.0, -0.06, 0.0), (0.0, 0.0, 0.2), 0.07),
        ("elbow", 3, (0.0, 0.0, 0.2), (0.0, -0.06, 0.4), 0.07),
        ("forearm", 4, (0.0, 0.06, 0.4), (0.0, 0.0, 0.6), 0.07),
        ("forearm_end", 5, (0.0, 0.0, 0.6), (0.0, 0.04, 0.79), 0.07),
        ("wrist", 6, (0.0, 0.0, 0.785), (0.0, 0.0, 0.795), 0.0625),
        ("flange", 7, (0.0, 0.0, 0.818), (0.0, 0.0, 0.828), 0.04),
    )
    links, frame, joint = [], np.eye(4), 0
    for name, carrier, begin, end, radius in bodies:
        while joint < carrier:
            frame = frame @ _at_rest(robot.alpha[joint], robot.d[joint])
            joint += 1
        pose = np.linalg.solve(frame, _along(begin, end))
        links.append(LinkShape(name, "capsule", (radius, dist(begin, end)), pose, str(carrier)))
    return tuple(links)


def _at_rest(alpha: float, d: float) -> Array:
    """A joint's transform at q = 0, without a: Tz(d) Rx(alpha)."""
    pose = np.eye(4)
    pose[1:3, 1:3] = (np.cos(alpha), -np.sin(alpha)), (np.sin(alpha), np.cos(alpha))
    pose[2, 3] = d
    return pose


def _along(begin: tuple[float, ...], end: tuple[float, ...]) -> Array:
    """Pose half way between two places, z from one to the other; they differ along y and z alone."""
    axis, pose = np.subtract(end, begin), np.eye(4)
    y, z = axis[1:] / np.linalg.norm(axis)
    pose[1:3, 1:3] = (z, y), (-y, z)
    pose[:3, 3] = np.add(begin, 0.5 * axis)
    return pose


def iiwa14(tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """KUKA LBR iiwa 14 R820 (data sheet): from the mounting plane to the media flange, 126 mm beyond the wrist."""
    upper = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0])
    robot = Robot(
        name="iiwa14",
        a=np.zeros(7),
        alpha=np.deg2rad([-90.0, 90.0, 90.0, -90.0, -90.0, 90.0, 0.0]),
        d=np.array([0.36, 0.0, 0.42, 0.0, 0.40, 0.0, 0.126]),
        theta=np.zeros(7),
        lower=-upper,
        upper=upper,
        speed=np.deg2rad([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]),
    )
    return _placed(robot, tool, base)


def ur5e(tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """Universal Robots UR5e (maker's DH table); every joint turns twice, the elbow within half a turn."""
    upper = np.deg2rad([360.0, 360.0, 180.0, 360.0, 360.0, 360.0])
    robot = Robot(
        name="ur5e",
        a=np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0]),
        alpha=np.deg2rad([90.0, 0.0, 0.0, 90.0, -90.0, 0.0]),
        d=np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]),
        theta=np.zeros(6),
        lower=-upper,
        upper=upper,
        speed=np.full(6, np.pi),
    )
    return _placed(robot, tool, base)


def panda(tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """Franka Emika Panda (maker's table, Craig's convention) to the flange, 107 mm along the last axis."""
    robot = Robot(
        name="panda",
        a=np.array([0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088]),
        alpha=np.deg2rad([0.0, -90.0, 90.0, 90.0, -90.0, 90.0, 90.0]),
        d=np.array([0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.107]),
        theta=np.zeros(7),
        lower=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        upper=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        speed=np.array([2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100]),
        convention="modified",
    )
    return _placed(robot, tool, base)


def puma560(tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """Unimation Puma 560 (Corke, Armstrong-Helouvry 1994), standing on the floor; without speed limits."""
    robot = Robot(
        name="puma560",
        a=np.array([0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0]),
        alpha=np.deg2rad([90.0, 0.0, -90.0, 90.0, -90.0, 0.0]),
        d=np.array([0.67183, 0.0, 0.15005, 0.4318, 0.0, 0.0]),
        theta=np.zeros(6),
        lower=np.deg2rad([-160.0, -45.0, -225.0, -110.0, -100.0, -266.0]),
        upper=np.deg2rad([160.0, 225.0, 45.0, 170.0, 100.0, 266.0]),
        speed=np.full(6, np.inf),
    )
    return _placed(robot, tool, base)


def _placed(robot: Robot, tool: SE3 | Array | None, base: SE3 | Array | None) -> Robot:
    if tool is not None:
        robot = robot.with_tool(tool)
    return robot if base is None else robot.with_base(base)


def robot_by_name(name: str, tool: SE3 | Array | None = None, base: SE3 | Array | None = None) -> Robot:
    """The robot behind an entry point of the group `lwrprobe.robots`. Raises UnknownNameError with the known names."""
    from lwrprobe.contracts.plugins import load

    return load("robot", name)(tool=tool, base=base)
