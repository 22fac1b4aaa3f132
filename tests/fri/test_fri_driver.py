"""The driver against the emulated controller over real sockets on the loopback interface."""

import re
import socket
import subprocess
import threading
import time
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contracts import (
    ArmStatus,
    BufferedArm,
    ConnectionLost,
    DeviceRefused,
    Driver,
    DriverContext,
    DriverError,
    InputError,
    MotionInterrupted,
)
from lwrprobe_fri import FriConfig, FriDriver
from lwrprobe_fri.driver import FriArm
from lwrprobe_fri.emulator import Controller, ControllerSettings, FriEmulator, LaggingArm
from lwrprobe_fri.health_checks import _timing
from lwrprobe_fri.krl import PROGRAMS
from lwrprobe_fri.wire import State
from lwrprobe_rig.reactor import Reactor

pytestmark = pytest.mark.realtime

START = np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def bench(krl="A", emulate=None, **config):
    """(arm, emulator) that are connected but not open; both are patient, since the machine may be busy."""
    bind = f"127.0.0.1:{free_port()}"
    plant = LaggingArm(START)
    settings = ControllerSettings(cycle=0.01, krl=krl, **({"bridged": 50, "leave_quality": 0} | (emulate or {})))
    emulator = FriEmulator(lambda: Controller(plant, settings), "127.0.0.1:0", bind)
    with Reactor([emulator]):
        options = {"connect_timeout": 5.0, "start_timeout": 20.0, "silence": 1.0} | config
        arm = FriDriver(DriverContext(FriConfig(bind, emulator.address, krl, **options), None)).arm()
        try:
            yield arm, emulator
        finally:
            arm.close()


def move(arm, joint, by, cycles):
    """A smooth move of one joint; the last state."""
    start = np.array(arm.measurement.set_point)
    state = arm.read()
    for k in range(1, cycles + 1):
        goal = start.copy()
        goal[joint] += by * 0.5 * (1 - np.cos(np.pi * k / cycles))
        arm.command(goal)
        state = arm.read()
    return state


def read_on(arm):
    """Read until an error comes."""
    for _ in range(300):
        arm.read()


def hold_on(arm):
    """Stay where it is until an error comes."""
    for _ in range(300):
        arm.command(arm.read().q)


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


def test_plugin_fills_the_role_arm():
    driver = FriDriver(DriverContext(None, None))
    assert isinstance(driver, Driver)
    assert driver.roles == {"arm"}
    assert driver.ground_truth() is None
    with pytest.raises(DriverError, match="role arm"):
        driver.sensor()


@pytest.mark.parametrize("krl", ["A", "B"])
def test_command_mode_and_a_tenth_of_a_radian(krl):
    with bench(krl) as (arm, emulator):
        arm.open()
        assert arm.cycle == pytest.approx(0.01)
        state = arm.read()
        assert state.status & ~ArmStatus.LATE == 0
        assert state.q == pytest.approx(START, abs=1e-6)
        assert state.temperature.shape == (7,)
        move(arm, 0, 0.1, 100)
        for _ in range(10):
            state = arm.read()
        assert state.q[0] == pytest.approx(0.1, abs=1e-3)
        assert emulator.controller.error == 0
        arm.close()
        assert emulator.controller.state == State.MON
        assert emulator.controller.power


def test_started_by_hand():
    with bench("none") as (arm, emulator):
        timer = threading.Timer(0.5, lambda: emulator.control("start"))
        timer.start()
        arm.open()
        timer.join()
        assert emulator.controller.state == State.CMD


def test_joint_impedance():
    with bench("A", strategy="joint_impedance") as (arm, emulator):
        arm.open()
        assert move(arm, 6, 0.05, 50).q[6] == pytest.approx(0.05, abs=0.01)
        assert arm.measurement.control == 3
        assert emulator.controller.state == State.CMD


@pytest.mark.parametrize(("stated", "matrix", "mass"), [(-1.0, 0.0, 0.0), (-1.0, 0.1, 16.0), (7.0, 0.0, 7.0)])
def test_mass_is_none_where_an_emulated_controller_says_so(stated, matrix, mass):
    with bench(mass=stated) as (arm, emulator):
        assert arm.mass == (7.0 if stated == 7.0 else 16.0), "not known before the controller has spoken"
        emulator.controller._record["mass_matrix"] = matrix
        arm.connect()
        assert arm.mass == mass


def test_a_controller_elsewhere_is_not_believed_to_have_no_mass():
    arm = FriArm(FriConfig(remote="192.0.2.20:0"))
    arm._adopt_mass(np.zeros((7, 7)))
    assert arm.mass == 16.0


