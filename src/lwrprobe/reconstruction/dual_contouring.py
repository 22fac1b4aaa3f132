"""Dual contouring (Ju, Losasso, Schaefer, Warren, SIGGRAPH 2002): topology of the mesh; the caller places its vertices.

Each crossed grid edge gives one quadrangle between the four cells around it. A cell has one vertex for each sheet of
surface that passes through it (Nielson, Dual marching cubes, IEEE Visualization 2004), so that the result is closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])  # of a cell
_EDGES = np.array([(a, b) for a, b in combinations(range(8), 2) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1])
_AROUND = ((1, 1), (0, 1), (0, 0), (1, 0))  # the cells at an edge, counter-clockwise around its axis


@dataclass(slots=True, frozen=True)
class Topology:
    """What connects to what.

    Attributes
    ----------
    edges : (m, 4) node i, j, k and axis of each grid edge that has one end inside
    quads : (m, 4) vertices of the cells around each edge, counter-clockwise seen from outside
    cells : (n, 3) the cell of each vertex, by its lowest node
    """

    edges: np.ndarray
    quads: np.ndarray
    cells: np.ndarray

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Values (m, 4, k) of the corners of `quads`, added up for each vertex (n, k)."""
        vertex, columns = self.quads.ravel(), values.reshape(-1, values.shape[-1]).T
        return np.stack([np.bincount(vertex, column, len(self.cells)) for column in columns], axis=1)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Values (m, k) of the crossed edges, averaged for each vertex (n, k)."""
        return self.sums(np.repeat(values[:, None], 4, axis=1)) / np.bincount(self.quads.ravel())[:, None]


def topology(inside: np.ndarray) -> Topology:
    """Of the surface around the nodes (nx, ny, nz) bool that are `inside`; none of them on the grid's border."""
    crossed = np.zeros((*inside.shape, 3), dtype=bool)
    crossed[:-1, :, :, 0] = inside[:-1] != inside[1:]
    crossed[:, :-1, :, 1] = inside[:, :-1] != inside[:, 1:]
    crossed[:, :, :-1, 2] = inside[:, :, :-1] != inside[:, :, 1:]
    edges = np.argwhere(crossed)
    case = np.zeros([n - 1 for n in inside.shape], dtype=np.uint8)  # bit c: corner c is inside
    for c, (x, y, z) in enumerate(_CORNERS):
        nx, ny, nz = case.shape
        case |= inside[x : x + nx, y : y + ny, z : z + nz].astype(np.uint8) << c
    mixed = np.argwhere((case != 0) & (case != 255))
    sheet_of_edge, sheets = _sheets()
    count = sheets[case[tuple(mixed.T)]]
    first = np.zeros(case.shape, dtype=np.int64)
    first[tuple(mixed.T)] = np.cumsum(count) - count
    quads = np.empty((len(edges), 4), dtype=np.int64)
    for axis in range(3):
        rows = np.flatnonzero(edges[:, 3] == axis)
        for corner, beside in enumerate(_AROUND):
            offset = _offset(axis, beside)
            cell = tuple((edges[rows, :3] - offset).T)
            quads[rows, corner] = first[cell] + sheet_of_edge[case[cell], _edge_number(axis, offset)]
    enters = ~inside[tuple(edges[:, :3].T)]
    quads[enters] = quads[enters][:, [0, 3, 2, 1]]
    return Topology(edges, quads, np.repeat(mixed, count, axis=0))


def split(quads: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Two triangles (2m, 3) for each quadrangle (m, 4), split from its second vertex where `turned`, else its first."""
    rolled = np.where(turned[:, None], np.roll(quads, -1, axis=1), quads)
    return rolled[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def _offset(axis: int, beside: tuple[int, int]) -> np.ndarray:
    """How far along x, y, z an edge along `axis` lies from its cell's lowest node."""
    offset = np.zeros(3, dtype=np.int64)
    offset[[(axis + 1) % 3, (axis + 2) % 3]] = beside
    return offset


def _edge_number(axis: int, offset: np.ndarray) -> int:
    """Which of a cell's edges runs along `axis` from the corner at `offset`."""
    ends = (offset, offset + np.eye(3, dtype=np.int64)[axis])
    a, b = (int(corner @ (4, 2, 1)) for corner in ends)
    return _EDGES.tolist().index([a, b])


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
                pairs = list(combinations(face, 2))
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
