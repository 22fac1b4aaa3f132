"""What a calibration measures: touches with joints and raw readings, and readings in free space."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lwrprobe.contracts import WrenchSample
from lwrprobe.contracts.samples import Vector

Target = Literal["sphere", "table"]


@dataclass(slots=True, frozen=True)
class Touch:
    """One press of the probe's sphere: the force rises while the probe moves in, and falls while it moves out.

    Attributes
    ----------
    target : what is pressed
    place : index of the place at which the reference sphere stands, 0 where it stands at one place only
    times : (m,) s, the sensor's time stamps
    wrenches : (m, 6) N and N m, raw readings less the mean reading just before the touch
    rising : (m,) bool, whether the force rises
    arm_times : (k,) s, the arm's clock, from before the first sample to after the last one
    arm_joints : (k, n) rad, measured
    """

    target: Target
    place: int
    times: Vector
    wrenches: np.ndarray
    rising: np.ndarray
    arm_times: Vector
    arm_joints: np.ndarray


@dataclass(slots=True)
class Touches:
    """All that one calibration has measured.

    Attributes
    ----------
    touches : in order of time
    free : mean readings while the probe rests in free space, in order of time, raw
    free_joints : (n,) rad at each of them
    following : s, from a set point to the arm's measured motion; nan where it was not measured
    latency : s, from a sample's time stamp to its arrival on the arm's clock, the smallest
    """

    touches: list[Touch] = field(default_factory=list)
    free: list[WrenchSample] = field(default_factory=list)
    free_joints: list[Vector] = field(default_factory=list)
    following: float = float("nan")
    latency: float = 0.0

    @property
    def places(self) -> int:
        """Number of places at which the reference sphere stood."""
        return 1 + max((touch.place for touch in self.touches), default=0)