def test_connecting_alone_moves_nothing_and_reports():
    with bench() as (arm, emulator):
        readings = {reading.name: reading for reading in arm.health_checks(0.5)}
        assert readings["state"].value.startswith("MON")
        assert {"cycle", "rate", "jitter", "losses", "quality", "latency", "drives", "temperature"} <= set(readings)
        assert readings["cycle"].detail["cycle_ms"] == pytest.approx(10.0)
        assert readings["losses"].detail["received"] > 20
        assert "command mode" not in emulator.controller.events
        with pytest.raises(DriverError, match="not open"):
            arm.read()


def test_a_low_rate_for_lost_datagrams_is_not_blamed_on_the_controller():
    with bench() as (arm, emulator):
        emulator.set_faults("loss=0.3")
        (rate,) = [check.value for check in arm.health_checks(1.0) if check.name == "rate"]
    assert re.search(r"Hz of 100\.0, \d+ lost on the way$", rate)


@pytest.mark.parametrize(
    ("hertz", "lost", "said"),
    [(93.8, 0, ", as many as the controller sent: it paused"), (93.8, 6, ", 6 lost on the way"), (100.5, 0, "")],
)
def test_who_is_to_blame_for_a_rate(hertz, lost, said):
    timing = np.stack([np.arange(100.0) / hertz, np.full(100, 1e-4)], axis=1)
    checks = {check.name: check for check in _timing(timing, SimpleNamespace(cycle=0.01), lost)}
    assert checks["rate"].value == f"{hertz:.1f} Hz of 100.0{said}"


def test_late_runner_is_told_rests_and_may_go_on():
    """How many cycles count as late, and how it brakes, is in test_fri_answering.py, where no host can be busy."""
    with bench() as (arm, emulator):
        arm.open()
        goal = np.array(arm.measurement.set_point)
        for _ in range(30):
            goal[0] += 0.002
            arm.read()
            arm.command(goal)
        before = arm.traffic.late_set_points
        statuses = []
        wait_for(lambda: statuses.append(arm.read().status) or arm.traffic.late_set_points >= before + 35, 60.0)
        assert any(status & ArmStatus.LATE for status in statuses)
        resting = emulator.controller.set_point
        arm.read()
        assert emulator.controller.set_point == pytest.approx(resting, abs=1e-9)
        assert resting[0] - goal[0] < 0.02
        state = move(arm, 0, 0.02, 50)
        assert not state.status & ArmStatus.NOT_COMMANDING
        assert emulator.controller.error == 0


def test_states_that_came_while_nobody_read_are_kept():
    with bench() as (arm, _):
        arm.open()
        before = arm.read()
        time.sleep(0.4)
        after = arm.read()
        times = [before.time, *(state.time for state in arm.passed()), after.time]
        assert isinstance(arm, BufferedArm)
        assert len(times) > 10
        assert 0.0 < np.diff(times).min() < np.diff(times).max() < 0.2
        last = arm.read()
        assert last.time > after.time
        assert len(arm.passed()) < 10


def test_drives_off_discards_the_motion_and_restarts_only_when_asked():
    with bench() as (arm, emulator):
        arm.open()
        move(arm, 0, 0.05, 30)
        emulator.control("drives off")
        with pytest.raises(DriverError, match=r"left command mode.*drives off"):
            read_on(arm)
        with pytest.raises(DriverError, match="left command mode"):
            arm.command(START)
        emulator.control("drives on")
        events = len(emulator.controller.events)
        time.sleep(0.5)
        assert len(emulator.controller.events) == events
        assert emulator.controller.state == State.MON
        with pytest.raises(DriverError, match="left command mode"):
            arm.read()
        arm.restart()
        assert not arm.read().status & ArmStatus.NOT_COMMANDING
        assert move(arm, 0, 0.02, 30).q[0] > 0.05


def test_limit_violation_names_the_drive():
    with bench() as (arm, emulator):
        arm.open()
        emulator.control("limit")
        with pytest.raises(DriverError, match=r"drive errors 0x0001 \(A1\)"):
            read_on(arm)


def test_arm_that_stopped_for_want_of_answers_is_entered_again_and_no_other():
    with bench() as (arm, emulator):
        arm.open()
        move(arm, 0, 0.05, 30)
        emulator.control("fault down=1")
        with pytest.raises(MotionInterrupted, match=r"silent|answers missed") as stopped:
            hold_on(arm)
        assert stopped.value.unasked
        emulator.control("fault none")
        arm.reenter(30.0, asked=False)
        assert move(arm, 0, 0.02, 30).q[0] > 0.04
        emulator.control("drives off")
        with pytest.raises(MotionInterrupted) as stopped:
            read_on(arm)
        assert not stopped.value.unasked
        with pytest.raises(DeviceRefused, match="drives off"):
            arm.reenter(5.0, asked=False)
        emulator.control("drives on")
        arm.reenter(30.0, asked=True)
        assert not arm.read().status & ArmStatus.NOT_COMMANDING


