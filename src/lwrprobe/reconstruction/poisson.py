"""Screened Poisson reconstruction through Open3D, as the thesis did it and with the contacts' own normals."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from lwrprobe.contracts import (
    RECONSTRUCTOR_CONTRACT,
    InputError,
    MissingExtraError,
    Reconstruction,
    TouchRecord,
    TriangleMesh,
)
from lwrprobe.reconstruction.closed import is_closed
from lwrprobe.reconstruction.normals import estimate_normals
from lwrprobe.reconstruction.record import solid_points
from lwrprobe.reconstruction.touches import line_pitch


class Poisson:
    """Kazhdan, Hoppe, Screened Poisson surface reconstruction (2013); needs the extra `poisson`.

    With `normals="estimated"` it is the thesis's pipeline: moving least squares upsampling, normals from neighbours.
    On sparse lines that fails, as it did in the thesis; it is here to be compared with.
    """

    @dataclass(slots=True, frozen=True)
    class Config:
        """Options.

        Attributes
        ----------
        normals : `contact` takes the record's, `estimated` those of the moving least squares surface
        depth : of the octree, 4..10
        trim : share (0..0.5) of the vertices with the least data that is cut off
        """

        normals: Literal["contact", "estimated"] = "contact"
        depth: int = 6
        trim: float = 0.02

        def __post_init__(self) -> None:
            if not 4 <= self.depth <= 10:
                raise InputError("depth", self.depth, "a whole number from 4 to 10")
            if not 0.0 <= self.trim <= 0.5:
                raise InputError("trim", self.trim, "a share from 0 to 0.5")

    contract: ClassVar[int] = RECONSTRUCTOR_CONTRACT

    def __init__(self, config: Config | None = None) -> None:
        self.config = config or self.Config()

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Raises MissingExtraError without Open3D, InputError for points that span no solid."""
        library = _open3d()
        begin = time.perf_counter()
        without = []
        points = record.points
        solid_points(points)
        if self.config.normals == "contact" and record.normals is not None:
            normals = record.normals
        else:
            without = ["normals"] if record.normals is None else []
            points, normals = upsample(points, line_pitch(points, record.resolution))
        mesh = self._solve(library, points, normals)
        report = {
            "method": "poisson",
            "seconds": time.perf_counter() - begin,
            "watertight": is_closed(mesh.faces),
            "without": without,
            "points_used": len(points),
        }
        return Reconstruction(mesh, report)

    def _solve(self, library: Any, points: np.ndarray, normals: np.ndarray) -> TriangleMesh:
        cloud = library.geometry.PointCloud(library.utility.Vector3dVector(points))
        cloud.normals = library.utility.Vector3dVector(normals)
        solve = library.geometry.TriangleMesh.create_from_point_cloud_poisson
        with library.utility.VerbosityContextManager(library.utility.VerbosityLevel.Error):
            mesh, density = solve(cloud, depth=self.config.depth, n_threads=1)
        density = np.asarray(density)
        if self.config.trim > 0.0 and len(density):
            mesh.remove_vertices_by_mask(density < np.quantile(density, self.config.trim))
        return TriangleMesh(np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).astype(np.int64))


def _open3d() -> Any:
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise MissingExtraError("poisson", "open3d", "poisson") from error
    return open3d


def upsample(points: np.ndarray, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    """Moving least squares upsampling: points and normals of quadrics fitted around each point.

    Alexa et al. (2003), with samples in the local plane half a radius around each point, as PCL's SAMPLE_LOCAL_PLANE.
    """
    from scipy.spatial import cKDTree

    radius = 1.5 * pitch
    normals = estimate_normals(points, pitch)
    tree = cKDTree(points)
    ring = np.linspace(-0.5, 0.5, 5) * pitch
    offsets = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    made, facing = [], []
    for point, normal in zip(points, normals):
        near = points[tree.query_ball_point(point, radius)] - point
        if len(near) < 6:
            continue
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        x, y, z = near @ u, near @ v, near @ normal
        weight = np.exp(-((x * x + y * y + z * z) / (0.5 * radius**2)))[:, None]
        terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
        fit = np.linalg.lstsq(terms * weight, z * weight[:, 0], rcond=1e-6)[0]
        a, b = offsets.T
        height = fit[0] + fit[1] * a + fit[2] * b + fit[3] * a * a + fit[4] * a * b + fit[5] * b * b
        slope = fit[1] + 2.0 * fit[3] * a + fit[4] * b, fit[2] + fit[4] * a + 2.0 * fit[5] * b
        made.append(point + np.outer(a, u) + np.outer(b, v) + np.outer(height, normal))
        tilted = normal - np.outer(slope[0], u) - np.outer(slope[1], v)
        facing.append(tilted / np.linalg.norm(tilted, axis=1, keepdims=True))
    if not made:
        raise InputError("points", len(points), "points with at least 5 neighbours within 1.5 line pitches")
    return np.concatenate(made), np.concatenate(facing)
