"""The operator's side of an emulator: lines on standard input or on a small control port, while it runs."""

from __future__ import annotations

import gc
import os
import selectors
import socket
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from lwrprobe.cli.help_page import Command
from lwrprobe.contracts import ConnectionLost, InputError, LwrprobeError, UnknownNameError
from lwrprobe.contracts.address import as_address
from lwrprobe.host.real_time import ANSWERS, real_time_priority
from lwrprobe_rig.reactor import Device, Reactor


class OperatorConsole:
    """Hands lines to devices and their answers back.

    With one device a line goes straight to it (`fault loss=0.1`); with several the first word names it
    (`ati load 1=0,0,5,0,0,0`). `quit` ends the emulation.

    Parameters
    ----------
    devices : by name
    port : HOST:PORT of a UDP control port, empty for none; one datagram is one line, the answer goes back
    stdin : listen on standard input, too
    """

    def __init__(self, devices: Mapping[str, Device], port: str = "", stdin: bool = True) -> None:
        self._devices = devices
        self._address = as_address(port, "control") if port else None
        self._stdin = _descriptor_of_stdin() if stdin else None
        self._typed = b""
        self._socket: socket.socket | None = None
        self.reactor: Reactor | None = None

    def open(self, selector: selectors.BaseSelector) -> None:
        if self._address is not None:
            self._socket = line = bound_socket(self._address, "control")
            selector.register(line, selectors.EVENT_READ, lambda: self._from_port(line))
        if self._stdin is not None:
            stdin = self._stdin
            selector.register(stdin, selectors.EVENT_READ, lambda: self._from_stdin(stdin, selector))

    def due(self) -> float:
        return float("inf")

    def work(self, now: float) -> None: ...

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def control(self, line: str) -> str:
        """The answer to one line; an error becomes its sentence."""
        try:
            return self._carry_out(line)
        except LwrprobeError as error:
            return f"error: {error}"

    def _carry_out(self, line: str) -> str:
        if line.strip() == "quit":
            if self.reactor is not None:
                self.reactor.stop()
            return "bye"
        if len(self._devices) == 1:
            return next(iter(self._devices.values())).control(line)
        name, _, rest = line.strip().partition(" ")
        if name not in self._devices:
            raise UnknownNameError("device", name, self._devices)
        return self._devices[name].control(rest)

    def _from_port(self, line: socket.socket) -> None:
        data, peer = line.recvfrom(4096)
        line.sendto(self.control(data.decode("utf-8", "replace")).encode(), peer)

    def _from_stdin(self, stdin: int, selector: selectors.BaseSelector) -> None:
        typed = os.read(stdin, 4096)  # not readline: its buffer would hide further lines from select
        if not typed:
            selector.unregister(stdin)
            return
        *lines, self._typed = (self._typed + typed).split(b"\n")
        for words in lines:
            if words.strip():
                print(self.control(words.decode("utf-8", "replace")), flush=True)


def _descriptor_of_stdin() -> int | None:
    """None where there is no standard input, as under a service manager."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, ValueError, OSError):
        return None


def bound_socket(address: tuple[str, int], field: str) -> socket.socket:
    """A non-blocking UDP socket on `address`; ConnectionLost naming `field` when it is taken or not ours."""
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.setblocking(False)
    try:
        line.bind(address)
    except OSError as error:
        line.close()
        raise ConnectionLost(f"{field}: cannot bind {address[0]}:{address[1]}: {error.strerror}") from None
    return line


def run_command(app: Any, name: str, argv: list[str]) -> int:
    """Run a typer app as `lwrprobe emulate NAME ARGV...`; the exit code, 2 for bad options."""
    for command in app.registered_commands:
        command.cls = Command
    try:
        app(args=argv, prog_name=f"lwrprobe emulate {name}")
    except SystemExit as end:
        return int(end.code or 0)
    except LwrprobeError as error:
        print(f"lwrprobe emulate {name}: {error}", file=sys.stderr)
        return 2
    return 0


def serve(devices: Mapping[str, Device], greeting: str, control: str = "", seconds: float = float("inf")) -> int:
    """Run devices in the foreground until `quit`, an interrupt or the end of `seconds`; the exit code."""
    console = OperatorConsole(devices, control)
    reactor = Reactor([*devices.values(), console])
    console.reactor = reactor
    # What has been loaded stays: a collector that walks through it would hold up the devices' clocks.
    gc.collect()
    gc.freeze()
    print(greeting, flush=True)
    try:
        # A device keeps its own time, whatever else this host does.
        with real_time_priority(ANSWERS):
            reactor.run(seconds)
    except KeyboardInterrupt:
        return 0
    return 0


def joint_angles(text: str) -> np.ndarray:
    """(7,) rad from seven angles in degrees, separated by commas; raises InputError."""
    try:
        angles = np.radians([float(part) for part in text.split(",")])
    except ValueError:
        angles = np.empty(0)
    if angles.shape != (7,) or not np.isfinite(angles).all():
        raise InputError("--joints", text, "seven angles in degrees, separated by commas")
    return angles


def as_seconds(field: str, text: str) -> float:
    """A time that an operator has typed; raises InputError naming `field`."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds <= 60.0:
        raise InputError(field, text, "0 .. 60 s")
    return seconds
