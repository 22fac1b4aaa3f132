"""What is known before a calibration: one standard deviation of each quantity, from the makers' tolerances."""

from __future__ import annotations

from dataclasses import dataclass

GEAR_WAVES = 320.0
"""Waves of a joint's gear a turn, two for each tooth of a harmonic drive of ratio 160."""


@dataclass(slots=True, frozen=True)
class Priors:
    """Standard deviations of what the scene states, before anything is measured.

    The solver starts from the scene's values and adds these as observations. A quantity that the touches do not show
    keeps its prior, and the result says so.

    Attributes
    ----------
    probe_length, sphere_off_axis, sphere_radius : m
    stick_stiffness : relative
    sensor_gain : relative, of each axis
    sensor_crosstalk : share of an axis' full scale that another one at full scale adds
    dh_angle, dh_length : rad and m, of each Denavit-Hartenberg parameter
    joint_stiffness : relative, of each joint
    joint_compliance : rad/(N m), the value that these are relative to (1e4 N m/rad, a light arm with harmonic drives)
    joint_hysteresis : rad, width of the play of each joint
    gear_ripple : rad, amplitude of the wave of each joint's gear
    gear_waves : waves of that a turn
    clock_offset : s
    surface_compliance : m/N, of the reference sphere and of the table
    damping_time : s, over which a surface yields
    sphere_place : m, of the reference sphere
    table_height, table_tilt : m and rad
    zero_force, zero_torque : N and N m, by which a zero wanders during one touch
    hysteresis : share of full scale, of the sensor
    noise_force, noise_torque : N and N m, of one sample
    """

    probe_length: float = 3e-4
    sphere_off_axis: float = 2e-4
    sphere_radius: float = 3e-5
    stick_stiffness: float = 0.2
    sensor_gain: float = 0.015
    sensor_crosstalk: float = 0.01
    dh_angle: float = 8.7e-4
    dh_length: float = 3e-4
    joint_stiffness: float = 0.4
    joint_compliance: float = 1e-4
    joint_hysteresis: float = 5.2e-5
    gear_ripple: float = 8.7e-5
    gear_waves: float = GEAR_WAVES
    clock_offset: float = 8e-3
    surface_compliance: float = 1e-4
    damping_time: float = 2e-3
    sphere_place: float = 0.05
    table_height: float = 3e-3
    table_tilt: float = 0.02
    zero_force: float = 6e-3
    zero_torque: float = 2.8e-5
    hysteresis: float = 3e-3
    noise_force: float = 3.5e-3
    noise_torque: float = 2.5e-5
