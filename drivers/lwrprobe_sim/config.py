"""The simulator's own options."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class SimConfig:
    """What the simulated arm and sensor do beyond the scene: table `[drivers.sim]`, `--set drivers.sim.lag=0`.

    Any effect is switched off by zero and then costs nothing. The sensor's rate, range and resolution, the probe's
    stiffness and mass, and the objects' material are the scene's.

    Attributes
    ----------
    cycle : s, of the arm
    substeps : physical steps a cycle
    start_q : rad, joint values at t = 0; left out, the scene's `arm.start_deg`, or else a posture with the probe
        pointing down
    lag : s, time constant with which the motors follow the set point
    delay : s, whole cycles by which set points reach the motors late
    brake : rad/s^2, deceleration of `stop`
    joint_compliance : rad/(N m), of all joints or of each; the encoders are on the motors' side and do not see it. The
        default, 1e4 N m/rad a joint, leaves the tip some 2e4 N/m: an estimate for a light arm with harmonic drives and
        torque sensors, no data sheet's figure
    encoder_noise : rad, standard deviation
    stick_relaxation : s, time constant of the stick's inner damping
    tip_mass : kg, that swings on the stick; zero = the stick follows its forces at once
    static_friction : static over sliding friction, >= 1; above 1 slow sliding sticks and slips
    slow_sliding : m/s, below which a sliding contact takes hold again
    foot_friction : Coulomb coefficient between a movable object and what it stands on
    shear : tangential over normal contact stiffness (Mindlin 1949: 0.7 to 1)
    gravity : m/s^2, world frame, on what hangs on the sensor
    inertia : the load's inertial force is measured when the sensor accelerates
    noise_force, noise_torque : N and N m, standard deviation of each axis and sample
    quantisation, saturation : the scene's resolution and range count
    bias_force, bias_torque : N and N m, of the untared sensor
    drift_force, drift_torque : N/min and N m/min
    latency : s, from the instant of measurement to arrival
    late_share, late_by : share of samples that come later, by up to this [s]
    late_limit : s, samples older than that on arrival are flagged late
    loss : share of samples that never come
    burst_rate, burst_length : losses of all samples for a while: how many a second, and how long [s]
    spike_rate, spike_force : one-sample jumps of one force axis: how many a second, and how high [N]
    garbage_rate : samples with a NaN, how many a second
    freeze_at, freeze_for : s, the sensor repeats its last record from then on and for so long
    clock_skew : s, by which the sensor's time stamps are ahead of the arm's clock
    wrench_matrix : 36 numbers, row by row, by which the sensor multiplies the true wrench (force N over torque N m);
        left out, it reads what acts on it
    wander_force, wander_torque : N and N m, standard deviation of a bounded, smooth wandering of each axis' zero
    wander_time : s, between the independent values that it passes through
    hysteresis : width of each axis' hysteresis as a share of its range (a play operator)
    joint_hysteresis : rad, width of the play between motor and link of each joint
    gear_ripple : rad, amplitude of a wave between motor and link of each joint, 320 a turn
    friction_turn : rad, angle about the surface's normal between friction and what opposes the slip
    """

    cycle: float = 0.001
    substeps: int = 1
    start_q: tuple[float, ...] | None = None
    lag: float = 0.002
    delay: float = 0.0
    brake: float = 20.0
    joint_compliance: float | tuple[float, ...] = 1e-4
    encoder_noise: float = 0.0
    stick_relaxation: float = 0.0
    tip_mass: float = 0.0
    static_friction: float = 1.0
    slow_sliding: float = 0.002
    foot_friction: float = 0.4
    shear: float = 0.8
    gravity: Triple = (0.0, 0.0, -9.80665)
    inertia: bool = True
    noise_force: float = 0.003
    noise_torque: float = 2e-5
    quantisation: bool = True
    saturation: bool = True
    bias_force: Triple = (0.12, -0.08, 0.25)
    bias_torque: Triple = (0.001, -0.002, 0.0005)
    drift_force: Triple = (0.002, -0.001, 0.003)
    drift_torque: Triple = (0.0, 0.0, 0.0)
    latency: float = 0.004
    late_share: float = 0.1
    late_by: float = 0.002
    late_limit: float = 0.05
    loss: float = 0.0005
    burst_rate: float = 0.0
    burst_length: float = 0.1
    spike_rate: float = 0.0
    spike_force: float = 5.0
    garbage_rate: float = 0.0
    freeze_at: float = 0.0
    freeze_for: float = 0.0
    clock_skew: float = 0.0
    wrench_matrix: tuple[float, ...] | None = None
    wander_force: float = 0.0
    wander_torque: float = 0.0
    wander_time: float = 2.0
    hysteresis: float = 0.0
    joint_hysteresis: float = 0.0
    gear_ripple: float = 0.0
    friction_turn: float = 0.0

    TABLE: ClassVar[str] = "sim"
    """Name of the table, for messages."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not np.isfinite(value).all():
                raise InputError(f"{self.TABLE}.{field.name}", value, "finite numbers")
        self._check("cycle", 1e-5 <= self.cycle <= 0.1, "1e-5 to 0.1 s")
        self._check("substeps", 1 <= self.substeps <= 10_000, "1 to 10000")
        self._check("static_friction", 1.0 <= self.static_friction <= 10.0, "1 to 10")
        self._check("delay", 0.0 <= self.delay <= 60 * self.cycle, f"0 to 60 cycles ({60 * self.cycle:g} s)")
        self._check("brake", self.brake > 0.0, "more than 0")
        self._check("shear", self.shear > 0.0, "more than 0")
        self._check("joint_compliance", np.min(self.joint_compliance) >= 0.0, "not negative")
        self._check("wrench_matrix", self.wrench_matrix is None or len(self.wrench_matrix) == 36, "36 numbers")
        self._check("wander_time", self.wander_time > 0.0, "more than 0")
        self._check("friction_turn", abs(self.friction_turn) <= 0.5, "-0.5 to 0.5 rad")
        for name in ("late_share", "loss", "hysteresis"):
            self._check(name, 0.0 <= getattr(self, name) <= 1.0, "a share, 0 to 1")
        for name in _NOT_NEGATIVE:
            self._check(name, getattr(self, name) >= 0.0, "not negative")

    def _check(self, name: str, good: bool, allowed: str) -> None:
        if not good:
            raise InputError(f"{self.TABLE}.{name}", getattr(self, name), allowed)


_NOT_NEGATIVE = (
    "lag", "encoder_noise", "stick_relaxation", "tip_mass", "foot_friction", "slow_sliding", "noise_force",
    "noise_torque", "latency", "late_by", "late_limit", "burst_rate", "burst_length", "spike_rate", "garbage_rate",
    "freeze_for", "wander_force", "wander_torque", "joint_hysteresis", "gear_ripple",
)  # fmt: skip
