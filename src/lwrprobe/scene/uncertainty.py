"""Table `[uncertainty]`: how well the numbers of a scene are known, as one standard deviation each.

It is belief, as the rest of a scene is, and is never taken from `[truth]`. Names and units are those of `[truth]` where
both tables have a key. A calibration replaces single entries.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from lwrprobe.calibration.calibration_file import FORCE_ROWS
from lwrprobe.scene.table import NonNegative, Table

_BOTH: dict[str, float] = {
    "zero_force_mn": 6.0, "zero_torque_unm": 28.0, "base_shift_mm": 0.3, "base_turn_deg": 0.1,
    "joint_hysteresis_deg": 0.003, "gear_ripple_deg": 0.005, "friction_direction_deg": 3.0,
    "object_compliance_um_n": 50.0,
}  # fmt: skip
"""What a calibration does not change: sensor noise of low frequency, gears, the object."""

PROFILES: dict[str, dict[str, float]] = {
    "ideal": {},
    "lab": {
        **_BOTH, "probe_length_mm": 0.05, "sphere_off_axis_mm": 0.05, "sphere_radius_mm": 0.01,
        "stick_stiffness_percent": 5.0, "payload_percent": 3.0, "sensor_gain_percent": 0.3,
        "sensor_crosstalk_percent": 0.15, "sensor_hysteresis_percent": 0.1, "drift_mn_per_min": 5.0,
        "dh_twist_deg": 0.01, "dh_offset_deg": 0.01, "dh_a_mm": 0.05, "dh_d_mm": 0.05, "arm_stiffness_percent": 15.0,
        "arm_delay_ms": 1.0, "arm_lag_ms": 1.0, "sensor_delay_ms": 1.0, "clock_skew_ms": 1.0,
        "table_height_mm": 0.3, "table_tilt_deg": 0.1,
    },
    "datasheet": {
        **_BOTH, "probe_length_mm": 0.3, "sphere_off_axis_mm": 0.2, "sphere_radius_mm": 0.03,
        "stick_stiffness_percent": 20.0, "payload_percent": 10.0, "sensor_gain_percent": 1.5,
        "sensor_crosstalk_percent": 1.0, "sensor_hysteresis_percent": 0.3, "drift_mn_per_min": 50.0,
        "dh_twist_deg": 0.05, "dh_offset_deg": 0.05, "dh_a_mm": 0.3, "dh_d_mm": 0.3, "arm_stiffness_percent": 40.0,
        "arm_delay_ms": 8.0, "arm_lag_ms": 8.0, "sensor_delay_ms": 8.0, "clock_skew_ms": 8.0,
        "table_height_mm": 1.0, "table_tilt_deg": 0.3,
    },
}  # fmt: skip
"""Standard deviations of each profile; docs/explanation/simulator.md says where each figure comes from."""


_ForceError = Annotated[tuple[float, ...], Field(strict=False, min_length=FORCE_ROWS, max_length=FORCE_ROWS)]


class UncertaintyTable(Table):
    """How well the scene's numbers are known: one standard deviation of each. An entry left out is the profile's."""

    profile: Literal["ideal", "lab", "datasheet"] = "lab"
    """`ideal`: all numbers are exact; `lab`: measured with care on the set-up; `datasheet`: the makers' tolerances,
    nothing measured."""
    probe_length_mm: NonNegative | None = None
    """Distance from the flange, and from the sensor, to the sphere's centre."""
    sphere_off_axis_mm: NonNegative | None = None
    """Sphere's centre across the sensor's axis, in x and in y of the tip frame."""
    sphere_radius_mm: NonNegative | None = None
    stick_stiffness_percent: NonNegative | None = None
    """Of `probe.stiffness_lateral` and `probe.stiffness_axial`."""
    payload_percent: NonNegative | None = None
    """Of `probe.mass`."""
    sensor_gain_percent: NonNegative | None = None
    """Of each axis."""
    sensor_crosstalk_percent: NonNegative | None = None
    """Full scale of one axis on each other one, in percent of that one's full scale."""
    force_errors: tuple[_ForceError, ...] = Field(default=(), strict=False)
    """What a calibration leaves of the force's rows of the sensor's matrix: independent errors of one standard
    deviation each, 18 numbers a row. In the error budget they take the place of gain and crosstalk."""
    sensor_hysteresis_percent: NonNegative | None = None
    """Of each axis' full scale."""
    zero_force_mn: NonNegative | None = None
    """Wandering of each force axis' zero within seconds."""
    zero_torque_unm: NonNegative | None = None
    """The same of each torque axis."""
    drift_mn_per_min: NonNegative | None = None
    """Of each force axis' zero."""
    friction_direction_deg: NonNegative | None = None
    """Between friction and what opposes the slip."""
    object_compliance_um_n: NonNegative | None = None
    """Compliance of the object at the touch, where no touch has shown it."""
    dh_twist_deg: NonNegative | None = None
    """Denavit-Hartenberg alpha of each joint."""
    dh_offset_deg: NonNegative | None = None
    """Denavit-Hartenberg theta of each joint: its zero."""
    dh_a_mm: NonNegative | None = None
    dh_d_mm: NonNegative | None = None
    base_shift_mm: NonNegative | None = None
    """Of the robot's base along each axis."""
    base_turn_deg: NonNegative | None = None
    """About each axis of the base frame."""
    joint_hysteresis_deg: NonNegative | None = None
    """Width of the play of each joint."""
    gear_ripple_deg: NonNegative | None = None
    """Amplitude of the wave of each joint's gear."""
    arm_stiffness_percent: NonNegative | None = None
    """Of the stiffness of the arm's joints."""
    arm_delay_ms: NonNegative | None = None
    """Between a set point and the motion."""
    arm_lag_ms: NonNegative | None = None
    """Time constant with which the arm follows."""
    sensor_delay_ms: NonNegative | None = None
    """Between a force and its sample."""
    clock_skew_ms: NonNegative | None = None
    """Between the time stamps of arm and sensor."""
    table_height_mm: NonNegative | None = None
    table_tilt_deg: NonNegative | None = None
    """About the world's x and y."""

    def sigma(self, name: str) -> float:
        """One standard deviation of a quantity, in the unit that its key names; 0 where the profile has none."""
        own: Any = getattr(self, name)
        return float(PROFILES[self.profile].get(name, 0.0) if own is None else own)
