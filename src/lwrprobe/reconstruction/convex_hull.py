"""The convex hull of the contact points: the simplest closed surface, right on convex objects alone."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.reconstruction.record import solid_points


class ConvexHull:
    """Quickhull (Barber, Dobkin, Huhdanpaa 1996) over the contact points, through scipy.

    It knows neither normals nor free space: every hollow is filled.
    """

    @dataclass(slots=True, frozen=True)
    class Config:
        """No options."""

    contract: ClassVar[int] = RECONSTRUCTOR_CONTRACT

    def __init__(self, config: Config | None = None) -> None:
        self.config = config or self.Config()

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Closed hull of `record.points`; raises InputError for fewer than 4 points or points in one plane."""
        begin = time.perf_counter()
        mesh = convex_hull(record.points)
        report = {
            "method": "convex_hull",
            "seconds": time.perf_counter() - begin,
            "watertight": True,
            "without": [],
            "points": len(record.points),
        }
        return Reconstruction(mesh, report)


def convex_hull(points: np.ndarray) -> TriangleMesh:
    """Hull of (n, 3) points [m], whatever their scale; vertices are input points, faces look outward."""
    from scipy.spatial import ConvexHull as Quickhull
    from scipy.spatial import QhullError

    points = solid_points(points)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    scaled = (points - centre) / np.ptp(points, axis=0).max()
    try:
        hull = Quickhull(scaled)
    except QhullError as error:
        raise InputError("points", points.shape, f"points that span a solid ({str(error).splitlines()[0]})") from error
    faces = _outward(scaled, hull.simplices.astype(np.int64), hull.equations[:, :3])
    return TriangleMesh(points[hull.vertices], np.searchsorted(np.sort(hull.vertices), faces))


def _outward(points: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> np.ndarray:
    corner, left, right = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    turned = np.einsum("ij,ij->i", np.cross(left - corner, right - corner), normals) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    return faces
