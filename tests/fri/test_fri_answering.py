"""The process that answers the controller, on a clock that is counted: the host's load plays no part."""

import socket
import struct
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.host import arrival_time
from lwrprobe_fri import FriConfig
from lwrprobe_fri import messages as m
from lwrprobe_fri.answering import Answering
from lwrprobe_fri.driver import FriArm
from lwrprobe_fri.emulator import Controller, ControllerSettings, LaggingArm
from lwrprobe_fri.wire import State, decode_measurement
from lwrprobe_rig.link import FaultyLink, LinkFaults

START = np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])
CYCLE = 0.01
PEER = ("127.0.0.1", 49939)
STATION = "127.0.0.1:49939"


class CountedLine:
    """Emulated controller and runner around the answering process, whose two sockets this stands in for.

    The runner is a generator: it yields one order a cycle and gets the report of that cycle, None where no measurement
    came. Each time the process waits for a measurement, a cycle passes.
    """

    def __init__(self, faults=None, **settings):
        self.controller = Controller(LaggingArm(START), ControllerSettings(cycle=CYCLE, **settings))
        self.now = 100.0
        self.cycles = 0
        self._out, self._in = FaultyLink(faults or LinkFaults(), 1), FaultyLink(faults or LinkFaults(), 2)
        self._arrived, self._orders = deque(), deque()
        self._report, self._runner, self._failure = None, None, None
        self.loss = None
        self.noted = list

    def run(self, runner):
        """Until the runner has ended."""
        self._runner = runner
        self._orders.append(next(runner))
        Answering(FriConfig(remote=STATION), self, self).run()
        if self._failure is not None:
            raise self._failure

    # --- as the controller's socket ---

    def recvmsg_into(self, buffers, space, flags=0):
        while not self._arrived:
            if flags or not self._cycle():
                raise BlockingIOError
        data = self._arrived.popleft()
        buffers[0][: len(data)] = data
        return len(data), self.noted(), 0, PEER

    def sendto(self, data, peer):
        assert peer == PEER
        self._in.put(data, self.now + 0.3 * CYCLE)

    # --- as the line to the runner ---

    def recv(self, size, flags):
        if self._orders:
            return self._orders.popleft()
        if self._runner is None:
            return b""  # gone
        raise BlockingIOError

    def send(self, packet, flags):
        if packet[:1] == m.FAILURE:
            self._failure = self._failure or AssertionError(packet[1:].decode())
        if packet[:1] == m.LOSS:
            self.loss = m.unpack_loss(packet)
        if packet[:1] == m.ARRIVAL:
            self._report = m.Report.unpacked(packet)

    # --- insides ---

    def _cycle(self):
        if self.cycles:
            try:
                order = self._runner.send(self._report)
            except StopIteration:
                order = None
            except BaseException as failure:  # the process would report it as its own
                self._failure, order = failure, None
            if order is None:
                self._runner = None
                return False
            if order:
                self._orders.append(order)
        for data in self._in.arrived(self.now + 0.6 * CYCLE):
            self.controller.receive(data, self.now + 0.6 * CYCLE)
        self.cycles += 1
        assert self.cycles < 10_000, "the runner does not end"
        self.now += CYCLE
        self._report = None
        self._out.put(self.controller.tick(self.now), self.now)
        self._arrived.extend(self._out.arrived(self.now + 0.3 * CYCLE))
        return True


def taken_over(line):
    """Enter command mode; the last report."""
    report = yield m.REQUEST + b"start"
    while line.controller.state != State.CMD or report is None or not commandable(report):
        report = yield b""
    return (yield m.TAKE_OVER)


def commandable(report):
    return decode_measurement(report.measurement).commandable


def set_point(goal, last):
    return m.pack_set_point(tuple(goal), tuple((goal - last) / CYCLE))


def test_each_set_point_is_in_the_next_answer():
    line = CountedLine()

    def runner():
        yield from taken_over(line)
        goal = START.copy()
        for k in range(100):
            last = goal.copy()
            goal[3] += 0.0005 * (1.5 + np.sin(k))
            report = yield set_point(goal, last)
            assert report.position == pytest.approx(goal, abs=1e-12)
            assert not report.late
            # The controller takes it when its next cycle begins, in single precision.
            assert line.controller.set_point == pytest.approx(last, abs=1e-6)

    line.run(runner())
    assert line.cycles > 100
    assert line.controller.error == 0


def test_measurement_is_dated_when_it_came_and_not_when_the_process_was_run(monkeypatch):
    line, read_late = CountedLine(), 0.05
    clock = SimpleNamespace(monotonic=lambda: line.now + read_late, time_ns=lambda: round(1e9 * (line.now + read_late)))
    monkeypatch.setattr(arrival_time, "time", clock)
    line.noted = lambda: [(socket.SOL_SOCKET, 35, struct.pack("@ll", *divmod(round(1e9 * line.now), 10**9)))]

    def runner():
        for _ in range(5):
            report = yield b""
            assert report.time == pytest.approx(line.now, abs=1e-6)

    line.run(runner())
    line = CountedLine()
    line.noted = lambda: [(socket.SOL_SOCKET, 35, struct.pack("@ll", 2**31, 0))]  # the host's clock was set meanwhile
    line.run(dated(line, read_late))


