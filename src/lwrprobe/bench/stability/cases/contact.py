"""Friction, weight, a probe that is not what its description says."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.bench.gantry import build_world, rest
from lwrprobe.bench.stability.case import Case, Finding, within
from lwrprobe.bench.stability.gantry_loop import UPRIGHT
from lwrprobe.bench.stability.runs import strip
from lwrprobe.contact import WrenchConditioner, check_probe, identify_payload
from lwrprobe.contracts import WrenchSample
from lwrprobe.contracts.plugins import load
from lwrprobe.scene import load_scene

PRESS = 1e-5
"""m into a surface of 1e5 N/m: 1 N."""
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
    scene = load_scene("empty", [f"probe.mass={mass}", "probe.centre_of_mass=[0.001, -0.002, 0.035]"])
    return driver.World(scene, driver.Config(**CLEAN_STREAM), 1)


def _rest(world: Any, wrist: float, roll: float, count: int) -> tuple[list[WrenchSample], np.ndarray]:
    """Readings with the wrist turned out of the ready posture, and how the sensor is held then."""
    q = np.array([0.0, 0.5, 0.0, -1.4, 0.0, 1.2415926535897932, 0.0])
    q[4:] += (roll, -wrist, 0.2)
    world.place(q)
    return rest(world, q, count), world.tip()[:3, :3]


def _wrong_probe(quick: bool) -> list[Finding]:
    """A sphere 0.2 mm smaller than stated, then one on a stick that is bent by 1 mm: touches on a ball of 25 mm."""
    found = []
    for name, radius, bend in (
        ("as stated", 0.005, 0.0),
        ("radius off by 0.2 mm", 0.0048, 0.0),
        ("stick bent by 1 mm", 0.005, 1e-3),
    ):
        world = build_world(
            [f"probe.radius={radius}", "object.0.stiffness=1e5"], "sphere", noise_force=3e-3, noise_torque=1.6e-5
        )
        stated = load_scene("sphere", ["probe.stiffness_lateral=0.0", "probe.stiffness_axial=0.0"]).probe.as_probe()
        centres, forces, torques = _touches_on_the_ball(world, radius, np.array([bend, 0.0, 0.0]), 8 if quick else 16)
        seen = check_probe(stated, centres, np.tile(UPRIGHT, (len(centres), 1, 1)), forces, torques, 0.025)
        radius_off = 1e3 * abs(seen.radius_error - (radius - 0.005))
        offset_off = 1e3 * float(np.abs(seen.offset - (bend, 0.0, 0.0)).max())
        offset = np.round(1e3 * seen.offset, 3).tolist()
        text = f"radius error reported {1e3 * seen.radius_error:+.3f} mm, offset {offset} mm"
        found.append(within(name, text, max(radius_off, offset_off), 0.05, "mm"))
    return found


def _touches_on_the_ball(
    world: Any, radius: float, bend: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nominal centres, forces and torques (sensor frame) of presses of about 1 N all over the upper half.

    The bent stick is a shift of the sphere in the tip frame that nobody knows of: the sphere touches where it is, and
    the sensor measures it with that lever.
    """
    ball, reach = np.array([0.0, 0.0, 0.025]), 0.025 + radius
    centres, forces, torques = [], [], []
    for k in range(count):
        height = 0.15 + 0.85 * (k + 0.5) / count
        angle = 2.399963 * k
        out = np.array([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height])
        true = ball + (reach - PRESS) * out
        world.place(true + 0.01 * out)
        for share in np.linspace(1.0, 0.0, 20):
            world.command(true + 0.01 * share * out)
            world.advance()
        reading = np.mean([[*s.force, *s.torque] for s in rest(world, true, 16)], axis=0)
        centres.append(ball + reach * out - UPRIGHT @ bend)  # extrapolated to zero force
        forces.append(reading[:3])
        torques.append(reading[3:] + np.cross(bend, reading[:3]))
    return np.array(centres), np.array(forces), np.array(torques)


CASES = (
    Case(30, "friction sweep", "normal within 2 deg, no lost contacts with stick-slip", _friction_sweep),
    Case(31, "turning a heavy tip", "residual force below half the threshold", _heavy_tip),
    Case(32, "probe calibration wrong", "radius and offset errors reported to 0.05 mm", _wrong_probe),
)
