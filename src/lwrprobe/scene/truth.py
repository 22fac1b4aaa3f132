"""Table `[truth]`: how the simulated world differs from what the scene says of it.

The rest of a scene is what the user assumes. The simulator builds its world from the scene and this table, and the
evaluation compares with that world; nothing else may read the table (tests/sim/test_truth.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal, Self
from zlib import crc32

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, SerializerFunctionWrapHandler, model_serializer, model_validator
from pydantic_core import CoreSchema

from lwrprobe.contracts import SceneError
from lwrprobe.scene.table import Length, Refusal, Table

JOINTS = 0
"""Count of a quantity that has one number for each joint of the arm."""


class Kind(Enum):
    """How a quantity is drawn and what its numbers mean."""

    DIFFERENCE = "added to what the scene says; drawn from a normal distribution"
    PERCENT = "multiplies what the scene says; the logarithm is drawn, so that no draw reaches -100 %"
    SIZE = "how large an effect is, never negative; the absolute value of a normal draw"
    LEVEL = "takes the place of what the scene says; drawn uniformly"
    SCALE = "takes the place of what the scene says; its logarithm is drawn uniformly"


@dataclass(frozen=True, slots=True)
class Quantity:
    """Number of components and kind of one key of the table."""

    count: int
    kind: Kind


QUANTITIES: dict[str, Quantity] = {
    "probe_length_mm": Quantity(1, Kind.DIFFERENCE),
    "sphere_off_axis_mm": Quantity(2, Kind.DIFFERENCE),
    "sphere_radius_mm": Quantity(1, Kind.DIFFERENCE),
    "stick_stiffness_percent": Quantity(1, Kind.PERCENT),
    "payload_percent": Quantity(1, Kind.PERCENT),
    "sensor_gain_percent": Quantity(6, Kind.PERCENT),
    "sensor_crosstalk_percent": Quantity(30, Kind.DIFFERENCE),
    "zero_wander_force_mn": Quantity(1, Kind.SIZE),
    "zero_wander_torque_unm": Quantity(1, Kind.SIZE),
    "sensor_hysteresis_percent": Quantity(1, Kind.SIZE),
    "drift_mn_per_min": Quantity(3, Kind.DIFFERENCE),
    "sensor_delay_ms": Quantity(1, Kind.SIZE),
    "clock_skew_ms": Quantity(1, Kind.DIFFERENCE),
    "loss_burst_ms": Quantity(1, Kind.SIZE),
    "dh_twist_deg": Quantity(JOINTS, Kind.DIFFERENCE),
    "dh_offset_deg": Quantity(JOINTS, Kind.DIFFERENCE),
    "dh_a_mm": Quantity(JOINTS, Kind.DIFFERENCE),
    "dh_d_mm": Quantity(JOINTS, Kind.DIFFERENCE),
    "base_shift_mm": Quantity(3, Kind.DIFFERENCE),
    "base_turn_deg": Quantity(3, Kind.DIFFERENCE),
    "joint_stiffness_percent": Quantity(JOINTS, Kind.PERCENT),
    "joint_hysteresis_deg": Quantity(1, Kind.SIZE),
    "gear_ripple_deg": Quantity(1, Kind.SIZE),
    "arm_delay_ms": Quantity(1, Kind.SIZE),
    "arm_lag_ms": Quantity(1, Kind.SIZE),
    "table_height_mm": Quantity(1, Kind.DIFFERENCE),
    "table_tilt_deg": Quantity(2, Kind.DIFFERENCE),
    "object_friction": Quantity(1, Kind.LEVEL),
    "friction_direction_deg": Quantity(1, Kind.DIFFERENCE),
    "object_stiffness": Quantity(1, Kind.SCALE),
    "object_damping": Quantity(1, Kind.SCALE),
    "object_turn_deg": Quantity(1, Kind.DIFFERENCE),
    "object_shift_mm": Quantity(2, Kind.DIFFERENCE),
    "object_mass_kg": Quantity(1, Kind.SCALE),
}
"""All keys of the table that are drawn."""
ANYWHERE = "object_anywhere"
"""Key of the place that is drawn as a whole."""

_FORMS = "a number, a list of numbers, { sigma = number } or { between = [low, high] }"


class Departure(Table):
    """One quantity: its value (one number counts for each component), or how it is drawn from the seed."""

    value: tuple[float, ...] | None = Field(default=None, strict=False)
    sigma: float | None = Field(default=None, ge=0)
    """Standard deviation of a normal draw."""
    between: tuple[float, float] | None = Field(default=None, strict=False)
    """Ends of a uniform draw."""

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, given: Any) -> Any:
        if isinstance(given, int | float) and not isinstance(given, bool):
            return {"value": (float(given),)}
        if isinstance(given, list | tuple):
            return {"value": tuple(given)}
        if not isinstance(given, dict | Departure):
            raise ValueError(_FORMS)
        return given

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if sum(form is not None for form in (self.value, self.sigma, self.between)) != 1:
            raise ValueError(_FORMS)
        if self.between is not None and not self.between[0] <= self.between[1]:
            raise Refusal("between", self.between, "low <= high")
        return self

    @model_serializer(mode="wrap")
    def _shortest(self, handler: SerializerFunctionWrapHandler) -> Any:
        plain = {key: value for key, value in handler(self).items() if value is not None}
        return plain.get("value", plain)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        table = handler.resolve_ref_schema(handler(core))
        numbers = [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]
        return {"anyOf": [*numbers, table]}

    def reach(self) -> float:
        """The largest size that a component has, or is drawn with: three standard deviations."""
        if self.sigma is not None:
            return 3.0 * self.sigma
        return max((abs(number) for number in self.value or self.between or ()), default=0.0)


class TruthTable(Table):
    """How the simulated world differs from the scene. A value left out is the profile's.

    Each value is a number or a list of numbers, `{ sigma = s }` for a normal draw or `{ between = [low, high] }` for a
    uniform one. Every quantity has a random stream of its own: to set one does not change the others.
    """

    profile: Literal["ideal", "lab", "datasheet", "rough"] = "lab"
    """`ideal`: the world is as the scene says; `lab`: carefully calibrated; `datasheet`: within the makers' tolerances,
    uncalibrated; `rough`: worse than that, with an object that stands free."""
    seed: int | None = Field(default=None, ge=0, lt=2**63)
    """Of the draws; left out, the run's."""
    probe_length_mm: Departure | None = None
    """Sphere farther from the flange."""
    sphere_off_axis_mm: Departure | None = None
    """Sphere aside of the sensor's axis, along x and y of the tip frame."""
    sphere_radius_mm: Departure | None = None
    stick_stiffness_percent: Departure | None = None
    payload_percent: Departure | None = None
    """Mass of what hangs on the sensor."""
    sensor_gain_percent: Departure | None = None
    """Of the axes fx, fy, fz, tx, ty, tz."""
    sensor_crosstalk_percent: Departure | None = None
    """What an axis at its full scale adds to each of the five others, in percent of their full scale: six times five
    numbers, row by row of the matrix without its diagonal."""
    zero_wander_force_mn: Departure | None = None
    """Standard deviation of a bounded wandering of each force axis' zero."""
    zero_wander_torque_unm: Departure | None = None
    zero_wander_s: Length = 2.0
    """s between the independent values that the wandering zero passes through."""
    sensor_hysteresis_percent: Departure | None = None
    """Width of each axis' hysteresis in percent of its full scale."""
    drift_mn_per_min: Departure | None = None
    """Of the force axes' zeros, in addition to the simulator's."""
    sensor_delay_ms: Departure | None = None
    """Samples arrive later than the sensor says."""
    clock_skew_ms: Departure | None = None
    """The sensor's time stamps are ahead of the arm's clock."""
    loss_burst_ms: Departure | None = None
    """Length of the gaps in the sensor's stream."""
    loss_bursts_per_min: float = Field(default=1.0, ge=0)
    dh_twist_deg: Departure | None = None
    """Denavit-Hartenberg alpha of each joint."""
    dh_offset_deg: Departure | None = None
    """Denavit-Hartenberg theta of each joint: its zero."""
    dh_a_mm: Departure | None = None
    dh_d_mm: Departure | None = None
    base_shift_mm: Departure | None = None
    base_turn_deg: Departure | None = None
    """About the base frame's x, y, z."""
    joint_stiffness_percent: Departure | None = None
    joint_hysteresis_deg: Departure | None = None
    """Width of the play between motor and link of each joint."""
    gear_ripple_deg: Departure | None = None
    """Amplitude of a wave between motor and link, 320 a turn (a harmonic drive of ratio 160)."""
    arm_delay_ms: Departure | None = None
    """Set points reach the motors later, in whole cycles."""
    arm_lag_ms: Departure | None = None
    """Added to the time constant with which the motors follow."""
    table_height_mm: Departure | None = None
    """The objects stand on the table and rise with it."""
    table_tilt_deg: Departure | None = None
    """About the world's x and y; the objects lean with it."""
    object_friction: Departure | None = None
    friction_direction_deg: Departure | None = None
    """Angle about the surface's normal between friction and what opposes the slip."""
    object_stiffness: Departure | None = None
    """N/m"""
    object_damping: Departure | None = None
    """N s/m"""
    object_turn_deg: Departure | None = None
    """Of all objects together, about the vertical through their middle."""
    object_shift_mm: Departure | None = None
    """Along the world's x and y."""
    object_mass_kg: Departure | None = None
    """A single object stands free with this mass; left out, it is held as the scene says."""
    object_anywhere: bool = False
    """All objects together lie anywhere in the area, at any angle about the vertical: drawn from the seed, in the place
    of `object_turn_deg` and `object_shift_mm`."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for name, quantity in QUANTITIES.items():
            departure = getattr(self, name)
            if departure is not None:
                _check(name, quantity, departure)
        return self

    @property
    def ideal(self) -> bool:
        """Nothing differs."""
        departs = self.object_anywhere or any(getattr(self, name) is not None for name in QUANTITIES)
        return self.profile == "ideal" and not departs

    def departure(self, name: str) -> Departure | None:
        """What was set for a quantity, else the profile's, None where the world is as the scene says."""
        return getattr(self, name) or PROFILES[self.profile].get(name)

    def draw(self, run_seed: int, joints: int = 0) -> dict[str, np.ndarray]:
        """(k,) numbers of each quantity that differs; those of the joints only where their number is given.

        `ANYWHERE` has three shares, from 0 to 1: of a turn, and of what is free along x and y.
        Raises SceneError for a list of another length than the number of joints.
        """
        seed = run_seed if self.seed is None else self.seed
        drawn = {}
        if self.object_anywhere:
            drawn[ANYWHERE] = _stream(ANYWHERE, seed).random(3)
        for name, quantity in QUANTITIES.items():
            departure, count = self.departure(name), quantity.count or joints
            if departure is not None and count:
                drawn[name] = _numbers(name, quantity, departure, seed, count)
        return drawn


