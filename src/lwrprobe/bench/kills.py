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

_IDEAL = "truth.profile=ideal"
_SMALL = (_IDEAL, "area.lower=[-0.02, -0.035, 0.046]", "area.upper=[0.02, 0.035, 0.054]")
"""The upper edge of the block."""
_AT_ONCE = 4
"""Runs in real time side by side: each of them mostly waits."""
_UNPREPARED = 0.1
"""So many more runs, as a share, are killed while they are prepared."""
_PREPARATION = 4.0
"""s by the clock on the wall after which such a run is killed at the latest."""
_LOST = 0.2
"""s of contacts that a kill may cost."""
_MORE_TIME = 10.0
"""s of robot time that a resumed run may take longer."""
_MORE_ERROR, _LESS_COVERAGE = 0.02, 0.02
"""mm and share by which a resumed run may be worse."""
_MOST = 0.5
"""Share of the kills that must come after the first contact: before it there is nothing to lose."""
_TIME, _CONTACTS, _NOTED = range(3)
"""What a run writes into shared memory: its time in s, the number of its contacts, and when it knew each of them."""
_MOST_CONTACTS = 100_000


@dataclass(slots=True)
class Kill:
    """One killed run.

    Attributes
    ----------
    seed : of the run
    after : s, of the run's own time when it was killed
    contacts : that the run knew
    lost : s by the clock on the wall, from the first contact that is not in contacts.csv to the last one that it knew
    lost_in_bag : s, the same of its bag
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


@dataclass(slots=True)
class Running:
    """A process that explores.

    Attributes
    ----------
    process : it
    known : what it knows, in memory that outlives it: time s, number of contacts, and the time by the clock on the
        wall s of each contact
    folder : of its run
    """

    process: Any
    known: Any
    folder: Path

    def kill(self, seed: int) -> Kill:
        """At once; then recover the folder, read all of it and compare it with what the run knew."""
        self.process.kill()
        self.process.join()
        return _read_back(Kill(seed, float(self.known[_TIME]), int(self.known[_CONTACTS])), self.known, self.folder)


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """Options `count` (in real time), `resumed` (over a whole run, resumed afterwards), `scene`, `seed`."""
    asked = Options("kills", options, "count", "resumed", "scene", "seed")
    if not hasattr(os, "fork"):
        raise LwrprobeError("bench kills needs a system that can fork a process")
    count, resumed = asked.count("count", 5 if quick else 200), asked.count("resumed", 1 if quick else 20)
    scene, chance = asked.text("scene", "block"), random.Random(asked.count("seed", 1))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        whole = explore(load_scene(scene, [_IDEAL]), place / "whole", record=True)
        length = float(explore(load_scene(scene, _SMALL), place / "small", record=True)["sim_time_s"])
        moments = [chance.uniform(0.0, length) for _ in range(count)]
        kills = _killed_in_real_time(scene, moments, place)
        unprepared = max(1, round(_UNPREPARED * count))
        early = [_killed_while_prepared(scene, count + 1 + n, chance, place / f"p{n}") for n in range(unprepared)]
        taken_up = [_killed_and_resumed(scene, whole, chance, place / f"r{number}") for number in range(resumed)]
    report = BenchReport("kills", "Recorded runs killed at random times")
    report.machine = machine()
    _tables(report, kills, early, taken_up, whole)
    _requirements(report, kills, early, taken_up, whole)
    report.figures["lost"] = lambda figure: _draw(figure, kills, taken_up, whole)
    report.notes = [
        f"in real time: {scene} on a small area, {_AT_ONCE} runs side by side, each killed at a random time of the "
        f"{length:.1f} s that the unbroken run takes; the time counts from the strategy's first sample",
        "while prepared: after a random time since the process was started; most of these have not moved yet",
        "lost: by the clock on the wall, from the first contact that is not on disk to the last one that the run knew; "
        "a run that this machine held up catches up with the robot's time afterwards, faster than it",
        f"resumed: {scene} as it is, faster than real time, killed at a random time of the whole run",
    ]
    return report


def _tables(
    report: BenchReport, kills: list[Kill], early: list[Kill], taken_up: list[Kill], whole: dict[str, Any]
) -> None:
    columns = ["seed", "killed at s", "contacts", "lost s", "lost in the bag s", "unreadable"]
    for title, rows in (("Killed in real time", kills), ("Killed while prepared", early)):
        cells = [[k.seed, k.after, k.contacts, k.lost, k.lost_in_bag, k.problem or "no"] for k in rows]
        report.table(title, columns, cells)
    errors = [f"{name} mm" for name in _ERRORS]
    columns = ["run", "killed at s", "status", "robot time s", "coverage", *errors, "reason"]
    resumed = [[f"resumed {n}", k.after, *_figures(k.resumed)] for n, k in enumerate(taken_up, 1)]
    report.table("Resumed", columns, [["unbroken", None, *_figures(whole)], *resumed])


_ERRORS = {
    "contact error, median": ("contact_error_mm", "median"),
    "distance of contacts from the surface, median": ("surface_error_mm", "median"),
    "mesh error, mean": ("mesh_error_mm", "mean"),
}


def _error(summary: dict[str, Any], name: str) -> float | None:
    table, key = _ERRORS[name]
    return (summary.get(table) or {}).get(key)


def _figures(summary: dict[str, Any]) -> list[Any]:
    status, reason = summary.get("status", "unreadable"), summary.get("reason")
    errors = [_error(summary, name) for name in _ERRORS]
    return [status, summary.get("sim_time_s"), summary.get("coverage"), *errors, reason]


def _requirements(
    report: BenchReport, kills: list[Kill], early: list[Kill], taken_up: list[Kill], whole: dict[str, Any]
) -> None:
    every = [*kills, *early, *taken_up]
    unreadable = sum(bool(k.problem) for k in every)
    report.require("no folder is unreadable", f"{unreadable} of {len(every)}", unreadable == 0)
    after = sum(k.contacts > 0 for k in kills)
    requirement = f"at least {_MOST:.0%} of the kills in real time come after the first contact"
    report.require(requirement, f"{after} of {len(kills)}", after >= _MOST * len(kills))
    for name, lost in (("contacts.csv", [k.lost for k in kills]), ("the bag", [k.lost_in_bag for k in kills])):
        most = max(lost)
        report.require(f"at most {_LOST:g} s of contacts are not in {name}", f"{most:.3f} s", most <= _LOST)
    done = [k.resumed for k in taken_up if k.resumed.get("status") == "done"]
    report.require("resumed runs are done", f"{len(done)} of {len(taken_up)}", len(done) == len(taken_up))
    if done:
        more = max(float(s["sim_time_s"]) for s in done) - float(whole["sim_time_s"])
        allowed = f"at most {_MORE_TIME:g} s of robot time more than the unbroken run"
        report.require(allowed, f"{more:+.1f} s", more <= _MORE_TIME)
        for name in _ERRORS:
            unbroken, found = _error(whole, name), [_error(s, name) for s in done]
            if unbroken is None:
                continue
            worst = max(float("inf") if error is None else error for error in found) - unbroken
            allowed = f"{name}, at most {_MORE_ERROR:g} mm above that of the unbroken run"
            report.require(allowed, f"{worst:+.3f} mm", worst <= _MORE_ERROR)
        less = whole["coverage"] - min(s["coverage"] for s in done)
        allowed = f"coverage at most {_LESS_COVERAGE:g} below that of the unbroken run"
        report.require(allowed, f"{less:+.3f}", less <= _LESS_COVERAGE)


def _draw(figure: Any, kills: list[Kill], taken_up: list[Kill], whole: dict[str, Any]) -> None:
    left, right = figure.subplots(1, 2)
    for name, lost in (("contacts.csv", [k.lost for k in kills]), ("bag", [k.lost_in_bag for k in kills])):
        left.plot([k.after for k in kills], lost, ".", label=name)
    left.axhline(_LOST, color="gray", linestyle="--", label="allowed")
    left.set(xlabel="robot time of the kill [s]", ylabel="contacts lost [s]")
    left.legend()
    done = [k for k in taken_up if k.resumed.get("status") == "done"]
    more = [float(k.resumed["sim_time_s"]) - float(whole["sim_time_s"]) for k in done]
    right.plot([k.after for k in done], more, ".")
    right.axhline(_MORE_TIME, color="gray", linestyle="--")
    right.set(xlabel="robot time of the kill [s]", ylabel="robot time of the resumed run, more than unbroken [s]")
    for axes in (left, right):
        axes.grid(True, alpha=0.3)


def _killed_in_real_time(scene: str, moments: list[float], place: Path) -> list[Kill]:
    """One run for each moment [s of its own time]; a batch is killed before the first of it is read."""
    kills = []
    for first in range(0, len(moments), _AT_ONCE):
        batch = dict(enumerate(moments[first : first + _AT_ONCE], first + 1))
        running = {seed: _started_small(scene, seed, place / f"k{seed}") for seed in batch}
        waiting = set(batch)
        while waiting:
            for seed in tuple(waiting):
                if not running[seed].process.is_alive() or running[seed].known[_TIME] >= batch[seed]:
                    running[seed].process.kill()
                    waiting.discard(seed)
            time.sleep(0.001)
        kills += [running[seed].kill(seed) for seed in batch]
    return kills


def _killed_while_prepared(scene: str, seed: int, chance: random.Random, folder: Path) -> Kill:
    running = _started_small(scene, seed, folder)
    running.process.join(chance.uniform(0.0, _PREPARATION))
    return running.kill(seed)


def _killed_and_resumed(scene: str, whole: dict[str, Any], chance: random.Random, folder: Path) -> Kill:
    """At an evenly distributed time of the run; before its probe was ever free there is nothing to resume."""
    moment = chance.uniform(0.02, 0.98) * float(whole["sim_time_s"])
    running = _started(scene, [_IDEAL], folder, realtime=False)
    _wait_for(running, moment)
    kill = running.kill(int(whole["seed"]))
    if not kill.problem:
        try:
            kill.resumed = resume(folder)
        except LwrprobeError as error:
            kill.resumed = {"status": "refused", "reason": str(error)}
    return kill


def _started_small(scene: str, seed: int, folder: Path) -> Running:
    return _started(scene, [*_SMALL, f"run.seed={seed}"], folder, realtime=True)


def _started(scene: str, settings: list[str], folder: Path, *, realtime: bool) -> Running:
    known = RawArray("d", _NOTED + _MOST_CONTACTS)
    process = multiprocessing.get_context("fork").Process(
        target=_explore, args=(scene, settings, folder, realtime, known), daemon=True
    )
    process.start()
    return Running(process, known, folder)


def _wait_for(running: Running, moment: float) -> None:
    while running.process.is_alive() and running.known[_TIME] < moment:
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
            for number in range(int(known[_CONTACTS]), min(len(contacts), _MOST_CONTACTS)):
                known[_NOTED + number] = time.monotonic()
                known[_CONTACTS] = number + 1


def _read_back(kill: Kill, known: Any, folder: Path) -> Kill:
    if not (folder / "scene.toml").is_file() and not kill.after:
        return kill  # killed before there was a run
    try:
        recover(folder)
        times = read_run(folder, corrected=False).record.times
        assert times is not None
        # A run that was killed while it was prepared has no bag yet; one that knows a contact must have it.
        begun = kill.contacts or any(folder.glob("bag/*.mcap"))
        in_bag = sum(m.decode().width for m in read_bag(folder) if m.topic == "/contacts") if begun else 0
    except Exception as error:  # whatever it is: somebody could not read the folder
        kill.problem = f"{type(error).__name__}: {error}"
        return kill
    if kill.contacts:
        kill.lost, kill.lost_in_bag = (_since(known, min(kept, kill.contacts)) for kept in (len(times), in_bag))
    return kill


def _since(known: Any, kept: int) -> float:
    """s from the first contact that is not among the `kept` ones to the last one that is known.

    From the last kept one to that would count the path between two touches as well, on which there is no contact.
    """
    count = int(known[_CONTACTS])
    return float(known[_NOTED + count - 1] - known[_NOTED + kept]) if kept < count else 0.0
