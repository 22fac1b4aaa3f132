"""The process that owns the socket: it answers every measurement within its cycle, whatever the runner is doing.

A process and not a thread, since a thread has to wait for the interpreter's lock: for as long as the runner's own
code holds it, and for as long as the system lets somebody else run in the runner's stead meanwhile.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import signal
import socket
import struct
import sys
import time
from collections import deque
from dataclasses import asdict
from math import radians
from typing import Any, get_args

from lwrprobe.contracts.address import as_address
from lwrprobe.host.arrival_time import SPACE, arrival_time
from lwrprobe_fri import messages as m
from lwrprobe_fri.config import FriConfig
from lwrprobe_fri.krl import PROGRAMS, Request
from lwrprobe_fri.packet_filter import PacketFilter
from lwrprobe_fri.ramp import Ramp
from lwrprobe_fri.wire import JOINTS, CommandWriter, Field, Measurement, Quality, State, decode_measurement

_FIELDS = {
    "position": Field.JOINT_POSITION,
    "joint_impedance": Field.JOINT_POSITION | Field.JOINT_STIFFNESS | Field.JOINT_DAMPING,
}
_REQUESTS: dict[bytes, Request] = {name.encode(): name for name in get_args(Request)}
_BUFFER = 2048
_BRIDGED = 10  # cycles without measurement for which the ramp goes on braking
_RECENT = 12  # measurements that tell whether answers were missing when command mode ended
_MISSING = 2  # answers missed among them, from which on it has ended for that reason
_PERMITTED = 80  # priority, where the configuration leaves it to the system
_LOCK_ALL = 3  # MCL_CURRENT | MCL_FUTURE

_SetPoint = tuple[tuple[float, ...], tuple[float, ...]]


class RunnerGone(Exception):
    """The runner's end of the line is closed."""


