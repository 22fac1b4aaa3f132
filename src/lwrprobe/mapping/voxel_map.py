"""The voxel map: occupied, free and unknown space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from numbers import Real
from pathlib import Path

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe.contracts.samples import Vector
from lwrprobe.host.whole_file import write_whole
from lwrprobe.mapping import carve_kernels, kernels, octomap_file
from lwrprobe.mapping.voxel_set import VoxelSet

MAX_VOXELS_LISTED = 50_000_000
WIDEST_SPHERE = 256  # voxels
_NO_POINT = "three finite coordinates within the map's range of +-{:.6g} m"


class VoxelState(IntEnum):
    """What is known about a voxel."""

    UNKNOWN = 0
    FREE = 1
    OCCUPIED = 2


@dataclass(slots=True)
class Leaves:
    """Cubes of one state each, as large as OctoMap's pruned octree has them.

    `centres` (n, 3) m, `sizes` (n,) m edges, `states` (n,) of `VoxelState`.
    """

    centres: np.ndarray
    sizes: np.ndarray
    states: np.ndarray


class VoxelMap:
    """Occupied and free voxels on OctoMap's grid: 2^16 voxels an axis, centred on the world's origin.

    An occupied voxel stays occupied when the sphere sweeps it later. A voxel is free when the sphere has swept all of
    it. Insertion and look-up walk the last levels of a 64-tree in compiled code.

    Parameters
    ----------
    resolution : m, edge of the smallest voxel, 1e-6 .. 1e3

    Raises
    ------
    InputError : naming the field, for points that are not finite or lie outside the grid, and for wrong shapes
    """

    __slots__ = ("_carved", "_holds", "_insert", "_occupied", "_resolution")

    def __init__(self, resolution: float = 0.002) -> None:
        if not _within(resolution, 1e-6, 1e3):
            raise InputError("resolution", resolution, "metres, 1e-6 to 1e3")
        self._resolution = float(resolution)
        self._occupied = VoxelSet(self._resolution)
        self._carved = VoxelSet(self._resolution)
        self._insert, self._holds = _single_calls()

    @property
    def resolution(self) -> float:
        """m, edge of the smallest voxel."""
        return self._resolution

    @property
    def reach(self) -> float:
        """m, the grid covers -reach <= x < reach on each axis."""
        return kernels.CENTRE_KEY * self._resolution

    @property
    def occupied_words(self) -> np.ndarray:
        """The occupied voxels' tree as its kernels read it; valid until the next insertion, never to be written."""
        return self._occupied.words

    def __len__(self) -> int:
        """Number of occupied voxels of the smallest size."""
        return len(self._occupied)

    def insert(self, points: np.ndarray) -> int:
        """Mark the voxels of (n, 3) points [m] occupied; how many were not before. All or, on an error, none."""
        points = self._points(points, "points")
        before = len(self._occupied)
        row = 0
        while (row := kernels.insert_points(self._occupied.words, points, row)) < len(points):
            self._occupied.grow()
        return len(self._occupied) - before

    def insert_point(self, point: Vector) -> bool:
        """Mark the voxel of one point (3,) [m] occupied; whether it was not before."""
        try:
            x, y, z = point.tolist()
            status = self._insert(self._occupied.words, x, y, z)
        except (AttributeError, TypeError, ValueError):
            return self.insert_point(_triple(point, "point"))
        while status == kernels.NO_CAPACITY:
            self._occupied.grow()
            status = self._insert(self._occupied.words, x, y, z)
        if status == kernels.OUTSIDE:
            raise self._refused("point", point)
        return status == kernels.NEW

    def carve_path(self, path: np.ndarray, radius: float) -> None:
        """Mark free what a sphere of `radius` [m] sweeps along a polyline of its centres (n, 3) [m].

        Only voxels wholly inside; one point alone is a sphere at rest.
        """
        path = self._points(path, "path")
        if not (_within(radius, 0.0, WIDEST_SPHERE * self._resolution) and radius > 0.0):
            raise InputError("radius", radius, f"metres, above 0 and at most {WIDEST_SPHERE} voxels")
        if len(path) == 0:
            return
        segments, row = max(len(path) - 1, 1), 0
        while (row := carve_kernels.carve_path(self._carved.words, path, float(radius), row)) < segments:
            self._carved.grow()

    def occupied(self, point: Vector) -> bool:
        """Whether something was touched in the voxel of a point (3,) [m]."""
        try:
            x, y, z = point.tolist()
            found = self._holds(self._occupied.words, x, y, z)
        except (AttributeError, TypeError, ValueError):
            return self.occupied(_triple(point, "point"))
        if found is None:
            raise self._refused("point", point)
        return found

    def state(self, point: Vector) -> VoxelState:
        """What is known about the voxel of a point (3,) [m]."""
        return VoxelState(int(self.states(np.reshape(_triple(point, "point"), (1, 3)))[0]))

    def states(self, points: np.ndarray) -> np.ndarray:
        """(n,) uint8 of `VoxelState` for (n, 3) points [m]."""
        points = _rows(points, "points")
        states = np.empty(len(points), np.uint8)
        row = kernels.states_of(self._occupied.words, self._carved.words, points, states)
        if row >= 0:
            raise self._refused(f"points[{row}]", points[row])
        return states

    def nearest(self, point: Vector) -> tuple[float, Vector]:
        """Distance [m] from a point (3,) to the nearest occupied voxel centre, and that; (inf, nan) on an empty map."""
        point = _triple(point, "point")
        centre = np.empty(3)
        distance = kernels.nearest_voxel(self._occupied.words, point, centre)
        if distance < 0.0:
            raise self._refused("point", point)
        return distance, centre

    def centres(self) -> np.ndarray:
        """(n, 3) m, centres of all occupied voxels of the smallest size."""
        return self._listed(VoxelState.OCCUPIED)

    def free_centres(self) -> np.ndarray:
        """(n, 3) m, centres of all free voxels of the smallest size."""
        return self._listed(VoxelState.FREE)

    def free_count(self) -> int:
        """Number of free voxels of the smallest size."""
        tree = self._octree()
        return sum(int(size) ** 3 for size in tree.sizes[(tree.codes == 0) & (tree.states == VoxelState.FREE)])

    def leaves(self) -> Leaves:
        """Occupied and free cubes after pruning, in OctoMap's order."""
        tree = self._octree()
        leaf = tree.codes == 0
        keys, sizes = tree.keys[leaf], tree.sizes[leaf]
        centres = octomap_file.centres(keys, sizes, self._resolution)
        return Leaves(centres, sizes * self._resolution, tree.states[leaf].astype(np.uint8))

    def bounds(self) -> tuple[Vector, Vector] | None:
        """Lower and upper corner (3,) [m] of the box around all occupied voxels; None where there is none."""
        if not len(self):
            return None
        words = self._occupied.words
        low = words[kernels.LOWER : kernels.LOWER + 3].astype(np.float64)
        high = words[kernels.UPPER : kernels.UPPER + 3].astype(np.float64) + 1.0
        return (low - kernels.CENTRE_KEY) * self._resolution, (high - kernels.CENTRE_KEY) * self._resolution

    def write(self, path: str | Path) -> Path:
        """Write `.bt` or `.ot`, by the ending, as OctoMap's own readers take it; the path as written.

        Raises StorageError.
        """
        path = Path(path)
        write_whole(path, self.encoded(_ending(path)))
        return path

    def encoded(self, ending: str) -> bytes:
        """Content of a file with the ending `.bt` or `.ot`."""
        return octomap_file.encode(self._octree(), self._resolution, ending)

    @classmethod
    def read(cls, path: str | Path) -> VoxelMap:
        """Map from a `.bt` or `.ot`; log-odds below 0 become free, the rest occupied.

        Raises FormatError naming file and place where the content is broken.
        """
        path = Path(path)
        resolution, occupied, carved = octomap_file.decode(path, _ending(path))
        voxels = cls(resolution)
        voxels._occupied, voxels._carved = occupied, carved
        return voxels

    def _octree(self) -> octomap_file.Octree:
        return octomap_file.octree(self._occupied, self._carved)

    def _listed(self, state: VoxelState) -> np.ndarray:
        tree = self._octree()
        wanted = (tree.codes == 0) & (tree.states == state)
        keys, sizes = tree.keys[wanted], tree.sizes[wanted]
        count = sum(int(size) ** 3 for size in sizes)
        if count > MAX_VOXELS_LISTED:
            raise InputError("map", f"{count} voxels", f"at most {MAX_VOXELS_LISTED} in one list; leaves() has cubes")
        centres = np.empty((count, 3))
        kernels.expand(keys, sizes, self._resolution, centres)
        return centres

    def _points(self, points: object, field: str) -> np.ndarray:
        value = _rows(points, field)
        row = kernels.first_outside(self._occupied.words, value)
        if row >= 0:
            raise self._refused(f"{field}[{row}]", value[row])
        return value

    def _refused(self, field: str, point: Vector) -> InputError:
        return InputError(field, _triple(point, field).tolist(), _NO_POINT.format(self.reach))


