"""What has changed between two calibrations of the same arm and probe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.calibration.calibration_file import Calibration

COMPARED = ("tool_shift", "sphere_radius", "stick_stiffness", "force_to_torque")
"""Quantities of probe and sensor: they stay unless something was bent, loosened or overloaded."""
NOTICED = 3.0
"""Standard deviations of the difference from which on a number has changed."""


@dataclass(slots=True, frozen=True)
class Drift:
    """A number that has changed.

    Attributes
    ----------
    quantity, index : which number
    before, now : SI
    deviations : the change in standard deviations of the difference
    """

    quantity: str
    index: int
    before: float
    now: float
    deviations: float


def drifts(now: Calibration, before: Calibration) -> list[Drift]:
    """Numbers that both calibrations have seen and that differ, the most significant first."""
    found = []
    for name in COMPARED:
        one, other = now.quantities[name], before.quantities[name]
        for k, (value, past) in enumerate(zip(one.values, other.values)):
            sigma = float(np.hypot(one.sigma[k], other.sigma[k]))
            if one.visible[k] and other.visible[k] and abs(value - past) > NOTICED * sigma:
                found.append(Drift(name, k, past, value, abs(value - past) / max(sigma, 1e-300)))
    return sorted(found, key=lambda drift: -drift.deviations)
