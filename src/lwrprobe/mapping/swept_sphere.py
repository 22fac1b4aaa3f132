"""Free space as it is found: the path of a sphere that touches nothing, place after place."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts.samples import Vector
from lwrprobe.mapping import sweep_kernels as kernels
from lwrprobe.mapping.voxel_map import VoxelMap


class SweptSphere:
    """Marks free what a sphere sweeps, a straight piece of its path at once.

    Most places lie on a line with those before. They are only remembered, which costs a fraction of carving from each
    to the next; `leave` marks what is still pending. Nothing is lost by that: a voxel that no short step sweeps wholly
    may be swept by several. Places may lie beside the line by 1/200 of a voxel.

    Parameters
    ----------
    voxels : the map that is marked
    radius : m, of the sphere
    """

    __slots__ = ("_extend", "_free", "_path", "_radius", "_voxels")

    def __init__(self, voxels: VoxelMap, radius: float) -> None:
        self._voxels, self._radius = voxels, radius
        self._path = np.zeros((1 + kernels.MAX_PLACES, 3))
        self._path[0, 1] = voxels.resolution
        self._extend = _entry()
        self._free = False

    def move_to(self, centre: Vector) -> None:
        """The sphere has moved straight to `centre` (3,) [m]; the first time, or after `leave`, it appears there.

        Raises InputError for a path that is not finite or leaves the map, at the latest when it is marked.
        """
        self._free = True
        x, y, z = centre.tolist()
        if self._extend(self._path, x, y, z):
            return
        end = self._mark()
        self._path[1], self._path[0, 0] = end, 1
        self._extend(self._path, x, y, z)

    def leave(self) -> None:
        """The sphere is no longer free: its path ends where it was last."""
        if self._free:
            self._mark()
            self._path[0, 0], self._free = 0, False

    def _mark(self) -> Vector:
        """Carve what is pending; where it ends."""
        count = int(self._path[0, 0])
        if count > 1:
            self._voxels.carve_path(self._path[[1, count]], self._radius)
        return self._path[count].copy()


@cache
def _entry() -> Callable:
    return entry(kernels.extend, np.empty((0, 3)), 0.0, 0.0, 0.0)
