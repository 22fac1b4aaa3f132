"""The runner's end of the line to the controller: the answering process does what has to be done in time."""

from __future__ import annotations

import select
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from lwrprobe.contracts import ConnectionLost, DeviceRefused, DriverError
from lwrprobe.contracts.address import as_address
from lwrprobe.host.arrival_time import note_arrivals
from lwrprobe_fri import messages as m
from lwrprobe_fri.answering import command_line, drives_of, set_time_out, silence_of
from lwrprobe_fri.config import FriConfig
from lwrprobe_fri.krl import PROGRAMS, Request
from lwrprobe_fri.messages import Traffic
from lwrprobe_fri.wire import JOINTS, Measurement, decode_measurement

_PATIENCE = 5  # cycles without set point whose way the next one may make up for
_KEPT = 1000  # measurements that nobody has read
_START_UP = 20.0  # s that a new process may take to say its first word, on a busy machine
_BUFFER = 1 << 20


@dataclass(slots=True, frozen=True)
class Arrival:
    """One admitted measurement: when it reached this host, how many cycles after the one before, whether its answer was
    late."""

    index: int
    time: float
    steps: int
    measurement: Measurement
    late: bool


class Connection:
    """Requests to the arm and its answers; used by one thread at a time."""

    def __init__(self, config: FriConfig) -> None:
        self.config = config
        self.loss = ""
        """Why command mode ended without being asked to; empty while all is well."""
        self.unasked = False
        """Then: nobody has stopped the arm, and no limit has."""
        self.scheduling = ""
        """How the system schedules the answering process, in words."""
        self._program = PROGRAMS[config.krl]
        self._speed = [radians(v) for v in config.speed]
        self._range = [radians(v) for v in config.range]
        self._traffic = Traffic()
        self._timing: deque[tuple[float, float]] = deque(maxlen=20_000)
        self._set_point: tuple[tuple[float, ...], int] | None = None
        self._following = False
        self._take_overs = 0
        self._orders = 0
        self._first: Measurement | None = None
        self._latest: Arrival | None = None
        self._unread: deque[Arrival] = deque(maxlen=_KEPT)
        self._report: m.Report | None = None
        self._silent = True
        self._answered = False
        self._failure = ""
        self._line: socket.socket | None = None
        self._process: subprocess.Popen | None = None

    def open(self) -> None:
        """Bind the socket and begin to answer; returns when the first measurement has come."""
        controller = self._bound_socket()
        set_time_out(controller, self.config.silence)
        note_arrivals(controller)
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (self._line, theirs):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        with controller, theirs:
            handed = (controller.fileno(), theirs.fileno())
            # A session of its own: a Ctrl-C at the terminal is the runner's to deal with.
            self._process = subprocess.Popen(
                command_line(self.config, controller, theirs),
                pass_fds=handed,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        try:
            self._await_first_word()
            self.wait_until(lambda arrival: True, self.config.connect_timeout, "no measurement came")
        except DriverError:
            self.close()
            raise

    def close(self) -> None:
        """End the process and release the port; the controller notices the silence."""
        if self._line is not None:
            self._line.close()
            self._line = None
        if self._process is not None:
            try:
                self._process.wait(self.config.silence + 2.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None

    @property
    def latest(self) -> Arrival | None:
        self._take_in()
        return self._latest

    def arrival(self) -> Arrival:
        """The newest measurement; ConnectionLost before the first."""
        latest = self.latest
        if latest is None:
            raise ConnectionLost(silence_of(self.config))
        return latest

    @property
    def traffic(self) -> Traffic:
        """What has been counted since the line was opened."""
        self._take_in()
        return self._traffic

    @property
    def broken(self) -> bool:
        """The process that answers is gone."""
        return bool(self._failure)

    @property
    def following(self) -> bool:
        """Set points are taken now."""
        return self._following

    @property
    def resting(self) -> bool:
        """Nothing that goes out moves, and all that was ordered has been carried out."""
        self._take_in()
        report = self._report
        return report is None or (report.resting and report.orders == self._orders)

    @property
    def answered_in_time(self) -> float:
        """Share of the controller's measurements since the line was opened whose answer it has not missed."""
        if self._first is None or self._latest is None or self._report is None:
            return 0.0
        # The counter continues where it was before this remote came; a restart begins it anew.
        missed = max(0, self._latest.measurement.misses - self._first.misses)
        return max(0.0, 1.0 - missed / max(1, self._report.cycles))

    def timing(self) -> np.ndarray:
        """(n, 2) s: arrival of the latest measurements, and how long after it the answer was sent."""
        self._take_in()
        return np.array(self._timing).reshape(-1, 2)

    def next(self, seen: int) -> Arrival:
        """The newest measurement, as soon as one later than index `seen` is there; ConnectionLost on silence."""
        end = time.monotonic() + 2.0 * self.config.silence
        while True:
            self._take_in()
            if self._latest is not None and self._latest.index > seen:
                return self._latest
            left = end - time.monotonic()
            if self._failure or left <= 0.0:
                raise ConnectionLost(self._failure or silence_of(self.config))
            self._take_in(left)

    def unread(self) -> list[Arrival]:
        """All measurements since the last call, oldest first."""
        arrivals = list(self._unread)
        self._unread.clear()
        return arrivals

    def wait_until(self, good: Callable[[Arrival], bool], timeout: float, otherwise: str) -> Arrival:
        """The first measurement that is `good`; ConnectionLost or DeviceRefused, saying why, after `timeout`."""
        end = time.monotonic() + timeout
        seen = -1
        while True:
            self._take_in()
            latest = self._latest
            if not self._silent and latest is not None and latest.index > seen:
                if good(latest):
                    return latest
                seen = latest.index
            left = end - time.monotonic()
            if self._failure:
                raise ConnectionLost(self._failure)
            if left <= 0.0:
                raise self._timeout_error(otherwise, timeout)
            self._take_in(left)

    def request(self, request: Request) -> None:
        """Put a request to the KRL program into every answer from now on."""
        self._order(m.REQUEST + request.encode())

    def claims_started(self, measurement: Measurement) -> bool:
        return self._program.claims_started(measurement)

    def take_over(self) -> None:
        """From now on set points are followed and the end of command mode is a loss."""
        self.loss = ""
        self._set_point = None
        self._following = True
        self._take_overs += 1
        self._order(m.TAKE_OVER)

    def let_go(self) -> None:
        """From now on set points are refused; what still moves brakes."""
        self._following = False
        self._order(m.LET_GO)

    def aim(self, joints: Sequence[float]) -> None:
        """Set point for the next answer; refused when the wire could not follow it.

        Raises DeviceRefused for a joint beyond its range or farther than its speed allows.
        """
        latest, report = self.arrival(), self._report
        assert report is not None, "it comes with every arrival"
        start, since = self._set_point or (report.position, report.cycles - 1)
        elapsed = min(max(1, report.cycles - since), _PATIENCE) if self._set_point else 1
        time_step = latest.measurement.cycle * elapsed
        for name, q, before, speed, reach in zip(JOINTS, joints, start, self._speed, self._range):
            if abs(q) > reach:
                raise DeviceRefused(f"set point refused: {name} at {q:.4f} rad, its range is +-{reach:.4f} rad")
            if abs(q - before) > 1.001 * speed * time_step:
                raise DeviceRefused(
                    f"set point refused: {name} would step {q - before:+.4f} rad in {1000 * time_step:.0f} ms, "
                    f"allowed are {speed * time_step:.4f} rad"
                )
        velocity = tuple((q - before) / time_step for q, before in zip(joints, start))
        self._set_point = (tuple(joints), report.cycles)
        self._order(m.pack_set_point(self._set_point[0], velocity))

    # --- insides ---

    def _order(self, packet: bytes) -> None:
        self._orders += 1
        if self._line is None:
            return
        try:
            self._line.send(packet)
        except OSError:
            self._break("its process is gone")

    def _take_in(self, seconds: float = 0.0) -> None:
        """All that the answering process has said; waits for its first word at most so long."""
        line = self._line
        if line is None or self._failure:
            return
        try:
            if seconds > 0.0:
                select.select([line], [], [], seconds)
            while not self._failure:
                self._understand(line.recv(m.LARGEST, socket.MSG_DONTWAIT))
        except BlockingIOError:
            return
        except OSError:
            self._break("its process is gone")

    def _understand(self, packet: bytes) -> None:
        match packet[:1]:
            case m.ARRIVAL:
                self._note(m.Report.unpacked(packet))
            case m.SILENCE:
                self._traffic = m.unpack_silence(packet)
                self._silent = True
            case m.LOSS:
                take_overs, unasked, why = m.unpack_loss(packet)
                if take_overs == self._take_overs and self._following:
                    self._following, self._set_point, self.loss, self.unasked = False, None, why, unasked
            case m.SCHEDULING:
                self.scheduling = packet[1:].decode("utf-8", "replace")
            case m.FAILURE:
                self._break(packet[1:].decode("utf-8", "replace"))
            case _:
                self._break("its process is gone")
        self._answered = self._answered or packet[:1] != m.SCHEDULING

    def _note(self, report: m.Report) -> None:
        measurement = decode_measurement(report.measurement)
        assert isinstance(measurement, Measurement), "only what has been admitted is reported"
        self._report = report
        self._first = self._first or measurement
        self._latest = Arrival(report.index, report.time, report.steps, measurement, report.late)
        self._unread.append(self._latest)
        self._timing.append((report.time, report.took))
        self._traffic = Traffic(*report.traffic)
        self._silent = False

    def _break(self, why: str) -> None:
        self._failure = f"the line to the controller broke: {why}"
        if self._following:
            self._following, self._set_point, self.loss, self.unasked = False, None, self._failure, False

    def _await_first_word(self) -> None:
        """The time-outs count from where the process is up and listens, be it only to silence."""
        end = time.monotonic() + _START_UP
        while not self._answered:
            left = end - time.monotonic()
            if self._failure or left <= 0.0:
                raise ConnectionLost(self._failure or f"the answering process did not start within {_START_UP:g} s")
            self._take_in(left)

    def _bound_socket(self) -> socket.socket:
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            line.bind(as_address(self.config.bind, "drivers.fri.bind"))
        except OSError as error:
            line.close()
            raise ConnectionLost(f"cannot bind {self.config.bind} (drivers.fri.bind): {error.strerror}") from None
        return line

    def _timeout_error(self, otherwise: str, timeout: float) -> DriverError:
        traffic = self._traffic
        received = f"{traffic.foreign} datagrams came from other addresses, {traffic.malformed} were malformed"
        if self._silent or self._latest is None:
            where = f"from {self.config.remote} at {self.config.bind}"
            return ConnectionLost(f"{otherwise} {where} within {timeout:g} s; {received}")
        latest = self._latest.measurement
        return DeviceRefused(
            f"{otherwise} within {timeout:g} s: state {latest.state.name}, quality {latest.quality.name}, "
            f"{drives_of(latest)}, {100 * latest.answer_rate:.0f} % answered in time"
        )
