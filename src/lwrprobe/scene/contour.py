"""A triangle mesh of a solid's exact surface, with its edges and corners kept sharp.

Dual contouring (Ju, Losasso, Schaefer, Warren, SIGGRAPH 2002) on a grid whose lines lie close to both sides of the
solid's level faces and corners. A cell has one vertex for each sheet of surface that passes through it, so that the
result is closed; the vertex is put onto the solid's own corner, else its edge, else its nearest face.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations, pairwise

import numpy as np

from lwrprobe.contracts import TriangleMesh
from lwrprobe.scene import program
from lwrprobe.scene.contour_kernels import crossings, snap
from lwrprobe.scene.solid_kernels import contains_batch, nearest_batch

_BESIDE = 5e-5  # m, how close grid lines lie to a level face
_HAIR = 0.02  # of a cell's size: an edge may cut a mixed cell's corner by less than can be found
_MOST = 16  # corners' coordinates that get lines of their own, per axis
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])  # of a cell
_EDGES = np.array([(a, b) for a, b in combinations(range(8), 2) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1])


def contour(numbers: np.ndarray, indices: np.ndarray, levels: list[np.ndarray], cell: float) -> TriangleMesh:
    """The surface as a closed mesh; `levels` holds each axis's coordinates of level faces, `cell` m the cells' size."""
    lines = _grid(numbers, indices, levels, cell)
    shape = tuple(map(len, lines))
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.empty(len(nodes), dtype=np.int64)
    contains_batch(numbers, indices, nodes, inside)
    inside = inside.reshape(shape)
    cells, case = _mixed_cells(inside)
    sheet_of_edge, sheets = _sheets()
    first = np.concatenate([[0], np.cumsum(sheets[case])])
    number = np.full([n - 1 for n in shape], -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    vertices = _vertices(numbers, indices, lines, inside, cells, case, first)
    vertices, same = np.unique(vertices, axis=0, return_inverse=True)
    quads = same.reshape(-1)[_quads(inside, number, case, first, sheet_of_edge)]
    return TriangleMesh(vertices, _triangles(numbers, indices, vertices, quads))


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
        sharp = sharp if len(sharp) <= _MOST else np.empty(0)
        beside = min(_BESIDE, np.diff(level).min() / 3.0)
        stops = np.sort(np.concatenate([level - beside, level + beside, sharp, sharp - beside, sharp + beside]))
        pieces = [np.linspace(a, b, max(int(np.ceil((b - a) / cell)), 1) + 1)[1:] for a, b in pairwise(stops)]
        lines.append(np.concatenate([stops[:1], *pieces]))
    return lines


def _distinct(values: np.ndarray | list[float]) -> np.ndarray:
    values = np.sort(np.asarray(values, dtype=np.float64))
    return values[np.concatenate([[True], np.diff(values) > 1e-6])] if len(values) else values


def _mixed_cells(inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (k, 3) that have corners inside and outside, and the case (k,) of each: bit c = corner c inside."""
    case = np.zeros([n - 1 for n in inside.shape], dtype=np.int64)
    for c, (x, y, z) in enumerate(_CORNERS):
        nx, ny, nz = case.shape
        case |= inside[x : x + nx, y : y + ny, z : z + nz] << c
    cells = np.argwhere((case != 0) & (case != 255))
    return cells, case[tuple(cells.T)]


@cache
def _sheets() -> tuple[np.ndarray, np.ndarray]:
    """Sheet of each of the 12 edges (-1: not crossed), (256, 12), and number of sheets, (256,), in every case.

    Crossed edges that share a face of the cell belong to one sheet; on a face whose four edges are all crossed, the
    two at each inside corner. Both cells at a face decide alike.
    """
    sheet, count = np.full((256, 12), -1), np.zeros(256, dtype=np.int64)
    for case in range(256):
        inside = [(case >> c) & 1 for c in range(8)]
        crossed = [e for e, (a, b) in enumerate(_EDGES) if inside[a] != inside[b]]
        group = {e: {e} for e in crossed}
        for axis in range(3):
            for side in (0, 1):
                face = [e for e in crossed if (_CORNERS[_EDGES[e], axis] == side).all()]
                pairs = combinations(face, 2)
                if len(face) == 4:
                    pairs = [(e, f) for e, f in pairs if any(inside[c] for c in set(_EDGES[e]) & set(_EDGES[f]))]
                for e, f in pairs:
                    joined = group[e] | group[f]
                    for member in joined:
                        group[member] = joined
        for s, members in enumerate({id(g): g for g in group.values()}.values()):
            sheet[case, list(members)] = s
            count[case] = s + 1
    return sheet, count


