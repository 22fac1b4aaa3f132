"""Friction, weight, a probe that is not what its description says."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.bench.gantry import rest
from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.stability.runs import strip
from lwrprobe.calibration import CalibrationRefused
from lwrprobe.contact import WrenchConditioner, identify_payload
from lwrprobe.contracts import WrenchSample
from lwrprobe.contracts.plugins import load
from lwrprobe.exploration.procedures.calibrate import calibrate
from lwrprobe.scene import Scene, load_scene

REFERENCE = 0.03
"""m, diameter of the sphere of a calibration."""
CLEAN_STREAM = {"lag": 0.0, "drift_force": (0.0, 0.0, 0.0), "latency": 0.0, "late_share": 0.0, "loss": 0.0}


def _friction_sweep(quick: bool) -> list[Finding]:
    found = []
    sweep = [("0.5", 1.0)] if quick else [("0.0", 1.0), ("0.3", 1.0), ("0.5", 1.0), ("0.8", 1.0), ("0.3", 1.5)]
    for friction, static in sweep:
        run = strip("block", [f"object.0.friction={friction}", f"drivers.sim.static_friction={static}"])
        error = run.summary["normal_error_deg"]["median"]
        point = run.summary["contact_error_mm"]["median"]
        text = f"{run.describe()}; normal off by {error:.2f} deg, point by {point:.3f} mm"
        setting = f"friction {friction}" + (", stick-slip (static 1.5 times)" if static > 1.0 else "")
        also = run.summary["status"] == "done" and run.within_limit
        found.append(within(setting, text, error, 2.0, "deg", also=also))
    return found


def _heavy_tip(quick: bool) -> list[Finding]:
    """Weight identified in five orientations, then the wrist turned; the arm and the sensor are the simulator's."""
    found = []
    for grams in (100,) if quick else (10, 30, 100):
        world = _arm_in_free_space(1e-3 * grams)
        tilts = [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)]
        samples, rotations = [], []
        for wrist, roll in tilts:
            readings, rotation = _rest(world, wrist, roll, 25)
            samples += readings
            rotations += [rotation] * len(readings)
        payload = identify_payload(samples, rotations)
        conditioner = WrenchConditioner(world.probe, world.scene.sensor.rate, payload=payload)
        for degrees in (45, 90):
            readings, rotation = _rest(world, np.radians(degrees), 0.3, 60)
            left = np.mean([conditioner.condition(sample, rotation).force for sample in readings], axis=0)
            residual = 1e3 * float(np.linalg.norm(left))
            text = f"mass found {1e3 * payload.mass:.2f} g, {residual:.1f} mN left"
            half = 500.0 * world.scene.contact.threshold
            found.append(within(f"{grams} g, turned by {degrees} deg", text, residual, half, "mN"))
    return found


def _arm_in_free_space(mass: float) -> Any:
    driver = load("driver", "sim")
    slow = "motion.acceleration=0.5"  # at rest here; a scene refuses a probe whose inertia would read as a touch
    scene = load_scene("empty", [f"probe.mass={mass}", "probe.centre_of_mass=[0.001, -0.002, 0.035]", slow])
    return driver.World(scene, driver.Config(**CLEAN_STREAM), 1)


def _rest(world: Any, wrist: float, roll: float, count: int) -> tuple[list[WrenchSample], np.ndarray]:
    """Readings with the wrist turned out of the ready posture, and how the sensor is held then."""
    q = np.array([0.0, 0.5, 0.0, -1.4, 0.0, 1.2415926535897932, 0.0])
    q[4:] += (roll, -wrist, 0.2)
    world.place(q)
    return rest(world, q, count), world.tip()[:3, :3]


def _wrong_probe(quick: bool) -> list[Finding]:
    """A stick that is bent, and a sphere of another radius than stated, given to a calibration by touch."""
    found = []
    for bend in (0.4,) if quick else (0.4, -0.4):
        calibration, _ = calibrate(_departing("sphere_off_axis_mm", [bend, 0.0]), REFERENCE)
        offset = 1e3 * calibration.values("tool_shift")
        text = f"offset {np.round(offset, 3).tolist()} mm"
        off = float(np.abs(offset - (bend, 0.0, 0.0)).max())
        found.append(within(f"stick bent by {bend:g} mm", text, off, 0.05, "mm"))
    try:
        calibrate(_departing("sphere_radius_mm", -0.2), REFERENCE)
    except CalibrationRefused as refusal:
        found.append(Finding("radius off by 0.2 mm", str(refusal), "radii" in str(refusal)))
    else:
        found.append(Finding("radius off by 0.2 mm", "accepted", False))
    return found


def _departing(name: str, value: Any) -> Scene:
    """A block in a world that differs from its scene in one quantity alone."""
    return load_scene("block", {"truth.profile": "ideal", f"truth.{name}": value})


CASES = (
    Case(30, "friction sweep", "normal within 2 deg, no lost contacts with stick-slip", _friction_sweep),
    Case(31, "turning a heavy tip", "residual force below half the threshold", _heavy_tip),
    Case(32, "probe calibration wrong", "offset reported to 0.05 mm, a wrong radius refused", _wrong_probe),
)