def dated(line, late):
    for _ in range(5):
        report = yield b""
        assert report.time == pytest.approx(line.now + late, abs=1e-6)


def test_set_point_is_followed_as_late_as_the_driver_states():
    """The answer to a measurement leaves before the runner has seen it: what it leads to goes out with the next one."""
    line, arm = CountedLine(), FriArm(FriConfig(cycle=CYCLE))

    def runner():
        yield from taken_over(line)
        goal = START.copy()
        goal[3] += 0.001
        yield set_point(goal, START)
        cycles = 1
        while line.controller.set_point[3] < START[3] + 0.0009:
            yield set_point(goal, goal)
            cycles += 1
        assert cycles * CYCLE == pytest.approx(CYCLE + arm.delay)

    line.run(runner())


def test_late_runner_is_braked_and_counted_and_may_go_on():
    line = CountedLine()

    def runner():
        yield from taken_over(line)
        goal, places = START.copy(), []
        for _ in range(30):
            goal[0] += 0.002
            report = yield set_point(goal, goal - 0.002 * np.eye(7)[0])
            assert not report.late
        before = m.Traffic(*report.traffic).late_set_points
        for _ in range(40):
            report = yield b""
            assert report.late
            places.append(report.position[0])
        assert m.Traffic(*report.traffic).late_set_points - before == 40
        assert (np.diff(places) >= 0.0).all()
        assert np.ptp(places[20:]) == 0.0
        assert 0.0 < places[-1] - goal[0] < 0.02
        for _ in range(50):
            goal[0] += 0.002
            report = yield set_point(goal, goal - 0.002 * np.eye(7)[0])
            assert not report.late
        assert report.position == pytest.approx(goal, abs=1e-9)

    line.run(runner())
    assert line.controller.state == State.CMD
    assert line.controller.error == 0


@pytest.mark.parametrize(
    ("happens", "unasked", "words"),
    [
        ("drives_off", False, "drives off"),
        ("violate", False, "drive errors 0x0001"),
        ("fri_stop", False, "monitor mode, drives on"),
        ("missing", True, "answers missed"),
        ("rating", True, "quality BAD"),
    ],
)
def test_command_mode_is_left_to_the_operator_unless_it_ended_for_want_of_answers(happens, unasked, words):
    faults = LinkFaults()
    line = CountedLine(faults)

    def runner():
        report = yield from taken_over(line)
        for _ in range(30):
            yield set_point(START, START)
        match happens:
            case "missing":
                faults.down = 1.0
                for _ in range(8):
                    yield b""
                faults.down = 0.0
            case "rating":
                line.controller.rating.ceiling = 1
            case "violate":
                line.controller.violate("limit")
            case _:
                getattr(line.controller, happens)()
        while line.loss is None:
            report = yield b""
        assert report is None or not commandable(report)

    line.run(runner())
    assert line.loss[1] is unasked
    assert words in line.loss[2]


def test_controller_that_went_on_without_an_answer_is_answered_from_where_it_is():
    faults = LinkFaults()
    line = CountedLine(faults, leave_quality=0)

    def runner():
        yield from taken_over(line)
        goal, step = START.copy(), 0.001 * np.eye(7)[0]
        for _ in range(30):
            goal += step
            yield set_point(goal, goal - step)
        faults.down = 1.0
        for _ in range(3):
            yield b""
        faults.down = 0.0
        for _ in range(60):
            before = line.controller.set_point[0]
            goal += step
            yield set_point(goal, goal - step)
            assert abs(line.controller.set_point[0] - before) < 0.0021, "no jump back to where its own ramp had braked"

    line.run(runner())
    assert line.controller.state == State.CMD


def test_cycles_without_a_measurement_are_braked_through():
    faults = LinkFaults()
    line = CountedLine(faults, bridged=50, leave_quality=0)

    def runner():
        yield from taken_over(line)
        goal = START.copy()
        for _ in range(30):
            goal[0] += 0.002
            report = yield set_point(goal, goal - 0.002 * np.eye(7)[0])
        faults.down = 1.0
        for _ in range(5):
            assert (yield b"") is None
        faults.down = 0.0
        report = yield b""
        assert report.steps == 6
        assert report.late
        assert report.resting
        assert goal[0] < report.position[0] < goal[0] + 0.02

    line.run(runner())
    assert line.controller.state == State.CMD
    assert line.controller.error == 0


@pytest.mark.slow
def test_bad_line_is_counted_and_never_makes_the_driver_break_a_limit():
    faults = LinkFaults(resize=0.02, duplicate=0.1, reorder=0.03, jitter=0.002, loss=0.01)
    line = CountedLine(faults, bridged=50, leave_quality=0)
    counts = []

    def runner():
        yield from taken_over(line)
        goal = START.copy()
        for _ in range(3000):
            last = goal.copy()
            goal[0] += 0.0002
            report = yield set_point(goal, last)
            if report is not None:
                counts.append(m.Traffic(*report.traffic))

    line.run(runner())
    assert counts[-1].malformed
    assert counts[-1].repeated
    assert counts[-1].lost
    assert line.controller.state == State.CMD
    assert line.controller.error == 0
    violations = ("speed", "range", "interpolation", "flags", "number")
    assert not [event for event in line.controller.events if any(word in event for word in violations)]