def _vertices(
    numbers: np.ndarray, indices: np.ndarray, lines: list[np.ndarray], inside: np.ndarray,
    cells: np.ndarray, case: np.ndarray, first: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """One point a sheet: the middle of its crossings, then put onto the solid's corner, edge or face."""
    sheet_of_edge, _ = _sheets()
    total, hits = np.zeros((first[-1], 3)), np.zeros(first[-1])
    cell_of = np.repeat(np.arange(len(cells)), np.diff(first))
    for e, (a, b) in enumerate(_EDGES):
        sheet = sheet_of_edge[case, e]
        crossed = np.flatnonzero(sheet >= 0)
        begin, end = (np.column_stack([lines[d][cells[crossed, d] + _CORNERS[c, d]] for d in range(3)]) for c in (a, b))
        begins_inside = inside[tuple((cells[crossed] + _CORNERS[a]).T)]
        points = np.empty_like(begin)
        crossings(numbers, indices, begin, end, begins_inside, points)
        place = first[crossed] + sheet[crossed]
        np.add.at(total, place, points)
        np.add.at(hits, place, 1.0)
    middle = total / hits[:, None]
    lower = np.column_stack([lines[d][cells[cell_of, d]] for d in range(3)])
    upper = np.column_stack([lines[d][cells[cell_of, d] + 1] for d in range(3)])
    vertices = np.empty_like(middle)
    snap(numbers, indices, middle, lower, upper, _HAIR, vertices)
    borrowed = _taken(vertices) & _in_another_cell(vertices, lines, cells, cell_of, [n - 1 for n in inside.shape])
    again = np.empty((int(borrowed.sum()), 3))
    snap(numbers, indices, middle[borrowed], lower[borrowed], upper[borrowed], 0.0, again)
    vertices[borrowed] = again
    return vertices


def _taken(vertices: np.ndarray) -> np.ndarray:
    """Which vertices share their place, to within a micrometre, with another."""
    taken = np.zeros(len(vertices), dtype=bool)
    for shift in (0.0, 0.5):
        place = np.floor(vertices / 1e-6 + shift).astype(np.int64)
        _, same, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
        taken |= count[same.reshape(-1)] > 1
    return taken


def _in_another_cell(
    vertices: np.ndarray, lines: list[np.ndarray], cells: np.ndarray, cell_of: np.ndarray, shape: list[int]
) -> np.ndarray:
    """Which vertices lie in a cell that is not theirs and has vertices of its own."""
    where = np.column_stack([np.searchsorted(lines[d], vertices[:, d], side="right") - 1 for d in range(3)])
    where = np.clip(where, 0, np.array(shape) - 1)
    mixed = np.zeros(shape, dtype=bool)
    mixed[tuple(cells.T)] = True
    return (where != cells[cell_of]).any(axis=1) & mixed[tuple(where.T)]


def _quads(
    inside: np.ndarray, number: np.ndarray, case: np.ndarray, first: np.ndarray, sheet_of_edge: np.ndarray
) -> np.ndarray:
    """Around each crossed grid line the four cells' vertices, counter-clockwise seen from outside."""
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        a, b = np.take(inside, range(inside.shape[axis] - 1), axis), np.take(inside, range(1, inside.shape[axis]), axis)
        at = np.argwhere(a != b)
        corners = []
        for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):  # counter-clockwise around the axis
            cell = at.copy()
            cell[:, u] -= du
            cell[:, v] -= dv
            n = number[tuple(cell.T)]
            edge = _edge_index(axis, u, v, du, dv)
            corners.append(first[n] + sheet_of_edge[case[n], edge])
        quad = np.column_stack(corners)
        leaves = a[tuple(at.T)] == 1
        quads.append(np.where(leaves[:, None], quad, quad[:, ::-1]))
    return np.concatenate(quads)


def _triangles(numbers: np.ndarray, indices: np.ndarray, vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Each quadrangle split along the diagonal whose middle is nearer to the surface; triangles without area go."""
    gaps = np.empty((2, len(quads)))
    for d in (0, 1):
        middle = 0.5 * (vertices[quads[:, d]] + vertices[quads[:, d + 2]])
        unused, parts = np.empty_like(middle), np.empty(len(middle), dtype=np.int64)
        nearest_batch(numbers, indices, middle, gaps[d], unused, np.empty_like(middle), parts)
    first = np.abs(gaps[0]) <= np.abs(gaps[1])
    split = np.where(first[:, None], quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]]).reshape(-1, 3)
    a, b, c = split.T
    return split[(a != b) & (b != c) & (c != a)]


@cache
def _edge_index(axis: int, u: int, v: int, du: int, dv: int) -> int:
    """Which of a cell's edges runs along `axis` at du, dv of the other two."""
    for e, (a, b) in enumerate(_EDGES):
        if _CORNERS[a, axis] != _CORNERS[b, axis] and _CORNERS[a, u] == du and _CORNERS[a, v] == dv:
            return e
    raise AssertionError("a cell has an edge there")