def _check(name: str, quantity: Quantity, departure: Departure) -> None:
    """Refuse what the kind of quantity does not allow."""
    if departure.sigma is not None and quantity.kind in (Kind.LEVEL, Kind.SCALE):
        raise Refusal(name, {"sigma": departure.sigma}, "a number or { between = [low, high] }")
    given = departure.value or departure.between or ()
    if departure.value is not None and quantity.count and len(given) not in (1, quantity.count):
        raise Refusal(name, list(given), f"one number or {quantity.count}")
    lowest = {Kind.PERCENT: -100.0, Kind.SIZE: 0.0, Kind.LEVEL: 0.0, Kind.SCALE: 0.0}.get(quantity.kind)
    open_end = quantity.kind in (Kind.PERCENT, Kind.SCALE)
    if lowest is not None and any(number < lowest or (open_end and number == lowest) for number in given):
        raise Refusal(name, list(given), f"{'above' if open_end else 'at least'} {lowest:g}")


def _numbers(name: str, quantity: Quantity, departure: Departure, seed: int, count: int) -> np.ndarray:
    if departure.value is not None:
        if len(departure.value) not in (1, count):
            raise SceneError(f"truth.{name}", list(departure.value), f"one number or {count}, one for each joint")
        return np.full(count, departure.value) if len(departure.value) == 1 else np.array(departure.value)
    random, kind = _stream(name, seed), quantity.kind
    if departure.between is not None:
        low, high = departure.between
        if kind is Kind.SCALE:
            return np.exp(random.uniform(np.log(low), np.log(high), count))
        return random.uniform(low, high, count)
    drawn = (departure.sigma or 0.0) * random.standard_normal(count)
    if kind is Kind.PERCENT:
        return 100.0 * np.expm1(0.01 * drawn)
    return np.abs(drawn) if kind is Kind.SIZE else drawn


