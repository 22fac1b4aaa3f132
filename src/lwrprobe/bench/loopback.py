"""Addresses on this host that nobody listens to, for benches over real sockets."""

from __future__ import annotations

import socket


def free_addresses(count: int, kind: int = socket.SOCK_DGRAM) -> list[str]:
    """`127.0.0.1:PORT` each, of sockets of one kind that were free a moment ago."""
    probes = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    addresses = [f"127.0.0.1:{probe.getsockname()[1]}" for probe in probes]
    for probe in probes:
        probe.close()
    return addresses
