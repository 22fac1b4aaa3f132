"""A run folder read back: what was touched, where the sphere passed, what was found out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lwrprobe.contracts import Area, FormatError, LwrprobeError, TouchRecord, TriangleMesh
from lwrprobe.contracts.options import configure
from lwrprobe.contracts.plugins import load
from lwrprobe.evaluation.summary import Summary
from lwrprobe.evaluation.table_touches import TablePlane
from lwrprobe.evaluation.truth import is_simulated, true_solid
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.scene import Scene, load_scene
from lwrprobe.scene.solid import Solid

CLOUD_FILE = "contacts.ply"
"""The contacts that the mesh is made of, corrected."""
HIDING_FILE = "hiding.ply"
"""The places where something about as large as certified could hide, with the size in m."""

_CONTACTS = ("time", "x", "y", "z", "nx", "ny", "nz", "force", "confidence")
_TRACE = ("time", "x", "y", "z", "force", "touching", "clearance")
_LEAN = "lean"
LEANS = 0.03
"""rad from the vertical, from which on the stick leans: the upper end of one 50 mm long is then 1.5 mm aside."""


@dataclass(slots=True)
class RunFolder:
    """What a run left behind, complete or cut short.

    Attributes
    ----------
    folder : where it lies
    scene : as it was run
    summary : content of summary.json, None when the run did not get that far
    record : contacts and free path, as the run's mesh is made of them; without what was touched after the object had
        moved, and without the table
    force : (n,) N, of each contact
    trace : (k, 8) time s, x y z m, force N, touching 0 or 1, clearance m, lean of the stick rad
    """

    folder: Path
    scene: Scene
    summary: Summary | None
    record: TouchRecord
    force: np.ndarray
    trace: np.ndarray

    @property
    def area(self) -> Area:
        """Where the sphere's centre could go: the scene's area, as far up as the run has raised it."""
        return self.scene.area.as_area().raised(0.0 if self.summary is None else 1e-3 * self.summary.area_raised_mm)

    def true_solid(self) -> Solid | None:
        """The objects where they really were; None where that is not known, or where there were none.

        The summary says whether it is known. A run that was cut off has none, and its driver's name has to tell.
        """
        known = is_simulated(self.scene) if self.summary is None else self.summary.truth_known
        return true_solid(self.scene) if known else None

    @property
    def times(self) -> np.ndarray:
        """(n,) s, of each contact."""
        assert self.record.times is not None, "contacts.csv has them"
        return self.record.times

    def until(self, time: float) -> TouchRecord:
        """The record of what was touched and passed up to a time [s]."""
        record, n = self.record, int(np.searchsorted(self.times, time, side="right"))
        trace = self.trace[self.trace[:, 0] <= time]
        normals, confidence = (rows if rows is None else rows[:n] for rows in (record.normals, record.confidence))
        return replace(
            record, points=record.points[:n], normals=normals, confidence=confidence, times=self.times[:n],
            free_path=trace[trace[:, 5] == 0.0, 1:4], leaning=leaning_places(trace),
        )  # fmt: skip

    @property
    def duration(self) -> float:
        """s, to the last thing that was noted."""
        return max((0.0, *self.trace[-1:, 0].tolist(), *self.times[-1:].tolist()))


def read_run(folder: str | Path, corrected: bool = True) -> RunFolder:
    """Read a run folder; a last line that a killed run left unfinished is left out.

    `corrected` gives the contacts as the run corrected them after its end, where it came to do so; otherwise all are as
    measured.

    Raises FormatError, naming the file, for a folder that is no run's, and SceneError for a broken scene file.
    """
    folder = Path(folder)
    scene_file = folder / "scene.toml"
    if not scene_file.is_file():
        raise FormatError(f"{folder}: not a run folder: it has no scene.toml")
    scene = load_scene(str(scene_file))
    contacts = read_table(folder / "contacts.csv", _CONTACTS)
    summary = Summary.read(folder / "summary.json") if (folder / "summary.json").is_file() else None
    moved = summary.stillness.get("moved_since_s") if summary is not None and summary.stillness else None
    if moved is not None:  # what was touched from then on was somewhere else
        contacts = contacts[contacts[:, 0] < moved]
    if summary is not None and summary.table_found is not None:
        contacts = contacts[~TablePlane.of(summary.table_found).touched(contacts[:, 1:4], contacts[:, 4:7])]
    path = folder / "trace.csv"
    trace = read_table(path, _TRACE, (_LEAN,)) if path.is_file() else np.empty((0, len(_TRACE) + 1))
    record = TouchRecord(
        points=contacts[:, 1:4],
        normals=contacts[:, 4:7],
        confidence=contacts[:, 8],
        times=contacts[:, 0],
        free_path=trace[trace[:, 5] == 0.0, 1:4],
        leaning=leaning_places(trace),
        probe_radius=scene.probe.radius,
        table=scene.table.height if scene.table.present else None,
        lowest=scene.area.lower[2],
        pitch=summary.line_spacing_m if summary is not None and summary.line_spacing_m else _pitch(scene),
    )
    if corrected:
        record = _corrected(record, folder / CLOUD_FILE)
    return RunFolder(folder, scene, summary, record, contacts[:, 7], trace)


def run_mesh(folder: Path) -> TriangleMesh | None:
    """The mesh of a run [m, world frame]; None where it has none, as after a run without contacts.

    Raises FormatError for a broken file.
    """
    from lwrprobe.reconstruction.meshes import read_mesh

    file = folder / "mesh.stl"
    mesh = read_mesh(file) if file.is_file() else None
    return mesh if mesh is not None and len(mesh.faces) else None


def _corrected(record: TouchRecord, file: Path) -> TouchRecord:
    """The record with points and normals of the run's cloud.

    A cloud of another number of contacts is an earlier one: the run was resumed after it had been written.
    """
    if not file.is_file():
        return record
    cloud = read_cloud(file)
    if cloud.normals is None or len(cloud.points) != len(record.points):
        return record
    return replace(record, points=cloud.points, normals=cloud.normals)


def _pitch(scene: Scene) -> float | None:
    """m between the lines of a run whose summary does not say it: the strategy's option `step`; None without one."""
    try:
        strategy = load("strategy", scene.strategy.name)
        options = configure(strategy.Config, scene.strategy.options, "strategy")
    except LwrprobeError:
        return None
    step = getattr(options, "step", None)
    return float(step) if isinstance(step, int | float) and step > 0.0 else None


