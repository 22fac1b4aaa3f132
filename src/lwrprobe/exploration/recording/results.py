"""What is made of a run's contacts: the record for reconstruction, and the files beside the streams."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lwrprobe.contracts import Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import Scene


def touch_record(recorder: Recorder, scene: Scene, voxels: VoxelMap, line_spacing: float | None) -> TouchRecord:
    """What a reconstructor is given: contacts, or the map's voxels, and the path on which nothing was touched."""
    trace = recorder.trace()
    free = trace[trace[:, 5] == 0.0, 1:4] if len(trace) else np.empty((0, 3))
    if scene.reconstruction.points == "voxels":
        return TouchRecord(
            points=voxels.centres(),
            free_path=free,
            probe_radius=scene.probe.radius,
            table=scene.table.height if scene.table.present else None,
            lowest=scene.area.lower[2],
            resolution=voxels.resolution,
            pitch=line_spacing,
        )
    return TouchRecord(
        points=recorder.points(),
        normals=recorder.normals(),
        trust=np.array([c.trust for c in recorder.contacts]),
        times=np.array([c.time for c in recorder.contacts]),
        free_path=free,
        probe_radius=scene.probe.radius,
        table=scene.table.height if scene.table.present else None,
        lowest=scene.area.lower[2],
        pitch=line_spacing,
    )


def write_results(
    out: Path,
    scene: Scene,
    pipeline: Pipeline,
    recorder: Recorder,
    surface: Reconstruction | None,
    summary: Summary,
) -> None:
    """Cloud, map, mesh and picture of a run, into its folder; contacts and path are there already."""
    from lwrprobe.evaluation.preview import draw_preview
    from lwrprobe.mapping.clouds import Cloud, write_cloud
    from lwrprobe.reconstruction.meshes import write_mesh

    force = np.array([c.magnitude for c in recorder.contacts])
    trust = np.array([c.trust for c in recorder.contacts])
    write_cloud(out / "contacts.ply", Cloud(recorder.points(), recorder.normals(), {"force": force, "trust": trust}))
    write_cloud(out / "cloud.pcd", Cloud(pipeline.voxels.centres()))
    pipeline.voxels.write(out / "map.bt")
    mesh = surface.mesh if surface is not None else TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    write_mesh(out / "mesh.stl", mesh)
    truth = scene.solid().mesh() if scene.objects and summary.link_collisions is not None else None
    facts = [f"{summary.contacts} contacts", f"{summary.sim_time_s:.0f} s"]
    if summary.mesh_error_mm is not None:
        facts.append(f"mesh error {summary.mesh_error_mm['mean']:.2f} mm")
    title = f"{scene.title or scene.name}: {scene.strategy.name}"
    draw_preview(out / "preview.png", title, recorder.points(), surface.mesh if surface else None, truth, facts)
