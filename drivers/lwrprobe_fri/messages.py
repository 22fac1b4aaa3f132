"""What runner and answering process send each other: one packet a message, its first byte the kind."""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields

from lwrprobe_fri.wire import MEASUREMENT_SIZE

ARRIVAL, SILENCE, LOSS, FAILURE, SCHEDULING = b"a", b"s", b"l", b"f", b"h"
"""From the answering process: a measurement was answered; none came; command mode has ended; the process ends; how the
system schedules it."""
SET_POINT, REQUEST, TAKE_OVER, LET_GO = b"p", b"r", b"t", b"g"
"""From the runner."""

_REPORT = struct.Struct("<c ?? Q Q Q I d d 7d 12Q")
_SET_POINT = struct.Struct("<c 7d 7d")
_LOSS = struct.Struct("<c I ?")
_SILENCE = struct.Struct("<c 12Q")
LARGEST = 4096


@dataclass(slots=True)
class Traffic:
    """What has been counted since the line was opened; nothing late or lost is hidden.

    Attributes
    ----------
    received : measurements that were used
    foreign, malformed : datagrams of others, and with a wrong size, id or content
    late_answers : the controller did not reflect the last answer in time
    late_set_points : the runner had no new set point when an answer was due
    backlog : measurements that had already been overtaken by newer ones when they were read
    unsent : answers that the system refused to send
    lost, repeated, old, implausible, restarts : gaps in the sequence, and what was not used (see `PacketFilter`)
    """

    received: int = 0
    foreign: int = 0
    malformed: int = 0
    late_answers: int = 0
    late_set_points: int = 0
    backlog: int = 0
    unsent: int = 0
    lost: int = 0
    repeated: int = 0
    old: int = 0
    implausible: int = 0
    restarts: int = 0

    def as_tuple(self) -> tuple[int, ...]:
        return tuple(getattr(self, name) for name in _COUNTED)


_COUNTED = tuple(f.name for f in fields(Traffic))


@dataclass(slots=True, frozen=True)
class Report:
    """One answered measurement.

    Attributes
    ----------
    late, resting : the answer before was late; nothing that goes out moves
    index : of the measurement among those answered
    cycles : of the controller since the line was opened; orders : messages of the runner carried out so far
    steps : cycles since the measurement before
    time, took : s, arrival by `time.monotonic`, and until the answer was sent
    position : (7) rad, what was answered
    traffic : counts so far
    measurement : the datagram
    """

    late: bool
    resting: bool
    index: int
    cycles: int
    orders: int
    steps: int
    time: float
    took: float
    position: tuple[float, ...]
    traffic: tuple[int, ...]
    measurement: bytes

    def packed(self) -> bytes:
        head = (self.late, self.resting, self.index, self.cycles, self.orders, self.steps, self.time, self.took)
        return _REPORT.pack(ARRIVAL, *head, *self.position, *self.traffic) + self.measurement

    @classmethod
    def unpacked(cls, packet: bytes) -> Report:
        words = _REPORT.unpack_from(packet)
        late, resting, index, cycles, orders, steps, time, took = words[1:9]
        measurement = packet[-MEASUREMENT_SIZE:]
        return cls(late, resting, index, cycles, orders, steps, time, took, words[9:16], words[16:], measurement)


def pack_set_point(joints: tuple[float, ...], velocity: tuple[float, ...]) -> bytes:
    """Joints (7) rad and their velocity (7) rad/s."""
    return _SET_POINT.pack(SET_POINT, *joints, *velocity)


def unpack_set_point(packet: bytes) -> tuple[tuple[float, ...], tuple[float, ...]]:
    words = _SET_POINT.unpack(packet)
    return words[1:8], words[8:]


def pack_silence(traffic: Traffic) -> bytes:
    """No measurement has come for a while; what has come instead is in the counts."""
    return _SILENCE.pack(SILENCE, *traffic.as_tuple())


def unpack_silence(packet: bytes) -> Traffic:
    return Traffic(*_SILENCE.unpack(packet)[1:])


def pack_loss(take_overs: int, unasked: bool, why: str) -> bytes:
    """Command mode has ended by itself, after so many take-overs; whether it may be entered again unasked."""
    return _LOSS.pack(LOSS, take_overs, unasked) + why.encode()[: LARGEST - 64]


def unpack_loss(packet: bytes) -> tuple[int, bool, str]:
    return *_LOSS.unpack_from(packet)[1:], packet[_LOSS.size :].decode("utf-8", "replace")
