"""The device's text console: one command, one reply, whatever else comes in between."""

from __future__ import annotations

import contextlib
import re
import socket
import time

from lwrprobe.contracts import ConnectionLost, DeviceRefused, DriverError

_PROMPT = re.compile(r"(?:^|\n)>\s*$")
_OPTION = re.compile(rb"\xff(?:[\xfb-\xfe].|\xfa.*?\xff\xf0|[\xf0-\xf9])", re.DOTALL)
_REFUSAL = re.compile(r"(?im)^.*\b(error|unknown|invalid|illegal|bad command)\b.*$")
_AFTER_PROMPT = 0.3  # s; a prompt may belong to an unsolicited line, the reply then follows


class Console:
    """A telnet dialogue that reads until the reply it expects and the prompt behind it have come.

    Replies may come in pieces, be echoed, be preceded by log lines or by a prompt that belongs to one.
    """

    def __init__(self, address: tuple[str, int], timeout: float) -> None:
        self._address = address
        self._timeout = timeout
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Connect and wait for the greeting; ConnectionLost when there is none, as for a second client."""
        try:
            self._socket = socket.create_connection(self._address, self._timeout)
        except OSError as error:
            raise ConnectionLost(f"console {self._where}: {error.strerror or error}") from None
        try:
            self.ask("", "")
        except DriverError as error:
            self.close()
            hint = "end that one, or set drivers.ati.take_over = true where it is dead"
            raise ConnectionLost(f"{error}; another client may hold the console: {hint}") from None

    def close(self) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
        self._socket = None

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def closed_by_device(self) -> bool:
        """Whether an open console was closed at the other end; log lines that have come meanwhile are dropped."""
        if self._socket is None:
            return False
        self._socket.setblocking(False)
        try:
            while self._socket.recv(4096):
                pass
        except BlockingIOError:
            return False
        except OSError:
            return True
        return True

    def ask(self, command: str, expected: str) -> str:
        """The text that came after `command`, up to a prompt, once the pattern `expected` is in it.

        Raises DeviceRefused, quoting the reply, when a prompt came without it, and ConnectionLost when nothing
        came any more.
        """
        line = self._send(command)
        pattern = re.compile(expected, re.MULTILINE)
        text, end = "", time.monotonic() + self._timeout
        patience = end
        while True:
            left = min(end, patience) - time.monotonic()
            piece = self._receive(line, left) if left > 0.0 else b""
            text += piece.decode("latin-1")
            reply = _without_echo(text, command)
            prompted = _PROMPT.search(text) is not None
            if prompted and pattern.search(reply):
                return reply
            if not piece:
                raise self._no_reply(command, reply, prompted)
            patience = time.monotonic() + _AFTER_PROMPT if prompted else end

    def _send(self, command: str) -> socket.socket:
        """The connection that the command went out on."""
        if self._socket is None:
            raise ConnectionLost(f"console {self._where}: not connected")
        try:
            self._socket.sendall(command.encode("ascii") + b"\r\n")
            return self._socket
        except OSError as error:
            self.close()
            raise ConnectionLost(f"console {self._where}: {error.strerror or error}") from None

    def _receive(self, line: socket.socket, seconds: float) -> bytes:
        """Some bytes, or none when the time is over."""
        try:
            line.settimeout(seconds)
            piece = line.recv(4096)
        except TimeoutError:
            return b""
        except OSError as error:
            self.close()
            raise ConnectionLost(f"console {self._where}: {error.strerror or error}") from None
        if not piece:
            self.close()
            raise ConnectionLost(f"console {self._where}: the device has closed the connection")
        return _OPTION.sub(b"", piece).replace(b"\r", b"")

    def _no_reply(self, command: str, reply: str, prompted: bool) -> Exception:
        refusal = _REFUSAL.search(reply)
        said = (refusal[0] if refusal else reply).strip() or "nothing"
        if prompted:
            return DeviceRefused(f"console {self._where}: {command!r} was answered with: {said[:200]}")
        self.close()
        return ConnectionLost(f"console {self._where}: no full reply to {command!r} within {self._timeout:g} s")

    @property
    def _where(self) -> str:
        return f"{self._address[0]}:{self._address[1]}"


def _without_echo(text: str, command: str) -> str:
    """The device echoes the line, some terminals do so again: neither is part of the reply."""
    if not command:
        return text
    return re.sub(rf"(?m)^>?\s*{re.escape(command)}\s*$\n?", "", text)
