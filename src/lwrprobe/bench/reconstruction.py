"""Reconstructors side by side: error against run time and against the number of contacts.

The data are those of an ideal scan along lines (see `sampled_lines`), as raw contacts and as the voxel centres that
the thesis kept. The phases of the lines are spread evenly, so that no end of an object is lucky; the objects are
about symmetric, which makes 1/8 and 3/8 stand for 5/8 and 7/8 as well. Errors are two-sided, above the lowest height
of the sphere's centre. The default method and the convex hull are measured at every phase, the others at the first.

Beside them stand contacts that the simulated robot explored: of the run folders in `runs`, one a scene by name. What is
missing there is explored first, with the scene's own strategy and settings, and kept for the next time.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from lwrprobe.bench.exploration import SOURCE_SCENES
from lwrprobe.bench.options import Options
from lwrprobe.bench.reconstruction_peers import Method, peers
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.bench.sampled_lines import LOWEST, sample_lines, voxelised
from lwrprobe.bench.timing import load_before
from lwrprobe.contracts import InputError, LwrprobeError, TouchRecord
from lwrprobe.evaluation import mesh_error
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.reconstruction.concave_hull import ConcaveHull
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.convex_hull import ConvexHull
from lwrprobe.reconstruction.hermite_rbf import HermiteRbf
from lwrprobe.reconstruction.poisson import Poisson
from lwrprobe.scene import load_scene

CONVEX = ("block", "cylinder_vertical", "cylinder_horizontal", "stacked_blocks")
DEFAULT = "contact_surface"
EVERY_PHASE = (DEFAULT, "convex_hull")
EXPLORED = {"raw": "explored", "voxels": "explored, voxels"}
"""Names of the data that come from runs."""
NEEDS = (
    (10.0, "raw", 0.30, 2.5),
    (10.0, "voxels", 0.45, 3.5),
    (15.0, "raw", 0.9, 5.0),
    (10.0, "explored", 0.30, 2.5),
    (10.0, "explored, voxels", 0.45, 3.5),
)
"""Lines mm, data, and the mean and largest error mm that the default method may have."""
BRIDGE = {(10.0, data): {"mean": 0.35, "worst": 2.5} for data in ("raw", "explored")}
_SAMPLES = 4000  # of each surface, for the errors


@dataclass(slots=True, frozen=True)
class Outcome:
    """One method on one record; lengths in mm, processor time in s; volume error in %, NaN where the mesh is open."""

    method: str
    scene: str
    pitch: float
    data: str
    contacts: int
    mean: float
    worst: float
    volume: float
    watertight: bool
    seconds: float


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench reconstruction`; options `scenes`, `pitches` (mm) and `phases`, each separated by commas.

    `runs` is the folder of run folders, `runs/bench` unless set otherwise, and nothing in a quick run; `explore=no`
    takes only the runs that are there.
    """
    asked = Options("reconstruction", options, "explore", "phases", "pitches", "runs", "scenes")
    if asked.text("explore", "yes") not in ("yes", "no"):
        raise InputError("bench reconstruction option explore", options["explore"], "yes or no")
    scenes = asked.words("scenes", SOURCE_SCENES[::3] if quick else SOURCE_SCENES)
    pitches = asked.numbers("pitches", [10.0] if quick else [5.0, 10.0, 15.0])
    phases = asked.numbers("phases", [0.375] if quick else [0.125, 0.375], above=-1.0)
    load = load_before()
    others, missing = peers()
    methods = _own() | others
    outcomes: list[Outcome] = []
    failures: dict[str, str] = {}
    _warm(methods, sample_lines(load_scene(SOURCE_SCENES[0]).solid(), 0.015))
    for scene in scenes:
        solid = load_scene(scene).solid()
        for pitch in pitches:
            for phase in phases:
                raw = sample_lines(solid, 1e-3 * pitch, phase)
                chosen = methods if phase == phases[0] else {name: methods[name] for name in EVERY_PHASE}
                for data, record in (("raw", raw), ("voxels", voxelised(raw))):
                    outcomes += _measure(chosen, record, solid, (scene, pitch, data), failures)
    unexplored = _measure_runs(methods, scenes, quick, options, outcomes, failures)
    return _report(outcomes, failures, missing, len(phases), unexplored, load)


def _measure_runs(
    methods: dict[str, Method],
    scenes: list[str],
    quick: bool,
    options: dict[str, str],
    outcomes: list[Outcome],
    failures: dict[str, str],
) -> list[str]:
    """All methods on explored contacts; the scenes for which there are none."""
    if quick and "runs" not in options:
        return []
    home, missing = Path(options.get("runs", "runs/bench")), []
    for scene in scenes:
        folder = home / scene
        if not (folder / "summary.json").is_file():
            if options.get("explore", "yes") == "no":
                missing.append(scene)
                continue
            explore(load_scene(scene, ["truth.profile=ideal"]), folder)
        done = read_run(folder)
        if len(done.record.points) == 0:
            missing.append(scene)
            continue
        pitch = round(1e3 * (done.record.pitch or 0.010), 6)
        solid = done.scene.solid()
        for data, record in (("raw", done.record), ("voxels", voxelised(done.record))):
            outcomes += _measure(methods, record, solid, (scene, pitch, EXPLORED[data]), failures)
    return missing


