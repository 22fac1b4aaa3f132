"""Several runs over one object become one: contacts, map, cloud and mesh.

The first run keeps its place; the others are registered to what is there already, since the object may have been
moved by a few millimetres in between. Runs that do not belong together are refused, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import InputError, LeftOut, LwrprobeError, Reconstruction, TouchRecord
from lwrprobe.evaluation.coverage import DEFAULT_SPACING
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.evaluation.run_folder import RunFolder, read_run
from lwrprobe.evaluation.summary import Summary
from lwrprobe.evaluation.truth import true_solid
from lwrprobe.exploration.recording.results import write_run
from lwrprobe.exploration.recording.run_files import check_apart, check_own, clear_run
from lwrprobe.mapping import VoxelMap
from lwrprobe.reconstruction.registration import Registration, intruding, register
from lwrprobe.scene import Scene

FARTHEST, FARTHEST_TURN = 0.010, np.radians(6.0)
"""m and rad, by which an object may have been moved between two runs."""
MIN_PAIRS, MIN_OVERLAP = 40, 0.15
MAX_MISFIT, MAX_APART = 0.15, 0.4e-3
"""Share of the pairs that may stay far apart; m, median distance of the pairs."""
MAX_INTRUDING = 0.01
"""Share of one run's touches that may lie where the other run's sphere was."""
TABLE_SLACK = 1e-3
"""m, by which the tables of two runs may differ in height."""

Message = Callable[[str], None]


def merge(
    folders: Sequence[str | Path],
    out: Path,
    *,
    method: str | None = None,
    as_is: bool = False,
    message: Message = lambda text: None,
) -> dict[str, Any]:
    """Join the contacts of run folders into a run folder `out` and return its summary.

    Parameters
    ----------
    folders : two or more; the first one's frame and scene are kept
    method : reconstructor, None = the one that the first run's scene names
    as_is : leave every run where it is; whether they belong together is checked all the same
    message : called with a sentence at each step

    Raises InputError naming the run (`runs[i]`) and why it does not belong to those before it, or for an `out` that is
    one of the runs or has files that are no run's, and FormatError for a folder that is no run's. Nothing is written
    then.
    """
    if len(folders) < 2:
        raise InputError("runs", [str(folder) for folder in folders], "two run folders or more")
    check_apart("out", Path(out), map(Path, folders))
    check_own(Path(out))
    runs = [read_run(folder) for folder in folders]
    for i, run in enumerate(runs):
        if len(run.record.points) == 0:
            raise InputError(f"runs[{i}]", str(run.folder), "a run that touched something")
    joined, trace, facts = runs[0].record, runs[0].trace, [_first(runs[0])]
    which = [np.zeros(len(joined.points), dtype=np.int64)]
    force = [runs[0].force]
    delay = 0.0
    for i, run in enumerate(runs[1:], start=1):
        message(f"aligning {run.folder} with the runs before it")
        _same_setting(runs[0], run, i)
        found = register(run.record, joined, on_table=joined.table is not None)
        if as_is:
            moved, path = run.record, run.trace
        else:
            _not_too_far(found, run, i)
            moved, path = _moved(run.record, found), _moved_trace(run.trace, found)
        _belongs(found, moved, joined, run, i, as_is)
        facts.append(_fact(run, found, as_is))
        delay += runs[i - 1].duration
        joined, trace = _join(joined, moved, delay), np.concatenate([trace, _delayed_trace(path, delay)])
        which.append(np.full(len(moved.points), i, dtype=np.int64))
        force.append(run.force)
    message("reconstructing")
    scene = _scene(runs)
    surface, lack = _reconstruct(joined, scene, method)
    voxels = VoxelMap(scene.map.resolution)
    voxels.insert(joined.points)
    known = all(run.summary is not None and run.summary.truth_known for run in runs)
    summary = _together(runs, known)
    summary.merged = facts
    summary.contacts, summary.voxels = len(joined.points), len(voxels)
    summary.line_spacing_m = joined.pitch
    _compare(summary, scene, joined, surface, known)
    summary.reconstruction = _plain(surface.report) if surface is not None else None
    summary.left_out = list(lack)
    mesh = surface.mesh if surface is not None else None
    clear_run(out)
    write_run(out, scene, joined, np.concatenate(force), trace, voxels, mesh, summary, np.concatenate(which))
    return summary.as_dict()


def _same_setting(first: RunFolder, run: RunFolder, i: int) -> None:
    """Raises InputError where table or probe are not those of the first run."""
    a, b = first.record, run.record
    if (a.table is None) != (b.table is None):
        has, lacks = (first, run) if b.table is None else (run, first)
        raise InputError(
            f"runs[{i}]", str(run.folder), f"runs over the same table ({has.folder} has one, {lacks.folder} has none)"
        )
    if a.table is not None and b.table is not None and abs(a.table - b.table) > TABLE_SLACK:
        heights = f"{1e3 * a.table:g} and {1e3 * b.table:g} mm"
        raise InputError(f"runs[{i}]", str(run.folder), f"runs over the same table (their heights are {heights})")
    if a.probe_radius != b.probe_radius:
        radii = f"{1e3 * (a.probe_radius or 0.0):g} and {1e3 * (b.probe_radius or 0.0):g} mm"
        raise InputError(f"runs[{i}]", str(run.folder), f"runs with the same sphere (their radii are {radii})")


def _not_too_far(found: Registration, run: RunFolder, i: int) -> None:
    if found.shift > FARTHEST or found.angle > FARTHEST_TURN:
        moved = f"{1e3 * found.shift:.1f} mm and {np.degrees(found.angle):.1f} deg"
        limits = f"{1e3 * FARTHEST:g} mm and {np.degrees(FARTHEST_TURN):g} deg"
        raise InputError(
            f"runs[{i}]", str(run.folder), f"an object moved by {limits} at most (it fits best when moved by {moved})"
        )


def _belongs(found: Registration, moved: TouchRecord, joined: TouchRecord, run: RunFolder, i: int, as_is: bool) -> None:
    """Raises InputError with the reason why a run's touches cannot be of the same object."""

    def refuse(why: str) -> InputError:
        return InputError(f"runs[{i}]", str(run.folder), f"touches of the same object ({why})")

    if found.pairs < MIN_PAIRS or found.overlap < MIN_OVERLAP:
        raise refuse(f"only {found.pairs} of its touches, {found.overlap:.0%}, have one of the others near them")
    if not as_is and found.after > MAX_APART:
        raise refuse(f"the surfaces are {1e3 * found.after:.2f} mm apart when they fit best")
    if not as_is and found.misfit > MAX_MISFIT:
        raise refuse(f"{found.misfit:.0%} of its touches are 1.5 mm off the others' surface when they fit best")
    if as_is and found.before > MAX_APART:
        raise refuse(f"the surfaces are {1e3 * found.before:.2f} mm apart and are not to be moved")
    for points, others, whose in ((moved.points, joined, "its"), (joined.points, moved, "the others'")):
        inside = intruding(points, others)
        if inside.mean() > MAX_INTRUDING:
            place = ", ".join(f"{1e3 * value:.0f}" for value in points[inside].mean(axis=0))
            raise refuse(f"{inside.mean():.0%} of {whose} touches, about ({place}) mm, lie where a sphere went freely")