class Answering:
    """Answers, mirrors, follows set points; everything that motion needs happens in `_answer`.

    Parameters
    ----------
    config : of the driver
    controller : bound to `drivers.fri.bind`, with a receive time-out of `silence`
    runner : packets to and from the runner
    """

    def __init__(self, config: FriConfig, controller: socket.socket, runner: socket.socket) -> None:
        self.config = config
        self.traffic = m.Traffic()
        self.packets = PacketFilter([radians(v) for v in config.speed])
        self._program = PROGRAMS[config.krl]
        self._integers = self._program.integers("idle", config.strategy)
        self._host, self._port = as_address(config.remote, "drivers.fri.remote")
        self._ramp = Ramp([radians(v) for v in config.speed], [radians(v) for v in config.acceleration])
        self._writer = CommandWriter(_FIELDS[config.strategy], (config.stiffness,) * 7, (config.damping,) * 7)
        self._sequence = 0
        self._index = 0
        self._cycles = 0
        self._orders = 0
        self._take_overs = 0
        self._set_point: _SetPoint | None = None
        self._answered: _SetPoint | None = None
        self._following = False
        self._braking = False
        self._silent = True
        self._silent_since = time.monotonic()
        self._misses_before: int | None = None
        self._misses: deque[int] = deque(maxlen=_RECENT)
        self._controller = controller
        self._runner = runner

    def run(self) -> None:
        """Until the runner goes, by itself or killed: the controller notices the silence then."""
        try:
            self._tell(m.SCHEDULING + _prefer(self.config).encode())
            buffer = memoryview(bytearray(_BUFFER))
            while True:
                self._serve(buffer)
        except RunnerGone:
            return
        except Exception as error:  # whatever ends this has to reach the runner
            self._tell(m.FAILURE + f"{type(error).__name__}: {error}".encode())

    def _serve(self, buffer: memoryview) -> None:
        """Take all that has come, answer the newest."""
        try:
            size, ancillary, _, peer = self._controller.recvmsg_into([buffer], SPACE)
        except BlockingIOError:
            self._obey()
            return self._fall_silent(time.monotonic())
        newest, steps = None, 0
        while True:
            arrival = arrival_time(ancillary)
            measurement = self._checked(buffer[:size], peer)
            ahead = self.packets.steps(measurement) if measurement else 0
            if ahead:
                self.traffic.backlog += newest is not None
                newest, steps, source, raw = measurement, steps + ahead, peer, bytes(buffer[:size])
                measured = arrival
            try:
                size, ancillary, _, peer = self._controller.recvmsg_into([buffer], SPACE, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
        self._obey()
        if newest is not None:
            self._silent_since = measured
            self._answer(newest, steps, measured, source, raw)
        elif arrival - self._silent_since > self.config.silence:
            self._fall_silent(arrival)  # datagrams come, but none of them is a measurement of the controller's

    def _obey(self) -> None:
        """Carry out what the runner has sent meanwhile."""
        while True:
            try:
                packet = self._runner.recv(m.LARGEST, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                raise RunnerGone from None
            if not packet:
                raise RunnerGone
            self._orders += 1
            match packet[:1]:
                case m.SET_POINT:
                    self._set_point = m.unpack_set_point(packet)
                case m.REQUEST:
                    self._request(_REQUESTS[packet[1:]])
                case m.TAKE_OVER:
                    self._set_point = None
                    self._braking = False
                    self._following = True
                    self._take_overs += 1
                case m.LET_GO:
                    self._braking = True
                    self._following = False

    def _request(self, request: Request) -> None:
        self._integers = self._program.integers(request, self.config.strategy)

    def _checked(self, data: memoryview, peer: tuple[str, int]) -> Measurement | None:
        if peer[0] != self._host or (self._port and peer[1] != self._port):
            self.traffic.foreign += 1
            return None
        measurement = decode_measurement(data)
        if isinstance(measurement, str):
            self.traffic.malformed += 1
            return None
        return measurement

    def _answer(self, measurement: Measurement, steps: int, arrival: float, peer: tuple[str, int], raw: bytes) -> None:
        late = self._reflects_late(measurement)
        if (
            self._misses_before is None or measurement.misses < self._misses_before
        ):  # the controller began to count anew
            self._misses_before = measurement.misses
            self._misses.clear()
        missed = self._misses[-1] if self._misses else measurement.misses
        self._misses.append(measurement.misses)
        self._cycles += steps
        if self._silent or not measurement.commandable:
            self._mirror(measurement)
        else:
            if measurement.misses > missed:
                # It has gone on without an answer: the next one begins where it is now.
                self._ramp.position = measurement.set_point
            late |= self._move(measurement.cycle, steps)
        self._send(measurement, peer)
        took = time.monotonic() - arrival
        self._silent = False
        self.traffic.received += 1
        for name in ("lost", "repeated", "old", "implausible", "restarts"):
            setattr(self.traffic, name, getattr(self.packets, name))
        self._tell(
            m.Report(
                bool(late),
                self._ramp.resting,
                self._index,
                self._cycles,
                self._orders,
                steps,
                arrival,
                took,
                tuple(self._ramp.position),
                self.traffic.as_tuple(),
                raw,
            ).packed()
        )
        self._index += 1

    def _mirror(self, measurement: Measurement) -> None:
        """Answer with the controller's own set point, so that taking over is free of a jump."""
        if self._following:
            why = _why_lost(measurement, measurement.misses - (self._misses_before or 0))
            self._lose(why, self._ended_by_itself(measurement))
        self._set_point = None
        self._ramp.rest_at(measurement.set_point)

    def _ended_by_itself(self, measurement: Measurement) -> bool:
        """Answers were missing, or the rating fell: nobody has stopped the arm, and no limit has."""
        if measurement.error:
            return False
        missing = measurement.misses - self._misses[0] >= _MISSING
        return missing or (measurement.power != 0 and measurement.quality < Quality.OK)

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
        self._ramp.follow(*target, cycle)
        return False

    def _send(self, measurement: Measurement, peer: tuple[str, int]) -> None:
        self._sequence = (self._sequence + 1) & 0xFFFF
        answer = self._writer.pack(self._sequence, measurement.sequence, self._integers, self._ramp.position)
        try:
            self._controller.sendto(answer, peer)
        except OSError:
            self.traffic.unsent += 1

    def _reflects_late(self, measurement: Measurement) -> bool:
        late = self._index > 0 and measurement.reflected != self._sequence
        self.traffic.late_answers += late
        return late

    def _fall_silent(self, now: float) -> None:
        self._silent_since = now
        if not self._silent:
            self._silent = True
            self.packets.forget()
            if self._following:
                self._lose(silence_of(self.config), True)
        self._tell(m.pack_silence(self.traffic))

    def _lose(self, why: str, unasked: bool) -> None:
        """Command mode has ended by itself: forget the motion and make sure that nothing restarts unasked."""
        self._following = False
        self._set_point = None
        self._request("stop")
        self._tell(m.pack_loss(self._take_overs, unasked, why))

    def _tell(self, packet: bytes) -> None:
        try:
            self._runner.send(packet, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return  # the runner has not read for many cycles; the next report holds all that counts
        except OSError:
            raise RunnerGone from None


def _prefer(config: FriConfig) -> str:
    """Priority, core and memory of this process; in words what the system has permitted.

    Raises OSError for a core or a priority that the user wants and the system refuses.
    """
    priority = config.priority if config.priority >= 0 else _PERMITTED
    try:
        if config.core >= 0:
            os.sched_setaffinity(0, {config.core})
        if priority:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        if config.priority > 0 or config.core >= 0:
            wanted = f"drivers.fri.core {config.core}, drivers.fri.priority {config.priority}"
            raise OSError(f"the system refuses {wanted}: {error.strerror}") from None
        priority = 0
    return f"{f'SCHED_FIFO {priority}' if priority else 'ordinary'}, memory {_lock_memory()}"


def _lock_memory() -> str:
    """Keep all pages in memory, so that none has to be fetched while a measurement waits."""
    try:
        refused = ctypes.CDLL(None, use_errno=True).mlockall(_LOCK_ALL)
    except (OSError, AttributeError):
        refused = -1
    return "not locked" if refused else "locked"


def set_time_out(controller: socket.socket, seconds: float) -> None:
    """A time-out of the kernel's own: no poll before each receive."""
    whole = int(seconds)
    controller.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", whole, int(1e6 * (seconds - whole))))


def silence_of(config: FriConfig) -> str:
    """In words."""
    return f"the controller at {config.remote} has been silent for {1000 * config.silence:.0f} ms"


def drives_of(measurement: Measurement) -> str:
    """Power and errors in words."""
    power = "drives on" if measurement.power else "drives off"
    faulty = [name for i, name in enumerate(JOINTS) if measurement.error >> i & 1]
    if not measurement.error:
        return power
    return f"{power}, drive errors 0x{measurement.error:04x}" + (f" ({', '.join(faulty)})" if faulty else "")


def _why_lost(measurement: Measurement, misses: int) -> str:
    now = "monitor mode" if measurement.state != State.CMD else "command mode without drives"
    return (
        f"the controller left command mode: now {now}, {drives_of(measurement)}, quality {measurement.quality.name}, "
        f"{misses} answers missed since this connection was opened"
    )


def command_line(config: FriConfig, controller: socket.socket, runner: socket.socket) -> list[str]:
    """How this process is started; both sockets are handed down."""
    sockets = [str(controller.fileno()), str(runner.fileno())]
    return [sys.executable, "-c", _START, json.dumps(sys.path), json.dumps(asdict(config)), *sockets]


# The runner's own search path: it need not be that of a fresh interpreter.
_START = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); "
    "from lwrprobe_fri.answering import main; main(sys.argv[2:])"
)


def _config(fields: dict[str, Any]) -> FriConfig:
    """The configuration whose fields have passed through JSON, which knows no tuples."""
    lists = {name: tuple(value) for name, value in fields.items() if isinstance(value, list)}
    return FriConfig(**(fields | lists))


def main(argv: list[str]) -> None:
    """Entry of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the runner brakes the arm first and then ends this process
    config = _config(json.loads(argv[0]))
    controller = socket.socket(fileno=int(argv[1]))
    runner = socket.socket(fileno=int(argv[2]))
    # Nothing here makes cycles; a collection would come at the wrong moment.
    gc.disable()
    Answering(config, controller, runner).run()
