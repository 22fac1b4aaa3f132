"""The settings of the sensor's faults, laid out for `sensor_kernels`."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Probe
from lwrprobe_sim import sensor_kernels as sensor
from lwrprobe_sim.config import SimConfig


def sensor_settings(c: SimConfig, probe: Probe, rate: float) -> np.ndarray:
    """(SETTINGS,) of a sensor that samples at `rate` Hz, with the range and resolution of the probe."""
    s, period = np.zeros(sensor.SETTINGS), 1.0 / rate
    s[sensor.PERIOD] = period
    s[sensor.NOISE_FORCE], s[sensor.NOISE_TORQUE] = c.noise_force, c.noise_torque
    if c.quantisation:
        s[sensor.COUNT_FORCE], s[sensor.COUNT_TORQUE] = probe.force_resolution, probe.torque_resolution
    span = np.concatenate([probe.force_range, probe.torque_range])
    s[sensor.RANGE : sensor.RANGE + 6] = span if c.saturation else np.inf
    s[sensor.BIAS : sensor.BIAS + 6] = c.bias_force + c.bias_torque
    s[sensor.DRIFT : sensor.DRIFT + 6] = np.array(c.drift_force + c.drift_torque) / 60.0
    s[sensor.SPIKES], s[sensor.SPIKE_FORCE] = c.spike_rate * period, c.spike_force
    s[sensor.GARBAGE] = c.garbage_rate * period
    s[sensor.LATENCY], s[sensor.LATE_SHARE], s[sensor.LATE_BY] = c.latency, c.late_share, c.late_by
    s[sensor.LATE_LIMIT], s[sensor.LOSS] = c.late_limit, c.loss
    s[sensor.BURST], s[sensor.BURST_LENGTH] = c.burst_rate * period, c.burst_length
    s[sensor.FREEZE_FROM], s[sensor.FREEZE_TO] = c.freeze_at, c.freeze_at + c.freeze_for
    s[sensor.SKEW] = c.clock_skew
    if c.wrench_matrix is not None:
        s[sensor.MIXED] = 1.0
        s[sensor.MATRIX : sensor.MATRIX + 36] = c.wrench_matrix
    s[sensor.WANDER_FORCE], s[sensor.WANDER_TORQUE] = c.wander_force, c.wander_torque
    s[sensor.WANDER_TIME] = c.wander_time
    s[sensor.PLAYS] = c.hysteresis > 0.0
    s[sensor.PLAY : sensor.PLAY + 6] = 0.5 * c.hysteresis * span
    return s
