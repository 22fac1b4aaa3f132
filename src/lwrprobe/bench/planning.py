"""How long the strategy `active` takes to choose a stroke, and to update its estimate, as the contacts become more.

Runs are cut off after some robot time. What is timed is each answer of the strategy with which a stroke or a line was
chosen, and in it the update of the estimate; the rest is the choice, with the path to where it begins. Options
(`--set`): `scenes`; `seconds` of robot time; `contacts`, from which on the requirements count.
"""

from __future__ import annotations

from functools import partial
from time import perf_counter
from typing import Any
from unittest.mock import patch

import numpy as np

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import Motion, Observation
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.exploration.procedures.explore import Exploration, RunOptions
from lwrprobe.mapping.estimate import SurfaceEstimate
from lwrprobe.scene import load_scene

SCENES = ("block", "jaw_chuck", "random:organic:3:400")
MOST = 50.0
"""ms, for each of the two."""
COLUMNS = {
    "scene": "scene",
    "robot s": "time",
    "contacts": "contacts",
    "choices": "choices",
    "update ms": "update",
    "update ms, most": "update_max",
    "choice ms": "choice",
    "choice ms, most": "choice_max",
}

Choice = tuple[int, float, float]
"""Contacts so far, s of the update, s of all else."""


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench planning`; options `scenes`, `seconds` of robot time, `contacts`."""
    asked = Options("planning", options, "scenes", "seconds", "contacts")
    scenes = asked.words("scenes", SCENES[:1] if quick else SCENES)
    seconds, many = asked.count("seconds", 60 if quick else 900), asked.count("contacts", 500 if quick else 10_000)
    report = BenchReport("planning", "Choosing strokes: time against the number of contacts")
    report.machine = machine() | versions("numpy", "numba", "scipy")
    found = {scene: choices(scene, seconds) for scene in scenes}
    rows = [_row(scene, time, made) for scene, (time, made) in found.items()]
    report.records("Every scene", COLUMNS, rows)
    late = np.array([choice for _, made in found.values() for choice in made if choice[0] >= many]).reshape(-1, 3)
    for name, column in (("updating the estimate", 1), ("choosing a stroke", 2)):
        middle = 1e3 * float(np.median(late[:, column])) if len(late) else np.inf
        measured = f"{middle:.3g} ms in {len(late)}" if len(late) else "no run came so far"
        report.require(f"{name} from {many} contacts on: median <= {MOST:g} ms", measured, middle <= MOST)
    report.figures["contacts"] = partial(_draw, found={scene: made for scene, (_, made) in found.items()})
    report.data["choices"] = {scene: [list(choice) for choice in made] for scene, (_, made) in found.items()}
    return report


def choices(name: str, seconds: float) -> tuple[float, list[Choice]]:
    """s of robot time, and all choices that `active` made in a run over a scene, cut off after so many `seconds`."""
    scene = load_scene(name, ["strategy.name=active", "truth.profile=ideal", f"run.time_limit={seconds}"])
    made: list[Choice] = []
    with Exploration(scene, RunOptions()) as exploration:
        strategy, contacts = exploration.pipeline.strategy, exploration.recorder.contacts
        answer, update = strategy.step, SurfaceEstimate.update
        spent = [0.0, 0.0]  # s in updates, and their number, within one answer

        def timed_update(estimate: SurfaceEstimate, stroke_ended: bool = True) -> None:
            begin = perf_counter()
            update(estimate, stroke_ended)
            spent[:] = spent[0] + perf_counter() - begin, spent[1] + 1

        def timed_step(observation: Observation) -> Motion:
            spent[:], begin = (0.0, 0.0), perf_counter()
            motion = answer(observation)
            if spent[1]:
                made.append((len(contacts), spent[0], perf_counter() - begin - spent[0]))
            return motion

        time = 0.0
        with patch.object(strategy, "step", timed_step), patch.object(SurfaceEstimate, "update", timed_update):
            for seen in exploration:
                time = seen.time
    return time, made


def _row(scene: str, time: float, made: list[Choice]) -> dict[str, Any]:
    row: dict[str, Any] = {"scene": scene, "time": time, "choices": len(made)}
    if made:
        contacts, *spent = np.array(made).T
        row["contacts"] = int(contacts.max())
        for key, values in zip(("update", "choice"), spent):
            row |= {key: 1e3 * float(np.median(values)), f"{key}_max": 1e3 * float(values.max())}
    return row


def _draw(figure: Any, found: dict[str, list[Choice]]) -> None:
    """Both times of each choice against the contacts."""
    figure.set_size_inches(7.0, 3.4)
    axes = figure.subplots()
    for number, (scene, made) in enumerate(found.items()):
        contacts, update, choice = np.array(made).reshape(-1, 3).T
        colour = f"C{number}"
        axes.plot(contacts, 1e3 * update, "x", color=colour, label=f"{scene}: update")
        axes.plot(contacts, 1e3 * choice, "o", color=colour, fillstyle="none", label=f"{scene}: choice")
    axes.axhline(MOST, color="grey", lw=0.8)
    axes.set_xlabel("contacts so far")
    axes.set_ylabel("ms")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=7)
