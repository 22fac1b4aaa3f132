"""The objects of a scene as shapes that MuJoCo can touch.

Primitives and their unions are MuJoCo's own shapes and exact. MuJoCo takes a mesh for its convex hull, so that any
other body is covered by a skin: a thin convex prism inwards from each triangle of its surface. A body that is made of
flat faces and cylinders is cut with manifold3d, which leaves few triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.scene.shape import Shape
from lwrprobe.scene.solid import Solid

SKIN = 0.002
"""m, thickness of the prisms: a sphere that presses by some micrometres is never behind them."""
MIN_AREA = 1e-11
"""m^2; smaller triangles are left out."""
ENDLESS = 1.0
"""m, edge of the box that stands for a half space."""


@dataclass(slots=True, frozen=True)
class Piece:
    """One convex geometry: a primitive with its size [m], or the corners (k, 3) of a hull, at a pose (4, 4)."""

    kind: str
    size: tuple[float, ...]
    pose: np.ndarray
    corners: np.ndarray | None = None


def pieces(shape: Shape, tolerance: float) -> list[Piece]:
    """Convex pieces that make an object, curved surfaces within `tolerance` m where MuJoCo has no shape for them.

    Raises SceneError for an object that has no end or a mesh that is not closed.
    """
    return _pieces(shape, np.eye(4), tolerance)


def _pieces(shape: Shape, frame: np.ndarray, tolerance: float) -> list[Piece]:
    at = frame @ shape.at.matrix()
    if shape.shape == "box":
        return [Piece("box", tuple(0.5 * edge for edge in shape.size), at)]
    if shape.shape in ("cylinder", "capsule"):
        return [Piece(shape.shape, (shape.radius, 0.5 * shape.length), at)]
    if shape.shape == "sphere":
        return [Piece("sphere", (shape.radius,), at)]
    if shape.shape == "union":
        return [piece for child in shape.children for piece in _pieces(child, at, tolerance)]
    cut = _cut(shape, tolerance)
    if cut is not None:
        return _skin(_mesh_of(cut), frame)
    return _skin(Solid.from_shapes((shape,)).mesh(tolerance), frame)


def _skin(mesh: TriangleMesh, frame: np.ndarray) -> list[Piece]:
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice_area = np.linalg.norm(normals, axis=1)
    good = twice_area > 2.0 * MIN_AREA
    corners, normals = corners[good], normals[good] / twice_area[good, None]
    inner = corners - SKIN * normals[:, None, :]
    return [Piece("hull", (), frame, np.concatenate(pair)) for pair in zip(corners, inner)]


def _mesh_of(cut: Any) -> TriangleMesh:
    mesh = cut.to_mesh64()
    return TriangleMesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, np.int64))


def _cut(shape: Shape, tolerance: float) -> Any:
    """The body as a manifold3d solid; None where a shape in it is neither flat nor round about an axis."""
    import manifold3d

    body: Any
    if shape.shape == "box":
        body = manifold3d.Manifold.cube(shape.size, center=True)
    elif shape.shape == "half_space":
        body = manifold3d.Manifold.cube((ENDLESS,) * 3, center=True).translate((0.0, 0.0, -0.5 * ENDLESS))
    elif shape.shape == "cylinder":
        segments = _segments(shape.radius, tolerance)
        # corners as far outside of the circle as the middles of the edges are inside
        radius = shape.radius * 2.0 / (1.0 + np.cos(np.pi / segments))
        body = manifold3d.Manifold.cylinder(shape.length, radius, circular_segments=segments, center=True)
    elif shape.shape in ("union", "difference", "intersection"):
        parts = [_cut(child, tolerance) for child in shape.children]
        if any(part is None for part in parts):
            return None
        operation = {"union": "Add", "difference": "Subtract", "intersection": "Intersect"}[shape.shape]
        body = manifold3d.Manifold.batch_boolean(parts, getattr(manifold3d.OpType, operation))
    else:
        return None
    return body.transform(shape.at.matrix()[:3])


def _segments(radius: float, tolerance: float) -> int:
    """Edges of a polygon that keeps within `tolerance` of a circle."""
    return 4 * max(4, int(np.ceil(0.25 * np.pi / np.sqrt(4.0 * min(tolerance, radius) / radius))))
