"""Both datagrams of FRI 1.0 (KRC2 lr, LWR 4+), as the remote side sees them.

Little endian, 4-byte aligned, no padding left implicit. The ids double as the interface version. Joints come in
the order A1 A2 E1 A3 A4 A5 A6, which is base to flange; wrenches in the order Fx Fy Fz Tz Ty Tx.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from enum import IntEnum, IntFlag

import numpy as np

JOINTS = ("A1", "A2", "E1", "A3", "A4", "A5", "A6")
MEASUREMENT_ID, MEASUREMENT_SIZE = 0x2006, 916
COMMAND_ID, COMMAND_SIZE = 0x1005, 376

_MEASUREMENT = struct.Struct("<4H 16f16i2H f2H7fI 4H7f 7f12f 7f7f12f12f 7f7f6f 42f49f7f")
_COMMAND = struct.Struct("<4H 16f16i2H I 7f12f7f6f 7f7f6f6f")

# Positions in the unpacked measurement.
_KRL_REAL, _KRL_INT, _KRL_BOOL = slice(4, 20), slice(20, 36), 36
_TIMESTAMP, _STATE, _QUALITY, _CYCLE_MEASURED, _CYCLE_COMMANDED = 38, 39, 40, 41, 42
_SAFETY, _ANSWER_RATE, _LATENCY, _JITTER, _MISS_RATE, _MISSES = 43, 44, 45, 46, 47, 48
_POWER, _CONTROL, _ERROR, _WARNING = 49, 50, 51, 52
_TEMPERATURE, _MEASURED, _MEASURED_FRAME = slice(53, 60), slice(60, 67), slice(67, 79)
_COMMANDED, _OFFSET = slice(79, 86), slice(86, 93)
_TORQUE, _EXTERNAL, _TCP_WRENCH = slice(117, 124), slice(124, 131), slice(131, 137)
_MASS_MATRIX = slice(179, 228)

_FARTHEST = 3.2  # rad; no joint of the arm turns farther than 170 degrees
_LONGEST_CYCLE = 0.2  # s; friOpen takes 1..100 ms


class State(IntEnum):
    """Of the interface. `OFF` is never sent; the remote uses it for "nothing received"."""

    OFF = 0
    MON = 1
    CMD = 2


class Quality(IntEnum):
    """The controller's rating of the remote's timing."""

    UNACCEPTABLE = 0
    BAD = 1
    OK = 2
    PERFECT = 3


class Field(IntFlag):
    """Which fields of a command count."""

    JOINT_POSITION = 0x0001
    JOINT_TORQUE = 0x0004
    JOINT_STIFFNESS = 0x0010
    JOINT_DAMPING = 0x0020
    CARTESIAN_POSITION = 0x0100
    CARTESIAN_WRENCH = 0x0400
    CARTESIAN_STIFFNESS = 0x1000
    CARTESIAN_DAMPING = 0x2000


class Measurement:
    """One measurement datagram that has passed every check; fields are cut out when asked for."""

    __slots__ = ("values",)

    def __init__(self, values: tuple) -> None:
        self.values = values

    @property
    def sequence(self) -> int:
        return self.values[0]

    @property
    def reflected(self) -> int:
        """Sequence number of the last command that the controller had received."""
        return self.values[1]

    @property
    def krl_real(self) -> tuple[float, ...]:
        """$FRI_TO_REA[1..16]."""
        return self.values[_KRL_REAL]

    @property
    def krl_int(self) -> tuple[int, ...]:
        """$FRI_TO_INT[1..16]."""
        return self.values[_KRL_INT]

    @property
    def krl_bool(self) -> int:
        """Bit i = $FRI_TO_BOOL[i + 1]."""
        return self.values[_KRL_BOOL]

    @property
    def timestamp(self) -> float:
        """s, the controller's clock; single precision, coarse after some hours."""
        return self.values[_TIMESTAMP]

    @property
    def state(self) -> State:
        return State(self.values[_STATE])

    @property
    def quality(self) -> Quality:
        return Quality(self.values[_QUALITY])

    @property
    def measurement_cycle(self) -> float:
        """s between two measurements."""
        return self.values[_CYCLE_MEASURED]

    @property
    def cycle(self) -> float:
        """s between two commands: what every limit per cycle follows from."""
        return self.values[_CYCLE_COMMANDED]

    @property
    def safety_factor(self) -> float:
        """Given to friStart; 1 = the controller's full limits."""
        return self.values[_SAFETY]

    @property
    def answer_rate(self) -> float:
        """Mean over the last 100 packets, ideally 1."""
        return self.values[_ANSWER_RATE]

    @property
    def latency(self) -> float:
        """s, mean round trip as the controller sees it."""
        return self.values[_LATENCY]

    @property
    def jitter(self) -> float:
        """s, mean, as the controller sees it."""
        return self.values[_JITTER]

    @property
    def miss_rate(self) -> float:
        return self.values[_MISS_RATE]

    @property
    def misses(self) -> int:
        """Answers that the controller has missed since the interface was opened."""
        return self.values[_MISSES]

    @property
    def power(self) -> int:
        """One bit a drive; 0 = drives off."""
        return self.values[_POWER]

    @property
    def control(self) -> int:
        """1 position, 2 Cartesian impedance, 3 joint impedance, 0 other."""
        return self.values[_CONTROL]

    @property
    def error(self) -> int:
        """One bit a drive."""
        return self.values[_ERROR]

    @property
    def warning(self) -> int:
        """One bit a drive."""
        return self.values[_WARNING]

    @property
    def temperature(self) -> np.ndarray:
        """(7,) of the drives; the unit is not stated, taken as degree Celsius."""
        return np.array(self.values[_TEMPERATURE])

    @property
    def measured(self) -> tuple[float, ...]:
        """(7) rad."""
        return self.values[_MEASURED]

    @property
    def measured_frame(self) -> np.ndarray:
        """(3, 4) of the tool, in the base frame set on the controller."""
        return np.array(self.values[_MEASURED_FRAME]).reshape(3, 4)

    @property
    def set_point(self) -> list[float]:
        """(7) rad: the controller's own set point and what FRI adds to it."""
        values = self.values
        return [a + b for a, b in zip(values[_COMMANDED], values[_OFFSET])]

    @property
    def torque(self) -> np.ndarray:
        """(7,) N·m, measured."""
        return np.array(self.values[_TORQUE])

    @property
    def external_torque(self) -> np.ndarray:
        """(7,) N·m, the controller's estimate."""
        return np.array(self.values[_EXTERNAL])

    @property
    def tcp_wrench(self) -> np.ndarray:
        """(6,) N, N·m, estimated, put into the order Fx Fy Fz Tx Ty Tz; its sign is the controller's."""
        fx, fy, fz, tz, ty, tx = self.values[_TCP_WRENCH]
        return np.array([fx, fy, fz, tx, ty, tz])

    @property
    def mass_matrix(self) -> np.ndarray:
        """(7, 7) of the arm in its joints; the unit is not stated."""
        return np.array(self.values[_MASS_MATRIX]).reshape(7, 7)

    @property
    def commandable(self) -> bool:
        """The controller follows set points now."""
        values = self.values
        return values[_STATE] == State.CMD and values[_POWER] != 0 and values[_ERROR] == 0


