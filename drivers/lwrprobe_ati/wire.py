"""UDP commands to the device and data records from it, big endian."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from enum import IntEnum
from typing import NamedTuple

from lwrprobe.contracts import SampleStatus

INPUTS = 6
_HEAD = struct.Struct(">4I2B")
_BLOCK = struct.Struct(">6i")
_COMMAND = struct.Struct(">HBB")
_CRC_START = 0x1234
_LARGEST_LEFT_OVER = 17  # one byte less than a record's head


class Command(IntEnum):
    """Codes of the UDP commands."""

    START = 1
    STOP = 2
    PING = 4
    RESET_TELNET = 5


def encode_command(command: Command, sequence: int, packets: int = 0) -> bytes:
    """The datagram; `packets` counts for START alone, 0 = without end.

    The CRC has 16 bits, polynomial 0x1021, most significant bit first, and starts from 0x1234.
    """
    tail = struct.pack(">I", packets) if command is Command.START else b""
    body = _COMMAND.pack(_COMMAND.size + len(tail) + 2, sequence & 0xFF, command) + tail
    return body + struct.pack(">H", crc_hqx(body, _CRC_START))


class Record(NamedTuple):
    """One reading of one transducer.

    Attributes
    ----------
    stamp : 1/4096 s since 1900, modulo 2^32
    sequence : modulo 2^32
    status : words 1 and 2
    battery : level, unit not stated
    mask : bit i = transducer i + 1 active
    counts : (6) Fx Fy Fz Tx Ty Tz, or gages
    """

    stamp: int
    sequence: int
    status: tuple[int, int]
    battery: int
    mask: int
    counts: tuple[int, ...]


class Datagram(NamedTuple):
    """What one datagram held: records, oldest first, and how many bytes were left over."""

    records: tuple[Record, ...]
    left_over: int


def decode_datagram(data: bytes | memoryview, transducer: int) -> Datagram | str:
    """The records of one transducer (1..6), or why the datagram is refused: `size`, `content` or `absent`.

    Blocks are packed: with mask 0x12 the first is transducer 2, the second 5. Mask 0 comes from very old firmware;
    the number of transducers, from 1 up, then follows from the length. Left-over bytes short of a record's
    head are tolerated. Records of one datagram follow each other; if they do not, all of them are refused.
    """
    records: list[Record] = []
    at, size = 0, len(data)
    bit = 1 << (transducer - 1)
    while size - at > _LARGEST_LEFT_OVER:
        stamp, sequence, status_1, status_2, battery, mask = _HEAD.unpack_from(data, at)
        active = mask or _mask_from_length(size, at)
        length = _HEAD.size + _BLOCK.size * active.bit_count()
        if at + length > size or not active:
            return "size"
        if active >> INPUTS or (records and not _continues(records[-1], sequence, active)):
            return "content"
        if not active & bit:
            return "absent"
        before = (active & (bit - 1)).bit_count()
        counts = _BLOCK.unpack_from(data, at + _HEAD.size + _BLOCK.size * before)
        records.append(Record(stamp, sequence, (status_1, status_2), battery, active, counts))
        at += length
    if not records:
        return "size"
    return Datagram(tuple(records), size - at)


def _mask_from_length(size: int, at: int) -> int:
    blocks, rest = divmod(size - _HEAD.size, _BLOCK.size)
    return (1 << blocks) - 1 if at == 0 and rest == 0 and 1 <= blocks <= INPUTS else 0


def _continues(before: Record, sequence: int, mask: int) -> bool:
    return sequence == (before.sequence + 1) & 0xFFFFFFFF and mask == before.mask


class Light(IntEnum):
    """A two-bit LED field of the status words; a dark one may be blinking."""

    DARK = 0
    RED = 1
    GREEN = 2
    ORANGE = 3


def battery_light(record: Record) -> Light:
    """Status word 1, bits 10 and 11."""
    return Light(record.status[0] >> 10 & 3)


def powered(record: Record, transducer: int) -> bool:
    """The analog front end of the transducer is present."""
    word, place = _place(record, transducer)
    return bool(word >> (16 + 2 * place) & 1)


def status_flags(record: Record, transducer: int) -> SampleStatus:
    """What the status words say about one transducer and the battery, as flags of a wrench sample."""
    word, place = _place(record, transducer)
    flags = SampleStatus.OK
    if word >> (24 + place) & 1:
        flags |= SampleStatus.SATURATED
    if word >> (27 + place) & 1:
        flags |= SampleStatus.BRIDGE_LOW
    if not powered(record, transducer):
        flags |= SampleStatus.INVALID
    if battery_light(record) in (Light.RED, Light.ORANGE):
        flags |= SampleStatus.LOW_BATTERY
    return flags


def _place(record: Record, transducer: int) -> tuple[int, int]:
    group, place = divmod(transducer - 1, 3)
    return record.status[group], place
