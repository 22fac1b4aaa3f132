"""A run or a mesh against the true shape."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lwrprobe.contracts import InputError, Reconstruction, TriangleMesh
from lwrprobe.evaluation.coverage import Coverage
from lwrprobe.evaluation.mesh_error import MeshError
from lwrprobe.evaluation.point_error import NormalError, PointError
from lwrprobe.runs.run import Run
from lwrprobe.scene import Scene
from lwrprobe.scene.solid import Solid

if TYPE_CHECKING:
    import trimesh

DEFAULT_SPACING = 0.010
"""m, line spacing that coverage is computed with where a run has no lines."""


@dataclass(slots=True, frozen=True)
class Evaluation:
    """How far something is from the true shape.

    Attributes
    ----------
    mesh : of the mesh, None without one
    points : distances of the contacts from the true surface, None without contacts
    normals : of the contacts, None without contacts
    coverage : share of the reachable surface with a contact nearby, None without contacts
    """

    mesh: MeshError | None = None
    points: PointError | None = None
    normals: NormalError | None = None
    coverage: Coverage | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, lengths in mm, angles in degrees; what is None is left out."""
        parts = {name: getattr(self, name) for name in ("mesh", "points", "normals", "coverage")}
        return {name: part.as_dict() for name, part in parts.items() if part is not None}


def evaluate(
    subject: Run | trimesh.Trimesh | TriangleMesh | Reconstruction | str | Path,
    scene: str | Path | Scene | None = None,
    *,
    above: float | None = None,
) -> Evaluation:
    """Compare a run, or a mesh, with the true shape.

    Parameters
    ----------
    subject : a run, a mesh, or a mesh file (.stl, .ply, .obj, .glb)
    scene : whose objects are the truth: a built-in name, a scene file, a `Scene`, or a closed mesh file; None = the
        run's own
    above : m, only what lies higher is compared, None = what the sphere's centre can get down to in that scene

    Raises
    ------
    InputError
        For a mesh without a scene, a scene without objects, and what is neither run nor mesh.
    FormatError
        For a broken file.
    """
    from lwrprobe.evaluation import coverage, mesh_error, normal_error, reach, surface_error
    from lwrprobe.evaluation.truth import read_truth, true_solid

    if scene is None:
        if not isinstance(subject, Run):
            raise InputError("scene", None, "a scene or a closed mesh, unless a run is evaluated")
        scene = subject.scene
    solid: Solid | None
    if isinstance(scene, Scene):
        solid, lowest = true_solid(scene), scene.area.lower[2]
    else:
        solid, lowest = read_truth(str(scene))
    if solid is None or solid.empty:
        raise InputError("scene", getattr(scene, "name", scene), "a scene with an object")
    above = lowest if above is None else above
    mesh = _triangles(subject)
    error = None if mesh is None else mesh_error(mesh, solid, above)
    if not isinstance(subject, Run) or not len(subject.contacts):
        return Evaluation(error)
    radius, contacts = subject.scene.probe.radius, subject.contacts
    # From the sphere's centre: on the surface itself the normal jumps at every edge.
    true = solid.nearest(contacts.points + radius * contacts.normals).normals
    within = reach(solid, radius, max(above, radius), subject.scene.area.as_area())
    return Evaluation(
        error,
        surface_error(contacts.points, solid),
        normal_error(contacts.normals, true),
        coverage(contacts.points, contacts.normals, within, subject.summary.line_spacing_m or DEFAULT_SPACING),
    )


def _triangles(subject: object) -> TriangleMesh | None:
    """The mesh of what is evaluated, None for a run without one."""
    from lwrprobe.reconstruction.meshes import read_mesh

    if isinstance(subject, Run):
        subject = subject.mesh
        if subject is None:
            return None
    if isinstance(subject, Reconstruction):
        subject = subject.mesh
    if isinstance(subject, str | Path):
        return read_mesh(subject)
    if isinstance(subject, TriangleMesh):
        return subject
    try:
        vertices, faces = np.asarray(subject.vertices, dtype=np.float64), np.asarray(subject.faces, dtype=np.int64)  # type: ignore[attr-defined]
    except (AttributeError, TypeError, ValueError):
        raise InputError("subject", subject, "a Run, a mesh, or the path of a mesh file") from None
    return TriangleMesh(vertices, faces)
