"""Table `[arm.correction]`: by how much an arm differs from the model of its kind."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field

from lwrprobe.contracts import SceneError
from lwrprobe.scene.table import NonNegative, Table

UNITS = {"dh_a_mm": 1e-3, "dh_twist_deg": np.pi / 180.0, "dh_d_mm": 1e-3, "dh_offset_deg": np.pi / 180.0}
"""SI of the keys of the kinematic table, in the order of a robot's columns."""
GEARS = ("gear_sine_deg", "gear_cosine_deg")
"""Keys of the gears' waves."""


class ArmCorrection(Table):
    """What is known of one arm beyond its model, a number for each joint; left out: zero.

    Names are those of the table `[truth]`, where both have a key. `lwrprobe calibrate` finds the numbers.
    """

    dh_a_mm: tuple[float, ...] = Field(default=(), strict=False)
    dh_twist_deg: tuple[float, ...] = Field(default=(), strict=False)
    dh_d_mm: tuple[float, ...] = Field(default=(), strict=False)
    dh_offset_deg: tuple[float, ...] = Field(default=(), strict=False)
    """Denavit-Hartenberg parameters less those of the model."""
    gear_sine_deg: tuple[float, ...] = Field(default=(), strict=False)
    gear_cosine_deg: tuple[float, ...] = Field(default=(), strict=False)
    """The joint's value less its motor's position is sine times sin k q plus cosine times cos k q, with k the number
    `arm.gear_waves` and q the motor's position."""
    joint_hysteresis_deg: NonNegative = 0.0
    """Width of the play of each joint: a link stays behind its motor by half of it."""
    errors: tuple[Annotated[tuple[float, ...], Field(strict=False)], ...] = Field(default=(), strict=False)
    """What a calibration leaves of the kinematic table and of the sphere's centre together: independent errors of one
    standard deviation each, m and rad, of a, alpha, d and theta of all joints and of the centre in the tip frame. In
    the error budget they take the place of the single numbers of `[uncertainty]`."""

    def table_change(self, joints: int) -> np.ndarray:
        """(4, joints) of a [m], alpha [rad], d [m] and theta [rad]; raises SceneError for another number of joints."""
        self.error_rows(joints)  # a wrong number is said before a run, not by the budget after it
        return np.array([unit * self._row(name, joints) for name, unit in UNITS.items()])

    def waves(self, joints: int) -> np.ndarray:
        """(2, joints) rad of sine and cosine; raises SceneError for another number of joints."""
        return np.radians([self._row(name, joints) for name in GEARS])

    def error_rows(self, joints: int) -> np.ndarray:
        """(k, 4 joints + 3) m and rad, no row without a calibration; raises SceneError for rows of another length."""
        length = 4 * joints + 3
        for row in self.errors:
            if len(row) != length:
                raise SceneError(
                    "arm.correction.errors", row, f"rows of {length} numbers, four for each joint and three"
                )
        return np.array(self.errors).reshape(-1, length)

    def calibrated(
        self, table: np.ndarray, waves: np.ndarray, play: float, errors: tuple[tuple[float, ...], ...]
    ) -> Self:
        """This one with another change of the table (4 n,) on top, the waves (2 n,) and play [rad] of the gears, and
        what is left of table and tool."""
        joints = table.size // len(UNITS)
        rows = dict(zip(UNITS, (self.table_change(joints).ravel() + table).reshape(len(UNITS), joints)))
        changed = {name: tuple((row / UNITS[name]).tolist()) for name, row in rows.items()}
        gears = {name: tuple(row.tolist()) for name, row in zip(GEARS, np.degrees(waves).reshape(len(GEARS), joints))}
        whole = {"joint_hysteresis_deg": float(np.degrees(play)), "errors": errors}
        return self.model_copy(update={**changed, **gears, **whole})

    def _row(self, name: str, joints: int) -> np.ndarray:
        row = getattr(self, name) or (0.0,) * joints
        if len(row) != joints:
            raise SceneError(f"arm.correction.{name}", row, f"{joints} numbers, one for each joint")
        return np.array(row)
