"""Recorded runs that are killed at random times: what is left on disk, and whether they can be resumed.

Each run is a forked process that writes into shared memory what it knows; that outlives the kill, so that the folder
is compared with what the run knew at that moment.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import tempfile
import time
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any

from lwrprobe.bags.bag_file import read_bag
from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import LwrprobeError
from lwrprobe.evaluation.machine import machine
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.exploration.procedures.explore import Exploration, RunOptions, explore, resume
from lwrprobe.exploration.procedures.recover import recover
from lwrprobe.scene import load_scene

_SMALL = ("area.lower=[-0.02, -0.035, 0.046]", "area.upper=[0.02, 0.035, 0.054]")
"""The upper edge of the block: the first touch comes after 3 s."""
_LONGEST = 10.0
"""s of its own time at which a run in real time is killed at the latest."""
_UNPREPARED = 0.1
"""Share of these runs that are killed while they are prepared."""
_LOST = 0.2
"""s of contacts that a kill may cost."""
_MORE_TIME = 10.0
"""s of robot time that a resumed run may take longer."""
_MORE_ERROR, _LESS_COVERAGE = 0.02, 0.02
"""mm and share by which a resumed run may be worse."""
_TIME, _CONTACT, _CONTACTS = range(3)
"""What a run writes into shared memory: its time and that of its last contact in s, the number of contacts."""


@dataclass(slots=True)
class Kill:
    """One killed run.

    Attributes
    ----------
    seed : of the run
    after : s, of the run's own time when it was killed
    contacts : that the run knew
    lost : s of contacts that it knew and that are not in contacts.csv; lost_in_bag : not in its bag
    problem : why the folder cannot be read, empty where it can
    resumed : summary of the resumed run, empty where that was not asked for
    """

    seed: int
    after: float
    contacts: int
    lost: float = 0.0
    lost_in_bag: float = 0.0
    problem: str = ""
    resumed: dict[str, Any] = field(default_factory=dict)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Options `count` (in real time), `resumed` (over a whole run, resumed afterwards), `scene`, `seed`."""
    asked = Options("kills", options, "count", "resumed", "scene", "seed")
    if not hasattr(os, "fork"):
        raise LwrprobeError("bench kills needs a system that can fork a process")
    count, resumed = asked.count("count", 5 if quick else 200), asked.count("resumed", 1 if quick else 20)
    scene, chance = asked.text("scene", "block"), random.Random(asked.count("seed", 1))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        whole = explore(load_scene(scene), place / "whole", record=True)
        kills = [_killed_in_real_time(scene, seed, chance, place / f"k{seed}") for seed in range(1, 1 + count)]
        taken_up = [_killed_and_resumed(scene, whole, chance, place / f"r{number}") for number in range(resumed)]
    report = BenchReport("kills", "Recorded runs killed at random times")
    report.machine = machine()
    _tables(report, kills, taken_up, whole)
    _requirements(report, kills, taken_up, whole)
    report.notes = [
        f"in real time: {scene} on a small area, killed in the first {_LONGEST:g} s, {_UNPREPARED:.0%} of the runs "
        "also while they are prepared",
        "lost: between the last contact that the run knew when it was killed and the last one on disk",
        f"resumed: {scene} as it is, faster than real time, killed at a random time of the whole run",
    ]
    return report


def _tables(report: BenchReport, kills: list[Kill], taken_up: list[Kill], whole: dict[str, Any]) -> None:
    columns = ["seed", "killed at s", "contacts", "lost s", "lost in the bag s", "unreadable"]
    rows = [[k.seed, k.after, k.contacts, k.lost, k.lost_in_bag, k.problem or "no"] for k in kills]
    report.table("Killed in real time", columns, rows)
    columns = ["run", "killed at s", "status", "robot time s", "coverage", "surface error median mm", "reason"]
    report.table(
        "Resumed",
        columns,
        [
            ["unbroken", None, *_figures(whole)],
            *([f"resumed {n}", k.after, *_figures(k.resumed)] for n, k in enumerate(taken_up, 1)),
        ],
    )


def _figures(summary: dict[str, Any]) -> list[Any]:
    error = summary.get("surface_error_mm") or {}
    status, reason = summary.get("status", "unreadable"), summary.get("reason")
    return [status, summary.get("sim_time_s"), summary.get("coverage"), error.get("median"), reason]


