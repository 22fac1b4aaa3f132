"""The emulated controller on the wire: its socket, its clock, its faults, its operator."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable

from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe.contracts.address import as_address
from lwrprobe_fri.emulator.controller import Controller
from lwrprobe_fri.emulator.rating import QUALITIES
from lwrprobe_rig.console import as_seconds, bound_socket
from lwrprobe_rig.link import FaultyLink, LinkFaults

_CATCH_UP = 0.05
"""Of a cycle, by which one may be shorter to make up for a late one."""
_FORGOTTEN = 20.0
"""Cycles of delay that are made up for at most."""
_LATE = 0.2
"""Of a cycle, by which one may begin too late and the next one still begin on time."""


class FriEmulator:
    """A `lwrprobe_rig.reactor.Device` that sends a measurement every cycle and takes the answers.

    Parameters
    ----------
    make_controller : called once now and once at every restart
    bind, remote : HOST:PORT of this end (port 0 = any free one) and of the driver
    seed : of the line's faults
    """

    WORDS = ("fault", "drives", "emergency", "acknowledge", "limit", "restart", "start", "stop", "status", "help")

    def __init__(
        self,
        make_controller: Callable[[], Controller],
        bind: str,
        remote: str,
        seed: int = 0,
    ) -> None:
        self._make_controller = make_controller
        self.controller = make_controller()
        self.faults = LinkFaults()
        self.overruns = 0
        """Cycles that this process itself began too late by a good part of one."""
        self._bind = as_address(bind, "bind")
        self._remote = as_address(remote, "remote")
        self._out = FaultyLink(self.faults, seed)
        self._in = FaultyLink(self.faults, seed + 1)
        self._socket: socket.socket | None = None
        self._next = 0.0
        self._behind = 0.0
        self._frozen: bytes | None = None
        self._last = b""

    @property
    def address(self) -> str:
        """HOST:PORT that is really bound."""
        assert self._socket is not None, "open() binds the port"
        host, port = self._socket.getsockname()
        return f"{host}:{port}"

    # --- as a device of the reactor ---

    def open(self, selector: selectors.BaseSelector) -> None:
        self._socket = line = bound_socket(self._bind, "bind")
        selector.register(line, selectors.EVENT_READ, lambda: self._receive(line))
        self._next = time.monotonic()

    def due(self) -> float:
        return min(self._next, self._out.due(), self._in.due())

    def work(self, now: float) -> None:
        self._deliver(now)
        if now >= self._next:
            self._begin_cycle(now)
            self._deliver(now)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def control(self, line: str) -> str:
        """One line of the operator; `help` lists them."""
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        controller = self.controller
        match word:
            case "fault":
                self.set_faults(rest)
            case "drives" if rest in ("on", "off"):
                controller.acknowledge() if rest == "on" else controller.drives_off()
            case "emergency":
                controller.emergency_stop()
            case "acknowledge":
                controller.acknowledge()
            case "limit":
                controller.violate("limit violation by the operator")
            case "restart":
                self._restart(as_seconds("restart", rest or "1"))
            case "start":
                controller.fri_start(1.0)
            case "stop":
                controller.fri_stop()
            case "status":
                return f"{controller.describe()}; {self.overruns} overruns"
            case "help":
                return (
                    "fault NAME=VALUE,... | fault none | drives on|off | emergency | acknowledge | limit | "
                    "restart [S] | start | stop | status | quit"
                )
            case _:
                raise UnknownNameError("control word", line.strip(), self.WORDS)
        return "ok"

    def set_faults(self, text: str) -> None:
        """`loss=0.05,delay=0.002,quality=bad,freeze`, or `none`; what is not named stays as it is."""
        for item in filter(None, text.split(",")):
            name, _, value = item.strip().partition("=")
            match name:
                case "none":
                    self.faults.clear()
                    self._frozen = None
                    self.controller.rating.ceiling = 3
                case "freeze":
                    self._frozen = self._last if value in ("", "1", "on") else None
                case "quality":
                    if value not in QUALITIES:
                        raise InputError("fault quality", value, ", ".join(QUALITIES))
                    self.controller.rating.ceiling = QUALITIES.index(value)
                case _:
                    self.faults.set(name, value)

    # --- insides ---

    def _begin_cycle(self, now: float) -> None:
        cycle = self.controller.settings.cycle
        self._last = self.controller.tick(now)
        self._out.put(self._last if self._frozen is None else self._frozen, now)
        late = now - self._next
        self._next += cycle
        if late > _LATE * cycle:
            # This process was kept from running. The next cycle is a full one, as the real controller's always are:
            # else the remote had less to answer in, and would be rated for what happened here. What was lost is made
            # up for in small parts, so that the mean rate stays, but for a long pause, after which the clock goes on.
            self.overruns += 1
            self._behind = min(self._behind + late, _FORGOTTEN * cycle)
            self._next = now + cycle
        elif self._behind > 0.0:
            part = min(self._behind, _CATCH_UP * cycle)
            self._behind -= part
            self._next -= part

    def _deliver(self, now: float) -> None:
        for data in self._in.arrived(now):
            self.controller.receive(data, now)
        for data in self._out.arrived(now):
            if self._socket is not None:
                self._socket.sendto(data, self._remote)

    def _receive(self, line: socket.socket) -> None:
        now = time.monotonic()
        while True:
            try:
                data, peer = line.recvfrom(2048)
            except BlockingIOError:
                break
            if peer[0] == self._remote[0]:
                self._in.put(data, now)
        self._deliver(now)

    def _restart(self, seconds: float) -> None:
        """As after a switch-off: silent for a while, then monitor mode with new counters, the arm where it was."""
        self.controller = self._make_controller()
        self._frozen = None
        self._next = time.monotonic() + seconds
