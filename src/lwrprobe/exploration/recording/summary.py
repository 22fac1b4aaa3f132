"""The content of summary.json: what a run did, how good it was, what each stage cost and what was left out."""

from __future__ import annotations

from dataclasses import asdict
from math import ceil
from typing import Any

import numpy as np

from lwrprobe.contact import WrenchNoise
from lwrprobe.contracts import Bounds, GroundTruth, Reconstruction
from lwrprobe.evaluation import gap_over_time, gap_p95_over_time, reach
from lwrprobe.evaluation.coverage import DEFAULT_SPACING
from lwrprobe.evaluation.machine import machine, versions
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.loop.explorer import Outcome
from lwrprobe.exploration.recording.bridged import Bridged, bridged
from lwrprobe.exploration.recording.certification import CertifiedRun
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.open_border import open_borders
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.true_errors import true_errors
from lwrprobe.exploration.recording.untouched import MEETS, NOT_FOLLOWED, UNKNOWN, untouched
from lwrprobe.exploration.stages.clearance import ClearanceStage
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene
from lwrprobe.scene.table import Pose

_GAP_SAMPLES = 5000
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
    errors, left_out = true_errors(scene, truth, recorder, pipeline, surface, budget)
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
        **errors,
        **_certified(scene, truth, recorder, certified),
        truth=truth.differences if truth is not None else None,
        cycle_us=outcome.cycle_us,
        force_control=pipeline.force.report(),
        stages=outcome.stages,
        left_out=[*pipeline.left_out, *left_out],
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
