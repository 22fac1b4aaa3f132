"""Where grid lines cross the surface, and vertices put onto a solid's corners, edges and faces."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.scene.edge_kernels import edge_point
from lwrprobe.scene.mesh_kernels import mesh_nearest
from lwrprobe.scene.program import CHAIN_INDICES, CHAINS, MESHES, VERTEX_NUMBERS, VERTICES
from lwrprobe.scene.solid_kernels import chain_bound, nearest
from lwrprobe.scene.surface_kernels import contains

_HALVINGS = 14
_ALTERNATIONS = 20  # between an edge and a cell, towards a point of both


@kernel
def crossings(numbers, indices, begin, end, begins_inside, points):
    """By bisection, where the path from begin (n, 3) to end (n, 3) passes through the surface, into points (n, 3)."""
    for n in range(begin.shape[0]):
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            s = 0.5 * (low + high)
            x = begin[n, 0] + s * (end[n, 0] - begin[n, 0])
            y = begin[n, 1] + s * (end[n, 1] - begin[n, 1])
            z = begin[n, 2] + s * (end[n, 2] - begin[n, 2])
            inside = contains(numbers, indices, x, y, z)
            for m in range(indices[MESHES]):
                inside = inside or mesh_nearest(numbers, indices, m, x, y, z)[0] < 0.0
            if inside == (begins_inside[n] == 1):
                low = s
            else:
                high = s
        for axis in range(3):
            points[n, axis] = begin[n, axis] + low * (end[n, axis] - begin[n, axis])


@kernel
def snap(numbers, indices, middles, lower, upper, hair, vertices):
    """Put middles (n, 3), each in its cell lower..upper (n, 3), onto a corner or an edge in the cell, else a face.

    Corners and edges out of the cell by less than the share `hair` of its size count as in it.
    """
    for n in range(middles.shape[0]):
        x, y, z = middles[n, 0], middles[n, 1], middles[n, 2]
        found, px, py, pz = _corner_in(numbers, indices, x, y, z, lower[n], upper[n], hair)
        if not found:
            found, px, py, pz = _edge_in(numbers, indices, x, y, z, lower[n], upper[n], hair)
        if not found:
            _, px, py, pz, _, _, _, _ = nearest(numbers, indices, x, y, z)
        vertices[n, 0], vertices[n, 1], vertices[n, 2] = px, py, pz


@kernel
def _corner_in(numbers, indices, x, y, z, lower, upper, hair):
    best, bx, by, bz = np.inf, x, y, z
    for v in range(indices[VERTICES]):
        row = indices[VERTICES + 1] + VERTEX_NUMBERS * v
        px, py, pz = numbers[row], numbers[row + 1], numbers[row + 2]
        square = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
        if square < best and _in_cell(px, py, pz, lower, upper, hair):
            best, bx, by, bz = square, px, py, pz
    return best < np.inf, bx, by, bz


@kernel
def _edge_in(numbers, indices, x, y, z, lower, upper, hair):
    size = np.sqrt(np.sum((upper - lower) ** 2))
    best, bx, by, bz = size * size, x, y, z
    for chain in range(indices[CHAINS]):
        if chain_bound(numbers, indices, chain, x, y, z) > size:
            continue
        row = indices[CHAINS + 2] + CHAIN_INDICES * chain
        i, j, kind = indices[row + 2], indices[row + 3], indices[row + 7]
        for e in range(indices[row], indices[row + 1]):
            px, py, pz, _ = edge_point(numbers, indices, e, kind, i, j, x, y, z)
            square = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
            if square >= best:
                continue
            for _ in range(_ALTERNATIONS):
                if _in_cell(px, py, pz, lower, upper, hair):
                    break
                qx, qy, qz = _into_cell(px, py, pz, lower, upper)
                px, py, pz, _ = edge_point(numbers, indices, e, kind, i, j, qx, qy, qz)
            square = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
            if square < best and _in_cell(px, py, pz, lower, upper, hair):
                best, bx, by, bz = square, px, py, pz
    return best < size * size, bx, by, bz


@kernel
def _into_cell(x, y, z, lower, upper):
    """Nearest point of a cell."""
    return min(max(x, lower[0]), upper[0]), min(max(y, lower[1]), upper[1]), min(max(z, lower[2]), upper[2])


@kernel
def _in_cell(x, y, z, lower, upper, hair):
    for axis, value in enumerate((x, y, z)):
        slack = hair * (upper[axis] - lower[axis])
        if value < lower[axis] - slack or value >= upper[axis] + slack:
            return False
    return True
