"""The content of summary.json: what a run did, how good it was, what each stage cost and what was left out."""

from __future__ import annotations

from dataclasses import asdict
from math import ceil
from typing import Any

import numpy as np

from lwrprobe.contact import WrenchNoise
from lwrprobe.contracts import Area, Bounds, GroundTruth, InputError, LeftOut, Reconstruction, TriangleMesh
from lwrprobe.control import approach_speed
from lwrprobe.evaluation import (
    Reach,
    aligned_points,
    coverage,
    coverage_over_time,
    end_errors,
    gap_over_time,
    gap_p95_over_time,
    lower_bound_time,
    mesh_error,
    normal_error,
    point_error,
    reach,
    reachable_error,
    surface_error,
    upright,
)
from lwrprobe.evaluation.align import align
from lwrprobe.evaluation.coverage import DEFAULT_SPACING
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.evaluation.mesh_error import sample_mesh
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.loop.explorer import Outcome
from lwrprobe.exploration.recording.bridged import Bridged, bridged
from lwrprobe.exploration.recording.certification import CertifiedRun
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.open_border import open_borders
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.untouched import MEETS, NOT_FOLLOWED, UNKNOWN, untouched
from lwrprobe.exploration.stages.clearance import STICK, ClearanceStage
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

_ALIGNED_SAMPLES = 1500
_GAP_SAMPLES = 5000
_UPRIGHT_SAMPLES = 4000  # each is looked at some hundred times
_PACKAGES = ("lwrprobe", "numpy", "scipy", "numba", "ruckig")


def summarise(
    scene: Scene,
    pipeline: Pipeline,
    truth: GroundTruth[Scene] | None,
    recorder: Recorder,
    outcome: Outcome,
    surface: Reconstruction | None,
    explore_seconds: float,
    budget: ErrorBudget | None = None,
    certified: CertifiedRun | None = None,
) -> Summary:
    """The summary but for wall time, devices and limits; what needs the truth is None on real devices.

    `certified` is None where no probe has moved.
    """
    points, normals = recorder.points(), recorder.normals()
    clearance = pipeline.clearance.smallest if pipeline.clearance is not None else np.inf
    pitch = pipeline.line_spacing or DEFAULT_SPACING
    bounds = pipeline.bounds
    return Summary(
        scene=scene.name,
        strategy=scene.strategy.name,
        estimator=scene.contact.estimator,
        seed=scene.run.seed,
        status=outcome.status,
        stopped_by=outcome.stopped_by,
        reason=outcome.reason if len(points) else f"{outcome.reason}; no contact",
        contacts=len(points),
        voxels=len(pipeline.voxels),
        sim_time_s=round(outcome.time, 4),
        **_search(bounds),
        area_raised_mm=round(1e3 * pipeline.raised, 2),
        real_time_factor=round(outcome.time / max(explore_seconds, 1e-9), 2),
        path_length_m=round(outcome.path, 4),
        contact_path_length_m=round(outcome.contact_path, 4),
        peak_force_n=round(truth.peak_force if truth is not None else outcome.peak_force, 4),
        peak_force_bound_n=round(max(outcome.peak_bound, outcome.peak_force), 4),
        true_peak_force_n=round(truth.probe_peak_force, 4) if truth is not None else None,
        rejected_share=round(1.0 - recorder.accepted / outcome.touches, 4) if outcome.touches else None,
        range_used=round(outcome.range_used, 4),
        link_collisions=truth.link_collisions if truth is not None else None,
        min_clearance_m=round(float(clearance), 5) if np.isfinite(clearance) else None,
        force_guard_interventions=outcome.guard_interventions,
        sensor_gaps=outcome.gaps,
        reaction_late_by_s=round(outcome.late_by, 4),
        reentries=sum(one["device"] == "arm" for one in outcome.interruptions),
        interruptions=outcome.interruptions,
        slowed_cycles=outcome.slowed_cycles,
        bridged=[zone.as_dict() for zone in _bridged(recorder, scene, pitch)],
        open_borders=[side.as_dict() for side in open_borders(points, normals, scene.probe.radius, pipeline.explored)],
        untouched=_untouched(scene, points, normals, surface, pitch, pipeline),
        noise_at_rest=_noise_at_rest(pipeline),
        stillness=pipeline.object_motion.report() if pipeline.object_motion is not None else None,
        torque=pipeline.torque.report() if pipeline.torque is not None else None,
        error_budget=budget.report() if budget is not None else None,
        **_against_truth(scene, truth, recorder, pipeline, surface, budget),
        **_certified(scene, truth, recorder, certified),
        truth=truth.differences if truth is not None else None,
        cycle_us=outcome.cycle_us,
        force_control=pipeline.force.report(),
        stages=outcome.stages,
        left_out=pipeline.left_out,
        wrench_counters=asdict(outcome.counters),
        versions=versions(*_PACKAGES),
        machine=machine(),
        line_spacing_m=pipeline.line_spacing,
    )