def _requirements(report: BenchReport, kills: list[Kill], taken_up: list[Kill], whole: dict[str, Any]) -> None:
    unreadable = sum(bool(k.problem) for k in [*kills, *taken_up])
    report.require("no folder is unreadable", f"{unreadable} of {len(kills) + len(taken_up)}", unreadable == 0)
    for name, lost in (("contacts.csv", [k.lost for k in kills]), ("the bag", [k.lost_in_bag for k in kills])):
        most = max(lost)
        report.require(f"at most {_LOST:g} s of contacts are not in {name}", f"{most:.3f} s", most <= _LOST)
    done = [k.resumed for k in taken_up if k.resumed.get("status") == "done"]
    report.require("resumed runs are done", f"{len(done)} of {len(taken_up)}", len(done) == len(taken_up))
    if done:
        more = max(float(s["sim_time_s"]) for s in done) - float(whole["sim_time_s"])
        allowed = f"at most {_MORE_TIME:g} s of robot time more than the unbroken run"
        report.require(allowed, f"{more:+.1f} s", more <= _MORE_TIME)
        worse = max(s["surface_error_mm"]["median"] for s in done) - whole["surface_error_mm"]["median"]
        allowed = f"surface error, median, at most {_MORE_ERROR:g} mm above that of the unbroken run"
        report.require(allowed, f"{worse:+.3f} mm", worse <= _MORE_ERROR)
        less = whole["coverage"] - min(s["coverage"] for s in done)
        allowed = f"coverage at most {_LESS_COVERAGE:g} below that of the unbroken run"
        report.require(allowed, f"{less:+.3f}", less <= _LESS_COVERAGE)


def _killed_in_real_time(scene: str, seed: int, chance: random.Random, folder: Path) -> Kill:
    process, known = _started(scene, [*_SMALL, f"run.seed={seed}"], folder, realtime=True)
    if chance.random() < _UNPREPARED:
        process.join(chance.uniform(0.0, _LONGEST))
    else:
        _wait_for(process, known, chance.uniform(0.0, _LONGEST))
    return _read_back(_kill(process, known, seed), known, folder)


def _killed_and_resumed(scene: str, whole: dict[str, Any], chance: random.Random, folder: Path) -> Kill:
    """At an evenly distributed time of the run; before its probe was ever free there is nothing to resume."""
    moment = chance.uniform(0.02, 0.98) * float(whole["sim_time_s"])
    process, known = _started(scene, [], folder, realtime=False)
    _wait_for(process, known, moment)
    kill = _read_back(_kill(process, known, int(whole["seed"])), known, folder)
    if not kill.problem:
        try:
            kill.resumed = resume(folder)
        except LwrprobeError as error:
            kill.resumed = {"status": "refused", "reason": str(error)}
    return kill


def _started(scene: str, settings: list[str], folder: Path, *, realtime: bool) -> tuple[Any, Any]:
    """A process that explores, and the memory in which it says how far it is."""
    known = RawArray("d", 3)
    process = multiprocessing.get_context("fork").Process(
        target=_explore, args=(scene, settings, folder, realtime, known), daemon=True
    )
    process.start()
    return process, known


def _wait_for(process: Any, known: Any, moment: float) -> None:
    while process.is_alive() and known[_TIME] < moment:
        time.sleep(0.001)


def _explore(scene: str, settings: list[str], folder: Path, realtime: bool, known: Any) -> None:
    options = RunOptions(out=folder, realtime=realtime, record=True)
    with (
        open(os.devnull, "w") as nowhere,
        redirect_stderr(nowhere),
        Exploration(load_scene(scene, settings), options) as exploration,
    ):
        contacts = exploration.recorder.contacts
        for seen in exploration:
            known[_TIME] = seen.time
            if contacts:
                known[_CONTACT], known[_CONTACTS] = contacts[-1].time, len(contacts)


def _kill(process: Any, known: Any, seed: int) -> Kill:
    process.kill()
    process.join()
    return Kill(seed, float(known[_TIME]), int(known[_CONTACTS]))


def _read_back(kill: Kill, known: Any, folder: Path) -> Kill:
    """Recover the folder, read all of it and compare it with what the run knew."""
    if not (folder / "scene.toml").is_file() and not kill.after:
        return kill  # killed before there was a run
    try:
        recover(folder)
        times = read_run(folder).record.times
        assert times is not None
        # A run that was killed while it was prepared has no bag yet; one that knows a contact must have it.
        begun = kill.contacts or any(folder.glob("bag/*.mcap"))
        in_bag = sum(m.decode().width for m in read_bag(folder) if m.topic == "/contacts") if begun else 0
    except Exception as error:  # whatever it is: somebody could not read the folder
        kill.problem = f"{type(error).__name__}: {error}"
        return kill
    if kill.contacts:
        last = float(known[_CONTACT])
        kill.lost = max(0.0, last - times[-1]) if len(times) else last
        kept = min(in_bag, len(times))
        kill.lost_in_bag = max(0.0, last - times[kept - 1]) if kept else last - (times[0] if len(times) else 0.0)
    return kill
