"""A mesh moved onto the field of the object itself, where contacts show that it is smooth.

The surface of the sphere's centres is smooth around edges, which is why the mesh is made from it. In hollows it bends
more than the object, and what is interpolated between lines is worse there. Which of the two fields is better, held-out
contacts tell: beside edges the object's own is several times worse.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.reconstruction.choice import FOLDS, blocks
from lwrprobe.reconstruction.hermite_field import HermiteField
from lwrprobe.reconstruction.hermite_rbf import field_data
from lwrprobe.reconstruction.touches import Touches

_CLEARLY = 0.75  # of what the centres' field is off, that the object's own must keep below
_HELD_OUT = 100  # contacts of each fold that are predicted
_EVERY, _SHARED = 4, 2  # vertices of which one is measured, and the nearest of those whose mean one is moved by
_FULLY = 0.8  # of the pitch from contacts: so far the mesh is moved in full, one pitch away no more
_FARTHEST = 0.2  # radii: farther apart the two fields disagree about more than the course between lines


def predicted_better(touches: Touches, pitch: float) -> bool:
    """Whether the field on the object predicts held-out contacts clearly better than that of the sphere's centres.

    `pitch` [m] lies between the lines; blocks are held out that are wider.
    """
    on_object, on_centres = (_off(places, touches, pitch) for places in (touches.points, touches.centres))
    return on_object < _CLEARLY * on_centres


def settled(mesh: TriangleMesh, centres: HermiteField, touches: Touches, pitch: float, floor: float) -> TriangleMesh:
    """The mesh, moved along its normals near contacts by what the object's field is off from that of the `centres`.

    Only the difference counts: how far vertices of a mesh lie off the surface that its triangles follow stays. Nothing
    at or below the `floor` [m] is moved, and nothing to below it.
    """
    from scipy.spatial import cKDTree

    own = HermiteField(field_data(touches.points, touches, pitch), centres.reach)
    share = np.clip((1.0 - cKDTree(own.data.points).query(mesh.vertices)[0] / pitch) / (1.0 - _FULLY), 0.0, 1.0)
    moved = np.flatnonzero((share > 0.0) & (mesh.vertices[:, 2] > floor))
    normals, measured = _normals(mesh)[moved], slice(None, None, _EVERY)
    places = mesh.vertices[moved[measured]]
    shifted = places + touches.radius * normals[measured]
    off = own.values_near(places, places[:, None]) - centres.values_near(shifted, shifted[:, None])
    off = np.clip(off[:, 0], -_FARTHEST * touches.radius, _FARTHEST * touches.radius)
    count = min(_SHARED, len(places))
    near = cKDTree(places).query(mesh.vertices[moved], k=np.arange(1, count + 1))[1]
    vertices = mesh.vertices.copy()
    vertices[moved] -= (share[moved] * off[near].mean(axis=1))[:, None] * normals
    np.maximum(vertices[:, 2], floor, out=vertices[:, 2])
    return TriangleMesh(vertices, mesh.faces)


def _off(places: np.ndarray, touches: Touches, pitch: float) -> float:
    """m: what a field through all but one block of places (n, 3) is off at that block on average, a pitch at most."""
    block, off = blocks(touches.points, pitch), []
    for fold in range(FOLDS):
        held = np.flatnonzero(block == fold)
        if not 0 < len(held) < len(places):
            continue
        at = places[held[:: len(held) // _HELD_OUT + 1]]
        field = HermiteField(field_data(places, touches, pitch, block != fold), 2.0 * pitch)
        off.append(np.minimum(np.abs(field.values_near(at, at[:, None])[:, 0]), pitch))
    return float(np.concatenate(off).mean()) if off else 0.0


def _normals(mesh: TriangleMesh) -> np.ndarray:
    """(n, 3) unit normals of the vertices, means of their triangles' by area."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = [np.bincount(mesh.faces.ravel(), np.repeat(column, 3), len(mesh.vertices)) for column in across.T]
    normals = np.column_stack(sums)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
