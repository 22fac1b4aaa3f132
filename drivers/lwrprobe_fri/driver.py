"""The KUKA LWR 4+ over FRI 1.0 as a driver plug-in: role arm."""

from __future__ import annotations

import atexit
import time
from collections import deque
from dataclasses import asdict
from typing import Any, ClassVar

import numpy as np

from lwrprobe.contracts import (
    DRIVER_CONTRACT,
    ArmState,
    ArmStatus,
    ConnectionLost,
    DeviceRefused,
    DriverContext,
    DriverError,
    HealthCheck,
    InputError,
    MotionInterrupted,
)
from lwrprobe.contracts.address import as_address, is_loopback
from lwrprobe.contracts.samples import Vector
from lwrprobe_fri.config import FriConfig
from lwrprobe_fri.connection import Arrival, Connection
from lwrprobe_fri.health_checks import connection_health
from lwrprobe_fri.messages import Traffic
from lwrprobe_fri.wire import Measurement, Quality, State

_STILL = 1e-6
"""rad that a set point moves in a cycle at rest; measurements travel in single precision."""
_LEAST = 0.1
"""s that is waited at least."""
LWR4_MASS = 16.0
"""kg of all moving links (KUKA data sheet)."""


class FriArm:
    """The arm behind its controller.

    `open` enters command mode; when that ends by itself, `read` raises until `reenter` or `restart`. Times are those of
    `time.monotonic`, at the arrival of the measurement.
    """

    def __init__(self, config: FriConfig) -> None:
        self.config = config
        self.cycle = config.cycle or 0.01
        self.mass = LWR4_MASS if config.mass < 0.0 else config.mass
        self.delay = self.cycle
        """s beyond the next cycle: a measurement is answered at once, what it leads to goes out with the next one."""
        self._line: Connection | None = None
        self._seen = -1
        self._before: Arrival | None = None
        self._passed: list[ArmState] = []
        self._stopped = False
        self._read_at = 0.0
        self._loops: deque[float] = deque(maxlen=100_000)
        self._last_counters: dict[str, Any] = {}

    def __enter__(self) -> FriArm:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def connect(self) -> None:
        """Only listen and mirror: measurements flow, nothing can move. Does nothing when already connected."""
        if self._line is not None:
            return
        line = Connection(self.config)
        line.open()
        self._line, self._seen, self._before = line, -1, None
        atexit.register(self.close)
        try:
            self._adopt_cycle(line.arrival().measurement.cycle)
            self._adopt_mass(line.arrival().measurement.mass_matrix)
        except InputError:
            self.close()
            raise

    def open(self) -> None:
        """Connect, enter command mode and be ready to take set points."""
        self.connect()
        try:
            self.restart()
        except DriverError:
            self.close()
            raise

    def restart(self) -> None:
        """Enter command mode, again if need be: ask for stop where it is half on, wait for quality, ask for start.

        Raises DeviceRefused when the controller does not do so in time, ConnectionLost when it is silent.
        """
        self._enter(self._connected(), self.config.start_timeout)

    def reenter(self, seconds: float, asked: bool) -> None:
        """Enter command mode again after it has ended by itself, once the arm rests; `seconds` for all of it.

        Raises DeviceRefused where it does not come to that in time, or where a person has to look first and has not
        been `asked`: somebody or a limit has stopped the arm, or the controller was started anew meanwhile.
        """
        line = self._connected()
        end = time.monotonic() + seconds
        if not asked and not line.unasked:
            raise DeviceRefused(line.loss or "nobody was asked whether the arm may move")
        before = self._before
        line.wait_until(lambda a: True, seconds, "no measurement came")
        if not asked and before is not None and _restarted(before.measurement, line.arrival().measurement):
            raise DeviceRefused("the controller was started anew meanwhile")
        last: list[float] = []

        def rests(arrival: Arrival) -> bool:
            now = arrival.measurement.set_point
            still = bool(last) and max(abs(a - b) for a, b in zip(now, last)) < _STILL
            last[:] = now
            return still

        line.wait_until(rests, max(_LEAST, end - time.monotonic()), "the arm did not come to rest")
        self._enter(line, max(_LEAST, end - time.monotonic()))

    def _enter(self, line: Connection, seconds: float) -> None:
        """Into command mode; at most so many seconds for the quality, and again for the start."""
        config = self.config
        line.let_go()
        line.request("idle")
        self._leave_command_mode(line)
        wanted = Quality[config.quality.upper()]
        line.wait_until(
            lambda a: a.measurement.quality >= wanted,
            seconds,
            f"the connection did not become {config.quality}",
        )
        line.request("start")
        hint = "; start it at the pendant" if config.krl == "none" else ""
        line.wait_until(lambda a: a.measurement.commandable, seconds, f"command mode was not entered{hint}")
        line.take_over()
        self._stopped = False
        self._seen = line.arrival().index

    def read(self) -> ArmState:
        """Wait for the next measurement; the newest one when several have come.

        Raises MotionInterrupted on silence and once command mode has ended by itself, ConnectionLost when the process
        that answers is gone.
        """
        line = self._connected()
        if line.loss:
            raise MotionInterrupted(line.loss, line.unasked)
        try:
            arrival = line.next(self._seen)
        except ConnectionLost as error:
            if line.broken:
                raise
            raise MotionInterrupted(str(error), True) from error
        if line.loss:
            raise MotionInterrupted(line.loss, line.unasked)
        states = [self._next_state(one) for one in line.unread() if self._seen < one.index <= arrival.index]
        self._passed = states[:-1]
        self._seen = arrival.index
        self._read_at = time.monotonic()
        return states[-1]

    def passed(self) -> list[ArmState]:
        """States that came between the last two that `read` has returned, oldest first."""
        return self._passed

    def command(self, q: Vector) -> None:
        """Set point (7,) rad for the next answer.

        Raises InputError for anything but seven finite numbers, DeviceRefused for what the wire cannot follow or
        while the arm takes no set points.
        """
        joints = np.asarray(q, dtype=np.float64)
        if joints.shape != (7,) or not np.isfinite(joints).all():
            raise InputError("q", q, "seven finite joint angles in rad")
        line = self._connected()
        if line.loss:
            raise MotionInterrupted(line.loss, line.unasked)
        if not line.following:
            raise DeviceRefused(
                "the arm was stopped; open or restart it to move again" if self._stopped else "not in command mode"
            )
        try:
            line.aim(joints.tolist())
        except DeviceRefused:
            line.let_go()
            self._stopped = True
            raise
        self._loops.append(time.monotonic() - self._read_at)

    def stop(self) -> None:
        """Brake along the present direction and hold; set points are refused until `open` or `restart`."""
        line = self._line
        if line is None:
            return
        self._stopped = True
        line.let_go()
        end = time.monotonic() + self.config.stop_timeout
        while not line.resting and time.monotonic() < end:
            try:
                line.next(line.arrival().index)
            except DriverError:
                return  # silent: the controller itself brakes when answers stay away

    def close(self) -> None:
        """Stop, ask the program to leave command mode, release the port."""
        line = self._line
        if line is None:
            return
        try:
            self.stop()
            self._leave_command_mode(line)
        except DriverError:
            pass  # closing must free the port; a silent controller has stopped by itself
        finally:
            self._last_counters = self.counters()
            self._line = None
            line.close()
            atexit.unregister(self.close)

    @property
    def measurement(self) -> Measurement | None:
        """The newest datagram: drive temperatures, errors, warnings, torques, quality, statistics."""
        return self._line.latest.measurement if self._line and self._line.latest else None

    @property
    def traffic(self) -> Traffic:
        """What has been received, lost and late since `connect`."""
        return self._connected().traffic

    def counters(self) -> dict[str, Any]:
        """What has been counted since `connect`, or until the last `close`; times in ms.

        `answers_in_time` is the share of all measurements sent meanwhile whose answer the controller counts as
        received within its cycle; `loop_ms` what the runner took from a state to its set point.
        """
        line = self._line
        if line is None or line.latest is None:
            return self._last_counters
        loops = 1e3 * np.array(self._loops) if self._loops else np.zeros(1)
        answers = 1e3 * line.timing()[:, 1]
        return {
            **asdict(line.traffic),
            "answers_in_time": round(line.answered_in_time, 5),
            "answer_ms_p99": round(float(np.quantile(answers, 0.99)), 3),
            "loop_ms_median": round(float(np.median(loops)), 3),
            "loop_ms_p99": round(float(np.quantile(loops, 0.99)), 3),
            "quality": line.latest.measurement.quality.name,
            "scheduling": line.scheduling,
        }

    def timing(self) -> np.ndarray:
        """(n, 2) s: arrival of the latest measurements by `time.monotonic`, and the time until the answer was sent."""
        return self._connected().timing()

    def health_checks(self, seconds: float) -> list[HealthCheck]:
        """Listen for some seconds and report on cycle, timing, losses, quality and drives; nothing moves."""
        connected = self._line is not None
        self.connect()
        try:
            return connection_health(self._connected(), seconds)
        finally:
            if not connected:
                self.close()

    # --- insides ---

    def _connected(self) -> Connection:
        if self._line is None:
            raise DriverError("the arm is not open")
        return self._line

    def _adopt_cycle(self, cycle: float) -> None:
        cycle = round(cycle, 6)  # it travels in single precision
        if self.config.cycle and abs(self.config.cycle - cycle) > 1e-5:
            raise InputError(
                "drivers.fri.cycle", self.config.cycle, f"0 or {cycle}, which the controller was opened with"
            )
        if self.config.silence < 2.0 * cycle:
            raise InputError("drivers.fri.silence", self.config.silence, f"at least two cycles, {2 * cycle} s")
        self.cycle = self.delay = cycle

    def _adopt_mass(self, matrix: np.ndarray) -> None:
        """An emulated arm without mass says so; the arm of any other controller has mass."""
        if self.config.mass < 0.0:
            host, _ = as_address(self.config.remote, "drivers.fri.remote")
            self.mass = 0.0 if is_loopback(host) and not matrix.any() else LWR4_MASS

    def _leave_command_mode(self, line: Connection) -> None:
        """Back to monitor mode; also heals a program whose state still says command mode after that has ended."""
        if self.config.krl == "none":
            return

        def commanding(arrival: Arrival) -> bool:
            return arrival.measurement.state == State.CMD or line.claims_started(arrival.measurement)

        if commanding(line.arrival()):
            line.request("stop")
            line.wait_until(lambda a: not commanding(a), self.config.stop_timeout, "command mode was not left")

    def _next_state(self, arrival: Arrival) -> ArmState:
        m = arrival.measurement
        q = np.array(m.measured)
        state = ArmState(arrival.time, q, self._velocity(arrival, q), self._status(arrival), m.temperature)
        self._before = arrival
        return state

    def _velocity(self, arrival: Arrival, q: Vector) -> Vector:
        before = self._before
        if before is None or before.index >= arrival.index:
            return np.zeros(7)
        elapsed = (arrival.measurement.sequence - before.measurement.sequence) & 0xFFFF
        return (q - np.array(before.measurement.measured)) / (max(1, elapsed) * self.cycle)

    def _status(self, arrival: Arrival) -> int:
        m = arrival.measurement
        status = ArmStatus.OK
        if m.state != State.CMD:
            status |= ArmStatus.NOT_COMMANDING
        if m.power == 0:
            status |= ArmStatus.POWER_OFF
        if m.error:
            status |= ArmStatus.FAULT
        if arrival.late:
            status |= ArmStatus.LATE
        if self._before is not None and m.misses > self._before.measurement.misses:
            status |= ArmStatus.UNANSWERED
        return int(status)


def _restarted(before: Measurement, now: Measurement) -> bool:
    """The controller counts and times anew."""
    return now.misses < before.misses or now.timestamp < before.timestamp


class FriDriver:
    """KUKA LWR 4+ over FRI 1.0 (controller KRC2 lr): role arm."""

    Config: ClassVar[type] = FriConfig
    contract: ClassVar[int] = DRIVER_CONTRACT
    roles: ClassVar[frozenset[str]] = frozenset({"arm"})

    def __init__(self, context: DriverContext[object]) -> None:
        self._arm = FriArm(context.config or FriConfig())

    def arm(self) -> FriArm:
        return self._arm

    def sensor(self) -> None:
        raise DriverError("the driver 'fri' fills the role arm alone; choose another one for the sensor")

    def ground_truth(self) -> None:
        """A real device knows no ground truth."""

    @property
    def left_out(self) -> tuple[()]:
        """A real device leaves nothing out."""
        return ()

    def health_checks(self, seconds: float) -> list[HealthCheck]:
        """Lines for `lwrprobe doctor`."""
        return self._arm.health_checks(seconds)

    def counters(self) -> dict[str, Any]:
        """What was counted on the connection."""
        return self._arm.counters()
