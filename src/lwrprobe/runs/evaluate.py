"""A run, a mesh or contacts against the true shape."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lwrprobe.contracts import Area, InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.evaluation.align import Placement
from lwrprobe.evaluation.coverage import DEFAULT_SPACING, Coverage
from lwrprobe.evaluation.facings import FacingError
from lwrprobe.evaluation.mesh_error import MeshError
from lwrprobe.evaluation.point_error import NormalError, PointError
from lwrprobe.runs.run import Run
from lwrprobe.scene import Scene
from lwrprobe.scene.solid import Solid

if TYPE_CHECKING:
    import trimesh

DEFAULT_RADIUS = 0.005
"""m, of the probe's sphere where neither the run nor the contacts contain it."""


@dataclass(slots=True, frozen=True, eq=False, repr=False)
class Evaluation:
    """How far something is from the true shape.

    Attributes
    ----------
    mesh : of the mesh, None without one
    points : distances of the contacts from the true surface, None without contacts
    normals : of the contacts, None without contacts or without normals
    coverage : share of the reachable surface with a contact nearby, None likewise
    contacts : how many, None where the subject has no contacts of its own
    above : m, only what lies higher was compared
    alignment : the motion that was applied first, None where none was asked for
    surface : the mesh as it was compared, None without one
    truth : the true shape
    """

    mesh: MeshError | None
    points: PointError | None
    normals: NormalError | None
    coverage: Coverage | None
    contacts: int | None
    above: float
    alignment: Placement | None
    surface: TriangleMesh | None
    truth: Solid

    def facings(self) -> list[FacingError]:
        """Errors of the mesh, one for each direction that the true surface faces; none without a mesh."""
        from lwrprobe.evaluation.facings import facing_errors

        return [] if self.surface is None else facing_errors(self.surface, self.truth, self.above)

    def save(self, folder: str | Path) -> list[Path]:
        """Write deviation.ply and deviation.png of the mesh; the files, none without a mesh.

        Raises InputError for a folder that cannot be written to.
        """
        from lwrprobe.evaluation.deviation_map import draw_deviation, write_deviation

        if self.surface is None:
            return []
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError("folder", str(folder), f"a folder that can be written to ({error.strerror})") from None
        return [
            write_deviation(folder / "deviation.ply", self.surface, self.truth),
            draw_deviation(folder / "deviation.png", self.surface, self.truth, self.above),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, lengths in mm, angles in degrees; what is None is left out."""
        parts = {name: getattr(self, name) for name in ("mesh", "points", "normals", "coverage")}
        return {name: part.as_dict() for name, part in parts.items() if part is not None}

    def __repr__(self) -> str:
        return f"Evaluation({self.as_dict()})"


def evaluate(
    subject: Run | TouchRecord | trimesh.Trimesh | TriangleMesh | Reconstruction | str | Path,
    scene: str | Path | Scene | None = None,
    *,
    above: float | None = None,
    align: bool = False,
) -> Evaluation:
    """Compare a run, a mesh or contacts with the true shape.

    Parameters
    ----------
    subject : a run, contacts, a mesh, or the path of a run folder, a mesh (.stl, .ply, .obj, .glb), a cloud (.pcd,
        .ply, .csv) or a map (.bt, .ot)
    scene : whose objects are the truth: a built-in name, a scene file, a `Scene`, or a closed mesh file; None = the
        run's own, which for a real arm are where the scene states them. Objects of a `Scene` are where a simulation of
        it has them, those of a name or a file where it states them; those of a file with a table `[truth]`, as a run
        folder's has, where that puts them
    above : m, only what lies higher is compared, None = what the sphere's centre can get down to in that scene
    align : first move the subject onto the true shape by rigid registration

    Raises
    ------
    InputError
        For a mesh or contacts without a scene, a scene without objects, and what is none of these.
    FormatError
        For a broken file.
    """
    from lwrprobe.evaluation import mesh_error
    from lwrprobe.evaluation.align import align as place

    if isinstance(subject, str | Path):
        subject = _read(Path(subject))
    truth, lowest = _truth(scene, subject)
    above = lowest if above is None else above
    surface, record = _parts(subject)
    alignment = None
    if align:
        points = surface.vertices if surface is not None else np.empty((0, 3)) if record is None else record.points
        alignment = place(points, truth)
        surface = None if surface is None else replace(surface, vertices=alignment.points(surface.vertices))
        record = None if record is None else _moved(record, alignment)
    error = None if surface is None else mesh_error(surface, truth, above)
    area, spacing = None, DEFAULT_SPACING
    if isinstance(subject, Run):
        area = subject.scene.area.as_area().raised(1e-3 * subject.summary.area_raised_mm)
        spacing = subject.summary.line_spacing_m or DEFAULT_SPACING
    count = None if record is None else len(record.points)
    distances = normals = covered = None
    if record is not None and count:
        distances, normals, covered = _contact_errors(record, truth, above, area, spacing)
    return Evaluation(error, distances, normals, covered, count, above, alignment, surface, truth)


def _truth(scene: str | Path | Scene | None, subject: object) -> tuple[Solid, float]:
    """The true shape, and the height [m] above which it is compared."""
    from lwrprobe.evaluation.truth import is_simulated, read_truth, true_solid

    solid: Solid | None
    if scene is None:
        if not isinstance(subject, Run):
            raise InputError("scene", None, "a scene or a closed mesh, unless a run is evaluated")
        scene = subject.scene
        drawn = subject.summary.truth_known or is_simulated(scene)  # the world of a real arm is not
        solid = true_solid(scene) if drawn else scene.solid() if scene.objects else None
        lowest = scene.area.lower[2]
    elif isinstance(scene, Scene):
        solid, lowest = true_solid(scene), scene.area.lower[2]
    else:
        solid, lowest = read_truth(str(scene))
    if solid is None or solid.empty:
        raise InputError("scene", getattr(scene, "name", scene), "a scene with an object")
    return solid, lowest


def _read(path: Path) -> Run | TouchRecord | TriangleMesh:
    """A run folder, a mesh, or a cloud or map. A .ply without triangles is a cloud."""
    from lwrprobe.evaluation.touch_source import MAPS, read_touches
    from lwrprobe.mapping.clouds import ENDINGS as CLOUDS
    from lwrprobe.reconstruction.meshes import NoTriangles, read_mesh

    if path.is_dir():
        return Run.read(path)
    ending = path.suffix.lower()
    if ending == ".ply":
        try:
            return read_mesh(path)
        except NoTriangles:
            pass
    return read_touches(path) if ending in (*CLOUDS, *MAPS) else read_mesh(path)


def _parts(subject: object) -> tuple[TriangleMesh | None, TouchRecord | None]:
    """Mesh and contacts of what is evaluated; either may be missing."""
    record = None
    if isinstance(subject, TouchRecord):
        return None, subject
    if isinstance(subject, Run):
        contacts = subject.contacts
        record = TouchRecord(contacts.points, contacts.normals, probe_radius=subject.scene.probe.radius)
        subject = subject.mesh
        if subject is None:
            return None, record
    if isinstance(subject, Reconstruction):
        subject = subject.mesh
    if isinstance(subject, TriangleMesh):
        return subject, record
    try:
        vertices, faces = np.asarray(subject.vertices, dtype=np.float64), np.asarray(subject.faces, dtype=np.int64)  # type: ignore[attr-defined]
    except (AttributeError, TypeError, ValueError):
        raise InputError("subject", subject, "a Run, contacts, a mesh, or the path of one") from None
    return TriangleMesh(vertices, faces), record


def _moved(record: TouchRecord, motion: Placement) -> TouchRecord:
    normals = None if record.normals is None else motion.directions(record.normals)
    return replace(record, points=motion.points(record.points), normals=normals)


def _contact_errors(
    record: TouchRecord, truth: Solid, above: float, area: Area | None, spacing: float
) -> tuple[PointError, NormalError | None, Coverage | None]:
    from lwrprobe.evaluation import coverage, normal_error, reach, surface_error

    errors = surface_error(record.points, truth)
    if record.normals is None:
        return errors, None, None
    radius = record.probe_radius or DEFAULT_RADIUS
    # From the sphere's centre: on the surface itself the normal jumps at every edge.
    true = truth.nearest(record.points + radius * record.normals).normals
    within = reach(truth, radius, max(above, radius), area)
    covered = coverage(record.points, record.normals, within, spacing)
    return errors, normal_error(record.normals, true), covered
