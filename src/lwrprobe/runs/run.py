"""What an exploration found: contacts, map, mesh and summary, with or without a folder on disk."""

from __future__ import annotations

import io
from base64 import b64encode
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lwrprobe.contracts import InputError, TouchRecord, TriangleMesh
from lwrprobe.evaluation.run_folder import read_run, run_mesh
from lwrprobe.evaluation.summary import CUT_OFF, Summary
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import Scene

if TYPE_CHECKING:
    import trimesh
    from matplotlib.figure import Figure


@dataclass(slots=True, frozen=True, eq=False)
class Contacts:
    """The contacts of a run, in the order they were made, in the world frame; one row each.

    Attributes
    ----------
    points : (n, 3) m, on the object's surface
    normals : (n, 3) unit, out of the object
    forces : (n,) N, size of the contact force
    times : (n,) s since the start of the run
    confidence : (n,) 0 (do not use) to 1
    """

    points: np.ndarray
    normals: np.ndarray
    forces: np.ndarray
    times: np.ndarray
    confidence: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"Contacts({len(self)})"


class Run:
    """One exploration, finished or cut off: what it touched, what was made of it, and how good that is.

    `lwrprobe.explore`, `Session.finish` and `open_run` return it. In a notebook it shows itself as a picture.

    Parameters
    ----------
    scene : as it was run
    contacts : what the mesh is made from: without the table, and without what was touched after the object had moved
    record : the same as the reconstructors take it
    trace : (k, 8) path of the sphere's centre: time s, x y z m, force N, touching 0 or 1, clearance m, lean of
        the stick rad
    summary : all figures, see `Summary`
    folder : where the run lies on disk, None where it does not
    voxels : the map where it is at hand, None = it is read from the folder
    surface : the mesh where it is at hand, None = it is read from the folder
    """

    def __init__(
        self,
        scene: Scene,
        contacts: Contacts,
        record: TouchRecord,
        trace: np.ndarray,
        summary: Summary,
        folder: Path | None = None,
        voxels: VoxelMap | None = None,
        surface: TriangleMesh | None = None,
    ) -> None:
        self.scene, self.contacts, self.record, self.trace = scene, contacts, record, trace
        self.summary, self.folder = summary, folder
        self._voxels, self._surface = voxels, surface

    @classmethod
    def read(cls, folder: str | Path) -> Run:
        """A run from its folder, complete or cut off; map and mesh are read when they are asked for.

        Raises FormatError, naming the file, for a folder that is no run's, and SceneError for a broken scene file.
        """
        found = read_run(folder)
        record = found.record
        assert record.normals is not None
        assert record.times is not None
        assert record.confidence is not None
        contacts = Contacts(record.points, record.normals, found.force, record.times, record.confidence)
        summary = found.summary
        if summary is None:
            summary = Summary(
                scene=found.scene.name,
                strategy=found.scene.strategy.name,
                seed=found.scene.run.seed,
                status=CUT_OFF,
                reason="the run did not get to its end",
                contacts=len(contacts),
                sim_time_s=found.duration,
            )
        return cls(found.scene, contacts, record, found.trace, summary, found.folder)

    @cached_property
    def map(self) -> VoxelMap:
        """The voxel map of what was touched and of what was found free. Raises FormatError for a broken file."""
        if self._voxels is not None:
            return self._voxels
        if self.folder is not None and (self.folder / "map.bt").is_file():
            return VoxelMap.read(self.folder / "map.bt")
        voxels = VoxelMap(self.scene.map.resolution)
        voxels.insert(self.contacts.points)
        return voxels

    @cached_property
    def mesh(self) -> trimesh.Trimesh | None:
        """The reconstructed surface [m, world frame], None where there is none; `lwrprobe.reconstruct` makes others.

        Raises FormatError for a broken file.
        """
        from lwrprobe.reconstruction.meshes import as_trimesh

        surface = self._triangles
        return None if surface is None else as_trimesh(surface)

    @cached_property
    def _triangles(self) -> TriangleMesh | None:
        surface = self._surface
        if surface is None and self.folder is not None:
            surface = run_mesh(self.folder)
        return surface if surface is not None and len(surface.faces) else None

    def picture(self) -> bytes:
        """Contacts, mesh and true shape side by side, a PNG file."""
        from lwrprobe.evaluation.preview import run_preview

        if self.folder is not None and (self.folder / "preview.png").is_file():
            return (self.folder / "preview.png").read_bytes()
        return run_preview(self.scene, self.summary, self.contacts.points, self._triangles)

    def plot(self) -> Figure:
        """Contacts in space, coloured by height, beside the force and the coverage over time: a matplotlib figure."""
        figure = _figure()
        space = figure.add_subplot(1, 2, 1, projection="3d")
        points = 1e3 * self.contacts.points
        space.scatter(*points.T, c=points[:, 2], s=1, cmap="viridis")
        space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", title=f"{len(points)} contacts")
        space.locator_params(nbins=4)
        if len(points):
            space.set_box_aspect(np.maximum(np.ptp(points, axis=0), 1.0), zoom=0.85)
        force = figure.add_subplot(2, 2, 2)
        force.plot(self.trace[:, 0], self.trace[:, 4], linewidth=0.5)
        force.axhline(self.scene.contact.limit, color="red", linewidth=0.8, label="limit")
        force.set(ylabel="force [N]", title=f"{self.scene.title or self.scene.name}: {self.summary.status}")
        force.legend(loc="upper right")
        share = figure.add_subplot(2, 2, 4)
        growth = np.array(self.summary.coverage_over_time or np.empty((0, 2)))
        if len(growth):
            share.plot(growth[:, 0], 100.0 * growth[:, 1])
            share.set(xlabel="time [s]", ylabel="coverage [%]", ylim=(0.0, 102.0))
        else:
            share.plot(self.contacts.times, np.arange(1, len(self.contacts) + 1))
            share.set(xlabel="time [s]", ylabel="contacts")
        return figure

    def save(self, folder: str | Path) -> Run:
        """Leave a run folder, as an exploration with `out` does, but without the strategy's trace; the run in it.

        Raises InputError for a folder that cannot be written to, or has files of these names that are no run's.
        """
        from lwrprobe.evaluation.run_report import write_report
        from lwrprobe.exploration.recording.results import write_run
        from lwrprobe.exploration.recording.run_files import check_own

        folder = Path(folder)
        check_own(folder)
        c = self.contacts
        record = TouchRecord(c.points, c.normals, c.confidence, c.times)
        write_run(folder, self.scene, record, c.forces, self.trace, self.map, self._triangles, self.summary)
        write_report(folder)
        return Run.read(folder)

    def __repr__(self) -> str:
        s = self.summary
        return f"Run({s.scene!r}, {s.strategy!r}, {s.status!r}, {len(self.contacts)} contacts)"

    def _repr_html_(self) -> str:
        picture = b64encode(self.picture()).decode()
        rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in self._facts())
        return (
            f'<img src="data:image/png;base64,{picture}" alt="contacts, mesh and true shape" style="max-width:100%">'
            f"<table>{rows}</table>"
        )

    def _facts(self) -> list[tuple[str, str]]:
        s = self.summary
        rows = [
            ("scene", self.scene.title or self.scene.name),
            ("strategy", s.strategy),
            ("status", f"{s.status}: {s.reason}"),
            ("contacts", str(len(self.contacts))),
            ("robot time", f"{s.sim_time_s:.1f} s"),
        ]
        if s.coverage is not None:
            rows.append(("coverage", f"{s.coverage:.1%}"))
        if s.mesh_error_mm is not None:
            rows.append(("mesh error", f"mean {s.mesh_error_mm['mean']:.3f} mm"))
        if self.folder is not None:
            rows.append(("folder", str(self.folder)))
        return rows


def open_run(folder: str | Path) -> Run:
    """A run from its folder, complete or cut off.

    Raises FormatError, naming the file, for a folder that is no run's, and SceneError for a broken scene file.
    """
    if not isinstance(folder, str | Path):
        raise InputError("folder", folder, "the path of a run folder")
    return Run.read(folder)


def _figure() -> Figure:
    """A figure of no window manager, so that a notebook shows it once: where it is the cell's last value."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class Picture(Figure):
        def _repr_png_(self) -> bytes:
            stream = io.BytesIO()
            self.savefig(stream, format="png")
            return stream.getvalue()

    figure = Picture(figsize=(11.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
