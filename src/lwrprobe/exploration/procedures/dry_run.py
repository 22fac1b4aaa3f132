"""What an exploration would drive, without a device: the same loop and guards over the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.contracts.driver import HealthCheck
from lwrprobe.control import Refusal
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.procedures.start_posture import scene_at_start, unreachable_part
from lwrprobe.exploration.stages.pipeline import reaction_delay
from lwrprobe.exploration.stages.touch_law import tip_mass, touch_law
from lwrprobe.scene import Scene

_NEAR = np.radians(5.0)  # of a joint limit


@dataclass(slots=True)
class DryRun:
    """What came of it.

    Attributes
    ----------
    readings : one line each, marked where something is wrong
    summary : of the run in the simulator
    """

    readings: list[HealthCheck]
    summary: dict[str, Any]

    @property
    def good(self) -> bool:
        return all(reading.good for reading in self.readings)


def dry_run(scene: Scene, message: Callable[[str], None] = lambda text: None) -> DryRun:
    """Drive the scene in the simulator, at the real arm's cycle and with the real sensor's rate and delay.

    The objects are those of the scene file; where it has none, as for an unknown object, the lines are driven
    through the air down to the table. No device is opened. Raises InputError for a scene that cannot be run.
    """
    devices = Devices.assemble(scene, scene.run.seed, False)
    cycle, latency = devices.arm.cycle, devices.sensor.latency
    late = devices.arm_delay
    readings = [*_posture(scene), stability(scene, cycle, latency, devices.arm_mass, late)]
    summary = explore(_simulated(scene, cycle, latency, late), message=message)
    return DryRun(readings + _driven(scene, summary), summary)


def stability(scene: Scene, cycle: float, latency: float, arm_mass: float = 0.0, late: float = 0.0) -> HealthCheck:
    """S = K tau / B of the stiffest direction, and how fast it may be touched (see `control.force_law`).

    `arm_mass` is kg of the arm's moving links, `late` s by which it follows set points later than in the next cycle.
    The scene counts as a run takes it: where it refers to a calibration, as that found.
    """
    scene, robot, _, q = scene_at_start(scene)
    delay = reaction_delay(scene, cycle, latency, scene.sensor.rate, arm_delay=late)
    probe, contact = scene.probe.as_probe(), scene.contact
    soft = 1.0 / contact.stiffness + probe.compliance.min()
    law = touch_law(scene, delay, tip_mass(robot, arm_mass, q))
    facts = f"K {1.0 / soft:.3g} N/m, delay {1e3 * delay:.1f} ms"
    if isinstance(law, Refusal):
        return HealthCheck("stability number", f"{law.stability_number:.3f}; {facts}: {law.reason}", False)
    text = f"{law.stability_number:.3f} ({facts}); touch at up to {1e3 * law.approach_speed:.2f} mm/s"
    return HealthCheck("stability number", ", ".join([text, *law.warnings]), True, {"S": law.stability_number})


def _posture(scene: Scene) -> list[HealthCheck]:
    scene, robot, pose, q = scene_at_start(scene)
    margins = np.minimum(q - robot.lower, robot.upper - q)
    tight = int(np.argmin(margins))
    place = ", ".join(f"{v:.3f}" for v in pose[:3, 3])
    joints = ", ".join(f"{v:.1f}" for v in np.degrees(q))
    beyond = unreachable_part(scene, robot, pose, q)
    return [
        HealthCheck("start", f"tip at {place} m, joints {joints} deg"),
        HealthCheck(
            "joint limits at the start",
            f"joint {tight + 1} is nearest, {np.degrees(margins[tight]):.1f} deg from its limit",
            bool(margins[tight] > _NEAR),
        ),
        HealthCheck("area", beyond or "all of it is within reach", not beyond),
    ]


def _simulated(scene: Scene, cycle: float, latency: float, late: float) -> Scene:
    # What the real devices' drivers know of themselves is what the simulator imitates.
    options = {"cycle": cycle, "latency": latency, "delay": late} | dict(scene.drivers.get("sim", {}))
    return scene.model_copy(
        update={
            "arm": scene.arm.model_copy(update={"driver": "sim"}),
            "sensor": scene.sensor.model_copy(update={"driver": "sim"}),
            "drivers": {**scene.drivers, "sim": options},
        }
    )


def _driven(scene: Scene, summary: dict[str, Any]) -> list[HealthCheck]:
    used = summary["limits_used"]
    share = ", ".join(f"{name.replace('_', ' ')} {value:.0%}" for name, value in used.items())
    readings = [
        HealthCheck("run", f"{summary['status']}: {summary['reason']}", summary["status"] == "done"),
        HealthCheck("time and way", f"{summary['sim_time_s']:.0f} s, {summary['path_length_m']:.2f} m"),
        HealthCheck("limits used at most", share, max(used.values()) <= 1.0, used),
        HealthCheck("slowed for the joints' sake", f"{summary['slowed_cycles']} cycles", summary["slowed_cycles"] == 0),
    ]
    if scene.objects:
        touched = f"{summary['contacts']} contacts, peak {summary['peak_force_n']:.2f} N of {scene.contact.limit:g} N"
        readings.append(HealthCheck("touch", touched, summary["peak_force_n"] <= scene.contact.limit))
        collisions = summary["link_collisions"]
        readings.append(HealthCheck("link collisions", str(collisions), collisions == 0))
    return readings
