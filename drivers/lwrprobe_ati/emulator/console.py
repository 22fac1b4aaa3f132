"""The emulated telnet line: echo, answer, prompt; in pieces and with chatter when asked for."""

from __future__ import annotations

import contextlib
import re
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import ConnectionLost

_OPTIONS = {251: "WILL", 252: "WONT", 253: "DO", 254: "DONT"}
_NAMES = {1: "ECHO", 3: "SUPPRESS-GO-AHEAD", 24: "TERMINAL-TYPE", 31: "WINDOW-SIZE"}
_GREETING = "WLAN:  2017/03/16 10:33:42 Telnet connection opened by client"
_LONGEST_LINE = 4096
"""Bytes without an end of line that are kept."""
_CHATTER = "WLAN:  2017/03/16 10:35:07 Signal strength -52 dBm"


class TelnetLine:
    """Serves one client at a time; a second one is turned away until the first is gone or `free` is called.

    Parameters
    ----------
    address : to listen on, port 0 = any free one
    answer : one line in, lines of the reply out
    """

    def __init__(self, address: tuple[str, int], answer: Callable[[str], list[str]], seed: int) -> None:
        self.pieces = 0.0
        """s between the pieces in which an answer comes, 0 = at once."""
        self.chatter = 0.0
        """s between unsolicited lines, 0 = none."""
        self.deaf_until = 0.0
        """Clients are turned away until then."""
        self._address = address
        self._answer = answer
        self._random = np.random.default_rng(seed)
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._typed = b""
        self._pending: deque[bytes] = deque()
        self._next_piece = float("inf")
        self._next_chatter = float("inf")

    @property
    def port(self) -> int:
        assert self._listener is not None, "open() binds the port"
        return self._listener.getsockname()[1]

    def open(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setblocking(False)
        try:
            listener.bind(self._address)
        except OSError as error:
            listener.close()
            where = f"{self._address[0]}:{self._address[1]}"
            raise ConnectionLost(f"telnet: cannot listen on {where}: {error.strerror}") from None
        listener.listen(4)
        self._listener = listener
        selector.register(listener, selectors.EVENT_READ, lambda: self._accept(listener, selector))

    def close(self) -> None:
        self.free()
        if self._listener is not None:
            self._listener.close()

    def free(self) -> None:
        """Drop the client, as UDP command 5 does."""
        if self._client is not None and self._selector is not None:
            self._selector.unregister(self._client)
            self._client.close()
        self._client = None
        self._typed = b""
        self._pending.clear()
        self._next_piece = self._next_chatter = float("inf")

    def due(self) -> float:
        return min(self._next_piece, self._next_chatter)

    def work(self, now: float) -> None:
        if now >= self._next_piece:
            self._send_now(self._pending.popleft())
            self._next_piece = now + self.pieces if self._pending else float("inf")
        if now >= self._next_chatter:
            self._next_chatter = now + self.chatter if self.chatter else float("inf")
            self.say([_CHATTER])

    def say(self, lines: list[str]) -> None:
        """Unsolicited lines and a new prompt."""
        self._send("".join(f"\r\n{line}" for line in lines) + "\r\n>")

    def set_chatter(self, seconds: float, now: float) -> None:
        self.chatter = seconds
        self._next_chatter = now + seconds if seconds else float("inf")

    def _accept(self, listener: socket.socket, selector: selectors.BaseSelector) -> None:
        with contextlib.suppress(OSError):
            client, _ = listener.accept()
            if self._client is not None or time.monotonic() < self.deaf_until:
                client.close()
                return
            client.setblocking(False)
            self._client = client
            selector.register(client, selectors.EVENT_READ, lambda: self._receive(client))
            self._send(f"{_GREETING}\r\n>")
            if self.chatter:
                self._next_chatter = 0.0

    def _receive(self, client: socket.socket) -> None:
        try:
            typed = client.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            typed = b""
        if not typed:
            self.free()
            return
        self._typed += self._without_options(typed)
        while match := re.search(rb"\r\n|\r\x00|\n", self._typed):
            line, self._typed = self._typed[: match.start()], self._typed[match.end() :]
            self._reply(line.decode("latin-1"))
        if len(self._typed) > _LONGEST_LINE:
            # As in a device with a small buffer the line is lost; what follows is a new one.
            self._typed = b""
            self.say(["Error: line too long"])

    def _reply(self, line: str) -> None:
        answer = "".join(f"{text}\r\n" for text in self._answer(line.strip()))
        self._send(f"{line}\r\n{answer}\r\n>")

    def _without_options(self, typed: bytes) -> bytes:
        """Telnet options that a client offers: each is mentioned in a line and otherwise ignored."""
        for kind, option in re.findall(rb"\xff([\xfb-\xfe])(.)", typed, re.DOTALL):
            name = _NAMES.get(option[0], str(option[0]))
            self.say([f"Telnet: {_OPTIONS[kind[0]]} {name}"])
        return re.sub(rb"\xff[\xfb-\xfe].", b"", typed, flags=re.DOTALL)

    def _send(self, text: str) -> None:
        data = text.encode("latin-1", "replace")
        if not self.pieces and not self._pending:
            self._send_now(data)
            return
        while data:
            cut = int(self._random.integers(1, 40))
            self._pending.append(data[:cut])
            data = data[cut:]
        if self._next_piece == float("inf"):
            self._next_piece = 0.0

    def _send_now(self, data: bytes) -> None:
        if self._client is None:
            return
        try:
            self._client.send(data)
        except OSError:
            self.free()
