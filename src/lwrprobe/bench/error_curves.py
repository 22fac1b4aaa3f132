"""The error of the mesh over a run's time, as if the run had ended at each of some instants."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from lwrprobe.contracts import GroundTruth, LwrprobeError, TouchRecord, TriangleMesh
from lwrprobe.evaluation import mesh_error, reach, reachable_error
from lwrprobe.evaluation.align import align
from lwrprobe.evaluation.mesh_error import sample_mesh
from lwrprobe.evaluation.reach import Reach
from lwrprobe.exploration.procedures.explore import Exploration
from lwrprobe.exploration.recording.certification import Certification
from lwrprobe.exploration.recording.true_errors import reached_upright
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene

INSTANTS = 16
"""At which a mesh is made, evenly over the run: each takes about a second."""
HALVINGS = 3
"""Of the time between two of them, in which the wanted errors are reached first."""
SAMPLES = 5000
"""Of mesh and surface each."""
REACH_SAMPLES = 5000
"""Of the surface, of which it is looked at whether the upright probe reaches them."""
ALIGNED = 1500
"""Of the mesh, by which it is aligned."""
IDEAL = "ideal"
"""Profile of a world that is as its scene says."""
MEANS = (1.0, 0.3, 0.1)
"""mm, of the mesh's mean error, to which the seconds are given."""
GOAL = 0.3, 1.0
"""mm, of the mean and the 95th percentile that are wanted together."""

AFTER = (60.0, 120.0, 240.0)
"""s, after which 95th percentile and certified diameter are given."""
LIFT = 0.01
"""m of path between two contacts, from which on the probe was lifted and not just off an edge."""

Row = tuple[float, float, float, float]
"""s; mm, mean and 95th percentile of the error of what the upright probe reaches; mm, mean of the whole surface."""


def reached(exploration: Exploration, truth: GroundTruth[Scene]) -> Reach:
    """What the upright probe reaches with its centre in the area."""
    pipeline, actual = exploration.pipeline, truth.scene
    solid, lowest = actual.solid(), float(pipeline.area.lower[2])
    found = reach(solid, actual.probe.radius, lowest, pipeline.area.raised(pipeline.raised), REACH_SAMPLES)
    return reached_upright(exploration.scene, pipeline, found, solid)


def error_curve(
    exploration: Exploration, truth: GroundTruth[Scene], found: Reach, instants: int = INSTANTS
) -> list[Row]:
    """The error of the mesh from what was touched until then, for a finished run; `found` is that of `reached`.

    Instants at which the contacts do not carry a mesh are left out.
    """
    outcome = exploration.explorer.outcome
    assert outcome is not None
    times = {*np.linspace(0.0, outcome.time, instants + 1)[1:].tolist(), *(t for t in AFTER if t < outcome.time)}
    rows = errors_at(exploration, truth, found, sorted(times))
    for _ in range(HALVINGS):
        soon = seconds_to(rows, *GOAL)
        if soon is None:
            break
        before = max((time for time, *_ in rows if time < soon), default=0.0)
        rows = sorted(rows + errors_at(exploration, truth, found, [0.5 * (before + soon)]))
    return rows


def errors_at(exploration: Exploration, truth: GroundTruth[Scene], found: Reach, times: Iterable[float]) -> list[Row]:
    """The rows of `error_curve` at some instants, s.

    In a world that differs from its scene the errors are those that remain after rigid alignment. Nothing where the
    mesh is not made from contacts, as that of the thesis is not.
    """
    if exploration.record.times is None:
        return []
    pipeline, trace = exploration.pipeline, exploration.recorder.trace()
    rows: list[Row] = []
    for time in times:
        before = trace[(trace[:, 0] <= time) & (trace[:, 5] == 0.0), 1:4]
        error = _error(_until(exploration.record, time, before), pipeline, truth, found)
        if error is not None:
            rows.append((round(float(time), 2), *error))
    return rows


def seconds_to(curve: list[Row], mean: float, p95: float = np.inf) -> float | None:
    """s from which on mean and 95th percentile, mm, stay as small as this; None where they never do."""
    reached = None
    for time, now, now_p95, _ in curve:
        if now > mean or now_p95 > p95:
            reached = None
        elif reached is None:
            reached = time
    return reached


