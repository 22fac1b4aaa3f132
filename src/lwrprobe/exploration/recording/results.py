"""What is made of a run's contacts: the record for reconstruction, and the files beside the streams."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np

from lwrprobe.contracts import InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.evaluation.run_folder import CLOUD_FILE, leaning_places
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.recording.recorder import CONTACT_COLUMNS, TRACE_COLUMNS, Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.host.whole_file import write_whole
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import Cloud, write_cloud
from lwrprobe.scene import Scene, write_scene


def touch_record(recorder: Recorder, scene: Scene, voxels: VoxelMap, line_spacing: float | None) -> TouchRecord:
    """What a reconstructor is given: contacts, or the map's voxels, and the path on which nothing was touched."""
    free, leaning = recorder.free_path(), leaning_places(recorder.trace())
    if scene.reconstruction.points == "voxels":
        return TouchRecord(
            points=voxels.centres(),
            free_path=free,
            leaning=leaning,
            probe_radius=scene.probe.radius,
            table=scene.table.height if scene.table.present else None,
            lowest=scene.area.lower[2],
            resolution=voxels.resolution,
            pitch=line_spacing,
        )
    return TouchRecord(
        points=recorder.points(),
        normals=recorder.normals(),
        confidence=np.array([c.confidence_score for c in recorder.contacts]),
        times=np.array([c.time for c in recorder.contacts]),
        free_path=free,
        leaning=leaning,
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
    force = np.array([c.magnitude for c in recorder.contacts])
    confidence = np.array([c.confidence_score for c in recorder.contacts])
    cloud = Cloud(recorder.points(), recorder.normals(), {"force": force, "confidence": confidence})
    write_shapes(out, scene, cloud, pipeline.voxels, surface.mesh if surface is not None else None, summary)


def write_run(
    out: Path,
    scene: Scene,
    record: TouchRecord,
    force: np.ndarray,
    trace: np.ndarray,
    voxels: VoxelMap,
    mesh: TriangleMesh | None,
    summary: Summary,
    run: np.ndarray | None = None,
) -> None:
    """A whole run folder but for the report and the strategy's trace.

    Parameters
    ----------
    out : made when missing
    record : contacts with normals, times and confidence
    force : (n,) N, of each contact
    trace : (k, 8) as `Recorder.trace` gives it
    run : (n,) number of the run that each contact comes from, where several were merged

    Raises InputError for a folder that cannot be made, StorageError where it cannot be written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("out", str(out), f"a folder that can be written to ({error.strerror})") from None
    write_scene(scene, out / "scene.toml")
    assert record.times is not None
    assert record.normals is not None
    assert record.confidence is not None
    columns = [record.times, record.points, record.normals, force, record.confidence]
    form, header = ["%.6f", *["%.7f"] * 3, *["%.6f"] * 3, "%.5f", "%.3f"], CONTACT_COLUMNS
    scalars = {"force": force, "confidence": record.confidence}
    if run is not None:
        columns, form, header = [*columns, run], [*form, "%d"], f"{header},run"
        scalars["run"] = run.astype(np.float64)
    _write_table(out / "contacts.csv", np.column_stack(columns), form, header)
    form = ["%.4f", *["%.6f"] * 3, "%.4f", "%d", "%.5f", "%.4f"]
    _write_table(out / "trace.csv", trace, form, TRACE_COLUMNS.replace(",state", ""))
    write_shapes(out, scene, Cloud(record.points, record.normals, scalars), voxels, mesh, summary)
    summary.write(out / "summary.json")


def write_shapes(
    out: Path, scene: Scene, cloud: Cloud, voxels: VoxelMap, mesh: TriangleMesh | None, summary: Summary
) -> None:
    """Cloud, map, mesh and picture of contacts, into a folder that is there. Raises StorageError."""
    from lwrprobe.evaluation.preview import run_preview
    from lwrprobe.reconstruction.meshes import write_mesh

    write_cloud(out / CLOUD_FILE, cloud)
    write_cloud(out / "cloud.pcd", Cloud(voxels.centres()))
    voxels.write(out / "map.bt")
    empty = TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    write_mesh(out / "mesh.stl", empty if mesh is None else mesh)
    write_whole(out / "preview.png", run_preview(scene, summary, cloud.points, mesh))


def _write_table(path: Path, rows: np.ndarray, form: list[str], header: str) -> None:
    text = StringIO()
    np.savetxt(text, rows, form, ",", header=header, comments="")
    write_whole(path, text.getvalue().encode())
