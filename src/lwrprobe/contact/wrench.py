"""The conditioned wrench, and what the sensor's noise is taken to be."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Final

import numpy as np

from lwrprobe.contracts import InputError, Probe, SampleStatus
from lwrprobe.contracts.samples import Vector

UNCONFIRMED: Final = 1 << 16
"""Status of a reading that jumped and has not been confirmed by a second one: it may be a spike."""

UNUSABLE: Final = int(SampleStatus.INVALID | SampleStatus.FROZEN | SampleStatus.LATE | SampleStatus.BRIDGE_LOW)
"""Statuses with which a wrench carries nothing new: its force is the last good one, held."""


_NOT_USABLE: Final = int(UNUSABLE | UNCONFIRMED | SampleStatus.SATURATED)  # flags are slow to put together


@dataclass(slots=True)
class Wrench:
    """The wrench of the contact alone: bias and payload are subtracted, faults of the stream are handled.

    Attributes
    ----------
    time : s, of the sample
    force : (3,) N, sensor frame
    torque : (3,) N·m about the sensor frame's origin, sensor frame
    world_force : (3,) N, the same force in the world frame
    sequence : of the sample
    status : flags of `SampleStatus`, and `UNCONFIRMED`
    zeroing : how often the conditioner has moved its zero so far; estimates that depend on the old zero are then
        invalid
    """

    time: float
    force: Vector
    torque: Vector
    world_force: Vector
    sequence: int = 0
    status: int = 0
    zeroing: int = 0

    @property
    def magnitude(self) -> float:
        """N, length of the force."""
        return hypot(*self.force.tolist())

    @property
    def usable(self) -> bool:
        """True when the values are new, valid, confirmed and within the sensor's range."""
        return not self.status & _NOT_USABLE


@dataclass(slots=True, frozen=True)
class WrenchNoise:
    """Standard deviation of one reading, per force axis [N] and per torque axis [N·m], quantisation included.

    The nano17 (calibration SI-12-0.12) is specified by its resolution alone: 1/320 N and 1/64 N·mm. Records of real
    ones behind ATI's wireless transmitter (five transducers, 125 Hz, 32-fold oversampling, mean of 8) bracket the
    noise: at low gain the gages flicker by 0.44 ADC counts (one standard deviation). The recorded calibration
    matrices turn that into 0.3-0.4 mN and 2-3 uN·m, the lower bound; were all of it amplifier noise, the 7.5-fold gain
    of the force calibration would make it 2.6-3.8 mN and 14-24 uN·m, the upper. One resolution step as one
    standard deviation, 3.1 mN and 15.6 uN·m, white and independent on each axis, is near that upper bound.
    """

    force: float
    torque: float

    def __post_init__(self) -> None:
        for name in ("force", "torque"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"noise.{name}", value, "a finite standard deviation, zero or more")

    @classmethod
    def of(cls, probe: Probe, counts: float = 1.0) -> WrenchNoise:
        """Gaussian noise of `counts` resolution steps, with the quantisation's 1/sqrt(12) step added in squares."""
        scale = float(np.sqrt(counts * counts + 1.0 / 12.0))
        return cls(scale * probe.force_resolution, scale * probe.torque_resolution)

    @classmethod
    def mean_of(cls, measured: Vector) -> WrenchNoise:
        """Of readings with (6,) standard deviations in N and N·m: the root of the mean square over three axes."""
        return cls(*np.sqrt(np.mean(np.square(measured).reshape(2, 3), axis=1)).tolist())

    def or_louder(self, other: WrenchNoise) -> WrenchNoise:
        """This noise, or the other one where that is larger."""
        return WrenchNoise(max(self.force, other.force), max(self.torque, other.torque))

    def over(self, other: WrenchNoise) -> float:
        """How many times as large as another one this is, in force or in torque; zero beside zero is 1."""
        both = ((self.force, other.force), (self.torque, other.torque))
        return max(mine / theirs if theirs > 0.0 else 1.0 if mine == 0.0 else np.inf for mine, theirs in both)