def test_controller_that_was_started_anew_is_not_entered_unasked():
    with bench() as (arm, emulator):
        arm.open()
        wait_for(lambda: arm.read() and emulator.controller.rating.answer_rate > 0.9)
        emulator.control("restart 1.5")
        with pytest.raises(MotionInterrupted):
            read_on(arm)
        with pytest.raises(DeviceRefused, match="started anew"):
            arm.reenter(10.0, asked=False)


def test_quality_drop_is_named():
    with bench(emulate={"leave_quality": 2}) as (arm, emulator):
        arm.open()
        emulator.control("fault quality=bad")
        with pytest.raises(DriverError, match=r"quality BAD"):
            read_on(arm)
        arm.config = FriConfig(arm.config.bind, arm.config.remote, start_timeout=0.3)
        with pytest.raises(DeviceRefused, match=r"did not become ok.*quality BAD"):
            arm.restart()


@pytest.mark.parametrize("fault", ["fault down=1", "restart 0.5", "fault freeze"])
def test_silence_is_a_typed_loss_and_the_next_start_works(fault):
    with bench() as (arm, emulator):
        arm.open()
        move(arm, 0, 0.02, 20)
        emulator.control(fault)
        with pytest.raises(DriverError, match=r"silent|left command mode"):
            read_on(arm)
        emulator.control("fault none")
        wait_for(lambda: emulator.controller.quality >= 2)
        with pytest.raises(DriverError):
            arm.read()
        arm.restart()
        assert not arm.read().status & ArmStatus.NOT_COMMANDING


def test_stop_brakes_and_holds_until_restarted():
    with bench() as (arm, emulator):
        arm.open()
        goal = np.array(arm.measurement.set_point)
        for _ in range(40):
            goal[0] += 0.004
            arm.read()
            arm.command(goal)
        arm.stop()
        arm.read()
        place = emulator.controller.set_point
        with pytest.raises(DeviceRefused, match="was stopped"):
            arm.command(goal)
        for _ in range(10):
            arm.read()
        assert emulator.controller.set_point == pytest.approx(place, abs=1e-9)
        assert emulator.controller.state == State.CMD
        arm.open()
        arm.command(np.array(arm.measurement.set_point))


def test_jump_is_refused_before_it_reaches_the_wire():
    with bench() as (arm, emulator):
        arm.open()
        jump = np.array(arm.measurement.set_point)
        jump[2] += 0.5
        with pytest.raises(DeviceRefused, match="E1 would step"):
            arm.command(jump)
        for _ in range(5):
            arm.read()
        assert emulator.controller.error == 0
        assert emulator.controller.state == State.CMD
        with pytest.raises(DeviceRefused, match="was stopped"):
            arm.command(START)


def test_pause_gives_no_licence_to_jump():
    with bench() as (arm, emulator):
        arm.open()
        goal = np.array(arm.measurement.set_point)
        arm.read()
        arm.command(goal)
        time.sleep(0.5)
        with pytest.raises(DeviceRefused, match="A1 would step"):
            arm.command(goal + 0.5 * np.eye(7)[0])
        assert emulator.controller.set_point == pytest.approx(goal, abs=1e-6)


def test_joint_beyond_its_range_is_refused():
    with bench() as (arm, _):
        arm.open()
        beyond = np.array(arm.measurement.set_point)
        beyond[1] = np.radians(119.5)
        with pytest.raises(DeviceRefused, match=r"A2 at .* its range"):
            arm.command(beyond)


@pytest.mark.parametrize("bad", [[0.0] * 6, [[0.0] * 7], [np.nan] * 7, [0.0] * 6 + [np.inf]])
def test_set_point_that_is_none(bad):
    with pytest.raises(InputError, match="seven finite joint angles"):
        FriDriver(DriverContext(None, None)).arm().command(np.array(bad))


def test_only_the_configured_peer_is_listened_to():
    with bench() as (arm, emulator), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        arm.connect()
        host, _, port = arm.config.bind.partition(":")
        received = arm.measurement.sequence
        for _ in range(50):
            stranger.sendto(emulator._last, (host, int(port)))
        wait_for(lambda: arm.traffic.foreign == 50)
        assert arm.measurement.sequence != received or arm.traffic.received > 0
        assert arm.traffic.repeated == 0