def leaning_places(trace: np.ndarray) -> np.ndarray | None:
    """(l, 3) m, of a trace (k, 8), where the stick leaned; None where it did nowhere."""
    leaning: np.ndarray = trace[trace[:, 7] > LEANS, 1:4]
    return leaning if len(leaning) else None


def read_table(path: Path, columns: tuple[str, ...], later: tuple[str, ...] = ()) -> np.ndarray:
    """(n, columns + later) numbers of a file that was written line by line; columns after the first ones may hold text.

    The `later` ones stand somewhere after those, and are 0 in files of older runs, which do not have them.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read: {error}") from None
    header, _, body = text.partition("\n")
    header = header.replace("trust", "confidence")  # its name in older runs
    if tuple(header.split(",")[: len(columns)]) != columns:
        raise FormatError(f"{path}: line 1: columns {header!r}; allowed: {','.join(columns)}")
    lines = body.split("\n")[:-1]  # what follows the last line's end was cut off
    rows = np.zeros((len(lines), len(columns) + len(later)))
    names = header.split(",")
    places = {len(columns) + k: names.index(name) for k, name in enumerate(later) if name in names}
    for i, line in enumerate(lines):
        cells = line.split(",")
        try:
            rows[i, : len(columns)] = [float(cell) for cell in cells[: len(columns)]]
            for column, place in places.items():
                rows[i, column] = float(cells[place])
        except (ValueError, IndexError):
            count = len(columns) + len(places)
            raise FormatError(f"{path}: line {i + 2}: {line!r}; allowed: {count} numbers") from None
    return rows