def _own() -> dict[str, Method]:
    workers = {
        DEFAULT: ContactSurface(),
        "convex_hull": ConvexHull(),
        "concave_hull, automatic": ConcaveHull(),
        "concave_hull, 15 mm": ConcaveHull(ConcaveHull.Config(alpha=0.015)),
        "hermite_rbf": HermiteRbf(),
        "poisson, contact normals": Poisson(),
        "poisson, as in the thesis": Poisson(Poisson.Config(normals="estimated")),
    }
    return {name: _mesh_of(worker) for name, worker in workers.items()}


def _mesh_of(worker: Any) -> Method:
    return lambda record: worker.reconstruct(record).mesh


def _warm(methods: dict[str, Method], record: TouchRecord) -> None:
    """Everything imported and compiled before it is timed."""
    for method in methods.values():
        with suppress(LwrprobeError, RuntimeError):
            method(record)


def _measure(
    methods: dict[str, Method], record: TouchRecord, solid: Any, place: tuple[str, float, str], failures: dict[str, str]
) -> list[Outcome]:
    """All methods on one record, one after the other, each timed once; one that fails is named once in the notes."""
    outcomes = []
    scene, pitch, data = place
    for name, method in methods.items():
        try:
            begin = process_time()
            mesh = method(record)
            seconds = process_time() - begin
            found = mesh_error(mesh, solid, LOWEST, samples=_SAMPLES)
        except (LwrprobeError, RuntimeError) as error:  # a peer's own error counts as no mesh
            failures.setdefault(name, f"{scene}, {pitch:g} mm, {data}: {error}")
            continue
        volume = np.nan if found.volume_error is None else 100.0 * abs(found.volume_error)
        errors = 1e3 * found.mean, 1e3 * found.hausdorff, volume
        outcomes.append(Outcome(name, scene, pitch, data, len(record.points), *errors, found.watertight, seconds))
    return outcomes


def _report(
    outcomes: list[Outcome],
    failures: dict[str, str],
    missing: list[str],
    phases: int,
    unexplored: list[str],
    load: dict[str, str],
) -> BenchReport:
    report = BenchReport("reconstruction", "Reconstruction: error against run time and against contacts")
    report.machine = machine() | load | versions("numpy", "numba", "scipy", "open3d", "pymeshlab")
    groups = sorted({(o.pitch, o.data) for o in outcomes})
    report.tables = [_summary(outcomes, pitch, data) for pitch, data in groups] + [_by_scene(outcomes)]
    report.verdicts = _verdicts(outcomes)
    report.notes = [
        "Errors in mm: mean of both ways and the largest of all, above z = 6 mm; mean over "
        f"{phases} line phases of each object ({' and '.join(EVERY_PHASE)}; the others at the first), then the median "
        "over objects; processor time of one call with everything loaded, as the machine may be busy with other work",
    ]
    report.notes += missing
    report.notes += [f"{scene}: no explored contacts" for scene in unexplored]
    report.notes += [f"{name} gave no mesh (first on {where})" for name, where in failures.items()]
    report.figures = {
        "time": lambda figure: _draw(figure, outcomes, "seconds", "processor time, s"),
        "contacts": lambda figure: _draw(figure, outcomes, "contacts", "number of contacts"),
    }
    report.data["outcomes"] = [{name: getattr(o, name) for name in Outcome.__slots__} for o in outcomes]
    return report


def _per_scene(outcomes: list[Outcome], method: str, pitch: float, data: str, value: str) -> dict[str, float]:
    """Mean over phases by scene; the scenes for which the value is known."""
    found: dict[str, list[float]] = {}
    for o in outcomes:
        if (o.method, o.pitch, o.data) == (method, pitch, data):
            found.setdefault(o.scene, []).append(float(getattr(o, value)))
    means = {scene: float(np.mean(values)) for scene, values in found.items()}
    return {scene: mean for scene, mean in means.items() if np.isfinite(mean)}


def _median(values: dict[str, float]) -> float | None:
    return float(np.median(list(values.values()))) if values else None


def _summary(outcomes: list[Outcome], pitch: float, data: str) -> Table:
    rows = []
    for method in dict.fromkeys(o.method for o in outcomes):
        closed = _per_scene(outcomes, method, pitch, data, "watertight")
        if closed:
            values = [_median(_per_scene(outcomes, method, pitch, data, v)) for v in ("mean", "worst", "volume")]
            whole = f"{sum(share == 1.0 for share in closed.values())} of {len(closed)}"
            rows.append([method, *values, whole, _median(_per_scene(outcomes, method, pitch, data, "seconds"))])
    columns = ["method", "mean mm", "max mm", "volume error %", "watertight", "CPU s"]
    return Table(f"Lines {pitch:g} mm apart, {data}", columns, rows)


