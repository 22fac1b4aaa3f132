"""Every fault of arm and sensor in turn, during a contour, over real sockets: what the run does about it.

The emulated rig runs in a process of its own, the exploration in this one, exactly as `lwrprobe explore` runs it. As
soon as the probe follows the surface the fault begins; from then on the simulated world is asked, many times a second,
where the arm is and how hard it presses.
"""

from __future__ import annotations

import csv
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.bench.emulated import Rig
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport, Verdict
from lwrprobe.contracts import UnknownNameError
from lwrprobe.evaluation.machine import machine
from lwrprobe.exploration.loop.explorer import ProgressSnapshot
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import Scene, load_scene
from lwrprobe.scene.scene_robot import robot_of

_SCENE = "cylinder_vertical"
_SMALL = (
    "area.lower=[-0.02, -0.045, 0.006]",
    "area.upper=[0.02, 0.045, 0.06]",
    "strategy.step=0.01",
    "truth.profile=ideal",
)
_TOUCHED = 40
"""Contacts after which the probe is taken to follow the surface."""
_WATCHED = 4.0
"""s for which a run that is to go on is watched."""
_BEFORE = 0.3
"""s of watching before the fault: they tell in which direction it finds the tip."""
_MOTION = 2e-4
"""m, from which on that direction is known."""
_TRIES = 3
"""Runs that a busy machine may end before the fault has begun."""


@dataclass(slots=True, frozen=True)
class Fault:
    """One thing that goes wrong.

    Attributes
    ----------
    name : a few words
    line : what the rig's operator types
    words : the sentence has one of these; empty = the run goes on
    travel : m that the tip may move after the fault began, the return path not counted
    goes_back : the tip is to leave the surface by itself
    person : somebody or a limit has stopped the arm, which must not move again unasked
    settings : of the scene, beside the small area
    """

    name: str
    line: str
    words: tuple[str, ...] = ()
    travel: float = 0.004
    goes_back: bool = False
    person: bool = False


# At 20 mm/s, 0.1 s of silence and the stop are 2.5 mm; frozen values are found after 0.5 s.
FAULTS = (
    # The run and the sensor's driver both wait for 1 s: on a busy host either is the first to say so.
    Fault("sensor silent", "ati fault down=1", ("no usable wrench sample", "has been silent"), goes_back=True),
    Fault("sensor repeats its last record", "ati fault freeze", ("no usable wrench sample",), goes_back=True),
    Fault("sensor's values stand still", "ati stuck 1 on", ("cannot be relied on", "no usable"), 0.015, goes_back=True),
    Fault("sensor saturated", "ati saturate 1 on", ("end of its range",), goes_back=True),
    Fault("bridge voltage low", "ati bridge 1 on", ("no usable wrench sample",), goes_back=True),
    Fault("samples 0.3 s late", "ati fault delay=0.3", ("no usable wrench sample",), goes_back=True),
    Fault("sensor switched off and on", "ati restart 1", ("no usable", "restarted"), goes_back=True),
    Fault("30 % of the samples lost", "ati fault loss=0.3"),
    Fault("sensor's line corrupt, 5 %", "ati fault corrupt=0.05"),
    Fault("controller silent", "fri fault down=1", ("has been silent",)),
    Fault("drives off", "fri drives off", ("drives off",), person=True),
    Fault("emergency stop", "fri emergency", ("drives off",), person=True),
    Fault("stopped by the operator", "fri stop", ("left command mode",), person=True),
    Fault("joint limit hit", "fri limit", ("drive errors",), person=True),
    Fault("quality falls", "fri fault quality=bad", ("quality BAD",)),
    Fault("controller repeats its last word", "fri fault freeze", ("has been silent", "left command mode")),
    Fault("controller restarted", "fri restart 1", ("has been silent", "left command mode")),
    Fault("2 % of the controller's datagrams lost", "fri fault loss=0.02"),
)
QUICK = ("sensor silent", "sensor saturated", "30 % of the samples lost", "controller silent", "drives off")
_REENTRY = "safety.reentry_time=4.0"
"""So that a bench does not wait long for an arm that does not come back."""


