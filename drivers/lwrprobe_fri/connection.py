"""The line to the controller: one thread owns the socket and answers every measurement within its cycle."""

from __future__ import annotations

import os
import socket
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import radians

import numpy as np

from lwrprobe.contracts import ConnectionLost, DeviceRefused, DriverError
from lwrprobe.contracts.address import as_address
from lwrprobe_fri.admission import Admission
from lwrprobe_fri.config import FriConfig
from lwrprobe_fri.krl import PROGRAMS, Request
from lwrprobe_fri.ramp import Ramp
from lwrprobe_fri.wire import JOINTS, CommandWriter, Field, Measurement, State, decode_measurement

_FIELDS = {
    "position": Field.JOINT_POSITION,
    "joint_impedance": Field.JOINT_POSITION | Field.JOINT_STIFFNESS | Field.JOINT_DAMPING,
}
# With the interpreter's 5 ms, a busy runner would keep the answering thread waiting for half a cycle.
_SWITCH_INTERVAL = 0.0005
_BUFFER = 2048
_BRIDGED = 10  # cycles without measurement for which the ramp goes on braking
_PATIENCE = 5  # cycles without set point whose way the next one may make up for


@dataclass(slots=True, frozen=True)
class Arrival:
    """One admitted measurement: when it came, how many cycles after the one before, whether its answer was late."""

    index: int
    time: float
    steps: int
    measurement: Measurement
    late: bool


@dataclass(slots=True)
class Traffic:
    """What has been counted since the line was opened; nothing late or lost is hidden.

    Attributes
    ----------
    received : measurements that were used
    foreign, malformed : datagrams of others, and with a wrong size, id or content
    late_answers : the controller did not reflect the last answer in time
    late_set_points : the runner had no new set point when an answer was due
    backlog : measurements that had already been overtaken by newer ones when they were read
    unsent : answers that the system refused to send
    """

    received: int = 0
    foreign: int = 0
    malformed: int = 0
    late_answers: int = 0
    late_set_points: int = 0
    backlog: int = 0
    unsent: int = 0


@dataclass(slots=True, frozen=True)
class _SetPoint:
    joints: tuple[float, ...]
    velocity: tuple[float, ...]
    index: int


