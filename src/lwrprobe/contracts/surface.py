"""What a reconstructor is given and what it returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from lwrprobe.contracts.samples import Vector
from lwrprobe.errors import InputError

RECONSTRUCTOR_CONTRACT = 1


@dataclass(slots=True)
class TriangleMesh:
    """Vertices (n, 3) m and faces (m, 3) int64, counter-clockwise seen from outside.

    `vertex_error`, where present, is the expected error of each vertex [m], (n,), and `vertex_error_aligned` the one
    that is left after the rigid motion that aligns the mesh with the true shape.
    """

    vertices: np.ndarray
    faces: np.ndarray
    vertex_error: np.ndarray | None = None
    vertex_error_aligned: np.ndarray | None = None


@dataclass(slots=True)
class TouchRecord:
    """All that touching has taught: the input of every reconstructor.

    Attributes
    ----------
    points : (n, 3) m contact points, world frame
    normals : (n, 3) unit, out of the object, or None where the source had none
    confidence : (n,) 0..1, or None
    times : (n,) s, or None
    free_path : (k, 3) m, centres of the sphere along the path while it touched nothing, in order of time, or None.
        A step between two rows longer than `free_gap` is not a swept segment
    probe_radius : m, or None where unknown (a cloud from elsewhere)
    table : m, height of the table, or None
    lowest : m, lowest height the sphere's centre was allowed to, or None
    resolution : m, voxel edge when the points are voxel centres, 0 for raw contacts
    pitch : m, distance between the scan's lines, or None where unknown
    leaning : (l, 3) m, centres of the sphere along the path while the stick leaned, in order of time, or None where it
        was upright all the time. Above these the stick has shown nothing to be free
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    confidence: np.ndarray | None = None
    times: np.ndarray | None = None
    free_path: np.ndarray | None = None
    free_gap: float = 0.01
    probe_radius: float | None = None
    table: float | None = None
    lowest: float | None = None
    resolution: float = 0.0
    pitch: float | None = None
    leaning: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.points = np.ascontiguousarray(self.points, dtype=np.float64)
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError("points", self.points.shape, "an (n, 3) array")
        if self.table is not None and not np.isfinite(self.table):
            raise InputError("table", self.table, "a finite height in metres, or None")
        if self.probe_radius is not None and not (np.isfinite(self.probe_radius) and self.probe_radius > 0.0):
            raise InputError("probe_radius", self.probe_radius, "a positive length in metres, or None")
        if self.pitch is not None and not (np.isfinite(self.pitch) and self.pitch > 0.0):
            raise InputError("pitch", self.pitch, "a positive length in metres, or None")
        for name, width in (("normals", 3), ("confidence", 0), ("times", 0)):
            value = getattr(self, name)
            if value is None:
                continue
            value = np.ascontiguousarray(value, dtype=np.float64)
            wanted = (len(self.points), 3) if width else (len(self.points),)
            if value.shape != wanted:
                raise InputError(name, value.shape, f"the shape {wanted}, one row a point")
            setattr(self, name, value)


@dataclass(slots=True)
class Reconstruction:
    """A mesh and how it came about.

    `report` holds at least `method`, `seconds`, `watertight` and `without`: a list of what it had to do without.
    """

    mesh: TriangleMesh
    report: dict[str, Any] = field(default_factory=dict)
    unreachable: Vector | None = None


@runtime_checkable
class Reconstructor(Protocol):
    """An entry of the group `lwrprobe.reconstructors`; `Config` is a dataclass with its options."""

    Config: ClassVar[type]
    contract: ClassVar[int]

    def __init__(self, config: Any) -> None: ...

    def reconstruct(self, record: TouchRecord) -> Reconstruction:
        """Raises InputError when the record cannot carry a surface, saying why."""
