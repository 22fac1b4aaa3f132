"""Explorations back to back in one process: does memory grow, are handles left open, do cycles take longer?"""

from __future__ import annotations

import gc
import os
import tempfile
import threading
import time
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Table
from lwrprobe.contracts import LwrprobeError
from lwrprobe.evaluation.machine import machine
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import load_scene

_DURATION, _QUICK = 7200.0, 40.0
"""s by the clock on the wall"""
_SETTLED = 0.25
"""Share of the explorations after which caches and pools are taken to be full."""
_GROWTH = 0.02
"""Share by which the memory may grow from then on to the end of two hours."""
_SLOWER = 0.1
"""Share by which a cycle may take longer in the last third than in the first one."""
_PIECE = 200_000
"""Additions of the fixed piece of work that tells how fast the machine is beside its other load."""
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 0


@dataclass(slots=True, frozen=True)
class State:
    """Of the process after one exploration; the names are the columns of the table.

    Attributes
    ----------
    robot_time, wall_time, processor_time : s since the begin, of all explorations
    memory : MB, resident
    handles, threads : numbers
    cycle : us of computing time, median of the exploration
    piece : us, a fixed piece of work that has nothing to do with explorations, right after the exploration
    status : of the exploration
    """

    exploration: int
    robot_time: float
    wall_time: float
    processor_time: float
    memory: float
    handles: int
    threads: int
    cycle: float
    piece: float
    status: str


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Options `scene`, `seconds` (by the clock on the wall, in all) and `set` (settings, separated by `;`)."""
    asked = Options("endurance", options, "scene", "seconds", "set")
    if not Path("/proc/self/fd").is_dir():
        raise LwrprobeError("bench endurance needs /proc, which tells memory and handles of a process")
    (seconds,) = asked.numbers("seconds", [_QUICK if quick else _DURATION])
    settings = [text for text in asked.text("set", "").split(";") if text]
    states = _explore_for(seconds, asked.text("scene", "block"), settings)
    report = BenchReport("endurance", "Explorations back to back in one process")
    report.machine = machine()
    columns = [one.name.replace("_", " ") + _UNITS.get(one.name, "") for one in fields(State)]
    report.tables = [Table("The process after each exploration", columns, [list(astuple(s)) for s in states])]
    _requirements(report, states)
    report.figures["curve"] = lambda figure: _draw(figure, states)
    report.notes = [
        "each exploration is recorded into a folder of its own, with bag, mesh and report, which is then removed",
        f"growth is counted from {_SETTLED:.0%} of the explorations on, by a straight line through the memory",
        "cycle: wall-clock time between two set points less what was waited for; it rises with other load of the "
        "machine, and so does the time of the fixed piece of work, by which it is divided for the requirement",
    ]
    return report


_UNITS = dict.fromkeys(("robot_time", "wall_time", "processor_time"), " s")
_UNITS |= {"memory": " MB", "cycle": " us", "piece": " us"}


def _explore_for(seconds: float, scene: str, settings: list[str]) -> list[State]:
    """For so long, each exploration with the next seed."""
    states: list[State] = []
    begin, robot = time.monotonic(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() - begin < seconds:
            number, out = len(states) + 1, Path(folder) / "run"
            summary = explore(
                load_scene(scene, ['truth.profile="ideal"', *settings, f"run.seed={number}"]), out, record=True
            )
            rmtree(out)
            gc.collect()
            robot += float(summary["sim_time_s"])
            states.append(_state(number, robot, time.monotonic() - begin, summary))
    return states


def _state(number: int, robot: float, wall: float, summary: dict[str, Any]) -> State:
    memory = int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE / 1e6
    handles = len(os.listdir("/proc/self/fd")) - 1  # that of the listing itself
    return State(
        number, robot, wall, time.process_time(), memory, handles, threading.active_count(),
        float(summary["cycle_us"]), _piece(), summary["status"],
    )  # fmt: skip


def _piece() -> float:
    """us, median of five."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        sum(range(_PIECE))
        times.append(time.perf_counter() - begin)
    return 1e6 * sorted(times)[2]


def _requirements(report: BenchReport, states: list[State]) -> None:
    done = sum(s.status == "done" for s in states)
    report.require("all explorations are done", f"{done} of {len(states)}", done == len(states))
    settled = states[int(_SETTLED * len(states)) :]
    if len(settled) < 4:
        return
    times, memory = np.array([s.wall_time for s in settled]), np.array([s.memory for s in settled])
    growth = float(np.polyfit(times, memory, 1)[0]) * states[-1].wall_time
    share = growth / float(memory.mean())
    requirement = f"memory grows by at most {_GROWTH:.0%} over all explorations"
    report.require(requirement, f"{growth:+.1f} MB, {share:+.2%}", share <= _GROWTH)
    first, last = settled[0], settled[-1]
    for requirement, begun, ended in (
        ("no handle is left open", first.handles, last.handles),
        ("no thread is left running", first.threads, last.threads),
    ):
        report.require(requirement, f"{ended - begun:+d} of {ended}", ended <= begun)
    by_clock = _last_to_first([s.cycle for s in settled])
    slower = _last_to_first([s.cycle / s.piece for s in settled])
    requirement = f"a cycle takes at most {_SLOWER:.0%} longer at the end, beside a fixed piece of work"
    report.require(requirement, f"{slower:+.1%} ({by_clock:+.1%} by the clock alone)", slower <= _SLOWER)


def _last_to_first(values: list[float]) -> float:
    """Share by which the median of the last third is above that of the first."""
    third = max(1, len(values) // 3)
    return float(np.median(values[-third:]) / np.median(values[:third])) - 1.0


def _draw(figure: Any, states: list[State]) -> None:
    times = [s.wall_time / 60.0 for s in states]
    rows: list[tuple[str, list[float]]] = [
        ("memory [MB]", [s.memory for s in states]),
        ("handles", [float(s.handles) for s in states]),
        ("cycle [us]", [s.cycle for s in states]),
        ("fixed work [us]", [s.piece for s in states]),
    ]
    for axes, (label, values) in zip(figure.subplots(len(rows), 1, sharex=True), rows):
        axes.plot(times, values, marker=".", linewidth=1.0)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.2 * max(values))
        axes.grid(True, alpha=0.3)
    axes.set_xlabel("time since the begin [min]")
