"""When a datagram reached this host.

The kernel notes it. The process that reads the datagram may have been kept from running since, and would date what a
device measured by as much too late.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from contextlib import suppress

_STAMP = 35  # SO_TIMESTAMPNS of Linux, which Python has no name for
_TIMESPEC = struct.Struct("@ll")
_OLDEST = 60.0  # s; beyond it, or below 0, the system's clock was set meanwhile

SPACE = socket.CMSG_SPACE(_TIMESPEC.size) if hasattr(socket, "CMSG_SPACE") else 0
"""Bytes of ancillary data in which the kernel hands the time over."""


def note_arrivals(line: socket.socket) -> None:
    """Have the kernel note the time of each datagram, where it can."""
    if sys.platform == "linux":
        with suppress(OSError):
            line.setsockopt(socket.SOL_SOCKET, _STAMP, 1)


def arrival_time(ancillary: list[tuple[int, int, bytes]]) -> float:
    """s on `time.monotonic` when a datagram came, just read with this ancillary data; now where that says nothing."""
    # In this order: where the system lets somebody else run in between, the arrival comes out too late, and never
    # earlier than it was. A clock that is mapped by its fastest datagrams would keep one that came too early.
    today, now = time.time_ns(), time.monotonic()
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _STAMP) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            age = 1e-9 * (today - 1_000_000_000 * seconds - nanoseconds)
            return now - age if 0.0 <= age < _OLDEST else now
    return now


def receive(line: socket.socket, size: int) -> tuple[bytes, float]:
    """One datagram of up to `size` bytes, and its `arrival_time`; raises what `socket.recv` raises."""
    if not SPACE:
        return line.recv(size), time.monotonic()
    data, ancillary, _, _ = line.recvmsg(size, SPACE)
    return data, arrival_time(ancillary)
