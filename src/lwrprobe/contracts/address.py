"""Network addresses as a user writes them: HOST:PORT."""

from __future__ import annotations

import socket
from ipaddress import IPv4Address

from lwrprobe.errors import InputError


def as_address(text: str, field: str) -> tuple[str, int]:
    """(IPv4 address, port) of `HOST:PORT`; port 0 means any. Resolves a host name once, here.

    Raises InputError naming `field` for anything else, an unknown host, or a port beyond 65535.
    """
    allowed = "HOST:PORT with an IPv4 address or a known host name, such as 192.0.2.7:49152"
    host, colon, port = str(text).strip().rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) <= 65535):
        raise InputError(field, text, allowed)
    try:
        return str(socket.getaddrinfo(host, None, socket.AF_INET)[0][4][0]), int(port)
    except (OSError, UnicodeError):
        raise InputError(field, text, allowed) from None


def is_loopback(host: str) -> bool:
    """Whether an IPv4 address, as `as_address` returns it, never leaves this host."""
    return IPv4Address(host).is_loopback
