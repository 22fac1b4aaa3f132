"""The control loop over real sockets: compute per cycle, jitter and misses at 1, 2, 4, 5 and 10 ms.

Driver and loop run in this process, the emulated controller and sensor in one of their own each. The load is the
explorer's own between two set points: read state and wrench, step a straight line, solve for the joints, command. All
of them take the real-time priority that they take in an exploration, where the system permits it.
"""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lwrprobe.bench.emulated import emulated, free_addresses
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.contracts import DriverContext, DriverError
from lwrprobe.contracts.plugins import load
from lwrprobe.evaluation.machine import machine
from lwrprobe.host.real_time import LOOP, real_time_priority
from lwrprobe.kinematics import IKSolver, robot_by_name

CYCLES_MS = (10.0, 5.0, 4.0, 2.0, 1.0)
_SHARES = (0.999, 0.99, 0.95)
_PLANNED = "as planned"
_SECONDS = 20.0
_QUICK_SECONDS = 4.0
_SWING = 0.02  # m, of the tip to and fro
_TURN = 4.0  # s, for one swing
_POSTURE = np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])
_COLUMNS = (
    "cycle ms | cycles | compute median us | compute p99 us | arrival jitter median ms | arrival jitter p99 ms | "
    "answer sent p99 ms | answers in time % | set points late | round trip ms | quality | samples | ended"
)