def _by_scene(outcomes: list[Outcome]) -> Table:
    columns = ["object", "lines mm", "data", "mean mm", "max mm", "volume error %", "hull's mean mm", "CPU s"]
    rows = []
    for scene in dict.fromkeys(o.scene for o in outcomes):
        for pitch, data in sorted({(o.pitch, o.data) for o in outcomes}):
            own = [_per_scene(outcomes, DEFAULT, pitch, data, v).get(scene) for v in ("mean", "worst", "volume")]
            hull = _per_scene(outcomes, "convex_hull", pitch, data, "mean").get(scene)
            seconds = _per_scene(outcomes, DEFAULT, pitch, data, "seconds").get(scene)
            rows.append([scene, pitch, data, *own, hull, seconds])
    return Table(f"{DEFAULT}, object by object", columns, rows)


def _verdicts(outcomes: list[Outcome]) -> list[Verdict]:
    verdicts = []
    for pitch, data, mean, worst in NEEDS:
        for value, limit, label in (("mean", mean, "mean"), ("worst", worst, "max")):
            found = _per_scene(outcomes, DEFAULT, pitch, data, value)
            if not found:
                continue
            where = f"{pitch:g} mm lines, {data}"
            middle = float(np.median(list(found.values())))
            verdict = f"median {middle:.3g} mm"
            verdicts.append(Verdict(f"{label} error <= {limit:g} mm at {where}, median", verdict, middle <= limit))
            above = [scene for scene, error in found.items() if error > limit]
            verdict = f"{len(found) - len(above)} of {len(found)}" + (f" (above: {', '.join(above)})" if above else "")
            verdicts.append(Verdict(f"the same on each object: {label}, {where}", verdict, not above))
            if "bridge" in found and (pitch, data) in BRIDGE:
                limit = BRIDGE[pitch, data][value]
                requirement = f"{label} error <= {limit:g} mm on the bridge at {where}"
                verdicts.append(Verdict(requirement, f"{found['bridge']:.3g} mm", found["bridge"] <= limit))
    own = [o for o in outcomes if o.method == DEFAULT]
    for data in ("raw", "explored"):
        volume = _per_scene(outcomes, DEFAULT, 10.0, data, "volume")
        if volume:
            verdict = f"median {_median(volume):.2g} %, largest {max(volume.values()):.2g} %"
            verdicts.append(
                Verdict(f"volume error <= 3 % at 10 mm lines, {data}", verdict, max(volume.values()) <= 3.0)
            )
    open_ones = sum(not o.watertight for o in own)
    verdicts.append(Verdict("always watertight", f"{len(own) - open_ones} of {len(own)} meshes", not open_ones))
    slowest = max(o.seconds for o in own)
    usual = float(np.median([o.seconds for o in own]))
    verdicts.append(
        Verdict("<= 0.5 s of processor time", f"median {usual:.2f} s, slowest {slowest:.2f} s", slowest <= 0.5)
    )
    worse = [f"{s}, {p:g} mm, {d}" for s, p, d in _worse_than_hull(outcomes)]
    verdict = "nowhere worse" if not worse else "worse on " + "; ".join(worse)
    verdicts.append(Verdict("never worse than the hull on a convex object", verdict, not worse))
    return verdicts


def _worse_than_hull(outcomes: list[Outcome]) -> list[tuple[str, float, str]]:
    worse = []
    for pitch, data in sorted({(o.pitch, o.data) for o in outcomes}):
        own, hull = (_per_scene(outcomes, method, pitch, data, "mean") for method in (DEFAULT, "convex_hull"))
        worse += [(s, pitch, data) for s in CONVEX if s in own and s in hull and own[s] > hull[s]]
    return worse


def _draw(figure: Any, outcomes: list[Outcome], value: str, label: str) -> None:
    """Mean error against a value, one mark an object and pitch: sampled lines, and what was explored."""
    panels = [kind for kind in ("raw", "explored") if any(o.data == kind for o in outcomes)]
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, kind in zip(all_axes, panels):
        for i, method in enumerate(dict.fromkeys(o.method for o in outcomes)):
            chosen = [o for o in outcomes if o.method == method and o.data == kind]
            own = method == DEFAULT
            axes.scatter(
                [getattr(o, value) for o in chosen], [o.mean for o in chosen], s=34 if own else 14,
                marker="osv^D"[i % 5], label=method, color=f"C{i % 10}", alpha=0.9 if own else 0.5,
            )  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel=label, title="sampled lines" if kind == "raw" else kind)
        axes.grid(True, which="both", linewidth=0.3)
    all_axes[0].set_ylabel("mean error, mm")
    all_axes[-1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
