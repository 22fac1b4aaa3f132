"""Emulated devices in processes of their own, and addresses on this host that nobody listens to."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from lwrprobe.contracts import DriverError

_RUN = (
    "import sys; from lwrprobe.contracts.plugins import load; sys.exit(load('emulator', sys.argv[1]).run(sys.argv[2:]))"
)


def free_addresses(count: int, kind: int = socket.SOCK_DGRAM) -> list[str]:
    """`127.0.0.1:PORT` each, of sockets of one kind that were free a moment ago."""
    probes = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    addresses = [f"127.0.0.1:{probe.getsockname()[1]}" for probe in probes]
    for probe in probes:
        probe.close()
    return addresses


@contextmanager
def emulated(name: str, *arguments: str) -> Iterator[None]:
    """An emulator, by its plug-in's name, while the block runs; raises DriverError when it does not start."""
    process = subprocess.Popen(
        [sys.executable, "-c", _RUN, name, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        if not process.stdout.readline():  # type: ignore[union-attr]
            raise DriverError(f"the emulator {name} did not start")
        yield
    finally:
        process.kill()
        process.communicate()
