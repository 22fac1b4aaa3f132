"""What the scene's `[uncertainty]` means for torque and force of the sensor."""

from __future__ import annotations

from math import hypot, radians, sqrt

import numpy as np

from lwrprobe.calibration.priors import GEAR_WAVES
from lwrprobe.contact import Settings, TorqueAgreement
from lwrprobe.contact.torque_kernels import WANDER
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.scene import Scene

FRICTION = 0.3
"""Tangent of the friction angle for which an error of the friction's direction is counted."""


def estimator_settings(scene: Scene) -> Settings:
    """Settings of the estimators; without any uncertainty the estimators' own."""
    if scene.uncertainty.profile == "ideal":
        return Settings()
    return Settings(zero_error=max(1e-3 * scene.uncertainty.sigma("zero_force_mn"), 1e-3), zero_time=WANDER)


def torque_agreement(scene: Scene, probe: Probe) -> TorqueAgreement | None:
    """What learns the errors of the torque; None where the estimator uses none, or no error is thought possible."""
    expected, zero = torque_errors(scene, probe), zero_torque(scene, probe)
    if scene.contact.estimator == "force_direction" or not expected.any() or zero <= 0.0:
        return None
    direction = FRICTION * radians(scene.uncertainty.sigma("friction_direction_deg"))
    return TorqueAgreement(probe, expected, zero, hypot(direction, 0.01), scene.sensor.rate)


def torque_errors(scene: Scene, probe: Probe) -> Vector:
    """(3,) m, error of the torque about the sphere over a force along the sensor's x, y, z: one standard deviation."""
    table, lever = scene.uncertainty, probe.sensor_distance
    gain, cross = 0.01 * table.sigma("sensor_gain_percent"), 0.01 * table.sigma("sensor_crosstalk_percent")
    aside, longer = 1e-3 * table.sigma("sphere_off_axis_mm"), 1e-3 * table.sigma("probe_length_mm")
    force, torque = probe.force_range, probe.torque_range
    found = np.zeros(3)
    for axis in range(3):
        across = axis < 2
        # Full scale of one axis on another: from torque and force to force, and from both to torque.
        to_force = float(force[0]) * hypot(lever / float(torque[0]) if across else 0.0, 1.0 / float(force[axis]))
        to_torque = float(torque[0]) * hypot(lever / float(torque[0]) if across else 0.0, 1.0 / float(force[axis]))
        terms = [cross * to_force * lever, cross * to_torque, aside]
        terms += [gain * lever, gain * lever, longer] if across else []
        found[axis] = hypot(*terms)
    return found


def zero_torque(scene: Scene, probe: Probe) -> float:
    """N m, torque about the sphere by the wandering zero of all axes: one standard deviation."""
    table = scene.uncertainty
    now = hypot(1e-6 * table.sigma("zero_torque_unm"), 1e-3 * table.sigma("zero_force_mn") * probe.sensor_distance)
    return sqrt(2.0) * now  # now, and when the bias was taken


def wave_slope(scene: Scene) -> float:
    """Largest share by which the wave of a joint's gear makes the joint faster or slower than its motor."""
    return radians(scene.uncertainty.sigma("gear_ripple_deg")) * GEAR_WAVES