def _noise_at_rest(pipeline: Pipeline) -> dict[str, float] | None:
    noise = pipeline.noise_at_rest
    if noise is None:
        return None
    over = noise.over(WrenchNoise.of(pipeline.probe))
    return {
        "force_n": round(noise.force, 6),
        "torque_nm": round(noise.torque, 8),
        "over_stated": round(over, 2),
    }


def _search(bounds: Bounds | None) -> dict[str, Any]:
    if bounds is None:
        return {}
    corners = [[round(1e3 * float(v), 2) for v in corner] for corner in (bounds.area.lower, bounds.area.upper)]
    times = {"found_at_s": round(bounds.found_at, 3), "search_time_s": round(bounds.bounded_at, 3)}
    return {**times, "bounds_mm": corners}


def _against_truth(
    scene: Scene,
    truth: GroundTruth[Scene] | None,
    recorder: Recorder,
    pipeline: Pipeline,
    surface: Reconstruction | None,
    budget: ErrorBudget | None,
) -> dict[str, Any]:
    keys = (
        "coverage", "coverage_upright", "coverage_5mm", "coverage_over_time", "end_errors_mm", "contact_error_mm",
        "contact_error_aligned_mm", "surface_error_mm", "voxel_error_mm", "normal_error_deg", "mesh_error_mm",
        "mesh_error_aligned_mm", "mesh_error_reachable_aligned_mm", "mesh_error_upright_aligned_mm",
        "claims_within_95", "claims_aligned_within_95",
        "lower_bound_time_s", "lower_bound_descending_s", "lower_bound_unknown_s",
    )  # fmt: skip
    found: dict[str, Any] = dict.fromkeys(keys)
    if truth is None or not scene.objects:
        return found
    points, normals, pitch = recorder.points(), recorder.normals(), pipeline.line_spacing or DEFAULT_SPACING
    actual, lowest, area = truth.scene, scene.area.lower[2], scene.area.as_area().raised(pipeline.raised)
    solid: Solid = actual.solid()
    radius = actual.probe.radius
    everywhere = reach(solid, radius, lowest)
    within = everywhere.within(area)
    found["lower_bound_time_s"] = _lower_bound(scene, within, pitch, pipeline.explored)
    if "delay_s" in pipeline.force.report():  # else the run ended before the first touch was planned
        descent = _fastest_descent(scene, pipeline)
        found["lower_bound_descending_s"] = _lower_bound(scene, within, pitch, pipeline.explored, descent)
        guarded = scene.motion.approach_speed
        found["lower_bound_unknown_s"] = _lower_bound(scene, within, pitch, pipeline.explored, descent, guarded)
    touches = [truth.contact_at(sequence) for sequence in recorder.sequences]
    known = np.array([true is not None for true in touches], dtype=bool)
    true_points = np.array([true.point for true in touches if true is not None]).reshape(-1, 3)
    # Which side was touched is another question than where it is: a base that is off by a millimetre uncovers nothing.
    aligned, facing = aligned_points(points[known], true_points), normals[known]
    share = coverage(aligned, facing, within, pitch).as_dict()
    found["coverage"], found["coverage_5mm"] = share["coverage"], share["coverage_5mm"]
    if len(points) == 0:
        return found
    few = reach(solid, radius, lowest, area, _UPRIGHT_SAMPLES)
    within_upright = reached_upright(scene, pipeline, few, solid)
    if len(within_upright.points) == len(few.points):
        within_upright = within
    found["coverage_upright"] = coverage(aligned, facing, within_upright, pitch).as_dict()["coverage"]
    times = np.array([contact.time for contact in recorder.contacts])
    at = np.linspace(0.0, times.max(), 41)[1:]
    if len(within.points):
        shares = coverage_over_time(aligned, facing, times[known], at, within, pitch)
        found["coverage_over_time"] = [[round(float(t), 2), round(float(c), 4)] for t, c in zip(at, shares)]
    ends = end_errors(points, normals, everywhere)
    found["end_errors_mm"] = [round(1e3 * end, 4) if np.isfinite(end) else None for end in ends]
    if known.any():
        true_normals = np.array([true.normal for true in touches if true is not None])
        found["contact_error_mm"] = point_error(points[known], true_points).as_dict()
        found["contact_error_aligned_mm"] = point_error(aligned, true_points).as_dict()
        if budget is not None:
            found["claims_within_95"] = budget.claims_within_95(points[known] - true_points, known)
            found["claims_aligned_within_95"] = budget.claims_within_95(aligned - true_points, known, aligned=True)
        found["normal_error_deg"] = normal_error(facing, true_normals).as_dict()
    found["surface_error_mm"] = surface_error(points, solid).as_dict()
    found["voxel_error_mm"] = surface_error(pipeline.voxels.centres(), solid).as_dict()
    if surface is not None:
        try:
            error = mesh_error(surface.mesh, solid, lowest).as_dict()
            found["mesh_error_mm"] = {"method": surface.report["method"], **error}
            moved = align(sample_mesh(surface.mesh, lowest, _ALIGNED_SAMPLES)[0], solid).points(surface.mesh.vertices)
            aligned_mesh = TriangleMesh(moved, surface.mesh.faces)
            error = mesh_error(aligned_mesh, solid, lowest).as_dict()
            found["mesh_error_aligned_mm"] = {"method": surface.report["method"], **error}
            reached = reachable_error(aligned_mesh, solid, within, lowest)
            found["mesh_error_reachable_aligned_mm"] = found["mesh_error_upright_aligned_mm"] = reached
            if within_upright is not within:
                upright_error = reachable_error(aligned_mesh, solid, within_upright, lowest)
                found["mesh_error_upright_aligned_mm"] = upright_error
        except InputError as error:  # a scrap of a mesh, too low or too small to be compared
            pipeline.left_out.append(LeftOut(stage="mesh error", why=str(error)))
    return found


