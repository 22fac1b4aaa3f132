"""A decoder and a client as short as can be, by offsets from the layout."""

import socket
import time


def naive_crc(data):
    """Bit by bit, as long division."""
    register = 0x1234
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1) ^ 0x1021 if register & 0x8000 else register << 1
            register &= 0xFFFF
    return register


def unsigned(data, offset, size=4):
    return int.from_bytes(data[offset : offset + size], "big")


def naive_records(data):
    """(stamp, sequence, status 1, status 2, battery, mask, {transducer: counts}) of each record, None if broken."""
    records, at = [], 0
    while len(data) - at >= 18:
        mask = data[at + 17]
        if not mask:
            mask = {18 + 24 * n: 2**n - 1 for n in range(1, 7)}.get(len(data), 0) if at == 0 else 0
        if mask == 0 or mask > 0x3F:
            return None
        active = [i + 1 for i in range(6) if mask >> i & 1]
        if len(data) - at < 18 + 24 * len(active):
            return None
        blocks = {}
        for n, transducer in enumerate(active):
            start = at + 18 + 24 * n
            blocks[transducer] = tuple(
                int.from_bytes(data[start + 4 * k : start + 4 * k + 4], "big", signed=True) for k in range(6)
            )
        head = [unsigned(data, at + 4 * k) for k in range(4)]
        records.append((*head, data[at + 16], mask, blocks))
        at += 18 + 24 * len(active)
    return records or None


class PlainTerminal:
    """Types lines, and reads until a prompt stands at the start of a line."""

    def __init__(self, address):
        host, _, port = address.partition(":")
        self.line = socket.create_connection((host, int(port)), 5.0)
        self.line.settimeout(0.05)

    def read(self, seconds=3.0):
        text, end = b"", time.monotonic() + seconds
        while time.monotonic() < end and not text.endswith(b"\r\n>"):
            try:
                piece = self.line.recv(4096)
            except TimeoutError:
                continue
            if not piece:
                break
            text += piece
        return text.decode("latin-1")

    def ask(self, command):
        self.line.sendall(command.encode() + b"\r\n")
        return self.read()

    def close(self):
        self.line.close()