@dataclass(slots=True)
class Outcome:
    """What came of one fault.

    Attributes
    ----------
    summary : of the run
    kept : contacts in the run folder afterwards; before : when the fault began
    path : (m, 4) s since the fault began, negative before it, and the tip in m
    peak : N, largest true force on the sphere since then
    collisions : of links other than the sphere; touching : the sphere, at the end
    """

    fault: Fault
    limit: float
    summary: dict[str, Any] = field(default_factory=dict)
    before: int = 0
    kept: int = 0
    path: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    peak: float = 0.0
    collisions: int = 0
    touching: bool = False

    @property
    def stopped(self) -> bool:
        """The run ended by itself, with exit code 1."""
        return self.summary["status"] != "done" and self.summary["reason"] != "interrupted"

    @property
    def travel(self) -> float:
        """m that the tip went on in the direction in which the fault found it: its return does not count."""
        ahead = self._ahead()
        return float(ahead.max()) if len(ahead) else float("nan")

    @property
    def rest_after(self) -> float:
        """s from the fault until the tip went on no more, to a twentieth of a millimetre."""
        ahead = self._ahead()
        times = self.path[self.path[:, 0] > 0.0, 0]
        return float(times[np.argmax(ahead >= ahead.max() - 5e-5)]) if len(ahead) else float("nan")

    def _ahead(self) -> np.ndarray:
        """(m,) m from the fault on, along the motion in which it found the tip."""
        before, after = self.path[self.path[:, 0] <= 0.0, 1:], self.path[self.path[:, 0] > 0.0, 1:]
        if len(before) < 2 or len(after) == 0:
            return np.empty(0)
        path, moved = before[-1] - before[0], after - before[-1]
        length = np.linalg.norm(path)
        return moved @ (path / length) if length > _MOTION else np.linalg.norm(moved, axis=1)

    def held(self) -> bool:
        """All that is required."""
        fault = self.fault
        quiet = self.peak <= self.limit and self.collisions == 0 and self.kept >= self.before > 0
        if not fault.words:
            return quiet and not self.stopped
        said = any(word in self.summary["reason"] for word in fault.words)
        left = not (fault.goes_back and self.touching)
        rests = not (fault.person and self.summary["reentries"])
        return quiet and self.stopped and said and left and rests and self.travel <= fault.travel


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Each fault in turn; option `only` names one of them."""
    wanted = [f for f in FAULTS if not quick or f.name in QUICK]
    if "only" in Options("faults", options, "only"):
        wanted = [f for f in FAULTS if f.name == options["only"]]
        if not wanted:
            raise UnknownNameError("fault", options["only"], [f.name for f in FAULTS])
    outcomes = [suffer(fault) for fault in wanted]
    report = BenchReport("faults", "Each fault of arm and sensor, during a contour over real sockets")
    report.machine = machine()
    columns = "fault | ended | exit code | moved on mm | for s | peak N | touches | kept | re-entries | sentence"
    report.table("What the run does about it", columns, [_row(o) for o in outcomes])
    report.verdicts = [
        Verdict(o.fault.name, f"peak {o.peak:.2f} N, moved {1e3 * o.travel:.2f} mm, {o.summary['reason']}", o.held())
        for o in outcomes
    ]
    report.notes = [
        f"limit {outcomes[0].limit:g} N; moved on: the tip, in the direction in which the fault found it",
        "touches: the sphere, at the end; kept: all contacts from before the fault are in the run folder",
        "peak: the true force on the sphere since the fault began, as the simulated world knows it",
    ]
    return report


def suffer(fault: Fault) -> Outcome:
    """One exploration with one fault; begun again where it ended before the fault could happen."""
    for _ in range(_TRIES):
        outcome = _suffer_once(fault)
        if outcome.before:
            break
    return outcome


def _suffer_once(fault: Fault) -> Outcome:
    rig = Rig.anywhere()
    scene = load_scene(_SCENE, [*_SMALL, _REENTRY, 'arm.driver="fri"', 'sensor.driver="ati"', *rig.settings])
    with tempfile.TemporaryDirectory() as folder, rig.running(_SCENE, scene, _SMALL):
        outcome = Outcome(fault, scene.contact.limit)
        operator = _Operator(rig, scene)
        watch = _Trigger(operator, outcome)
        outcome.summary = explore(scene, Path(folder), watch=watch)
        operator.rest(0.5)
        outcome.path = operator.path()
        truth = rig.truth()
        outcome.peak, outcome.collisions = truth["peak_since_mark_n"], truth["link_collisions"]
        outcome.touching = truth["force_n"] > 0.0
        with (Path(folder) / "contacts.csv").open() as rows:
            outcome.kept = sum(1 for _ in csv.reader(rows)) - 1
        return outcome


class _Trigger:
    """Shown what the probe does, it lets the fault begin, and ends a run that has gone on for long enough."""

    def __init__(self, operator: _Operator, outcome: Outcome) -> None:
        self._operator, self._outcome = operator, outcome
        self._watching: float | None = None
        self._begun: float | None = None
        self._ended = False

    def __call__(self, snapshot: ProgressSnapshot) -> None:
        now = time.monotonic()
        if self._watching is None:
            if snapshot.contacts >= _TOUCHED and snapshot.force > 0.0:
                self._operator.watch()
                self._watching = now
        elif self._begun is None:
            if now - self._watching > _BEFORE:
                self._outcome.before = snapshot.contacts
                self._operator.begin(self._outcome.fault.line)
                self._begun = time.monotonic()
        elif not self._outcome.fault.words and not self._ended and time.monotonic() - self._begun > _WATCHED:
            self._ended = True
            raise KeyboardInterrupt


class _Operator:
    """Types lines on the rig's control port, and asks the world where the arm is from a thread of its own."""

    def __init__(self, rig: Rig, scene: Scene) -> None:
        self._rig, self._robot = rig, robot_of(scene)
        self._looks: list[tuple[float, list[float]]] = []
        self._begun: float | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def watch(self) -> None:
        """Look where the arm is from now on."""
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def begin(self, line: str) -> None:
        """Let the fault happen."""
        self._rig.ask("world mark")
        self._begun = self._rig.truth()["time_s"]
        self._rig.ask(line)

    def rest(self, seconds: float) -> None:
        """Watch for a while longer, then no more."""
        time.sleep(seconds)
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def path(self) -> np.ndarray:
        """(m, 4) world's s since the fault began, negative before it, and the tip; empty when it never began."""
        if not self._looks or self._begun is None:
            return np.empty((0, 4))
        times = np.array([time for time, _ in self._looks])
        tips = self._robot.fk_batch(np.array([joints for _, joints in self._looks]))[:, :3, 3]
        moved = np.concatenate([[True], np.diff(times) > 0.0])
        return np.column_stack([times - self._begun, tips])[moved]

    def _watch(self) -> None:
        while not self._stop.wait(0.02):
            truth = self._rig.truth()
            self._looks.append((truth["time_s"], truth["joints"]))


def _row(o: Outcome) -> list[Any]:
    ended, code, sentence = ("by itself", 1, o.summary["reason"]) if o.stopped else ("goes on", None, "-")
    moved, rest = (1e3 * o.travel, o.rest_after) if o.fault.words else (None, None)
    seen = [o.peak, o.touching, o.kept >= o.before, o.summary["reentries"]]
    return [o.fault.name, ended, code, moved, rest, *seen, sentence]
