"""What the scene's `[uncertainty]` means for torque and force of the sensor."""

from __future__ import annotations

from math import hypot, radians, sqrt

import numpy as np

from lwrprobe.contact import Settings, TorqueAgreement
from lwrprobe.contact.torque_kernels import WANDER
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.scene import Scene

FRICTION = 0.3
"""Tangent of the friction angle for which an error of the friction's direction is counted."""


def friction_turn(scene: Scene) -> float:
    """rad, by which friction that is not opposite to the slip turns the normals: one standard deviation."""
    return FRICTION * radians(scene.uncertainty.sigma("friction_direction_deg"))


def estimator_settings(scene: Scene) -> Settings:
    """Settings of the estimators; without any uncertainty the estimators' own."""
    if scene.uncertainty.profile == "ideal":
        return Settings()
    probe = scene.probe.as_probe()
    return Settings(zero_error=max(zero_errors(scene, probe)[0], 1e-3), zero_time=WANDER, lag=lag(scene, probe))


def torque_agreement(scene: Scene, probe: Probe) -> TorqueAgreement | None:
    """What learns the errors of the torque; None where the estimator uses none, or no error is thought possible."""
    expected, zero = torque_errors(scene, probe), zero_torque(scene, probe)
    if scene.contact.estimator == "force_direction" or not expected.any() or zero <= 0.0:
        return None
    return TorqueAgreement(probe, expected, zero, hypot(friction_turn(scene), 0.01), scene.sensor.rate)


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


def zero_errors(scene: Scene, probe: Probe) -> tuple[float, float]:
    """N and N m, one standard deviation of the zero of a force and of a torque axis across the stick.

    It wanders, and it lags behind the load by half the width of the hysteresis: the load changes by more than that, so
    that the reading stands at an end of the loop nearly always.
    """
    table, behind = scene.uncertainty, 0.5 * lag(scene, probe)
    force = hypot(1e-3 * table.sigma("zero_force_mn"), behind)
    torque = behind * float(probe.torque_range[0]) / float(probe.force_range[0])
    return force, hypot(1e-6 * table.sigma("zero_torque_unm"), torque)


def lag(scene: Scene, probe: Probe) -> float:
    """N, width of the hysteresis of a force axis across the stick: one standard deviation."""
    return 0.01 * scene.uncertainty.sigma("sensor_hysteresis_percent") * float(probe.force_range[0])


def zero_torque(scene: Scene, probe: Probe) -> float:
    """N m, torque about the sphere by the zero of all axes: one standard deviation."""
    force, torque = zero_errors(scene, probe)
    return sqrt(2.0) * hypot(torque, force * probe.sensor_distance)  # now, and when the bias was taken