def _stream(name: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, crc32(name.encode())])


def _profile(
    normal: Mapping[str, float], uniform: Mapping[str, tuple[float, float]], fixed: Mapping[str, float]
) -> dict[str, Departure]:
    return {
        **{name: Departure(sigma=sigma) for name, sigma in normal.items()},
        **{name: Departure(between=ends) for name, ends in uniform.items()},
        **{name: Departure(value=(value,)) for name, value in fixed.items()},
    }


_SURFACE: dict[str, tuple[float, float]] = {
    "object_friction": (0.1, 0.5), "object_stiffness": (5e3, 1e7), "object_damping": (1.0, 20.0),
    "object_turn_deg": (-180.0, 180.0), "object_shift_mm": (-10.0, 10.0),
}  # fmt: skip
_BASE = {"base_shift_mm": 0.3, "base_turn_deg": 0.1, "friction_direction_deg": 3.0}
_SENSOR = {"zero_wander_force_mn": 6.0, "zero_wander_torque_unm": 28.0}
_GEARS = {"joint_hysteresis_deg": 0.003, "gear_ripple_deg": 0.005}
_DATASHEET = {
    "probe_length_mm": 0.3, "sphere_off_axis_mm": 0.2, "sphere_radius_mm": 0.03, "stick_stiffness_percent": 20.0,
    "payload_percent": 10.0, "sensor_gain_percent": 1.5, "sensor_crosstalk_percent": 1.0, "drift_mn_per_min": 50.0,
    "clock_skew_ms": 8.0, "dh_twist_deg": 0.05, "dh_offset_deg": 0.05, "dh_a_mm": 0.3, "dh_d_mm": 0.3,
    "joint_stiffness_percent": 40.0, "arm_delay_ms": 8.0, "arm_lag_ms": 8.0, "table_height_mm": 1.0,
    "table_tilt_deg": 0.3,
}  # fmt: skip
_WORN = (
    "probe_length_mm", "sphere_off_axis_mm", "sphere_radius_mm", "stick_stiffness_percent", "payload_percent",
    "sensor_gain_percent", "dh_offset_deg",
)  # fmt: skip
"""What handling and wear change: twice the data sheet's in `rough`."""