class Connection:
    """Answers, mirrors, follows set points; everything that motion needs happens in `_answer`.

    The thread owns socket, ramp and writer. Others hand over whole objects by one assignment each: the set point,
    the KRL integers, the wish to brake.
    """

    def __init__(self, config: FriConfig) -> None:
        self.config = config
        self.traffic = Traffic()
        self.admission = Admission([radians(v) for v in config.speed])
        self._timing: deque[tuple[float, float]] = deque(maxlen=20_000)
        self.loss = ""
        """Why command mode ended without being asked to; empty while all is well."""
        self._program = PROGRAMS[config.krl]
        self._integers = self._program.integers("idle", config.strategy)
        self._host, self._port = as_address(config.remote, "drivers.fri.remote")
        self._speed = [radians(v) for v in config.speed]
        self._range = [radians(v) for v in config.range]
        self._ramp = Ramp(self._speed, [radians(v) for v in config.acceleration])
        self._writer = CommandWriter(_FIELDS[config.strategy], (config.stiffness,) * 7, (config.damping,) * 7)
        self._sequence = 0
        self._cycles = 0
        self._set_point: _SetPoint | None = None
        self._answered: _SetPoint | None = None
        self._following = False
        self._braking = False
        self._latest: Arrival | None = None
        self._news = threading.Condition()
        self._silent = True
        self._closing = False
        self._failure = ""
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._interval = sys.getswitchinterval()

    # --- called by the arm ---

    def open(self) -> None:
        """Bind the socket and begin to answer; returns when the first measurement has come."""
        self._socket = self._bound_socket()
        sys.setswitchinterval(min(self._interval, _SWITCH_INTERVAL))
        self._thread = threading.Thread(target=self._run, name="fri", daemon=True)
        self._thread.start()
        try:
            self.wait_until(lambda arrival: True, self.config.connect_timeout, "no measurement came")
        except DriverError:
            self.close()
            raise

    def close(self) -> None:
        """End the thread and release the port; the controller notices the silence."""
        self._closing = True
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(self.config.silence + 2.0)
        if self._socket is not None:
            self._socket.close()
        if self._thread is not None:
            sys.setswitchinterval(self._interval)
        self._thread = self._socket = None

    @property
    def latest(self) -> Arrival | None:
        return self._latest

    @property
    def following(self) -> bool:
        """Set points are taken now."""
        return self._following

    @property
    def resting(self) -> bool:
        return self._ramp.resting

    def timing(self) -> np.ndarray:
        """(n, 2) s: arrival of the latest measurements, and how long after it the answer was sent."""
        return np.array(self._timing.copy()).reshape(-1, 2)  # the thread goes on appending to the deque itself

    def next(self, seen: int) -> Arrival:
        """The newest measurement, as soon as one later than index `seen` is there; ConnectionLost on silence."""
        end = time.monotonic() + 2.0 * self.config.silence
        with self._news:
            while self._latest is None or self._latest.index <= seen:
                left = end - time.monotonic()
                if self._failure or left <= 0.0:
                    raise ConnectionLost(self._failure or self._silence())
                self._news.wait(left)
            return self._latest

    def wait_until(self, good: Callable[[Arrival], bool], timeout: float, otherwise: str) -> Arrival:
        """The first measurement that is `good`; ConnectionLost or DeviceRefused, saying why, after `timeout`."""
        end = time.monotonic() + timeout
        seen = -1
        with self._news:
            while True:
                fresh = not self._silent and self._latest.index > seen
                if fresh and good(self._latest):
                    return self._latest
                seen = self._latest.index if fresh else seen
                left = end - time.monotonic()
                if self._failure:
                    raise ConnectionLost(self._failure)
                if left <= 0.0:
                    raise self._timeout_error(otherwise, timeout)
                self._news.wait(left)

    def request(self, request: Request) -> None:
        """Put a request to the KRL program into every answer from now on."""
        self._integers = self._program.integers(request, self.config.strategy)

    def claims_started(self, measurement: Measurement) -> bool:
        return self._program.claims_started(measurement)

    def take_over(self) -> None:
        """From now on set points are followed and the end of command mode is a loss."""
        self.loss = ""
        self._set_point = None
        self._braking = False
        self._following = True

    def let_go(self) -> None:
        """From now on set points are refused; what still moves brakes."""
        self._braking = True
        self._following = False

    def aim(self, joints: Sequence[float]) -> None:
        """Set point for the next answer; refused when the wire could not follow it.

        Raises DeviceRefused for a joint beyond its range or farther than its speed allows.
        """
        arrival, last = self._latest, self._set_point
        start = last.joints if last else tuple(self._ramp.position)
        elapsed = min(max(1, self._cycles - last.index), _PATIENCE) if last else 1
        time_step = arrival.measurement.cycle * elapsed
        for name, q, before, speed, reach in zip(JOINTS, joints, start, self._speed, self._range):
            if abs(q) > reach:
                raise DeviceRefused(f"set point refused: {name} at {q:.4f} rad, its range is +-{reach:.4f} rad")
            if abs(q - before) > 1.001 * speed * time_step:
                raise DeviceRefused(
                    f"set point refused: {name} would step {q - before:+.4f} rad in {1000 * time_step:.0f} ms, "
                    f"allowed are {speed * time_step:.4f} rad"
                )
        velocity = tuple((q - before) / time_step for q, before in zip(joints, start))
        self._set_point = _SetPoint(tuple(joints), velocity, self._cycles)

    # --- the thread ---

    def _run(self) -> None:
        try:
            self._prefer()
            buffer = memoryview(bytearray(_BUFFER))
            while not self._closing:
                self._serve(buffer)
        except Exception as error:  # whatever ends the thread has to reach the reader
            self._failure = f"the line to the controller broke: {type(error).__name__}: {error}"
            self._lose(self._failure)
        finally:
            with self._news:
                self._news.notify_all()

    def _serve(self, buffer: memoryview) -> None:
        """Take all that has come, answer the newest."""
        try:
            size, peer = self._socket.recvfrom_into(buffer)
        except BlockingIOError:
            return self._fall_silent()
        arrival = time.monotonic()
        newest, steps = None, 0
        while True:
            measurement = self._checked(buffer[:size], peer)
            ahead = self.admission.steps(measurement) if measurement else 0
            if ahead:
                self.traffic.backlog += newest is not None
                newest, steps, source = measurement, steps + ahead, peer
            try:
                size, peer = self._socket.recvfrom_into(buffer, 0, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
        if newest is not None:
            self._answer(newest, steps, arrival, source)

    def _checked(self, data: memoryview, peer: tuple[str, int]) -> Measurement | None:
        if peer[0] != self._host or (self._port and peer[1] != self._port):
            self.traffic.foreign += 1
            return None
        measurement = decode_measurement(data)
        if isinstance(measurement, str):
            self.traffic.malformed += 1
            return None
        return measurement

    def _answer(self, measurement: Measurement, steps: int, arrival: float, peer: tuple[str, int]) -> None:
        late = self._reflects_late(measurement)
        self._cycles += steps
        if self._silent or not measurement.commandable:
            self._mirror(measurement)
        else:
            late |= self._move(measurement.cycle, steps)
        self._send(measurement, peer)
        self._timing.append((arrival, time.monotonic() - arrival))
        self.traffic.received += 1
        with self._news:
            index = 0 if self._latest is None else self._latest.index + 1
            self._latest = Arrival(index, arrival, steps, measurement, late)
            self._silent = False
            self._news.notify_all()

    def _mirror(self, measurement: Measurement) -> None:
        """Answer with the controller's own set point, so that taking over is free of a jump."""
        if self._following:
            self._lose(_why_lost(measurement))
        self._set_point = None
        self._ramp.rest_at(measurement.set_point)

    def _move(self, cycle: float, steps: int) -> bool:
        """Advance the ramp by the cycles that have passed; True when the runner was late."""
        for _ in range(min(steps - 1, _BRIDGED)):
            self._ramp.brake(cycle)
        target = self._set_point
        if target is None or self._braking:
            self._ramp.brake(cycle)
            return False
        if target is self._answered:
            self._ramp.brake(cycle)
            self.traffic.late_set_points += 1
            return True
        self._answered = target
        self._ramp.follow(target.joints, target.velocity, cycle)
        return False

    def _send(self, measurement: Measurement, peer: tuple[str, int]) -> None:
        self._sequence = (self._sequence + 1) & 0xFFFF
        answer = self._writer.pack(self._sequence, measurement.sequence, self._integers, self._ramp.position)
        try:
            self._socket.sendto(answer, peer)
        except OSError:
            self.traffic.unsent += 1

    def _reflects_late(self, measurement: Measurement) -> bool:
        late = self._latest is not None and measurement.reflected != self._sequence
        self.traffic.late_answers += late
        return late

    def _fall_silent(self) -> None:
        if not self._silent:
            self._silent = True
            self.admission.forget()
            if self._following:
                self._lose(self._silence())

    def _lose(self, why: str) -> None:
        """Command mode has ended by itself: forget the motion and make sure that nothing restarts unasked."""
        if self._following:
            self._following = False
            self.loss = why
        self._set_point = None
        self.request("stop")

    def _prefer(self) -> None:
        """Priority and core of this thread, where the user wants them."""
        try:
            if self.config.core >= 0:
                os.sched_setaffinity(0, {self.config.core})
            if self.config.priority:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self.config.priority))
        except OSError as error:
            wanted = f"drivers.fri.core {self.config.core}, drivers.fri.priority {self.config.priority}"
            raise OSError(f"the system refuses {wanted}: {error.strerror}") from None

    # --- words and sockets ---

    def _bound_socket(self) -> socket.socket:
        line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        seconds = int(self.config.silence)
        micros = int(1e6 * (self.config.silence - seconds))
        # A time-out of the kernel's own needs no poll before each receive.
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", seconds, micros))
        try:
            line.bind(as_address(self.config.bind, "drivers.fri.bind"))
        except OSError as error:
            line.close()
            raise ConnectionLost(f"cannot bind {self.config.bind} (drivers.fri.bind): {error.strerror}") from None
        return line

    def _silence(self) -> str:
        return f"the controller at {self.config.remote} has been silent for {1000 * self.config.silence:.0f} ms"

    def _timeout_error(self, otherwise: str, timeout: float) -> DriverError:
        heard = f"{self.traffic.foreign} datagrams came from others, {self.traffic.malformed} were malformed"
        if self._silent:
            where = f"from {self.config.remote} at {self.config.bind}"
            return ConnectionLost(f"{otherwise} {where} within {timeout:g} s; {heard}")
        m = self._latest.measurement
        return DeviceRefused(
            f"{otherwise} within {timeout:g} s: state {m.state.name}, quality {m.quality.name}, "
            f"{_drives(m)}, {100 * m.answer_rate:.0f} % answered in time"
        )


def _why_lost(measurement: Measurement) -> str:
    now = "monitor mode" if measurement.state != State.CMD else "command mode without drives"
    return (
        f"the controller left command mode: now {now}, {_drives(measurement)}, quality {measurement.quality.name}, "
        f"{measurement.misses} answers missed"
    )


def _drives(measurement: Measurement) -> str:
    power = "drives on" if measurement.power else "drives off"
    faulty = [name for i, name in enumerate(JOINTS) if measurement.error >> i & 1]
    if not measurement.error:
        return power
    return f"{power}, drive errors 0x{measurement.error:04x}" + (f" ({', '.join(faulty)})" if faulty else "")
