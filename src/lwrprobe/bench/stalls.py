"""Whole explorations over real sockets on a host that stalls: busy loops beside them, and processes that are halted.

The emulated rig, the exploration and what disturbs them are processes of their own, as `lwrprobe emulate rig` and
`lwrprobe explore` are. How hard the probe really pressed is the simulated world's word.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.bench.emulated import Rig
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.evaluation.machine import machine
from lwrprobe.scene import load_scene

_SCENES = ("cylinder_vertical", "block", "bridge")
_HALTS = 20
"""In a run, at random times."""
_LONGEST = 1800.0
"""s that one run may take."""
_EXPLORE = "from lwrprobe.cli.app import main; main()"
_BUSY = "while True: pass"


@dataclass(slots=True, frozen=True)
class Disturbance:
    """What keeps the host from running something.

    Attributes
    ----------
    name : a few words
    busy : a busy loop on every core
    halted : `explorer` or `answering`: the process that is stopped and continued, empty = none
    halt : s, for how long
    """

    name: str
    busy: bool = False
    halted: str = ""
    halt: float = 0.0


DISTURBANCES = (
    Disturbance("none"),
    Disturbance("busy", busy=True),
    *(
        Disturbance(f"{who}-{round(1e3 * halt)}", halted=who, halt=halt)
        for who in ("explorer", "answering")
        for halt in (0.05, 0.1, 0.3)
    ),
)


@dataclass(slots=True)
class Outcome:
    """What came of one run.

    Attributes
    ----------
    summary : the run's, empty where there is none
    truth : the rig's: peak force, collisions
    halts : how often a process was halted
    said : the last line on the run's standard error, where it has left no summary
    """

    scene: str
    disturbance: Disturbance
    limit: float
    summary: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)
    halts: int = 0
    said: str = "-"

    @property
    def peak(self) -> float:
        """N, the largest true force."""
        return float(self.truth.get("peak_force_n", np.nan))

    def held(self) -> bool:
        """Done, never above the limit, and nothing was hit by a link."""
        done = self.summary.get("status") == "done"
        return done and self.peak <= self.limit and self.truth["link_collisions"] == 0


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Each disturbance and scene in turn; options `scenes`, `disturbances`, `runs` and `set` (settings, by `;`)."""
    asked = Options("stalls", options, "scenes", "disturbances", "runs", "set")
    known = {one.name: one for one in DISTURBANCES}
    names = asked.names("disturbances", "disturbance", ("busy", "answering-100") if quick else list(known), known)
    settings = [text for text in asked.text("set", "").split(";") if text]
    scenes = asked.words("scenes", _SCENES[:1] if quick else _SCENES)
    outcomes = [
        explore_disturbed(scene, known[name], settings, seed)
        for name in names
        for scene in scenes
        for seed in range(1, 1 + asked.count("runs", 1))
    ]
    report = BenchReport("stalls", "Explorations over real sockets on a host that stalls")
    report.machine = machine()
    columns = "disturbance | scene | status | robot time s | true peak N | bound N | reported N | collisions | "
    columns += "contact error RMS mm | late set points % | halts | re-entries | sensor interruptions | gaps | reason"
    report.table("What became of each run", columns, [_row(o) for o in outcomes])
    report.verdicts = [
        Verdict(
            f"{o.disturbance.name}, {o.scene}: done, peak at most {o.limit:g} N",
            f"{o.summary.get('status', 'no summary')}, {o.peak:.2f} N, {o.summary.get('reentries', 0)} re-entries",
            o.held(),
        )
        for o in outcomes
    ]
    report.notes = [
        "busy: one busy loop for each core beside the run",
        f"explorer-100: the exploring process is halted for 100 ms, {_HALTS} times at random; answering: the process "
        "that answers the controller",
        "true peak, collisions: as the simulated world knows them; bound: `peak_force_bound_n` of the summary",
    ]
    return report


def explore_disturbed(name: str, disturbance: Disturbance, settings: list[str], seed: int = 1) -> Outcome:
    """One exploration as from the command line, disturbed."""
    settings = ["truth.profile=ideal", *settings]
    rig, scene = Rig.anywhere(), load_scene(name, settings)
    outcome = Outcome(name, disturbance, scene.contact.limit)
    explore = ["explore", name, "--arm", "fri", "--sensor", "ati", "--seed", str(seed)]
    explore += [word for setting in (*settings, *rig.settings) for word in ("--set", setting)]
    with tempfile.TemporaryDirectory() as folder, rig.running(name, scene, settings, "--seed", str(seed)):
        out = Path(folder) / "run"
        words, said = [*explore, "--out", str(out), "--quiet"], Path(folder) / "said"
        with _busy(disturbance.busy), _exploring(words, said) as process:
            outcome.halts = _disturb(process, disturbance, out, seed)
        if (out / "summary.json").is_file():
            outcome.summary = json.loads((out / "summary.json").read_text())
        else:
            outcome.said = (said.read_text(errors="replace").splitlines() or ["-"])[-1]
        outcome.truth = rig.truth()
    return outcome


@contextmanager
def _busy(wanted: bool) -> Iterator[None]:
    """A busy loop for each core while the block runs."""
    count = (os.cpu_count() or 1) if wanted else 0
    loops = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


@contextmanager
def _exploring(arguments: list[str], said: Path) -> Iterator[subprocess.Popen[bytes]]:
    with said.open("wb") as stream:
        process = subprocess.Popen([sys.executable, "-c", _EXPLORE, *arguments], stderr=stream)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def _disturb(process: subprocess.Popen[bytes], disturbance: Disturbance, out: Path, seed: int) -> int:
    """Halt what is to be halted until the run has ended; how often that was."""
    ended = threading.Event()
    threading.Thread(target=_wait, args=(process, ended), daemon=True).start()
    halts, chance, begun = 0, random.Random(seed), out / "contacts.csv"
    while disturbance.halted and halts < _HALTS and not ended.wait(chance.uniform(1.0, 5.0)):
        if not begun.is_file() or begun.stat().st_size < 4096:
            continue  # the first touches are not yet over
        pid = process.pid if disturbance.halted == "explorer" else _answering(process.pid)
        if pid is None:
            continue
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
            try:
                time.sleep(disturbance.halt)
            finally:
                os.kill(pid, signal.SIGCONT)
            halts += 1
    ended.wait(_LONGEST)
    return halts


def _wait(process: subprocess.Popen[bytes], ended: threading.Event) -> None:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_LONGEST)
    ended.set()


def _answering(parent: int) -> int | None:
    """The child of the explorer that answers the controller."""
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError):
            stat = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(stat[1]) == parent and b"lwrprobe_fri.answering" in (entry / "cmdline").read_bytes():
                return int(entry.name)
    return None


def _row(o: Outcome) -> list[Any]:
    s = o.summary
    fri = s.get("devices", {}).get("fri", {})
    error = s.get("contact_error_mm") or {}
    sensor = sum(one["device"] == "sensor" for one in s.get("interruptions", ()))
    late = 100.0 * fri["late_set_points"] / fri["received"] if fri.get("received") else None
    forces = [o.peak, s.get("peak_force_bound_n"), s.get("peak_force_n"), o.truth.get("link_collisions")]
    connection = [late, o.halts, s.get("reentries"), sensor, s.get("sensor_gaps")]
    row = [o.disturbance.name, o.scene, s.get("status", "-"), s.get("sim_time_s"), *forces, error.get("rms")]
    return [*row, *connection, s.get("reason", o.said)]