PROFILES: dict[str, dict[str, Departure]] = {
    "ideal": {},
    "lab": _profile(
        {
            "probe_length_mm": 0.05, "sphere_off_axis_mm": 0.05, "sphere_radius_mm": 0.01,
            "stick_stiffness_percent": 5.0, "payload_percent": 3.0, "sensor_gain_percent": 0.3,
            "sensor_crosstalk_percent": 0.15, "drift_mn_per_min": 5.0, "clock_skew_ms": 1.0, "dh_twist_deg": 0.01,
            "dh_offset_deg": 0.01, "dh_a_mm": 0.05, "dh_d_mm": 0.05, "joint_stiffness_percent": 15.0,
            "arm_delay_ms": 1.0, "arm_lag_ms": 1.0, "table_height_mm": 0.3, "table_tilt_deg": 0.1, **_BASE,
        },
        _SURFACE,
        {"sensor_hysteresis_percent": 0.1, "loss_burst_ms": 20.0, **_SENSOR, **_GEARS},
    ),
    "datasheet": _profile(
        {**_DATASHEET, **_BASE},
        _SURFACE,
        {"sensor_hysteresis_percent": 0.3, "loss_burst_ms": 80.0, **_SENSOR, **_GEARS},
    ),
    "rough": _profile(
        {**_DATASHEET, **{name: 2.0 * _DATASHEET[name] for name in _WORN}, **_BASE},
        {**_SURFACE, "object_mass_kg": (0.1, 1.0)},
        {"sensor_hysteresis_percent": 0.3, "loss_burst_ms": 80.0, **_SENSOR, **_GEARS},
    ),
}  # fmt: skip
"""What each profile sets; docs/explanation/simulator.md says where each figure comes from."""
