"""A scene with what a calibration has measured in place of what its file states."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from lwrprobe.calibration import Calibration, read_calibration
from lwrprobe.contracts import SceneError
from lwrprobe.scene.scene import Scene
from lwrprobe.scene.table import Pose
from lwrprobe.scene.uncertainty import UncertaintyTable

if TYPE_CHECKING:
    from lwrprobe.kinematics import Robot

_STATED: dict[str, tuple[str, ...]] = {
    "arm": ("robot", "base", "tool", "correction", "gear_waves"),
    "probe": (
        "radius", "stick_length", "stick_radius", "sensor_distance", "stiffness_lateral", "stiffness_axial", "mass",
        "centre_of_mass", "force_range", "torque_range",
    ),
}  # fmt: skip
"""What a calibration is relative to."""


def stated_hash(scene: Scene) -> str:
    """Digest of what the scene states of arm and probe: a calibration counts for that alone."""
    stated = {table: {key: getattr(getattr(scene, table), key) for key in keys} for table, keys in _STATED.items()}
    text = json.dumps(stated, default=lambda value: value.model_dump(mode="json"), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def calibration_of(scene: Scene) -> Calibration | None:
    """What the scene's key `calibration` refers to, None where it has none.

    Raises FormatError for a broken file, and SceneError for a calibration of another arm or probe.
    """
    if not scene.calibration:
        return None
    found = read_calibration(scene.calibration)
    if found.scene_hash != stated_hash(scene):
        raise SceneError(
            f"{scene.name}: calibration",
            scene.calibration,
            f"a calibration of the arm and probe that the scene states; this one was made with scene {found.scene!r}, "
            "whose arm or probe differ: calibrate again",
        )
    return found


def calibrated(scene: Scene) -> Scene:
    """The scene as it is used: tool, probe, table and uncertainties from its calibration; itself without one.

    The arm's stiffness depends on its posture: see `stiff_as_calibrated`. The simulated world is built from the scene
    as stated. Raises what `calibration_of` raises.
    """
    found = calibration_of(scene)
    if found is None:
        return scene
    tool = scene.arm.tool.matrix()
    tool[:3, 3] += tool[:3, :3] @ found.values("tool")
    stick = found.values("stick_stiffness")
    probe: dict[str, Any] = {
        "radius": float(found.values("sphere_radius")[0]),
        "stiffness_lateral": float(stick[0]) if scene.probe.stiffness_lateral else 0.0,
    }
    if found.quantities["stick_stiffness"].visible[1] and scene.probe.stiffness_axial:
        probe["stiffness_axial"] = float(stick[1])
    if found.quantities["payload"].visible[0]:
        probe["mass"] = float(found.values("payload")[0])
    height, *slope = (float(v) for v in found.values("table"))
    table: dict[str, Any] = {}
    if scene.table.present:
        rise = float(np.hypot(slope[0], slope[1]))
        table = {"height": height, "tilt_deg": float(np.degrees(np.arctan(rise)))}
        if rise > 0.0:
            table["tilt_axis"] = (slope[1] / rise, -slope[0] / rise, 0.0)
    lower = scene.area.lower
    floor = max(lower[2], height + probe["radius"]) if scene.table.present else lower[2]
    return scene.model_copy(
        update={
            "arm": scene.arm.model_copy(
                update={
                    "tool": Pose(xyz=tuple(tool[:3, 3].tolist()), rpy_deg=scene.arm.tool.rpy_deg),
                    "correction": scene.arm.correction.calibrated(
                        found.values("kinematic_table"),
                        found.values("gear_waves"),
                        float(found.values("joint_hysteresis")[0]),
                        found.arm_errors,
                    ),
                }
            ),
            "probe": scene.probe.model_copy(update=probe),
            "table": scene.table.model_copy(update=table),
            "area": scene.area.model_copy(update={"lower": (lower[0], lower[1], floor)}),
            "uncertainty": _uncertainty(scene.uncertainty, found),
        }
    )


def stiff_as_calibrated(scene: Scene, found: Calibration | None, robot: Robot, q: np.ndarray) -> Scene:
    """The scene with the arm's stiffness along the stick at joint values q (n,), from that of the joints; its own
    without a calibration.

    Postures differ: an LWR 4+ whose tip is at one place has 25 or 38 kN/m there, by where its elbow is. Across the
    stick the arm gives way less than the stick, and there it matters little.
    """
    if found is None:
        return scene
    lever = robot.fk_batch(q[None])[0, :3, 2] @ robot.jacobian(q)[:3]
    joints, sigma = found.values("joint_stiffness"), found.sigma("joint_stiffness")
    gives = lever**2 / joints  # m/N
    unsure = float(np.linalg.norm(gives * sigma / joints) / np.sum(gives))
    kept = min(100.0 * unsure, scene.uncertainty.sigma("arm_stiffness_percent") or np.inf)
    return scene.model_copy(
        update={
            "contact": scene.contact.model_copy(update={"stiffness": 1.0 / float(np.sum(gives))}),
            "uncertainty": scene.uncertainty.model_copy(update={"arm_stiffness_percent": kept}),
        }
    )


def _uncertainty(stated: UncertaintyTable, found: Calibration) -> UncertaintyTable:
    """Standard deviations that the calibration has left; what it did not see keeps its own."""
    shift, stick = found.sigma("tool_shift"), found.sigma("stick_stiffness") / found.values("stick_stiffness")
    ratio = found.sigma("force_to_torque").reshape(3, 3)
    lever = max(abs(found.values("force_to_torque")[1]), 1e-6)
    a, alpha, d, theta = found.sigma("kinematic_table").reshape(4, -1).max(axis=1)
    measured = {
        "probe_length_mm": 1e3 * shift[2],
        "sphere_off_axis_mm": 1e3 * max(shift[:2]),
        "sphere_radius_mm": 1e3 * found.sigma("sphere_radius")[0],
        "stick_stiffness_percent": 1e2 * stick[0],
        # What counts for a contact's place is the torque for a force: both gains together.
        "sensor_gain_percent": 1e2 * max(ratio[0, 1], ratio[1, 0]) / lever,
        "sensor_crosstalk_percent": 1e2 * float(np.mean(np.diag(ratio)[:2])) / 0.01,
        "gear_ripple_deg": float(np.degrees(max(found.sigma("gear_waves")))),
        "joint_hysteresis_deg": float(np.degrees(found.sigma("joint_hysteresis")[0])),
        "dh_a_mm": 1e3 * float(a),
        "dh_d_mm": 1e3 * float(d),
        "dh_twist_deg": float(np.degrees(alpha)),
        "dh_offset_deg": float(np.degrees(theta)),
        "arm_delay_ms": 1e3 * found.sigma("arm_delay")[0],
        "sensor_delay_ms": 1e3 * found.sigma("sensor_latency")[0],
        "clock_skew_ms": 1e3 * found.sigma("clock_offset")[0],
        "table_height_mm": 1e3 * found.sigma("table")[0],
        "table_tilt_deg": float(np.degrees(max(found.sigma("table")[1:]))),
    }
    kept = {name: min(float(value), stated.sigma(name) or np.inf) for name, value in measured.items()}
    return stated.model_copy(update=kept | {"force_errors": found.force_errors})
