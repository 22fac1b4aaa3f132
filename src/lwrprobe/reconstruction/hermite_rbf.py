"""An implicit surface through the contact points, perpendicular to their normals, on the object itself."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import RECONSTRUCTOR_CONTRACT, InputError, Reconstruction, TouchRecord, TriangleMesh
from lwrprobe.reconstruction.clusters import cluster
from lwrprobe.reconstruction.contour import contour
from lwrprobe.reconstruction.grid import Grid, affordable
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.touches import Touches, line_pitch, prepare


class HermiteRbf:
    """Hermite radial basis functions (Macedo, Gois, Velho 2011) on contact points and normals.

    The rival of `contact_surface` without the sphere: it interpolates the object's surface, where edges are sharp,
    and knows nothing of free space. Closed at the table and at the border of the box around the contacts.
    """

    @dataclass(slots=True, frozen=True)
    class Config:
        """Options.

        Attributes
        ----------
        pitch : m, distance between the scan's lines; None takes the record's, or estimates it from the contacts
        step : m, edge of the grid's cells; None takes a fifth of the pitch. More where the object is so large that the
            grid would have more than 3 000 000 nodes
        """

        pitch: float | None = None
        step: float | None = None

        def __post_init__(self) -> None:
            for name in ("pitch", "step"):
                value = getattr(self, name)
                if value is not None and not (np.isfinite(value) and value > 0.0):
                    raise InputError(name, value, "a positive length in metres, or None")

    contract: ClassVar[int] = RECONSTRUCTOR_CONTRACT

    def __init__(self, config: Config | None = None) -> None:
        self.config = config or self.Config()

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Raises InputError for contacts that span no solid or whose normals enclose none."""
        begin = time.perf_counter()
        touches = prepare(record, 0.002)
        pitch = self.config.pitch or record.pitch or line_pitch(touches.centres, record.resolution)
        data = field_data(touches.points, touches, pitch)
        mesh = _surface(data, touches, pitch, self.config.step or 0.2 * pitch)
        report = {
            "method": "hermite_rbf",
            "seconds": time.perf_counter() - begin,
            "watertight": True,
            "without": [name for name in touches.without if name in ("normals", "table", "confidence")],
            "pitch": pitch,
            "points_used": len(data.points),
        }
        return Reconstruction(mesh, report)


def field_data(
    places: np.ndarray, touches: Touches, pitch: float, rows: np.ndarray | slice = slice(None)
) -> HermiteData:
    """What a field is zero at and perpendicular to: places (n, 3) m of the touches, those of `rows`, clustered."""
    groups = cluster(places[rows], touches.normals[rows], touches.confidence[rows], pitch / 3.0)
    share = 1.0 / np.sqrt(groups.weight)
    return HermiteData(groups.points, groups.normals, touches.noise * share, touches.normal_noise * share)


def _surface(data: HermiteData, touches: Touches, pitch: float, step: float) -> TriangleMesh:
    from scipy.spatial import cKDTree

    lower, upper = data.points.min(axis=0) - pitch, data.points.max(axis=0) + pitch
    step = affordable(lower, upper, step)
    if touches.table is not None:
        lower[2] = touches.table - 3.5 * step
    grid = Grid.around(lower - 3.0 * step, upper + 3.0 * step, step)
    values = HermiteField(data, 2.0 * pitch).values(grid, grid.nearest(data.points, pitch) >= 0)
    far = ~np.isfinite(values)
    nodes = grid.nodes()[far]
    nearest = cKDTree(data.points).query(nodes)[1]
    values[far] = np.einsum("ij,ij->i", nodes - data.points[nearest], data.normals[nearest])
    if touches.table is not None:
        heights = grid.origin[2] + step * np.arange(grid.shape[2])
        np.maximum(values, touches.table - heights, out=values)
    for axis in range(3):
        edge: list[slice | int] = [slice(None)] * 3
        for end in (0, -1):
            edge[axis] = end
            values[tuple(edge)] = step
    return contour(values, grid)
