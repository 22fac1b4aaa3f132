"""From a sampled field to a closed mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import InputError, TriangleMesh
from lwrprobe.reconstruction.contour_kernels import compose, connect, crossings, interpolate, place
from lwrprobe.reconstruction.grid import Grid

SHARPNESS = 0.1
"""Share of the largest eigenvalue from which on a second or third direction of the tangent planes counts as an edge."""

Hermite = Callable[[np.ndarray, np.ndarray, np.ndarray], None]
"""Fills positions (m, 3) in units of the grid and unit normals (m, 3) for crossed edges (m, 4)."""


def contour(values: np.ndarray, grid: Grid, hermite: Hermite | None = None) -> TriangleMesh:
    """Closed manifold where `values` (nx, ny, nz) change sign, negative inside; `values` is mended in place.

    `hermite` knows better than linear interpolation where the edges are crossed, and in which direction. Raises
    InputError when nothing is inside or the inside reaches the grid's border.
    """
    _check_border(values)
    while compose(values, 1e-6 * grid.step):
        pass
    lookup, nothing = np.full((*grid.shape, 3), -1, dtype=np.int32), np.empty((0, 4), dtype=np.int64)
    edges = np.empty((crossings(values, lookup, nothing), 4), dtype=np.int64)
    crossings(values, lookup, edges)
    positions, normals = np.empty((len(edges), 3)), np.empty((len(edges), 3))
    if hermite is None:
        interpolate(values, edges, positions, normals)
    else:
        hermite(edges, positions, normals)
    owner = np.empty(tuple(n - 1 for n in grid.shape), dtype=np.int64)
    vertices = np.empty((place(lookup, positions, normals, SHARPNESS, owner, np.empty((0, 3))), 3))
    place(lookup, positions, normals, SHARPNESS, owner, vertices)
    faces = np.empty((2 * len(edges), 3), dtype=np.int64)
    connect(values, edges, owner, vertices, faces)
    return TriangleMesh(grid.origin + grid.step * vertices, faces)


def _check_border(values: np.ndarray) -> None:
    if not (values < 0.0).any():
        raise InputError("contacts", "nothing inside", "contacts that enclose a solid")
    for axis in range(3):
        if (np.take(values, [0, -1], axis=axis) < 0.0).any():
            raise InputError("contacts", "the surface leaves the grid", "contacts with normals that enclose a solid")
