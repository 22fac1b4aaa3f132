"""A triangle mesh of a solid's exact surface, with its edges and corners kept sharp.

Dual contouring on a grid whose lines lie close to both sides of the solid's level faces and corners. Each vertex is
put onto the solid's own corner, else its edge, else its nearest face.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.reconstruction.dual_contouring import Topology, split, topology
from lwrprobe.scene import program
from lwrprobe.scene.contour_kernels import crossings, snap
from lwrprobe.scene.solid_kernels import contains_batch, nearest_batch

_BESIDE = 5e-5  # m, how close grid lines lie to a level face
_HAIR = 0.02  # of a cell's size: an edge may cut a mixed cell's corner by less than can be found
_MAX_STEPS = 16  # corners' coordinates that get lines of their own, per axis


def contour(numbers: np.ndarray, indices: np.ndarray, levels: list[np.ndarray], cell: float) -> TriangleMesh:
    """The surface as a closed mesh; `levels` holds each axis's coordinates of level faces, `cell` m the cells' size."""
    lines = _grid(numbers, indices, levels, cell)
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    contained = np.empty(nodes[..., 0].size, dtype=np.int64)
    contains_batch(numbers, indices, nodes.reshape(-1, 3), contained)
    inside = contained.reshape(nodes.shape[:3]) == 1
    surface = topology(inside)
    vertices, same = np.unique(_vertices(numbers, indices, lines, inside, surface), axis=0, return_inverse=True)
    return TriangleMesh(vertices, _triangles(numbers, indices, vertices, same.reshape(-1)[surface.quads]))


def _grid(numbers: np.ndarray, indices: np.ndarray, levels: list[np.ndarray], cell: float) -> list[np.ndarray]:
    row = indices[program.BOUNDS + 1]
    lower, upper = numbers[row : row + 3], numbers[row + 3 : row + 6]
    count, at = indices[program.VERTICES], indices[program.VERTICES + 1]
    corners = numbers[at : at + 3 * count].reshape(-1, 3)
    lines = []
    for axis in range(3):
        level = _distinct([*levels[axis], lower[axis], upper[axis]])
        level = level[(level >= lower[axis] - 1e-9) & (level <= upper[axis] + 1e-9)]
        sharp = _distinct(corners[:, axis]) if count else np.empty(0)
        sharp = sharp[np.abs(sharp[:, None] - level).min(axis=1) > _BESIDE] if len(sharp) else sharp
        sharp = sharp if len(sharp) <= _MAX_STEPS else np.empty(0)
        beside = min(_BESIDE, np.diff(level).min() / 3.0)
        stops = np.sort(np.concatenate([level - beside, level + beside, sharp, sharp - beside, sharp + beside]))
        pieces = [np.linspace(a, b, max(int(np.ceil((b - a) / cell)), 1) + 1)[1:] for a, b in pairwise(stops)]
        lines.append(np.concatenate([stops[:1], *pieces]))
    return lines


def _distinct(values: np.ndarray | list[float]) -> np.ndarray:
    values = np.sort(np.asarray(values, dtype=np.float64))
    return values[np.concatenate([[True], np.diff(values) > 1e-6])] if len(values) else values


def _vertices(
    numbers: np.ndarray, indices: np.ndarray, lines: list[np.ndarray], inside: np.ndarray, surface: Topology
) -> np.ndarray:
    """The middle of each vertex's crossings, put onto the solid's corner, edge or face."""
    nodes, cells = surface.edges[:, :3], surface.cells
    ends = nodes + np.eye(3, dtype=np.int64)[surface.edges[:, 3]]
    points = np.empty((len(nodes), 3))
    begins_inside = inside[tuple(nodes.T)].astype(np.int64)
    crossings(numbers, indices, _places(lines, nodes), _places(lines, ends), begins_inside, points)
    middle, lower, upper = surface.means(points), _places(lines, cells), _places(lines, cells + 1)
    vertices = np.empty_like(middle)
    snap(numbers, indices, middle, lower, upper, _HAIR, vertices)
    borrowed = _taken(vertices) & _in_another_cell(vertices, lines, cells)
    again = np.empty((int(borrowed.sum()), 3))
    snap(numbers, indices, middle[borrowed], lower[borrowed], upper[borrowed], 0.0, again)
    vertices[borrowed] = again
    return vertices


def _places(lines: list[np.ndarray], nodes: np.ndarray) -> np.ndarray:
    """Where nodes (n, 3) of the grid lie, (n, 3) m."""
    return np.column_stack([line[column] for line, column in zip(lines, nodes.T)])


def _taken(vertices: np.ndarray) -> np.ndarray:
    """Which vertices share their place, to within a micrometre, with another."""
    taken = np.zeros(len(vertices), dtype=bool)
    for shift in (0.0, 0.5):
        place = np.floor(vertices / 1e-6 + shift).astype(np.int64)
        _, same, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
        taken |= count[same.reshape(-1)] > 1
    return taken


def _in_another_cell(vertices: np.ndarray, lines: list[np.ndarray], cells: np.ndarray) -> np.ndarray:
    """Which vertices lie in a cell that is not theirs and has vertices of its own."""
    shape = [len(line) - 1 for line in lines]
    where = np.column_stack([np.searchsorted(lines[d], vertices[:, d], side="right") - 1 for d in range(3)])
    where = np.clip(where, 0, np.array(shape) - 1)
    mixed = np.zeros(shape, dtype=bool)
    mixed[tuple(cells.T)] = True
    return (where != cells).any(axis=1) & mixed[tuple(where.T)]


def _triangles(numbers: np.ndarray, indices: np.ndarray, vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Each quadrangle split along the diagonal whose middle is nearer to the surface; triangles without area go."""
    gaps = np.empty((2, len(quads)))
    for d in (0, 1):
        middle = 0.5 * (vertices[quads[:, d]] + vertices[quads[:, d + 2]])
        unused, parts = np.empty_like(middle), np.empty(len(middle), dtype=np.int64)
        nearest_batch(numbers, indices, middle, gaps[d], unused, np.empty_like(middle), parts)
    faces = split(quads, np.abs(gaps[1]) < np.abs(gaps[0]))
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]
