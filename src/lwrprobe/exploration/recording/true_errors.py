"""What a run is worth against the true shape: coverage, errors of contacts and mesh, and the least possible time."""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.contracts import GroundTruth, InputError, LeftOut, Reconstruction, TriangleMesh
from lwrprobe.control import approach_speed
from lwrprobe.evaluation import (
    Reach,
    aligned_points,
    coverage,
    coverage_over_time,
    end_errors,
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
from lwrprobe.evaluation.mesh_error import sample_mesh
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.clearance import STICK
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

_ALIGNED_SAMPLES = 1500
_UPRIGHT_SAMPLES = 4000  # each is looked at some hundred times
_TIMES = 40  # at which the coverage is stated
_KEYS = (
    "coverage", "coverage_upright", "coverage_5mm", "coverage_over_time", "end_errors_mm", "contact_error_mm",
    "contact_error_aligned_mm", "surface_error_mm", "voxel_error_mm", "normal_error_deg", "mesh_error_mm",
    "mesh_error_aligned_mm", "mesh_error_reachable_aligned_mm", "mesh_error_upright_aligned_mm",
    "claims_within_95", "claims_aligned_within_95",
    "lower_bound_time_s", "lower_bound_descending_s", "lower_bound_unknown_s",
)  # fmt: skip


def true_errors(
    scene: Scene,
    truth: GroundTruth[Scene] | None,
    recorder: Recorder,
    pipeline: Pipeline,
    surface: Reconstruction | None,
    budget: ErrorBudget | None,
) -> tuple[dict[str, Any], list[LeftOut]]:
    """The figures of summary.json that need the truth, null where they cannot be had, and what was left out of them."""
    found: dict[str, Any] = dict.fromkeys(_KEYS)
    if truth is None or not scene.objects:
        return found, []
    points, normals, pitch = recorder.points(), recorder.normals(), pipeline.line_spacing or DEFAULT_SPACING
    actual, lowest, area = truth.scene, scene.area.lower[2], scene.area.as_area().raised(pipeline.raised)
    solid: Solid = actual.solid()
    everywhere = reach(solid, actual.probe.radius, lowest)
    within = everywhere.within(area)
    found |= _lower_bounds(scene, pipeline, within, pitch)
    touches = [truth.contact_at(sequence) for sequence in recorder.sequences]
    known = np.array([true is not None for true in touches], dtype=bool)
    true_points, true_normals = (
        np.array([getattr(true, name) for true in touches if true is not None]).reshape(-1, 3)
        for name in ("point", "normal")
    )
    # Which side was touched is another question than where it is: a base that is off by a millimetre uncovers nothing.
    aligned, facing = aligned_points(points[known], true_points), normals[known]
    share = coverage(aligned, facing, within, pitch).as_dict()
    found["coverage"], found["coverage_5mm"] = share["coverage"], share["coverage_5mm"]
    if len(points) == 0:
        return found, []
    few = reach(solid, actual.probe.radius, lowest, area, _UPRIGHT_SAMPLES)
    within_upright = reached_upright(scene, pipeline, few, solid)
    if len(within_upright.points) == len(few.points):
        within_upright = within
    found["coverage_upright"] = coverage(aligned, facing, within_upright, pitch).as_dict()["coverage"]
    if len(within.points):
        times = np.array([contact.time for contact in recorder.contacts])
        at = np.linspace(0.0, times.max(), _TIMES + 1)[1:]
        shares = coverage_over_time(aligned, facing, times[known], at, within, pitch)
        found["coverage_over_time"] = [[round(float(t), 2), round(float(c), 4)] for t, c in zip(at, shares)]
    ends = end_errors(points, normals, everywhere)
    found["end_errors_mm"] = [round(1e3 * end, 4) if np.isfinite(end) else None for end in ends]
    if known.any():
        found["contact_error_mm"] = point_error(points[known], true_points).as_dict()
        found["contact_error_aligned_mm"] = point_error(aligned, true_points).as_dict()
        found["normal_error_deg"] = normal_error(facing, true_normals).as_dict()
        if budget is not None:
            found["claims_within_95"] = budget.claims_within_95(points[known] - true_points, known)
            found["claims_aligned_within_95"] = budget.claims_within_95(aligned - true_points, known, aligned=True)
    found["surface_error_mm"] = surface_error(points, solid).as_dict()
    found["voxel_error_mm"] = surface_error(pipeline.voxels.centres(), solid).as_dict()
    if surface is None:
        return found, []
    try:
        return found | _mesh_errors(surface, solid, lowest, within, within_upright), []
    except InputError as error:  # a scrap of a mesh, too low or too small to be compared
        return found, [LeftOut(stage="mesh error", why=str(error))]


def _mesh_errors(
    surface: Reconstruction, solid: Solid, lowest: float, within: Reach, within_upright: Reach
) -> dict[str, Any]:
    """Errors of a mesh above `lowest` m: of all of it, and of what can be reached, with the probe upright or not."""
    method = {"method": surface.report["method"]}
    moved = align(sample_mesh(surface.mesh, lowest, _ALIGNED_SAMPLES)[0], solid).points(surface.mesh.vertices)
    aligned = TriangleMesh(moved, surface.mesh.faces)
    reached = reachable_error(aligned, solid, within, lowest)
    same = within_upright is within
    return {
        "mesh_error_mm": method | mesh_error(surface.mesh, solid, lowest).as_dict(),
        "mesh_error_aligned_mm": method | mesh_error(aligned, solid, lowest).as_dict(),
        "mesh_error_reachable_aligned_mm": reached,
        "mesh_error_upright_aligned_mm": reached if same else reachable_error(aligned, solid, within_upright, lowest),
    }


def reached_upright(scene: Scene, pipeline: Pipeline, found: Reach, solid: Solid) -> Reach:
    """What of it the probe reaches as it is held at first: its stick shadows what lies under an overhang."""
    rotation, links = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()[:3, :3], pipeline.probe.links
    stick, other = scene.clearance.stick_threshold, scene.clearance.threshold
    return upright(found, solid, links, rotation, [stick if link.name == STICK else other for link in links])


def _lower_bounds(scene: Scene, pipeline: Pipeline, within: Reach, pitch: float) -> dict[str, float]:
    """s, than which no exploration of this object at this pitch and speed is faster; see `lower_bound_time`."""
    motion, contact, planned = scene.motion, scene.contact, pipeline.force.planned

    def bound(free_speed: float, descent_speed: float | None = None) -> float:
        seconds = lower_bound_time(
            within, pitch, motion.contour_speed, pipeline.explored, free_speed, motion.acceleration, descent_speed
        )
        return round(seconds, 2)

    found = {"lower_bound_time_s": bound(motion.free_speed)}
    if planned is not None:  # else the run ended before the first touch was planned
        # Down a wall, at which a foot is met with the force limit and no reserve.
        descent = approach_speed(contact.limit - contact.threshold, *planned, motion.acceleration)
        found["lower_bound_descending_s"] = bound(motion.free_speed, descent)
        found["lower_bound_unknown_s"] = bound(motion.approach_speed, descent)
    return found
