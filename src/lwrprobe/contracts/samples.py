"""What drivers deliver: one wrench sample, one arm state."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class SampleStatus(IntFlag):
    """What is wrong with a wrench sample; 0 is a good one."""

    OK = 0
    SATURATED = 1
    """At least one of the six axes is at the end of its range."""
    LATE = 2
    """The sample is older than the driver's limit when it arrives."""
    LOST_BEFORE = 4
    """At least one sample before this one never came (a gap in the sequence)."""
    FROZEN = 8
    """Sequence or time did not advance."""
    INVALID = 16
    """NaN, infinite or beyond anything the sensor can report."""
    LOW_BATTERY = 32
    BRIDGE_LOW = 64
    """Bridge voltage low: the values cannot be relied on."""


class ArmStatus(IntFlag):
    """Condition of the arm; 0 is ready and following."""

    OK = 0
    NOT_COMMANDING = 1
    """The controller does not follow set points now (FRI: monitor mode)."""
    POWER_OFF = 2
    FAULT = 4
    LATE = 8
    """The last answer missed its cycle."""
    STALE = 16
    """No new state since the last read."""
    UNANSWERED = 32
    """The controller had no answer in time since the last read, and went on with the last velocity."""


@dataclass(slots=True)
class WrenchSample:
    """One reading of a six-axis force/torque sensor.

    Attributes
    ----------
    time : s, on the clock that the arm's states use too; the instant of measurement, not of arrival
    force : (3,) N, the force that acts **on the probe**, in the sensor frame
    torque : (3,) N·m, about the sensor frame's origin, in the sensor frame
    sequence : grows by one a sample; a gap is a loss
    status : flags, 0 = good
    """

    time: float
    force: Vector
    torque: Vector
    sequence: int = 0
    status: int = 0


@dataclass(slots=True)
class ArmState:
    """One reading of the arm.

    Attributes
    ----------
    time : s, on the driver's clock
    q : (n,) rad (m for prismatic joints), measured
    qd : (n,) rad/s, measured or differentiated by the driver
    status : flags, 0 = ready and following
    """

    time: float
    q: Vector
    qd: Vector
    status: int = 0
    temperature: Vector | None = field(default=None)