def _moved(record: TouchRecord, found: Registration) -> TouchRecord:
    assert record.normals is not None
    assert record.free_path is not None
    return replace(
        record,
        points=found.points(record.points),
        normals=found.directions(record.normals),
        free_path=found.points(record.free_path),
        leaning=None if record.leaning is None else found.points(record.leaning),
    )


def _moved_trace(trace: np.ndarray, found: Registration) -> np.ndarray:
    moved = trace.copy()
    moved[:, 1:4] = found.points(trace[:, 1:4])
    return moved


def _delayed_trace(trace: np.ndarray, delay: float) -> np.ndarray:
    delayed = trace.copy()
    delayed[:, 0] += delay
    return delayed


def _join(a: TouchRecord, b: TouchRecord, delay: float) -> TouchRecord:
    """Both records as one, `b` as begun `delay` s after `a`, so that times still tell what came after what."""

    def both(name: str) -> np.ndarray:
        return np.concatenate([getattr(a, name), getattr(b, name)])

    assert b.times is not None
    b = replace(b, times=b.times + delay)
    leaning = [record.leaning for record in (a, b) if record.leaning is not None]
    return replace(
        a,
        points=both("points"),
        normals=both("normals"),
        confidence=both("confidence"),
        times=both("times"),
        free_path=both("free_path"),
        free_gap=min(a.free_gap, b.free_gap),
        leaning=np.concatenate(leaning) if leaning else None,
        lowest=min(low for low in (a.lowest, b.lowest) if low is not None),
        # with the smaller one, what only the coarser run passed would count as gaps between its lines
        pitch=max((pitch for pitch in (a.pitch, b.pitch) if pitch is not None), default=None),
    )


