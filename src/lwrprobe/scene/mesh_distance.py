"""Any triangle mesh, closed or not: distances to it, and membership along upright lines."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import InputError, TriangleMesh
from lwrprobe.scene import program
from lwrprobe.scene.mesh_body import box_tree
from lwrprobe.scene.mesh_kernels import column_crossings, mesh_gaps


class MeshDistance:
    """Distances of points to a mesh's triangles, which need not be closed; raises InputError for a mesh without any."""

    def __init__(self, mesh: TriangleMesh) -> None:
        vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
        if not len(faces) or not np.isfinite(vertices).all():
            raise InputError("mesh", f"{len(faces)} faces", "a mesh with faces and finite vertices")
        self._vertices = vertices
        self._faces, boxes, nodes = box_tree(vertices, faces)
        self._packed = program.pack_tree(vertices, self._faces, boxes, nodes)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) m from points (n, 3) to the nearest triangle, without sign."""
        out = np.empty(len(points))
        mesh_gaps(*self._packed, np.ascontiguousarray(points, dtype=np.float64), out)
        return out

    def contains(self, columns: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """(n, m) bool of points (x, y, z) with columns (n, 2) of x, y and heights (n, m) of z.

        By the winding number along the upright line: meaningful for a closed mesh.
        """
        order = np.argsort(heights, axis=1)
        ranked = np.take_along_axis(np.ascontiguousarray(heights, dtype=np.float64), order, axis=1)
        winding = np.empty(ranked.shape)
        column_crossings(self._vertices, self._faces, np.ascontiguousarray(columns, dtype=np.float64), ranked, winding)
        inside = np.empty(ranked.shape, dtype=bool)
        np.put_along_axis(inside, order, winding > 0.5, axis=1)
        return inside
