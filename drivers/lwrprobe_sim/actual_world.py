"""What the simulated world is built from: scene, simulator options and arm, with what `[truth]` changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe.scene.actual_scene import actual_scene, placed
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.scene.table import Pose
from lwrprobe_sim.config import SimConfig

Drawn = dict[str, np.ndarray]


@dataclass(slots=True, frozen=True)
class ActualWorld:
    """Scene, options and arm as they really are, and the numbers by which they differ from what the scene says."""

    scene: Scene
    config: SimConfig
    robot: Robot
    drawn: dict[str, Any]


def actual_world(scene: Scene, config: SimConfig, seed: int) -> ActualWorld:
    """The world behind a scene for a run's seed; the scene itself where its truth is ideal.

    Raises SceneError for departures that leave no probe or do not fit the arm's joints.
    """
    robot = robot_of(scene)
    truth = scene.truth
    if truth.ideal:
        return ActualWorld(scene, config, robot, {"profile": truth.profile})
    run = scene.run.model_copy(update={"seed": seed})
    drawn = placed(scene, truth.draw(seed, robot.n))
    report: dict[str, Any] = {name: [round(float(v), 9) for v in numbers] for name, numbers in drawn.items()}
    if "zero_wander_force_mn" in drawn or "zero_wander_torque_unm" in drawn:
        report["zero_wander_s"] = truth.zero_wander_s
    if "loss_burst_ms" in drawn:
        report["loss_bursts_per_min"] = truth.loss_bursts_per_min
    return ActualWorld(
        scene=actual_scene(scene.model_copy(update={"run": run})),
        config=_config(scene, config, drawn),
        robot=_robot(robot, drawn),
        drawn={"profile": truth.profile, **report},
    )


def _first(drawn: Drawn, name: str, unit: float) -> float:
    """A scalar in SI, zero where the world does not differ."""
    return unit * float(drawn[name][0]) if name in drawn else 0.0


def _config(scene: Scene, config: SimConfig, drawn: Drawn) -> SimConfig:
    changed: dict[str, Any] = {
        "lag": config.lag + _first(drawn, "arm_lag_ms", 1e-3),
        "delay": config.delay + _first(drawn, "arm_delay_ms", 1e-3),
        "latency": config.latency + _first(drawn, "sensor_delay_ms", 1e-3),
        "clock_skew": config.clock_skew + _first(drawn, "clock_skew_ms", 1e-3),
        "friction_turn": config.friction_turn + _first(drawn, "friction_direction_deg", np.pi / 180.0),
    }
    for option, name, unit in (
        ("hysteresis", "sensor_hysteresis_percent", 1e-2),
        ("wander_force", "zero_wander_force_mn", 1e-3),
        ("wander_torque", "zero_wander_torque_unm", 1e-6),
        ("joint_hysteresis", "joint_hysteresis_deg", np.pi / 180.0),
        ("gear_ripple", "gear_ripple_deg", np.pi / 180.0),
    ):
        if name in drawn:
            changed[option] = _first(drawn, name, unit)
    if "zero_wander_force_mn" in drawn or "zero_wander_torque_unm" in drawn:
        changed["wander_time"] = scene.truth.zero_wander_s
    if "loss_burst_ms" in drawn:
        changed["burst_length"] = _first(drawn, "loss_burst_ms", 1e-3)
        changed["burst_rate"] = scene.truth.loss_bursts_per_min / 60.0 if changed["burst_length"] > 0.0 else 0.0
    if "drift_mn_per_min" in drawn:
        changed["drift_force"] = tuple(np.add(config.drift_force, 1e-3 * drawn["drift_mn_per_min"]).tolist())
    if "joint_stiffness_percent" in drawn:
        soft = np.array(config.joint_compliance) / (1.0 + 0.01 * drawn["joint_stiffness_percent"])
        changed["joint_compliance"] = tuple(soft.tolist())
    matrix = _wrench_matrix(scene, drawn)
    if matrix is not None:
        own = np.eye(6) if config.wrench_matrix is None else np.reshape(config.wrench_matrix, (6, 6))
        changed["wrench_matrix"] = tuple((own @ matrix).ravel().tolist())
    return replace(config, **changed)


def _wrench_matrix(scene: Scene, drawn: Drawn) -> np.ndarray | None:
    """(6, 6) from the wrench about the origin that the kernels use to what the sensor reads; None for the identity.

    The kernels hold the sensor's origin straight behind the sphere. Where the sphere is off the axis, the origin lies
    d = -(x, y, 0) from there; the torque about it is greater by -d x F.
    """
    names = ("sphere_off_axis_mm", "sensor_gain_percent", "sensor_crosstalk_percent")
    if not any(name in drawn for name in names):
        return None
    x, y = 1e-3 * drawn.get("sphere_off_axis_mm", np.zeros(2))
    lever = np.eye(6)
    lever[3:, :3] = [[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]]
    reads = np.diag(1.0 + 0.01 * drawn.get("sensor_gain_percent", np.zeros(6)))
    if "sensor_crosstalk_percent" in drawn:
        span = np.array(scene.probe.force_range + scene.probe.torque_range)
        share = np.zeros((6, 6))
        share[~np.eye(6, dtype=bool)] = 0.01 * drawn["sensor_crosstalk_percent"]
        reads += share * span[:, None] / span
    return reads @ lever


def _robot(robot: Robot, drawn: Drawn) -> Robot:
    base, tool = robot.base.copy(), robot.tool.copy()
    base[:3, 3] += 1e-3 * drawn.get("base_shift_mm", np.zeros(3))
    turn = Pose(rpy_deg=tuple(drawn.get("base_turn_deg", np.zeros(3)).tolist())).matrix()
    x, y = drawn.get("sphere_off_axis_mm", np.zeros(2))
    tool[:3, 3] += 1e-3 * tool[:3, :3] @ [x, y, drawn.get("probe_length_mm", np.zeros(1))[0]]
    zeros = np.zeros(robot.n)
    return replace(
        robot,
        a=robot.a + 1e-3 * drawn.get("dh_a_mm", zeros),
        d=robot.d + 1e-3 * drawn.get("dh_d_mm", zeros),
        alpha=robot.alpha + np.radians(drawn.get("dh_twist_deg", zeros)),
        theta=robot.theta + np.radians(drawn.get("dh_offset_deg", zeros)),
        base=base @ turn,
        tool=tool,
    )