def _scene(runs: list[RunFolder]) -> Scene:
    """The first run's scene over the area of all."""
    areas = [run.scene.area for run in runs]
    lower = tuple(float(v) for v in np.min([area.lower for area in areas], axis=0))
    upper = tuple(float(v) for v in np.max([area.upper for area in areas], axis=0))
    scene = runs[0].scene
    return scene.model_copy(update={"area": scene.area.model_copy(update={"lower": lower, "upper": upper})})


def _reconstruct(record: TouchRecord, scene: Scene, method: str | None) -> tuple[Reconstruction | None, list[LeftOut]]:
    from lwrprobe.reconstruction.reconstruct import reconstruct

    own = method is None or method == scene.reconstruction.method
    options = scene.reconstruction.options if own else {}
    try:
        return reconstruct(record, method or scene.reconstruction.method, **options), []
    except InputError as error:
        if error.field in ("reconstructor", "option"):
            raise
        return None, [{"stage": "reconstruction", "why": str(error)}]
    except LwrprobeError as error:
        return None, [{"stage": "reconstruction", "why": str(error)}]


def _compare(summary: Summary, scene: Scene, record: TouchRecord, surface: Reconstruction | None, known: bool) -> None:
    """Coverage and errors against the first run's true shape into the summary, where a simulator knew it."""
    from lwrprobe.evaluation import coverage, mesh_error, reach, surface_error

    solid = true_solid(scene) if known else None
    if solid is None:
        return
    pitch = record.pitch or DEFAULT_SPACING
    found = reach(solid, scene.probe.radius, scene.area.lower[2], scene.area.as_area())
    assert record.normals is not None
    share = coverage(record.points, record.normals, found, pitch).as_dict()
    summary.coverage, summary.coverage_5mm = share["coverage"], share["coverage_5mm"]
    summary.surface_error_mm = surface_error(record.points, solid).as_dict()
    if surface is not None:
        error = mesh_error(surface.mesh, solid, scene.area.lower[2]).as_dict()
        summary.mesh_error_mm = {"method": surface.report["method"], **error}


def _together(runs: list[RunFolder], known: bool) -> Summary:
    """What the runs' summaries give in sum."""
    each = [run.summary for run in runs if run.summary is not None]
    unfinished = [str(run.folder) for run in runs if run.summary is None or run.summary.status != "done"]
    reason = f"merged from {len(runs)} runs"
    if unfinished:
        reason += f", of which {len(unfinished)} ended early ({', '.join(unfinished)})"
    peaks = [run.summary.peak_force_n if run.summary is not None else None for run in runs]
    return Summary(
        scene=runs[0].scene.name,
        strategy=runs[0].scene.strategy.name,
        status="ended early" if unfinished else "done",
        reason=reason,
        sim_time_s=round(sum(one.sim_time_s for one in each), 4),
        path_length_m=round(sum(one.path_length_m for one in each), 4),
        contact_path_length_m=round(sum(one.contact_path_length_m for one in each), 4),
        peak_force_n=round(max(float(run.force.max()) if peak is None else peak for run, peak in zip(runs, peaks)), 4),
        link_collisions=sum(one.link_collisions or 0 for one in each) if known else None,
        versions=versions("lwrprobe", "numpy", "scipy"),
        machine=machine(),
    )


def _first(run: RunFolder) -> dict[str, Any]:
    return {"folder": str(run.folder), "contacts": len(run.record.points), "strategy": run.scene.strategy.name}


def _fact(run: RunFolder, found: Registration, as_is: bool) -> dict[str, Any]:
    """How a run was registered to those before it."""
    x, y, z = (round(1e3 * float(value), 4) for value in found.translation)
    registration = {
        "moved": not as_is,
        "shift_mm": round(1e3 * found.shift, 4),
        "turn_deg": round(float(np.degrees(found.angle)), 4),
        "rotation": [[round(float(value), 9) for value in row] for row in found.rotation],
        "translation_mm": [x, y, z],
        "apart_before_mm": round(1e3 * found.before, 4),
        "apart_after_mm": round(1e3 * found.after, 4),
        "overlap": round(found.overlap, 4),
        "left_open": list(found.open),
    }
    return _first(run) | {"registration": registration}


def _plain(report: dict[str, Any]) -> dict[str, Any]:
    """The report's numbers and texts, as JSON takes them."""
    plain = {}
    for key, value in report.items():
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, str | int | float | bool | list):
            plain[key] = value
    return plain
