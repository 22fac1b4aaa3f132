"""The robot of a scene and its gears."""

from __future__ import annotations

from math import radians

from lwrprobe.kinematics import Gears, Robot, robot_by_name
from lwrprobe.scene.scene import Scene


def robot_of(scene: Scene) -> Robot:
    """The robot model that a scene names, with its base and tool, and its kinematic table corrected.

    Raises UnknownNameError for another model, SceneError for a correction of another number of joints.
    """
    robot = robot_by_name(scene.arm.robot).with_base(scene.arm.base.matrix()).with_tool(scene.arm.tool.matrix())
    change = scene.arm.correction.table_change(robot.n)
    return robot.with_table_changed(change) if change.any() else robot


def gears_of(scene: Scene, joints: int) -> Gears | None:
    """What the scene knows of the gears of so many joints, None where it knows nothing.

    Raises SceneError for a correction of another number of joints.
    """
    correction = scene.arm.correction
    sine, cosine = correction.waves(joints)
    if not sine.any() and not cosine.any() and correction.joint_hysteresis_deg == 0.0:
        return None
    return Gears(scene.arm.gear_waves, sine, cosine, radians(correction.joint_hysteresis_deg))
