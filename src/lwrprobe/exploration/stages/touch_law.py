"""The force law of a scene along the stick, its stiffest direction."""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.control import ForceLaw, Refusal, choose_force_law
from lwrprobe.kinematics import Robot, apparent_mass
from lwrprobe.scene import Scene

SLOPE_STEP = 0.01
"""m between the places whose stiffness is compared."""


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


def softer_than_along(scene: Scene, robot: Robot, q: np.ndarray) -> np.ndarray:
    """(3, 3) m/N, by which the arm gives way more than along the stick for a force along a unit vector n: n softer n.

    At joint values q (n,), of joints that are equally stiff. The less the arm is known, the less counts of what it
    gives way more; all of what it gives way less.
    """
    jacobian, axis = robot.jacobian(q)[:3], robot.fk_batch(q[None])[0, :3, 2]
    gives = jacobian @ jacobian.T
    sure = max(1.0 - 0.01 * scene.uncertainty.sigma("arm_stiffness_percent"), 0.0)
    more, ways = np.linalg.eigh(gives / float(axis @ gives @ axis) - np.eye(3))
    return (ways * np.where(more > 0.0, sure * more, more)) @ ways.T / arm_stiffness(scene)


def tip_mass(robot: Robot, arm_mass: float, q: np.ndarray) -> float:
    """kg, of an arm of `arm_mass` kg as its tip shows it at joint values q (n,); 0 for an arm that states no mass."""
    return apparent_mass(robot, arm_mass, q) if arm_mass > 0.0 else 0.0


def stiffness_slope(robot: Robot, q: np.ndarray) -> np.ndarray:
    """(3,) 1/m: by how much the logarithm of the arm's stiffness along the stick rises along the world's axes.

    At joint values q (n,), of joints that are equally stiff. A far tip bends the joints near the base with a longer
    lever: over an area of 0.2 m an LWR 4+ has 20 to 29 kN/m.
    """
    jacobian, axis = robot.jacobian(q), robot.fk_batch(q[None])[0, :3, 2]
    slope = np.empty(3)
    for k, moved in enumerate(SLOPE_STEP * np.linalg.pinv(jacobian)[:, :3].T):
        before, after = (axis @ robot.jacobian(q + side * moved)[:3] for side in (-1.0, 1.0))
        slope[k] = np.log((before @ before) / (after @ after)) / (2.0 * SLOPE_STEP)
    return slope