@pytest.mark.parametrize("pause", [0.002, 0.2])
def test_a_wrong_address_of_the_controller_is_seen_from_what_came_instead(pause):
    """Datagrams of another peer, more and less often than the driver's patience: the error counts them."""
    host, port = "127.0.0.1", free_port()
    config = FriConfig(f"{host}:{port}", "127.0.0.2:49939", connect_timeout=1.5, silence=0.1)
    arm = FriDriver(DriverContext(config, None)).arm()
    stop = threading.Event()

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            while not stop.wait(pause):
                stranger.sendto(b"x" * 16, (host, port))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        with pytest.raises(
            ConnectionLost, match=r"no measurement came .*; [1-9]\d* datagrams came from other addresses"
        ):
            arm.connect()
    finally:
        stop.set()
        sender.join()


def test_corrupted_line_yields_typed_errors_alone():
    """The wire has no checksum: a changed command may trip the controller, but the driver neither hangs nor dies."""
    with bench() as (arm, emulator):
        arm.open()
        emulator.control("fault corrupt=0.2")
        for _ in range(100):
            with suppress(DriverError):
                assert np.isfinite(arm.read().q).all()
                arm.command(np.array(arm.measurement.set_point))
            time.sleep(0.005)
        assert arm.traffic.malformed + arm.traffic.implausible > 0
        emulator.control("fault none")
        wait_for(lambda: emulator.controller.quality >= 2)
        arm.restart()
        assert arm.read().q == pytest.approx(emulator.controller.set_point, abs=0.01)


def test_nobody_there_is_a_typed_error_in_time():
    config = FriConfig(f"127.0.0.1:{free_port()}", "127.0.0.1:1", connect_timeout=0.3)
    arm = FriDriver(DriverContext(config, None)).arm()
    for _ in range(2):  # the port is free again after the first
        with pytest.raises(ConnectionLost, match=r"no measurement came from 127\.0\.0\.1:1 at .* within 0\.3 s"):
            arm.open()
    arm.close()


def test_core_that_does_not_exist_is_named():
    with bench(core=4095) as (arm, _), pytest.raises(ConnectionLost, match=r"drivers\.fri\.core 4095"):
        arm.open()


def test_port_in_use_is_named():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        bind = f"127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ConnectionLost, match=f"cannot bind {bind}"):
            FriDriver(DriverContext(FriConfig(bind), None)).arm().open()


def test_cycle_must_be_the_one_the_controller_was_opened_with():
    with bench(cycle=0.005) as (arm, _), pytest.raises(InputError, match=r"drivers\.fri\.cycle"):
        arm.open()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("bind", "nowhere"),
        ("bind", "127.0.0.1:0"),
        ("remote", "127.0.0.1:99999"),
        ("krl", "C"),
        ("strategy", "torque"),
        ("stiffness", -1.0),
        ("damping", 2.0),
        ("cycle", 1.0),
        ("quality", "good"),
        ("speed", (1.0,) * 6),
        ("acceleration", (0.0,) * 7),
        ("range", (np.nan,) * 7),
        ("silence", 0.0),
        ("priority", 100),
        ("mass", -2.0),
        ("mass", 101.0),
    ],
)
def test_bad_options_are_named(field, value):
    with pytest.raises(InputError, match=f"drivers.fri.{field}"):
        FriConfig(**{field: value})


def test_close_may_be_called_at_any_time():
    with bench() as (arm, _):
        arm.close()
        arm.open()
        arm.close()
        arm.close()
        arm.open()
        assert arm.read().q.shape == (7,)


def test_requests_are_those_of_the_two_programs():
    assert PROGRAMS["A"].integers("start", "joint_impedance")[14:] == (30, 10)
    assert PROGRAMS["A"].integers("stop", "position")[14:] == (10, 20)
    assert PROGRAMS["B"].integers("start", "position")[:2] == (10, 1)
    assert not any(PROGRAMS["none"].integers("start", "position"))


@pytest.fixture
def processes(monkeypatch):
    """The processes that are started during the test."""
    start, started = subprocess.Popen, []

    def popen(*arguments, **options):
        started.append(start(*arguments, **options))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", popen)
    return started


def test_end_of_the_answering_process_reaches_the_reader(processes):
    with bench() as (arm, _):
        arm.open()
        processes[0].kill()
        with pytest.raises(DriverError, match="the line to the controller broke: its process is gone"):
            read_on(arm)
        with pytest.raises(DriverError, match="its process is gone"):
            arm.command(np.zeros(7))
        arm.close()
        arm.open()
        assert arm.read().status & ~ArmStatus.LATE == 0  # a busy host answers late


def test_no_process_is_left_behind(processes):
    with bench() as (arm, _):
        arm.open()
        arm.close()
        assert len(processes) == 1
        assert processes[0].returncode is not None