def _within(value: object, lowest: float, greatest: float) -> bool:
    """Whether it is a number from `lowest` to `greatest`."""
    return isinstance(value, Real) and lowest <= float(value) <= greatest


def _single_calls() -> tuple[Callable, Callable]:
    """Insertion and look-up of one point: the array is the map's own, and Python converts or refuses the numbers."""
    examples = np.empty(0, np.int64), 0.0, 0.0, 0.0
    return entry(kernels.insert_point, *examples), entry(kernels.holds_point, *examples)


def _triple(point: object, field: str) -> np.ndarray:
    """Contiguous (3,) float64."""
    try:
        value = np.ascontiguousarray(point, np.float64)
    except (TypeError, ValueError):
        raise InputError(field, point, "three numbers in metres") from None
    if value.shape != (3,):
        raise InputError(field, value.shape, "an array of shape (3,)")
    return value


def _rows(points: object, field: str) -> np.ndarray:
    """Contiguous (n, 3) float64."""
    try:
        value = np.ascontiguousarray(points, np.float64)
    except (TypeError, ValueError):
        raise InputError(field, points, "an (n, 3) array of metres") from None
    if value.ndim != 2 or value.shape[1] != 3:
        raise InputError(field, value.shape, "an (n, 3) array of metres")
    return value


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in (".bt", ".ot"):
        raise UnknownNameError("map file ending", ending, (".bt", ".ot"))
    return ending