def decode_measurement(data: bytes | bytearray | memoryview) -> Measurement | str:
    """The measurement in a datagram, or why there is none in it: `size`, `id` or `content`.

    Content is refused when a state, quality or cycle is impossible, or a joint value is not finite or lies
    beyond any joint's reach.
    """
    if len(data) != MEASUREMENT_SIZE:
        return "size"
    values = _MEASUREMENT.unpack(data)
    if values[3] != MEASUREMENT_ID or values[2] != MEASUREMENT_SIZE:
        return "id"
    if not 1 <= values[_STATE] <= 2 or values[_QUALITY] > 3:
        return "content"
    if not (0.0 < values[_CYCLE_COMMANDED] <= _LONGEST_CYCLE and 0.0 < values[_CYCLE_MEASURED] <= _LONGEST_CYCLE):
        return "content"
    if not math.isfinite(values[_TIMESTAMP] + sum(values[53:60]) + sum(values[117:131])):
        return "content"
    # A comparison with NaN is false: these three lines refuse NaN and infinity, too.
    if not (_within(values[_MEASURED]) and _within(values[_COMMANDED]) and _within(values[_OFFSET], 2.0)):
        return "content"
    return Measurement(values)


def _within(angles: tuple[float, ...], factor: float = 1.0) -> bool:
    far = factor * _FARTHEST
    return all([-far <= a <= far for a in angles])


class CommandWriter:
    """Packs commands of one control strategy into one buffer.

    Parameters
    ----------
    fields : which fields count; fixed, since the controller wants them unchanged in command mode
    stiffness, damping : (7) N·m/rad and (7) 0..1, sent when their flags are set
    """

    def __init__(self, fields: Field, stiffness: Sequence[float], damping: Sequence[float]) -> None:
        self._fields = int(fields)
        self._before = (0.0,) * 16
        self._between = (0.0,) * 25
        self._after = (*stiffness, *damping, *(0.0,) * 12)
        self._buffer = bytearray(COMMAND_SIZE)

    def pack(self, sequence: int, reflected: int, krl_int: Sequence[int], joints: Sequence[float]) -> bytearray:
        """The datagram; the buffer is used again by the next call."""
        _COMMAND.pack_into(
            self._buffer,
            0,
            sequence,
            reflected,
            COMMAND_SIZE,
            COMMAND_ID,
            *self._before,
            *krl_int,
            0,
            0,
            self._fields,
            *joints,
            *self._between,
            *self._after,
        )
        return self._buffer
