"""What an arm that is known as its scene states leaves of a contact's error, if all else were exact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lwrprobe.calibration.priors import GEAR_WAVES
from lwrprobe.evaluation import aligned_points
from lwrprobe.kinematics import Robot

MOST = 3000
"""Contacts that are looked at."""


def arm_alone(robot: Robot, joints: np.ndarray, differences: Mapping[str, Any], seed: int) -> float | None:
    """m, median over places of how far they are off after alignment by the arm's table and gears alone.

    Parameters
    ----------
    robot : as the scene states it
    joints : (n, joints) rad, measured at the contacts
    differences : of the world, as in `summary.json` under `truth`
    seed : of the phases of the gears' waves and of the sides of their play, which are drawn here anew

    None without joints. Probe, sensor, loop and friction have no say in it, and a shift or turn of all has none.
    """
    if not len(joints):
        return None
    joints = joints[:: -(-len(joints) // MOST)]
    random, zeros = np.random.default_rng(seed), [0.0] * robot.n
    a, d, twist, offset = (
        np.array(differences.get(name, zeros)) for name in ("dh_a_mm", "dh_d_mm", "dh_twist_deg", "dh_offset_deg")
    )
    real = replace(
        robot,
        a=robot.a + 1e-3 * a,
        d=robot.d + 1e-3 * d,
        alpha=robot.alpha + np.radians(twist),
        theta=robot.theta + np.radians(offset),
    )
    wave, play = (np.radians(differences.get(name, [0.0])[0]) for name in ("gear_ripple_deg", "joint_hysteresis_deg"))
    links = joints + wave * np.sin(GEAR_WAVES * joints + random.uniform(0.0, 2.0 * np.pi, robot.n))
    links += 0.5 * play * random.choice([-1.0, 1.0], joints.shape)
    stated, true = robot.fk_batch(joints)[:, :3, 3], real.fk_batch(links)[:, :3, 3]
    return float(np.median(np.linalg.norm(aligned_points(stated, true) - true, axis=1)))
