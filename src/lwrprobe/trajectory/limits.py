"""What the tip may do, and how often it is asked."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from lwrprobe.contracts import InputError


@dataclass(slots=True, frozen=True)
class CartesianLimits:
    """Bounds of the tip's motion, on Euclidean norms (of the vector, not of each axis).

    Attributes
    ----------
    speed, acceleration, jerk : m/s, m/s^2, m/s^3
    turn_rate, turn_acceleration, turn_jerk : rad/s, rad/s^2, rad/s^3
    """

    speed: float
    acceleration: float
    jerk: float
    turn_rate: float
    turn_acceleration: float
    turn_jerk: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, int | float) or not isfinite(value) or not 1e-9 <= value <= 1e9:
                raise InputError(f"limits.{field.name}", value, "a number from 1e-9 to 1e9")


def as_cycle(value: object) -> float:
    """A cycle time [s] in the range that the generators are tested in; raises InputError."""
    if not isinstance(value, int | float) or not 1e-4 <= value <= 0.02:
        raise InputError("cycle", value, "seconds from 1e-4 to 0.02")
    return float(value)
