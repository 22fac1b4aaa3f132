"""A run folder made good after its run was killed: whole lines, a bag with its index, a summary, mesh and report."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from lwrprobe.bags.recover import RecoveredFile, recover_bag
from lwrprobe.contracts import FormatError, LwrprobeError, Reconstruction, StorageError
from lwrprobe.evaluation.run_folder import RunFolder, read_run
from lwrprobe.evaluation.summary import CUT_OFF, Summary
from lwrprobe.exploration.recording.logbook import OBSERVATIONS, read_log
from lwrprobe.exploration.recording.recorder import CONTACT_COLUMNS, STATE_COLUMNS, TRACE_COLUMNS
from lwrprobe.exploration.recording.results import write_shapes
from lwrprobe.host.whole_file import write_whole
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import Cloud
from lwrprobe.reconstruction.reconstruct import reconstruct

_TABLES = {"contacts.csv": (CONTACT_COLUMNS, 9), "trace.csv": (TRACE_COLUMNS, 7), "states.csv": (STATE_COLUMNS, 1)}
"""By file: the columns, and how many of them hold numbers."""


@dataclass(slots=True)
class Recovered:
    """What was made good.

    Attributes
    ----------
    contacts : whole ones in contacts.csv
    dropped : by file, lines that were given up
    bag : its files, empty without a bag
    written : results that were missing and are there now
    no_mesh : why the mesh that was written is empty, or empty
    resumable : `lwrprobe resume` can continue the run
    """

    contacts: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    bag: list[RecoveredFile] = field(default_factory=list)
    written: bool = False
    no_mesh: str = ""
    resumable: bool = False


def recover(folder: str | Path) -> Recovered:
    """Make a run folder good, whatever moment its run was killed in; what is complete stays untouched.

    Raises FormatError for a folder that is no run's, StorageError where it cannot be written.
    """
    folder = Path(folder)
    if not (folder / "scene.toml").is_file():
        raise FormatError(f"{folder}: not a run folder: it has no scene.toml")
    found = Recovered()
    try:
        for part in folder.glob("*.part"):
            part.unlink()
        for name, (columns, numbers) in _TABLES.items():
            found.dropped[name] = _whole_lines(folder / name, columns, numbers)
        if (folder / "bag").is_dir() and any((folder / "bag").glob("*.mcap")):
            found.bag = recover_bag(folder)
        if not _is_summary(folder / "summary.json"):
            (folder / "summary.json").unlink(missing_ok=True)
            found.written = True
        run = read_run(folder, corrected=False)
        found.contacts = len(run.record.points)
        found.resumable = _resumable(run)
        if found.written:
            found.no_mesh = _write_results(run)
    except OSError as error:
        raise StorageError(folder, error) from None
    return found


def _whole_lines(path: Path, columns: str, numbers: int) -> int:
    """Rewrite a table without the lines that are none; how many these were."""
    if not path.is_file():
        path.write_text(columns + "\n", encoding="utf-8")
        return 0
    content = path.read_bytes()
    lines = content.split(b"\n")
    header = lines[0].decode("utf-8", "replace")
    if len(lines) > 1 and header.split(",")[:numbers] == columns.split(",")[:numbers]:
        columns = header  # those of an older run, or of several that were merged
    ended, rest = lines[1:-1], lines[-1]
    kept = [line for line in ended if _is_row(line, numbers, columns.count(",") + 1)]
    dropped = len(ended) - len(kept) + bool(rest)
    if dropped or lines[0] != columns.encode():
        write_whole(path, b"\n".join([columns.encode(), *kept, b""]))
    return dropped


def _is_row(line: bytes, numbers: int, width: int) -> bool:
    cells = line.split(b",")
    try:
        values = [float(cell) for cell in cells[:numbers]]
        line.decode("utf-8")
    except ValueError:
        return False
    return len(cells) >= width and all(value == value for value in values)


def _is_summary(path: Path) -> bool:
    try:
        Summary.read(path)
    except (LwrprobeError, OSError):
        return False
    return True


def _resumable(run: RunFolder) -> bool:
    if not (run.folder / OBSERVATIONS).is_file():
        return False
    try:
        read_log(run.folder, 0.5 * run.scene.contact.threshold)
    except FormatError:
        return False
    return True


def _write_results(run: RunFolder) -> str:
    """Cloud, map, mesh, picture, summary and report from what is there; why the mesh is empty, if it is."""
    from lwrprobe.evaluation.run_report import write_report

    record, scene = run.record, run.scene
    assert record.confidence is not None
    voxels = VoxelMap(scene.map.resolution)
    voxels.insert(record.points)
    surface: Reconstruction | None = None
    no_mesh = "" if len(record.points) else "there is no contact"
    if len(record.points):
        try:
            surface = reconstruct(record, scene.reconstruction.method, **scene.reconstruction.options)
        except LwrprobeError as error:
            no_mesh = str(error)
    summary = Summary(
        scene=scene.name,
        strategy=scene.strategy.name,
        estimator=scene.contact.estimator,
        seed=scene.run.seed,
        status=CUT_OFF,
        reason="the run did not get to its end",
        contacts=len(record.points),
        voxels=len(voxels),
        sim_time_s=run.duration,
    )
    cloud = Cloud(record.points, record.normals, {"force": run.force, "confidence": record.confidence})
    write_shapes(run.folder, scene, cloud, voxels, surface.mesh if surface is not None else None, summary)
    summary.write(run.folder / "summary.json")
    write_report(run.folder, surface)
    return no_mesh
