"""The emulated device on the wire: console, data port, clock, faults and operator."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable, Iterable

import numpy as np

from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe.contracts.address import as_address
from lwrprobe_ati.emulator.console import TelnetLine
from lwrprobe_ati.emulator.datagrams import read_order, record_bytes
from lwrprobe_ati.emulator.dialogue import Dialogue, Settings
from lwrprobe_ati.emulator.transducer import Transducer, Wrench
from lwrprobe_rig.console import as_seconds, bound_socket
from lwrprobe_rig.link import FaultyLink, LinkFaults

INPUTS = range(1, 7)
_START, _STOP, _RESET_TELNET = 1, 2, 5
_TICKS = 4096
_RED, _GREEN = 1, 2
_DATAGRAMS_PER_SECOND = 250
_HOPELESS = 0.25  # s of lag after which records are skipped instead of sent in a burst
_HELP = (
    "load T=Fx,Fy,Fz,Tx,Ty,Tz (N, N-mm) | fault NAME=VALUE,... | fault none | saturate T on|off | bridge T on|off | "
    "stuck T on|off | power T on|off | plug T in|out | battery low|ok | restart [S] | status | quit"
)


class AtiEmulator:
    """A `lwrprobe_rig.reactor.Device`: settings over telnet, records over UDP from the port that took the start.

    Parameters
    ----------
    telnet, udp : HOST:PORT to listen on, port 0 = any free one
    active : transducers that are powered at the start
    noise : steps of a gage, standard deviation (one step is about 0.6 mN)
    first_stamp, first_sequence : of the first record, to try the wrap; the stamp counts 1/4096 s
    sticky : the first destination is kept until a restart, as users have seen
    """

    WORDS = ("load", "fault", "saturate", "bridge", "stuck", "power", "plug", "battery", "restart", "status", "help")

    def __init__(
        self,
        telnet: str,
        udp: str,
        active: Iterable[int] = (1,),
        noise: float = 1.0,
        seed: int = 0,
        first_stamp: int = 0x4E886762,
        first_sequence: int = 0,
        sticky: bool = False,
    ) -> None:
        self.transducers = {number: Transducer(number, noise, seed) for number in INPUTS}
        self._active = tuple(active)
        if not self._active or not set(self._active) <= set(INPUTS):
            raise InputError("active", self._active, "numbers from 1 to 6")
        self.settings = Settings()
        self.faults = LinkFaults()
        self.sent = 0
        self.refused = 0
        """Commands with a wrong length or CRC."""
        self._udp = as_address(udp, "udp")
        dialogue = Dialogue(self.settings, self.transducers, time.monotonic, lambda: self._restart(1.0))
        self.console = TelnetLine(as_address(telnet, "telnet"), dialogue.answer, seed)
        self._out = FaultyLink(self.faults, seed + 2)
        self._in = FaultyLink(self.faults, seed + 3)
        self._first_stamp, self._sequence = first_stamp, first_sequence
        self._sticky = sticky
        self._socket: socket.socket | None = None
        self._destination: tuple[str, int] | None = None
        self._sender: tuple[str, int] | None = None
        self._streaming = False
        self._left = 0
        self._booted = 0.0
        self._next = float("inf")
        self._measured_at: Callable[[float], float] = lambda instant: instant
        self._bundle: list[bytes] = []
        self._freezing = False
        self._last = b""
        self._battery_low = False
        self._power_up()

    @property
    def telnet_address(self) -> str:
        return f"{self._udp[0]}:{self.console.port}"

    @property
    def udp_address(self) -> str:
        assert self._socket is not None, "open() binds the port"
        host, port = self._socket.getsockname()
        return f"{host}:{port}"

    @property
    def sequence(self) -> int:
        """Number of the next record."""
        return self._sequence

    @property
    def streaming(self) -> bool:
        return self._streaming

    def set_load(
        self, transducer: int, wrench: Wrench, measured_at: Callable[[float], float] = lambda instant: instant
    ) -> None:
        """Where the transducer's force and torque come from, in N and N·m.

        `measured_at` says when the load of an instant is known; a record waits for that, and keeps its stamp.
        """
        self.transducers[transducer].load, self._measured_at = wrench, measured_at

    # --- as a device of the reactor ---

    def open(self, selector: selectors.BaseSelector) -> None:
        self._socket = line = bound_socket(self._udp, "udp")
        try:
            self.console.open(selector)
        except BaseException:
            line.close()
            raise
        selector.register(line, selectors.EVENT_READ, lambda: self._receive(line))
        self._booted = time.monotonic()

    def due(self) -> float:
        return min(self._measured_at(self._next), self._out.due(), self._in.due(), self.console.due())

    def work(self, now: float) -> None:
        self.console.work(now)
        self._obey(now)
        if now - self._next > _HOPELESS:
            # This process was kept from running: the records of that time are lost, with their numbers.
            skipped = int((now - self._next) * self.settings.rate)
            self._sequence += skipped
            self._next += skipped / self.settings.rate
        while self._measured_at(self._next) <= now:
            self._measure(self._next)
            self._next += 1.0 / self.settings.rate
        for data in self._out.arrived(now):
            self._transmit(data)

    def close(self) -> None:
        self.console.close()
        if self._socket is not None:
            self._socket.close()

    def control(self, line: str) -> str:
        """One line of the operator; `help` lists them."""
        word, _, rest = line.strip().partition(" ")
        words = rest.split()
        match word, words:
            case "load", [text]:
                self.set_loads(text)
            case "fault", _:
                self.set_faults(rest)
            case "saturate", [number, ("on" | "off") as state]:
                self._input(number).forced_saturation = state == "on"
            case "bridge", [number, ("on" | "off") as state]:
                self._input(number).bridge_low = state == "on"
            case "stuck", [number, ("on" | "off") as state]:
                self._input(number).stuck = state == "on"
            case "power", [number, ("on" | "off") as state]:
                self._input(number).set_power(state == "on")
            case "plug", [number, ("in" | "out") as state]:
                self._input(number).plug(state == "in")
            case "battery", [("low" | "ok") as state]:
                self._battery_low = state == "low"
            case "restart", _:
                self._restart(as_seconds("restart", rest or "1"))
            case "status", _:
                return self._describe()
            case "help", _:
                return _HELP
            case _:
                raise UnknownNameError("control line", line.strip(), self.WORDS)
        return "ok"

    def set_loads(self, text: str) -> None:
        """`2=1,-2,3.5,10,-20,30`: transducer, N and N·mm; several separated by `;`."""
        for item in filter(None, text.split(";")):
            number, _, values = item.partition("=")
            try:
                wrench = np.array([float(v) for v in values.split(",")])
            except ValueError:
                wrench = np.empty(0)
            if wrench.shape != (6,) or not np.isfinite(wrench).all():
                raise InputError("load", item, "TRANSDUCER=Fx,Fy,Fz,Tx,Ty,Tz in N and N-mm")
            wrench[3:] *= 1e-3
            self._input(number.strip()).load = _constant(wrench)

    def set_faults(self, text: str) -> None:
        """`loss=0.05,freeze,pieces=0.002,chatter=0.1`, or `none`; what is not named stays as it is."""
        for item in filter(None, text.split(",")):
            name, _, value = item.strip().partition("=")
            match name:
                case "none":
                    self._clear_faults()
                case "freeze":
                    self._freezing = value in ("", "1", "on")
                case "pieces":
                    self.console.pieces = as_seconds(f"fault {name}", value)
                case "chatter":
                    self.console.set_chatter(as_seconds(f"fault {name}", value), time.monotonic())
                case _:
                    self.faults.set(name, value)

    # --- insides ---

    def _measure(self, instant: float) -> None:
        """One record; several go into one datagram at high rates."""
        record = self._record(instant)
        if not (self._freezing and self._last):
            self._last = record
        self._bundle.append(self._last)
        if self.settings.dumping:
            self.console.say([self._dump_line(record)])
        if len(self._bundle) >= -(-self.settings.rate // _DATAGRAMS_PER_SECOND):
            self._out.put(b"".join(self._bundle), instant)
            self._bundle = []
        if self._left:
            self._left -= 1
            if not self._left:
                self._stop()

    def _record(self, instant: float) -> bytes:
        powered = [t for t in self.transducers.values() if t.powered]
        mask = sum(1 << (t.number - 1) for t in powered)
        words = [self._common_lights(), 0]
        blocks = []
        for transducer in powered:
            counts, saturated = transducer.counts(instant)
            blocks.append(counts)
            group, place = divmod(transducer.number - 1, 3)
            words[group] |= (_RED if saturated else _GREEN) << (2 * place) | 1 << (16 + 2 * place)
            words[group] |= saturated << (24 + place) | transducer.bridge_low << (27 + place)
        stamp = self._first_stamp + round((instant - self._booted) * _TICKS)
        record = record_bytes(stamp, self._sequence, words[0], words[1], 1 if self._battery_low else 7, mask, blocks)
        self._sequence += 1
        return record

    def _common_lights(self) -> int:
        """WLAN, external power and battery in status word 1."""
        return _GREEN << 6 | _GREEN << 8 | (_RED if self._battery_low else _GREEN) << 10

    def _dump_line(self, record: bytes) -> str:
        return f"{record[0:4].hex()} {record[4:8].hex()} {record[8:12].hex()} {record[12:16].hex()} " + " ".join(
            part.hex() for part in (record[16:17], record[17:18], record[18:22], record[22:26], record[26:30])
        )

    def _receive(self, line: socket.socket) -> None:
        now = time.monotonic()
        while True:
            try:
                data, peer = line.recvfrom(2048)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue
            self._sender = peer
            self._in.put(data, now)
        self._obey(now)

    def _obey(self, now: float) -> None:
        for data in self._in.arrived(now):
            order = read_order(data)
            if now < self._booted:
                continue
            if order is None:
                self.refused += 1
            elif order.code == _START:
                self._start(order.packets, now)
            elif order.code == _STOP:
                self._stop()
            elif order.code == _RESET_TELNET:
                self.console.free()

    def _start(self, packets: int, now: float) -> None:
        if not (self._sticky and self._destination):
            self._destination = self._sender
        self._left = packets
        if not self._streaming:
            self._streaming = True
            self._next = now + 1.0 / self.settings.rate

    def _stop(self) -> None:
        self._streaming = False
        self._next = float("inf")
        self._bundle = []

    def _transmit(self, data: bytes) -> None:
        if not self.settings.transmitting or self._destination is None or self._socket is None:
            return
        try:
            self._socket.sendto(data, self._destination)
            self.sent += 1
        except OSError:
            pass  # as over the radio: it is lost

    def _restart(self, seconds: float) -> None:
        """As after a switch-off: stream and console are gone, bias and settings too, the clock is arbitrary."""
        self._stop()
        self.console.free()
        self._clear_faults()
        self._destination = None
        self._sequence = 0
        self._first_stamp = 0x1000
        self._booted = self.console.deaf_until = time.monotonic() + seconds
        self._last = b""
        self._power_up()

    def _power_up(self) -> None:
        self.settings.rate, self.settings.oversampling = 125, 32
        for transducer in self.transducers.values():
            transducer.set_power(transducer.number in self._active)
            transducer.set_bias(False, 0.0)

    def _clear_faults(self) -> None:
        self.faults.clear()
        self._freezing = False
        self._battery_low = False
        self.console.pieces = 0.0
        self.console.set_chatter(0.0, 0.0)
        for transducer in self.transducers.values():
            transducer.forced_saturation = transducer.bridge_low = transducer.stuck = False

    def _input(self, number: str) -> Transducer:
        if number not in {str(n) for n in INPUTS}:
            raise InputError("transducer", number, "1 .. 6")
        return self.transducers[int(number)]

    def _describe(self) -> str:
        state = "streaming" if self._streaming else "quiet"
        powered = "".join(str(t.number) for t in self.transducers.values() if t.powered)
        return (
            f"{state} to {self._destination} at {self.settings.rate} Hz, transducers {powered}, sequence "
            f"{self._sequence}, {self.sent} datagrams sent, {self.refused} commands refused"
        )


def _constant(wrench: np.ndarray) -> Wrench:
    return lambda now: wrench