@dataclass(slots=True)
class _Run:
    """What one run at one cycle time left."""

    cycle: float
    compute: list[float] = field(default_factory=list)
    samples: int = 0
    begin: float = 0.0
    misses: int = 0
    late_set_points: int = 0
    arrivals: np.ndarray = field(default_factory=lambda: np.empty(0))
    turnarounds: np.ndarray = field(default_factory=lambda: np.empty(0))
    quality: str = ""
    latency: float = 0.0
    ended: str = _PLANNED

    @property
    def in_time(self) -> float:
        """Share of the controller's measurements that were answered within their cycle."""
        cycles = max(1, len(self.arrivals))
        return max(0.0, 1.0 - self.misses / (cycles + self.misses))

    @property
    def jitter(self) -> np.ndarray:
        """s, by which the time between two measurements differs from the cycle."""
        gaps = np.diff(self.arrivals)
        return np.abs(gaps - self.cycle) if len(gaps) else np.zeros(1)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Measure each cycle time in turn; options `seconds` and `cycle` (ms) change how long and which."""
    asked = Options("loop", options, "seconds", "cycle")
    (seconds,) = asked.numbers("seconds", [_QUICK_SECONDS if quick else _SECONDS])
    cycles = asked.numbers("cycle", CYCLES_MS)
    _warm_up()
    runs = [_measure(cycle / 1000.0, seconds) for cycle in cycles]
    report = BenchReport("loop", "The control loop over real sockets, driver against emulator")
    report.machine = machine()
    limits = [[f"{100 * share:g} %", _shortest(runs, share)] for share in _SHARES]
    report.table("Compute, jitter and misses", _COLUMNS, [_row(r) for r in runs])
    report.table("Shortest cycle at which so many answers are in time", "answers in time | cycle ms", limits)
    report.verdicts = [_verdict(r) for r in runs if r.cycle == 0.01]
    report.figures["jitter"] = lambda figure: _draw(figure, runs)
    report.notes = [
        "answers in time: as the emulated controller counts them, from its miss counter",
        "compute: from the state's arrival in the loop to its set point, sensor and inverse kinematics included",
        "controller, sensor and loop share this machine; a real controller keeps its own time",
    ]
    return report


def _shortest(runs: list[_Run], share: float) -> float | None:
    """ms, the shortest cycle down to which all of them had so many answers in time; None where the longest had not."""
    held = None
    for r in sorted(runs, key=lambda r: -r.cycle):
        if r.in_time < share or r.ended != _PLANNED:
            break
        held = 1000.0 * r.cycle
    return held


def _measure(cycle: float, seconds: float) -> _Run:
    bind, remote, udp, local = free_addresses(4)
    (telnet,) = free_addresses(1, socket.SOCK_STREAM)
    degrees = ",".join(f"{v:.9g}" for v in np.degrees(_POSTURE))
    arm_side = ("fri", "--bind", remote, "--remote", bind, "--cycle-ms", f"{1000 * cycle:g}", "--joints", degrees)
    with emulated(*arm_side), emulated("ati", "--telnet", telnet, "--udp", udp):
        arm = _driver("fri", bind=bind, remote=remote, cycle=cycle).arm()
        sensor = _driver("ati", telnet=telnet, udp=udp, local=local).sensor()
        outcome = _Run(cycle)
        try:
            arm.open()
            sensor.open()
            with real_time_priority(LOOP):
                _drive(arm, sensor, seconds, outcome)
        except DriverError as error:
            outcome.ended = str(error)
        finally:
            _account(arm, outcome)
            sensor.close()
            arm.close()
    return outcome


def _drive(arm: Any, sensor: Any, seconds: float, outcome: _Run) -> None:
    """Swing the tip along y; what the loop costs goes into `outcome.compute`."""
    robot, solver = _arm()
    q, following, pose, now_pose = _POSTURE.copy(), np.empty(7), np.eye(4), np.eye(4)
    robot.fk_into(q, pose)
    middle = pose[1, 3]
    arm.read()
    outcome.misses = -arm.measurement.misses
    outcome.begin = time.monotonic()
    for step in range(1, round(seconds / arm.cycle)):
        state = arm.read()
        begin = time.perf_counter()
        outcome.samples += len(sensor.read())
        robot.fk_into(state.q, now_pose)
        pose[1, 3] = middle + _SWING * np.sin(2.0 * np.pi * step * arm.cycle / _TURN) ** 3
        solver.track(pose, q, following)
        q[:] = following
        arm.command(q)
        outcome.compute.append(time.perf_counter() - begin)


def _account(arm: Any, outcome: _Run) -> None:
    last = arm.measurement
    if last is None or not outcome.compute:
        return
    outcome.misses += last.misses
    outcome.late_set_points = arm.traffic.late_set_points
    timing = arm.timing()
    outcome.arrivals, outcome.turnarounds = timing[timing[:, 0] >= outcome.begin].T
    outcome.quality, outcome.latency = last.quality.name, last.latency


def _row(r: _Run) -> list[Any]:
    if not r.compute:
        return [1000.0 * r.cycle, 0, *[None] * (_COLUMNS.count("|") - 2), r.ended]
    compute, jitter, sent = 1e6 * np.array(r.compute), 1e3 * r.jitter, 1e3 * float(np.quantile(r.turnarounds, 0.99))
    spreads = [float(np.quantile(values, share)) for values in (compute, jitter) for share in (0.5, 0.99)]
    counted = [100.0 * r.in_time, r.late_set_points, 1e3 * r.latency, r.quality, r.samples, r.ended]
    return [1000.0 * r.cycle, len(r.compute), *spreads, sent, *counted]


def _verdict(r: _Run) -> Verdict:
    held = r.in_time >= 0.99 and r.ended == _PLANNED
    p99 = 1e6 * float(np.quantile(r.compute, 0.99)) if r.compute else float("nan")
    measured = f"{100 * r.in_time:.2f} %, compute p99 {p99:.0f} us, ended {r.ended}"
    return Verdict("answers in time at 10 ms >= 99 %", measured, held)


def _draw(figure: Any, runs: list[_Run]) -> None:
    axes = figure.add_subplot()
    for r in runs:
        jitter = np.sort(1e3 * r.jitter)
        axes.semilogy(jitter, 1.0 - np.arange(len(jitter)) / len(jitter), label=f"{1000 * r.cycle:g} ms cycle")
    axes.set(xlabel="difference of arrival from the cycle [ms]", ylabel="share of cycles beyond")
    axes.set_title("Jitter of measurements on this machine")
    axes.grid(True, alpha=0.3)
    axes.legend()


def _arm() -> tuple[Any, IKSolver]:
    tool = np.eye(4)
    tool[2, 3] = 0.25
    robot = robot_by_name("lwr4").with_tool(tool)
    return robot, IKSolver(robot)


def _warm_up() -> None:
    """Compile before the clocks run: a compiler holds the interpreter for seconds."""
    robot, solver = _arm()
    pose = np.eye(4)
    robot.fk_into(_POSTURE, pose)
    solver.track(pose, _POSTURE, np.empty(7))


def _driver(name: str, **options: Any) -> Any:
    plugin = load("driver", name)
    return plugin(DriverContext(plugin.Config(**options), None))
