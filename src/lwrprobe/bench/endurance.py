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

_ROBOT_TIME, _QUICK = 7200.0, 300.0
"""s"""
_SETTLED = 0.25
"""Share of the explorations after which caches and pools are taken to be full."""
_GROWTH = 0.02
"""Share by which the memory may grow from then on to the end of two hours."""
_SLOWER = 0.1
"""Share by which a cycle may take longer in the last part than in the first one."""
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 0


@dataclass(slots=True, frozen=True)
class State:
    """Of the process after one exploration; the names are the columns of the table.

    Attributes
    ----------
    robot_time, wall_time : s since the begin, of all explorations
    memory : MB, resident
    handles, threads : numbers
    cycle : us of computing time, median of the exploration
    status : of the exploration
    """

    exploration: int
    robot_time: float
    wall_time: float
    memory: float
    handles: int
    threads: int
    cycle: float
    status: str


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Options `scene`, `seconds` (of robot time in all) and `set` (settings, separated by `;`)."""
    asked = Options("endurance", options, "scene", "seconds", "set")
    if not Path("/proc/self/fd").is_dir():
        raise LwrprobeError("bench endurance needs /proc, which tells memory and handles of a process")
    (seconds,) = asked.numbers("seconds", [_QUICK if quick else _ROBOT_TIME])
    settings = [text for text in asked.text("set", "").split(";") if text]
    states = _explore_for(seconds, asked.text("scene", "block"), settings)
    report = BenchReport("endurance", "Explorations back to back in one process")
    report.machine = machine()
    columns = [one.name.replace("_", " ") + _UNITS.get(one.name, "") for one in fields(State)]
    report.tables = [Table("The process after each exploration", columns, [list(astuple(s)) for s in states])]
    _requirements(report, states, seconds)
    report.figures["curve"] = lambda figure: _draw(figure, states)
    report.notes = [
        "each exploration is recorded into a folder of its own, with bag, mesh and report, which is then removed",
        f"growth is counted from {_SETTLED:.0%} of the explorations on, by a straight line through the memory",
        "cycle: wall-clock time between two set points less what was waited for; it rises with other load",
    ]
    return report


_UNITS = {"robot_time": " s", "wall_time": " s", "memory": " MB", "cycle": " us"}


def _explore_for(seconds: float, scene: str, settings: list[str]) -> list[State]:
    """So much robot time, each exploration with the next seed."""
    states: list[State] = []
    begin, robot = time.monotonic(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        while robot < seconds:
            number, out = len(states) + 1, Path(folder) / "run"
            summary = explore(load_scene(scene, [*settings, f"run.seed={number}"]), out, record=True)
            rmtree(out)
            gc.collect()
            robot += float(summary["sim_time_s"])
            states.append(_state(number, robot, time.monotonic() - begin, summary))
    return states


def _state(number: int, robot: float, wall: float, summary: dict[str, Any]) -> State:
    memory = int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE / 1e6
    handles = len(os.listdir("/proc/self/fd")) - 1  # that of the listing itself
    return State(
        number, robot, wall, memory, handles, threading.active_count(), float(summary["cycle_us"]), summary["status"]
    )


def _requirements(report: BenchReport, states: list[State], seconds: float) -> None:
    done = sum(s.status == "done" for s in states)
    report.require("all explorations are done", f"{done} of {len(states)}", done == len(states))
    settled = states[int(_SETTLED * len(states)) :]
    if len(settled) < 4:
        return
    times, memory = np.array([s.robot_time for s in settled]), np.array([s.memory for s in settled])
    growth = float(np.polyfit(times, memory, 1)[0]) * seconds
    share = growth / float(memory.mean())
    report.require(
        f"memory grows by at most {_GROWTH:.0%} over all explorations",
        f"{growth:+.1f} MB, {share:+.2%}",
        share <= _GROWTH,
    )
    more = settled[-1].handles - settled[0].handles
    report.require("no handle is left open", f"{more:+d} of {settled[-1].handles}", more <= 0)
    threads = settled[-1].threads - settled[0].threads
    report.require("no thread is left running", f"{threads:+d} of {settled[-1].threads}", threads <= 0)
    cycles = np.array([s.cycle for s in settled])
    third = max(1, len(cycles) // 3)
    slower = float(np.median(cycles[-third:]) / np.median(cycles[:third])) - 1.0
    report.require(f"a cycle takes at most {_SLOWER:.0%} longer at the end", f"{slower:+.1%}", slower <= _SLOWER)


def _draw(figure: Any, states: list[State]) -> None:
    times = [s.robot_time / 60.0 for s in states]
    rows: list[tuple[str, list[float]]] = [
        ("memory [MB]", [s.memory for s in states]),
        ("handles", [float(s.handles) for s in states]),
        ("cycle [us]", [s.cycle for s in states]),
    ]
    for axes, (label, values) in zip(figure.subplots(len(rows), 1, sharex=True), rows):
        axes.plot(times, values, marker=".", linewidth=1.0)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.2 * max(values))
        axes.grid(True, alpha=0.3)
    axes.set_xlabel("robot time of all explorations [min]")
