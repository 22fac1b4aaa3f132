"""UDP commands read and data records written byte by byte, as the device does.

Written from the layout alone and sharing nothing with the driver's `wire`, so that each checks the other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


def crc(data: bytes) -> int:
    """16 bits, polynomial x^16 + x^12 + x^5 + 1, most significant bit first, from 0x1234; 0 over a whole datagram."""
    register = 0x1234
    for byte in data:
        for bit in range(7, -1, -1):
            out = (register >> 15) ^ (byte >> bit & 1)
            register = (register << 1) & 0xFFFF
            if out:
                register ^= 0x1021
    return register


@dataclass(slots=True, frozen=True)
class Order:
    """A command that has passed length and CRC."""

    code: int
    packets: int


def read_order(data: bytes) -> Order | None:
    """The command in a datagram; None, as the device says nothing, for a wrong length or CRC."""
    if len(data) < 6 or int.from_bytes(data[:2], "big") != len(data) or crc(data):
        return None
    code = data[3]
    if len(data) != (10 if code == 1 else 6):
        return None
    return Order(code, int.from_bytes(data[4:8], "big") if code == 1 else 0)


def record_bytes(
    stamp: int,
    sequence: int,
    status_1: int,
    status_2: int,
    battery: int,
    mask: int,
    blocks: Iterable[Iterable[int]],
) -> bytes:
    """One record; `blocks` holds six counts a transducer of the mask, in ascending order."""
    words = (stamp, sequence, status_1, status_2)
    head = b"".join((word & 0xFFFFFFFF).to_bytes(4, "big") for word in words) + bytes((battery, mask))
    return head + b"".join(count.to_bytes(4, "big", signed=True) for block in blocks for count in block)
