"""From a sampled field to a closed mesh with sharp edges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lwrprobe.contracts import InputError, TriangleMesh
from lwrprobe.reconstruction.composition_kernels import compose
from lwrprobe.reconstruction.dual_contouring import Topology, split, topology
from lwrprobe.reconstruction.grid import Grid

SHARPNESS = 0.1
"""Share of the largest eigenvalue from which on a second or third direction of the tangent planes counts as an edge."""

_APART = 1e-3
"""Of a cell's edge: nearer vertices are moved apart, each so far into its own cell."""

Hermite = Callable[[np.ndarray, np.ndarray, np.ndarray], None]
"""Fills positions (m, 3) in units of the grid and unit normals (m, 3) for crossed edges (m, 4)."""


def contour(values: np.ndarray, grid: Grid, hermite: Hermite | None = None, height: float = 1.0) -> TriangleMesh:
    """Closed manifold where `values` (nx, ny, nz) change sign, negative inside; `values` is mended in place.

    `hermite` gives better crossings of the edges than linear interpolation, and their normals. On a smooth surface the
    tangent planes meet as far above it as the mean of the crossings lies below: a vertex has this share `height` of
    the way between them. 0.5 puts vertices on the surface and 1 the middles of edges. Raises InputError when nothing is
    inside or the inside reaches the grid's border.
    """
    _check_border(values)
    while compose(values, 1e-6 * grid.step):
        pass
    surface = topology(values < 0.0)
    positions, normals = np.empty((2, len(surface.edges), 3))
    (hermite or _interpolation(values))(surface.edges, positions, normals)
    vertices = _apart(_meet(surface, positions, normals, height), surface)
    corners = vertices[surface.quads]
    faces = split(surface.quads, _flatness(corners) < _flatness(np.roll(corners, -1, axis=1)))
    return TriangleMesh(grid.origin + grid.step * vertices, faces)


def _check_border(values: np.ndarray) -> None:
    if not (values < 0.0).any():
        raise InputError(
            "contacts", "nothing inside",
            "contacts that enclose a solid, with normals that point out of it and a step and a sphere smaller than it",
        )  # fmt: skip
    for axis in range(3):
        if (np.take(values, [0, -1], axis=axis) < 0.0).any():
            raise InputError("contacts", "the surface leaves the grid", "contacts with normals that enclose a solid")


def _interpolation(values: np.ndarray) -> Hermite:
    """Crossings by linear interpolation, normals from central differences."""

    def fill(edges: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> None:
        begin, end = edges[:, :3], edges[:, :3] + np.eye(3, dtype=np.int64)[edges[:, 3]]
        low, high = values[tuple(begin.T)], values[tuple(end.T)]
        share = (low / (low - high))[:, None]
        positions[:] = begin + share * (end - begin)
        slope = (1.0 - share) * _slopes(values, begin) + share * _slopes(values, end)
        normals[:] = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-150)

    return fill


def _slopes(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Central differences (n, 3) at nodes (n, 3), one-sided at the grid's border."""
    slopes = np.empty(nodes.shape)
    for axis, size in enumerate(values.shape):
        low, high = nodes.copy(), nodes.copy()
        low[:, axis] = np.maximum(nodes[:, axis] - 1, 0)
        high[:, axis] = np.minimum(nodes[:, axis] + 1, size - 1)
        slopes[:, axis] = (values[tuple(high.T)] - values[tuple(low.T)]) / (high - low)[:, axis]
    return slopes


def _meet(surface: Topology, positions: np.ndarray, normals: np.ndarray, height: float) -> np.ndarray:
    """The vertices (n, 3) in units of the grid: where the tangent planes of a cell's crossings meet, in the cell.

    A vertex minimises the squared distances to the planes; directions whose eigenvalue is below `SHARPNESS` of the
    largest are taken from the crossings' mean. Where one direction is left the surface is smooth.
    """
    middle = surface.means(positions)
    planes = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 1, 9)
    matrix = surface.sums(np.repeat(planes, 4, axis=1)).reshape(-1, 3, 3)
    heights = np.einsum("ek,eck->ec", normals, positions[:, None] - middle[surface.quads])
    right = surface.sums(heights[:, :, None] * normals[:, None])
    values, vectors = np.linalg.eigh(matrix)
    sharp = values > SHARPNESS * values[:, -1:]
    along = np.einsum("nij,ni->nj", vectors, right) * sharp / np.where(sharp, values, 1.0)
    along[sharp.sum(axis=1) == 1] *= height
    return np.clip(middle + np.einsum("nij,nj->ni", vectors, along), surface.cells, surface.cells + 1)


def _apart(vertices: np.ndarray, surface: Topology) -> np.ndarray:
    """The vertices (n, 3), those that all but share their place with another one moved into their own cells.

    A file without indices such as STL would make one vertex of them, as its readers merge what rounding may have
    parted: edges with four faces. Two sheets of one cell cross different edges of it, though they may do so at the same
    node.
    """
    from scipy.spatial import cKDTree

    shared = np.flatnonzero(cKDTree(vertices).query(vertices, k=[2])[0][:, 0] < _APART)
    if len(shared):
        halfway = surface.edges[:, :3] + 0.5 * np.eye(3)[surface.edges[:, 3]]
        middle, cell = surface.means(halfway)[shared], surface.cells[shared]
        moved = np.clip(vertices[shared], cell + _APART, cell + 1 - _APART)
        vertices[shared] = moved + _APART * (middle - moved)
    return vertices


def _flatness(corners: np.ndarray) -> np.ndarray:
    """Cosine between the two triangles into which quadrangles (m, 4, 3) are split from their first corner."""
    diagonal = corners[:, 2] - corners[:, 0]
    first = np.cross(corners[:, 1] - corners[:, 0], diagonal)
    second = np.cross(diagonal, corners[:, 3] - corners[:, 0])
    squares = np.einsum("ij,ij->i", first, first) * np.einsum("ij,ij->i", second, second)
    return np.einsum("ij,ij->i", first, second) / np.sqrt(np.maximum(squares, 1e-300))