def reached_upright(scene: Scene, pipeline: Pipeline, found: Reach, solid: Solid) -> Reach:
    """What of it the probe reaches as it is held at first: its stick shadows what lies under an overhang."""
    rotation, links = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()[:3, :3], pipeline.probe.links
    stick, other = scene.clearance.stick_threshold, scene.clearance.threshold
    return upright(found, solid, links, rotation, [stick if link.name == STICK else other for link in links])


def _certified(
    scene: Scene, truth: GroundTruth[Scene] | None, recorder: Recorder, certified: CertifiedRun | None
) -> dict[str, Any]:
    if certified is None:
        return {}
    last = certified.last
    rows: list[dict[str, float | None]] = []
    for time, diameter in zip(certified.times, certified.diameters):
        rows.append({"time_s": round(float(time), 3), "certified_mm": _rounded_up(diameter)})
    if truth is not None and scene.objects:
        actual = truth.scene
        found = reach(actual.solid(), actual.probe.radius, scene.area.lower[2], scene.area.as_area(), _GAP_SAMPLES)
        times = np.array([contact.time for contact in recorder.contacts])
        for key, over_time in (("gap_mean_mm", gap_over_time), ("gap_p95_mm", gap_p95_over_time)):
            for row, gap in zip(rows, over_time(recorder.points(), times, certified.times, found)):
                row[key] = round(1e3 * float(gap), 4) if np.isfinite(gap) else None
    return {
        "certified_mm": _rounded_up(last.diameter),
        "certificate": {
            "at_mm": [round(1e3 * float(x), 2) for x in last.place],
            "unknown_cm3": round(1e6 * last.unknown, 3),
            "out_of_reach_cm3": round(1e6 * last.out_of_reach, 3),
            "grid_mm": round(1e3 * certified.edge, 3),
        },
        "error_against_time": rows,
    }


def _rounded_up(length: float) -> float:
    """mm of a length [m]: what is certified must not become smaller."""
    return ceil(1e5 * length) / 100.0


def _bridged(recorder: Recorder, scene: Scene, pitch: float) -> list[Bridged]:
    times = np.array([contact.time for contact in recorder.contacts])
    return bridged(recorder.points(), recorder.normals(), times, scene.probe.radius, pitch)


def _untouched(
    scene: Scene,
    points: np.ndarray,
    normals: np.ndarray,
    surface: Reconstruction | None,
    pitch: float,
    pipeline: Pipeline,
) -> list[dict[str, object]]:
    if surface is None:
        return []
    pose = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()
    keeps = scene.clearance.threshold, scene.clearance.stick_threshold
    stage = ClearanceStage(pipeline.probe.links, pipeline.surface, *keeps)

    def hindrance(centre: np.ndarray, facing: np.ndarray) -> str:
        pose[:3, 3] = centre
        hindered = MEETS
        for touching, known in pipeline.touching_poses(centre, facing) or [(pose, True)]:
            if not stage.threatens(touching):
                if known:
                    return NOT_FOLLOWED
                hindered = UNKNOWN
        return hindered

    places = untouched(surface.mesh, points, normals, pitch, pipeline.probe.radius, pipeline.explored, hindrance)
    return [place.as_dict() for place in places]


def _fastest_descent(scene: Scene, pipeline: Pipeline) -> float:
    """m/s down a wall at which a foot is met with the force limit and no reserve."""
    report, contact = pipeline.force.report(), scene.contact
    margin = contact.limit - contact.threshold
    return approach_speed(margin, report["stiffness_along_stick"], report["delay_s"], scene.motion.acceleration)


def _lower_bound(
    scene: Scene,
    within: Reach,
    pitch: float,
    area: Area,
    descent_speed: float | None = None,
    free_speed: float | None = None,
) -> float:
    """s, no exploration of this object at this pitch and speed is faster (see `evaluation.lower_bound_time`)."""
    motion = scene.motion
    free = motion.free_speed if free_speed is None else free_speed
    bound = lower_bound_time(within, pitch, motion.contour_speed, area, free, motion.acceleration, descent_speed)
    return round(bound, 2)
