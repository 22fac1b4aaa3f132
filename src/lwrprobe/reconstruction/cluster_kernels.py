"""Gathering oriented points that lie close together and face the same way into one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lwrprobe.compiled import kernel


class Seeds(NamedTuple):
    """Clusters by their first member, and a hash table of cells that finds those nearby."""

    points: np.ndarray  # (n, 3) m
    normals: np.ndarray  # (n, 3)
    cells: np.ndarray  # (slots, 3) cell of a slot
    heads: np.ndarray  # (slots,) its latest seed, -1 where the slot is empty
    chain: np.ndarray  # (n,) the seed before in the same cell, -1 after the last


class Cells(NamedTuple):
    """Points sorted by the cell of a box in which they lie; no point lies in the box's outermost cells."""

    points: np.ndarray  # (n, 3) m
    normals: np.ndarray  # (n, 3)
    keys: np.ndarray  # (n,) cell of a point, counted along z, then y, then x; ascending
    size: np.ndarray  # (3,) cells of the box


@kernel
def cell_hash(i, j, k, size):
    """Slot of a cell in an open-addressing table of 2^m slots."""
    return (i * 73856093 ^ j * 19349663 ^ k * 83492791) & (size - 1)


@kernel
def assign(points, normals, size, agreement, seeds, count, label):
    """Label points with the nearest cluster seed within `size` that faces the same way, else a new one.

    The cells have an edge of `size`; the clusters' number so far goes in and comes out.
    """
    places, facings, cells, heads, chain = seeds
    slots = heads.shape[0]
    for p in range(points.shape[0]):
        ci = int(np.floor(points[p, 0] / size))
        cj = int(np.floor(points[p, 1] / size))
        ck = int(np.floor(points[p, 2] / size))
        best, nearest = -1, size * size
        for i in range(ci - 1, ci + 2):
            for j in range(cj - 1, cj + 2):
                for k in range(ck - 1, ck + 2):
                    slot = cell_hash(i, j, k, slots)
                    while heads[slot] >= 0 and not (
                        cells[slot, 0] == i and cells[slot, 1] == j and cells[slot, 2] == k
                    ):
                        slot = (slot + 1) & (slots - 1)
                    seed = heads[slot]
                    while seed >= 0:
                        apart, facing = 0.0, 0.0
                        for m in range(3):
                            apart += (points[p, m] - places[seed, m]) ** 2
                            facing += normals[p, m] * facings[seed, m]
                        if apart < nearest and facing > agreement:
                            best, nearest = seed, apart
                        seed = chain[seed]
        if best < 0:
            best = count
            count += 1
            for m in range(3):
                places[best, m], facings[best, m] = points[p, m], normals[p, m]
            slot = cell_hash(ci, cj, ck, slots)
            while heads[slot] >= 0 and not (cells[slot, 0] == ci and cells[slot, 1] == cj and cells[slot, 2] == ck):
                slot = (slot + 1) & (slots - 1)
            cells[slot, 0], cells[slot, 1], cells[slot, 2] = ci, cj, ck
            chain[best] = heads[slot]
            heads[slot] = best
        label[p] = best
    return count


@kernel
def merge(points, normals, weights, label, centre, facing, total):
    """Weighted mean point and normal of each cluster, the point put back onto the curved surface.

    A member at tangential offset l with slope s against the mean normal predicts the surface at the mean point as
    its own height plus s l / 2, exact for any quadratic; the heights average to zero by the choice of the mean.
    """
    n, clusters = points.shape[0], centre.shape[0]
    for p in range(n):
        c = label[p]
        total[c] += weights[p]
        for m in range(3):
            centre[c, m] += weights[p] * points[p, m]
            facing[c, m] += weights[p] * normals[p, m]
    for c in range(clusters):
        length = np.sqrt(facing[c, 0] ** 2 + facing[c, 1] ** 2 + facing[c, 2] ** 2)
        for m in range(3):
            centre[c, m] /= total[c]
            facing[c, m] /= length
    rise = np.zeros(clusters)
    for p in range(n):
        c = label[p]
        along, height, tangential = 0.0, 0.0, 0.0
        for m in range(3):
            along += normals[p, m] * facing[c, m]
            height += (points[p, m] - centre[c, m]) * facing[c, m]
        for m in range(3):
            offset = points[p, m] - centre[c, m] - height * facing[c, m]
            tangential += offset * (normals[p, m] - along * facing[c, m])
        rise[c] += 0.5 * weights[p] * tangential / along
    for c in range(clusters):
        for m in range(3):
            centre[c, m] += rise[c] / total[c] * facing[c, m]


@kernel
def support(cells, claims, alike, weights, reach, agreement, agreeing, total):
    """Weight within `reach` of each claim whose normals agree with the claim's: of those alike, and of all.

    The cells have an edge of `reach`; the cells beside a point's along z follow one another in the order of the keys.
    """
    points, normals, keys, size = cells
    for p in range(points.shape[0]):
        if not claims[p]:
            continue
        for i in range(-1, 2):
            for j in range(-1, 2):
                cell = keys[p] + (i * size[1] + j) * size[2]
                for q in range(np.searchsorted(keys, cell - 1), np.searchsorted(keys, cell + 2)):
                    apart, facing = 0.0, 0.0
                    for m in range(3):
                        apart += (points[p, m] - points[q, m]) ** 2
                        facing += normals[p, m] * normals[q, m]
                    if apart <= reach * reach and facing > agreement:
                        total[p] += weights[q]
                        if alike[q]:
                            agreeing[p] += weights[q]