def columns(curve: list[Row]) -> dict[str, float | None]:
    """The seconds to each of the errors, and the 95th percentile after each of `AFTER`; at the end of a shorter run."""
    found = {f"seconds_{mean:g}": seconds_to(curve, mean) for mean in MEANS}
    found["seconds_goal"] = seconds_to(curve, *GOAL)
    for after in AFTER:
        before = [p95 for time, _, p95, _ in curve if time <= after]
        found[f"p95_{after:g}"] = before[-1] if before else None
    return found


def certified(exploration: Exploration) -> dict[str, float]:
    """mm that could hide within reach after each of `AFTER`, for a finished run; at the end of a shorter one."""
    pipeline = exploration.pipeline
    run = Certification(exploration.recorder, pipeline.area, pipeline.probe, pipeline.line_spacing)
    return {f"certified_{after:g}": 1e3 * run.at(after).diameter for after in AFTER}


def lifts(trace: np.ndarray) -> int:
    """How often the probe was lifted off what it touches and went elsewhere; trace (k, 8) as of the recorder."""
    touching = np.flatnonzero(trace[:, 5] > 0.0)
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(trace[:, 1:4], axis=0), axis=1))])
    return int(np.count_nonzero(np.diff(path[touching])[np.diff(touching) > 1] > LIFT))


def draw_curves(figure: Any, found: list[dict[str, Any]]) -> None:
    """Mean error of the mesh against robot time: a panel a scene, a curve a run of the first seed."""
    shown = [item for item in found if item.get("curve")]
    if not shown:
        return
    seed = min(item["seed"] for item in shown)
    scenes = list(dict.fromkeys(item["scene"] for item in shown))
    strategies = list(dict.fromkeys(item["strategy"] for item in shown))
    wide = min(3, len(scenes))
    axes = figure.subplots(-(-len(scenes) // wide), wide, squeeze=False, sharey=True).ravel()
    for panel, scene in zip(axes, scenes):
        for item in shown:
            if (item["scene"], item["seed"], item["profile"]) != (scene, seed, "default"):
                continue
            times, means, *_ = zip(*item["curve"])
            colour = f"C{strategies.index(item['strategy'])}"
            panel.semilogy(times, means, colour, label=item["strategy"], lw=1)
        panel.axhline(0.3, color="grey", lw=0.5)
        panel.set_title(scene, fontsize=8)
        panel.tick_params(labelsize=7)
    for panel in axes[len(scenes) :]:
        panel.set_axis_off()
    figure.supxlabel("robot time, s", fontsize=8)
    figure.supylabel("mesh error, mean, mm", fontsize=8)
    axes[0].legend(fontsize=6)


def _until(record: TouchRecord, time: float, free_path: np.ndarray) -> TouchRecord:
    assert record.times is not None
    assert record.normals is not None
    assert record.confidence is not None
    kept = record.times <= time
    return replace(
        record,
        points=record.points[kept],
        normals=record.normals[kept],
        confidence=record.confidence[kept],
        times=record.times[kept],
        free_path=free_path,
    )


def _error(
    record: TouchRecord, pipeline: Pipeline, truth: GroundTruth[Scene], found: Reach
) -> tuple[float, float, float] | None:
    if not len(record.points):
        return None
    actual = truth.scene
    solid, lowest = actual.solid(), float(pipeline.area.lower[2])
    try:
        mesh = pipeline.reconstructor.reconstruct(record).mesh
        if truth.differences["profile"] != IDEAL:
            moved = align(sample_mesh(mesh, lowest, ALIGNED)[0], solid).points(mesh.vertices)
            mesh = TriangleMesh(moved, mesh.faces)
        whole = mesh_error(mesh, solid, lowest, samples=SAMPLES)
        reachable = reachable_error(mesh, solid, found, lowest)
    except LwrprobeError:  # too few contacts, or none above the lowest height
        return None
    return (reachable["mean"], reachable["p95"], round(1e3 * whole.mean, 4)) if reachable else None
