"""The common ground of all tables of a scene file."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Length = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
LARGEST = 5.0
"""m, of the size of a shape and of each coordinate of a place: what is beyond it was given in millimetres."""


def in_metres(largest: float) -> AfterValidator:
    """Refuse a number whose size [m] is beyond `largest`."""

    def check(length: float) -> float:
        if abs(length) > largest:
            meant = f"lengths are in metres, and {length:g} mm are {1e-3 * length:g}"
            raise ValueError(f"at most {largest:g} in size: {meant}")
        return length

    return AfterValidator(check)


Size = Annotated[Length, in_metres(LARGEST)]
Coordinate = Annotated[float, in_metres(LARGEST)]
Place = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]


class Refusal(ValueError):
    """A value that is wrong together with others: the key below the table, what was given, what is allowed."""

    def __init__(self, key: str, value: object, allowed: str) -> None:
        self.key, self.value, self.allowed = key, value, allowed
        super().__init__(allowed)


class Table(BaseModel):
    """A table whose keys are all known, whose numbers are finite, and which does not change."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class Pose(Table):
    """A frame in its parent: first turned about the parent's fixed x, y, z axes in this order, then moved."""

    xyz: Place = (0.0, 0.0, 0.0)
    """m"""
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """degrees about x, y, z"""

    def matrix(self) -> np.ndarray:
        """(4, 4), from this frame to its parent."""
        (sr, sp, sy), (cr, cp, cy) = exact_sin(self.rpy_deg), exact_sin(np.add(self.rpy_deg, 90.0))
        pose = np.eye(4)
        pose[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        pose[:3, 3] = self.xyz
        return pose


def exact_sin(degrees: ArrayLike) -> np.ndarray:
    """Sine of angles in degrees, exact at multiples of 90."""
    turns = np.mod(np.asarray(degrees, dtype=np.float64), 360.0)
    sine = np.sin(np.radians(turns))
    for angle, value in ((0.0, 0.0), (90.0, 1.0), (180.0, 0.0), (270.0, -1.0)):
        sine[turns == angle] = value
    return sine
