"""The force law of a scene along the stick, its stiffest direction."""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.control import ForceLaw, Refusal, choose_force_law
from lwrprobe.kinematics import Robot, apparent_mass
from lwrprobe.scene import Scene


def touch_law(
    scene: Scene, delay: float, tip_mass: float = 0.0, compliance: float | None = None, max_speed: float = 0.05
) -> ForceLaw | Refusal:
    """Damping and speeds for a touch along the stick, or why there are none.

    Parameters
    ----------
    delay : s, of the loop
    tip_mass : kg, of the arm as its tip shows it
    compliance : m/N of arm and object, None = what the scene states
    max_speed : m/s, the law's approach is never faster
    """
    contact, axial = scene.contact, float(scene.probe.as_probe().compliance.min())
    if compliance is None:
        compliance = 1.0 / contact.stiffness
    return choose_force_law(
        1.0 / (compliance + axial),
        delay,
        contact.target,
        contact.limit,
        force_threshold=contact.threshold,
        braking=scene.motion.acceleration,
        tip_mass=tip_mass,
        arm_stiffness=arm_stiffness(scene, compliance),
        max_speed=max_speed,
    )


def arm_stiffness(scene: Scene, compliance: float | None = None) -> float:
    """N/m, of the arm at its tip: what `compliance` [m/N] of arm and object, or the scene's, leaves to the arm."""
    together = 1.0 / scene.contact.stiffness if compliance is None else compliance
    left = together - 1.0 / scene.contact.object_stiffness
    return 1.0 / left if left > 0.0 else math.inf


def tip_mass(robot: Robot, arm_mass: float, q: np.ndarray) -> float:
    """kg, of an arm of `arm_mass` kg as its tip shows it at joint values q (n,); 0 for an arm that states no mass."""
    return apparent_mass(robot, arm_mass, q) if arm_mass > 0.0 else 0.0
