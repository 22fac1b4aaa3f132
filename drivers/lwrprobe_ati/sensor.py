"""One transducer of the ATI Wireless F/T: set-up, stream and counters."""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import asdict

from lwrprobe.contracts import ConnectionLost, DriverError, WrenchSample
from lwrprobe.contracts.address import as_address
from lwrprobe.host.arrival_time import note_arrivals, receive
from lwrprobe_ati import shutdown_hook
from lwrprobe_ati.config import AtiConfig
from lwrprobe_ati.console import Console
from lwrprobe_ati.setup import Setup, set_up, take_bias
from lwrprobe_ati.stream import Stream
from lwrprobe_ati.wire import Command, encode_command

_BUFFER = 1 << 20
_ORDER = ("received", "lost", "repeated", "old", "implausible")
_AT_ONCE = 4096  # datagrams taken by one read at most, so that it always returns
_FREEING = 0.3  # s between two attempts to get the console
_NOTICING = 1.0  # s for which it is tried


class AtiSensor:
    """One transducer of the device.

    `open` sets it up through the console, reads its calibration and starts the stream. Times of samples are those
    of `time.monotonic`, mapped from the device's stamps.
    """

    def __init__(self, config: AtiConfig) -> None:
        self.config = config
        self.rate = float(config.rate)
        self.latency = _known_latency(config)
        self.restarts = 0
        """How often start had to be sent again because nothing came."""
        self.setup: Setup | None = None
        self.stream: Stream | None = None
        self._console = Console(as_address(config.telnet, "drivers.ati.telnet"), config.timeout)
        self._socket: socket.socket | None = None
        self._sequence = 0
        self._last_received = 0.0
        self._asked = 0.0
        self._valid_from = 0.0
        self._emptied = 0.0
        self._owns_stream = False
        self._last_counters: dict[str, int] = {}
        self.ahead: int | None = None
        """`Stream.ahead` of the last stream that was closed."""

    def __enter__(self) -> AtiSensor:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """Whether it streams."""
        return self._socket is not None

    def open(self) -> None:
        """Connect, set up, stream; returns when the first record has come. Raises DriverError."""
        if self._socket is not None:
            return
        self._socket = self._connected_socket()
        try:
            self._open_console()
            # Only now: whoever holds the console goes on streaming.
            self._owns_stream = True
            shutdown_hook.register(self._stop_stream)
            self._stop_stream()
            self.setup = set_up(self._console, self.config)
            self.stream = Stream(self.config, self.setup.calibration)
            self._start_stream(self.stream)
        except DriverError:
            self.close()
            raise

    def read(self) -> list[WrenchSample]:
        """All samples since the last call, oldest first, bad ones flagged; never waits.

        Sends start again when the device has been silent for a while. Raises ConnectionLost when it stays silent,
        and when it was switched off and on in between: its settings and bias are then unknown.
        """
        stream = self._streaming()
        samples = [sample for sample in self._received(stream) if sample.time >= self._valid_from]
        if stream.packets.rebooted:
            raise ConnectionLost("the sensor's clock has jumped: it was restarted and has to be opened again")
        self._watch_silence()
        return samples

    def tare(self) -> None:
        """Let the device subtract its present reading; what was measured before is thrown away."""
        self._streaming()
        if not self._console.is_open:
            self._open_console()
        take_bias(self._console, self.config.transducer)
        self._last_received = self._valid_from = time.monotonic()

    def stop(self) -> None:
        """Stop streaming."""
        if self._socket is not None:
            self._stop_stream()

    def close(self) -> None:
        """Stop streaming, release console and port."""
        if self._socket is None:
            return
        self._last_counters = self.counters()
        if self.stream is not None:
            self.ahead = self.stream.ahead
        self._stop_stream()
        self._console.close()
        self._socket.close()
        self._socket = None
        self.stream = None
        self._owns_stream = False
        shutdown_hook.unregister(self._stop_stream)

    def counters(self) -> dict[str, int]:
        """What has been counted since `open`, or until the last `close`."""
        if self.stream is None:
            return self._last_counters
        packets = self.stream.packets
        order = {name: getattr(packets, name) for name in _ORDER}
        return order | asdict(self.stream.traffic) | {"restarts": self.restarts}

    # --- insides ---

    def _streaming(self) -> Stream:
        if self.stream is None:
            raise DriverError("the sensor is not open")
        return self.stream

    def _data_line(self) -> socket.socket:
        if self._socket is None:
            raise DriverError("the sensor is not open")
        return self._socket

    def _connected_socket(self) -> socket.socket:
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        line.setblocking(False)
        note_arrivals(line)
        try:
            line.bind(as_address(self.config.local, "drivers.ati.local"))
            # Connected: the kernel drops what anybody else sends.
            line.connect(as_address(self.config.udp, "drivers.ati.udp"))
        except OSError as error:
            line.close()
            where = f"{self.config.local} (drivers.ati.local) to {self.config.udp} (drivers.ati.udp)"
            raise ConnectionLost(f"no data line from {where}: {error.strerror}") from None
        return line

    def _open_console(self) -> None:
        """Connect; the device may need a moment to notice that the client before has gone.

        The command that frees a console goes out between two attempts only: it has no answer, and one that arrives
        after the connection closes the new client instead of the old one.
        """
        end = time.monotonic() + _NOTICING
        while True:
            try:
                return self._console.open()
            except ConnectionLost:
                if time.monotonic() > end:
                    raise
            if self.config.take_over:
                self._send(Command.RESET_TELNET)
            time.sleep(_FREEING)

    def _start_stream(self, stream: Stream) -> None:
        end = time.monotonic() + self.config.timeout
        self._discard()
        while stream.last is None:
            now = time.monotonic()
            if now >= end:
                raise ConnectionLost(self._nothing_came(stream))
            if now - self._asked >= 0.25:
                self._send(Command.START)
                self._asked = now
            time.sleep(0.002)
            self._received(stream)
        self._last_received = self._asked = time.monotonic()

    def _received(self, stream: Stream) -> list[WrenchSample]:
        samples: list[WrenchSample] = []
        line = self._data_line()
        for _ in range(_AT_ONCE):
            before = time.monotonic()
            try:
                data, arrival = receive(line, 2048)
            except BlockingIOError:
                self._emptied = before
                break
            except ConnectionRefusedError:
                continue  # nobody listens there just now: that is silence
            except OSError as error:
                raise ConnectionLost(f"the data line to {self.config.udp} broke: {error.strerror}") from None
            # It cannot have come before all was read last: that bounds what a jump of the system's clock may do.
            samples += stream.samples(data, max(arrival, self._emptied), time.monotonic())
        if samples:
            self._last_received = time.monotonic()
        return samples

    def _discard(self) -> None:
        """Throw away what an earlier stream has left in the buffer."""
        line = self._data_line()
        for _ in range(_AT_ONCE):
            try:
                line.recv(2048)
            except BlockingIOError:
                break
            except OSError:
                continue

    def _watch_silence(self) -> None:
        now = time.monotonic()
        silent = now - self._last_received
        if silent > self.config.lost_after:
            raise ConnectionLost(f"the sensor at {self.config.udp} has been silent for {silent:.2f} s")
        if silent > self.config.silence and now - self._asked > self.config.silence:
            if self._console.closed_by_device():
                self._owns_stream = False
                raise ConnectionLost(
                    f"the sensor at {self.config.udp} sends nothing any more and has closed its console: another "
                    "client has taken it over, or it was restarted"
                )
            self._asked = now
            self.restarts += 1
            self._send(Command.START)

    def _stop_stream(self) -> None:
        """Twice, since nothing acknowledges it; another client's stream is left alone."""
        if not self._owns_stream:
            return
        self._send(Command.STOP)
        self._send(Command.STOP)

    def _send(self, command: Command) -> None:
        self._sequence += 1
        line = self._socket  # None when a signal comes while all is half gone
        with contextlib.suppress(OSError):
            if line is not None:
                line.send(encode_command(command, self._sequence))

    def _nothing_came(self, stream: Stream) -> str:
        t = stream.traffic
        if not t.datagrams:
            return f"the sensor at {self.config.udp} sends nothing to {self.config.local}"
        return (
            f"no usable record from {self.config.udp}: of {t.datagrams} datagrams {t.malformed} were malformed, "
            f"{t.absent} without transducer {self.config.transducer}"
        )


def _known_latency(config: AtiConfig) -> float:
    """s: half of what is averaged into a record and half of the filter's window; the radio comes on top."""
    converter = config.rate * config.oversampling
    return 0.5 / config.rate + 0.5 * (config.taps - 1) / converter
