"""The alpha shape of the contact points: a hull that follows hollows wider than alpha."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.reconstruction.closed import count_pieces, is_closed
from lwrprobe.reconstruction.record import solid_points

_SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Faces of a positively oriented tetrahedron, outward; row i lies opposite corner i."""


class ConcaveHull:
    """Boundary of the Delaunay tetrahedra with a circumradius of at most alpha (Edelsbrunner, Muecke 1994).

    On lines further apart than 2 alpha it is a hollow shell: `watertight` and `components` of the report say so.
    """

    @dataclass(slots=True, frozen=True)
    class Config:
        """Options.

        Attributes
        ----------
        alpha : m; None takes the smallest alpha that keeps all points in one piece. The thesis used 0.015
        """

        alpha: float | None = None

        def __post_init__(self) -> None:
            if self.alpha is not None and not self.alpha > 0.0:
                raise InputError("alpha", self.alpha, "a positive length in metres, or None")

    contract: ClassVar[int] = RECONSTRUCTOR_CONTRACT

    def __init__(self, config: Config | None = None) -> None:
        self.config = config or self.Config()

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Raises InputError for points that span no solid, and for an alpha that leaves nothing."""
        begin = time.perf_counter()
        points, tetrahedra, radii = _delaunay(solid_points(record.points))
        alpha = self.config.alpha if self.config.alpha is not None else _automatic(tetrahedra, radii)
        kept = tetrahedra[radii <= alpha]
        if len(kept) == 0:
            raise InputError("alpha", alpha, f"at least {radii.min():.4g} m, the smallest circumradius here")
        mesh = _boundary(points, kept)
        report = {
            "method": "concave_hull",
            "seconds": time.perf_counter() - begin,
            "watertight": is_closed(mesh.faces),
            "without": [],
            "alpha": alpha,
            "components": count_pieces(mesh.faces),
            "points_left_out": len(points) - len(np.unique(kept)),
        }
        return Reconstruction(mesh, report)


def _delaunay(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3), positively oriented tetrahedra (m, 4) and their circumradii (m,); slivers without volume go."""
    from scipy.spatial import Delaunay

    centre, scale = points.mean(axis=0), np.ptp(points, axis=0).max()
    scaled = (points - centre) / scale
    corners = Delaunay(scaled, qhull_options="QJ Pp").simplices.astype(np.int64)
    a, b, c = (scaled[corners[:, i]] - scaled[corners[:, 0]] for i in (1, 2, 3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    corners[volume < 0.0] = corners[volume < 0.0][:, [0, 2, 1, 3]]
    solid = np.abs(volume) > 1e-14
    lengths = [np.einsum("ij,ij->i", v, v)[:, None] for v in (a, b, c)]
    centre_of = lengths[0] * np.cross(b, c) + lengths[1] * np.cross(c, a) + lengths[2] * np.cross(a, b)
    radii = np.linalg.norm(centre_of[solid], axis=1) / (2.0 * np.abs(volume[solid])) * scale
    return points, corners[solid], radii


def _automatic(tetrahedra: np.ndarray, radii: np.ndarray) -> float:
    """The smallest radius at which the tetrahedra up to it hold every point in one face-connected piece."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    faces = np.sort(tetrahedra[:, _SIDES], axis=2).reshape(-1, 3)
    owner = np.repeat(np.arange(len(tetrahedra)), 4)
    order = np.lexsort(faces.T)
    same = (np.diff(faces[order], axis=0) == 0).all(axis=1)
    one, two = owner[order[:-1][same]], owner[order[1:][same]]
    used = len(np.unique(tetrahedra))
    ladder = np.unique(radii)
    low, high = 0, len(ladder) - 1
    while low < high:
        middle = (low + high) // 2
        kept = radii <= ladder[middle]
        both = kept[one] & kept[two]
        graph = coo_matrix((np.ones(both.sum()), (one[both], two[both])), shape=(len(tetrahedra),) * 2)
        label = connected_components(graph, directed=False)[1][kept]
        whole = len(np.unique(label)) == 1 and len(np.unique(tetrahedra[kept])) == used
        low, high = (low, middle) if whole else (middle + 1, high)
    return float(ladder[low])


def _boundary(points: np.ndarray, tetrahedra: np.ndarray) -> TriangleMesh:
    """Faces that belong to one tetrahedron alone."""
    faces = tetrahedra[:, _SIDES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = faces[np.sort(first[count == 1])]
    used, compact = np.unique(outer, return_inverse=True)
    return TriangleMesh(points[used], compact.reshape(-1, 3).astype(np.int64))
