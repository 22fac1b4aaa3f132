"""Free space: the voxels that a sphere has swept wholly (kernels, private)."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.mapping.kernels import CENTRE_KEY, KEYS, NO_CAPACITY, SCALE, insert_key, real

PIECE = 8.0  # voxels; long segments are taken in pieces so that their boxes stay small
OVERLAP = 2.0  # voxels; more than a cube's diagonal, so that a cube across a joint lies wholly in one of the pieces


@kernel
def distance_to_segment(x, y, z, a, d, length2):
    """Distance from a point to the segment a .. a + d."""
    ux, uy, uz = x - a[0], y - a[1], z - a[2]
    t = 0.0
    if length2 > 0.0:
        t = min(max((ux * d[0] + uy * d[1] + uz * d[2]) / length2, 0.0), 1.0)
    return np.sqrt((ux - t * d[0]) ** 2 + (uy - t * d[1]) ** 2 + (uz - t * d[2]) ** 2)


@kernel
def swept_wholly(x, y, z, a, d, length2, radius):
    """Whether the unit cube about a centre lies in the capsule: convex, so its eight corners decide."""
    middle = distance_to_segment(x, y, z, a, d, length2)
    if middle + 0.8660254037844387 <= radius:
        return True
    if middle + 0.5 > radius:
        return False
    for corner in range(8):
        cx = x + (corner & 1) - 0.5
        cy = y + ((corner >> 1) & 1) - 0.5
        cz = z + (corner >> 2) - 0.5
        if distance_to_segment(cx, cy, cz, a, d, length2) > radius:
            return False
    return True


@kernel
def carve_piece(words, a, d, radius):
    """Set the voxels in the capsule about a .. a + d, in voxel units: 0 or NO_CAPACITY."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for i in range(3):
        low[i] = max(np.int64(np.ceil(min(a[i], a[i] + d[i]) - radius)), 0)
        high[i] = min(np.int64(np.floor(max(a[i], a[i] + d[i]) + radius)), KEYS) - 1
    length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    for kz in range(low[2], high[2] + 1):
        for ky in range(low[1], high[1] + 1):
            for kx in range(low[0], high[0] + 1):
                swept = swept_wholly(kx + 0.5, ky + 0.5, kz + 0.5, a, d, length2, radius)
                if swept and insert_key(words, kx, ky, kz) == NO_CAPACITY:
                    return NO_CAPACITY
    return 0


@kernel
def carve_path(words, path, radius, first):
    """Set the voxels swept along path[first:] by a sphere; first segment that did not fit, or their number.

    One point alone is a segment of no length.
    """
    scale = real(words[SCALE])
    segments = max(path.shape[0] - 1, 1)
    reach = radius * scale
    a, d = np.empty(3), np.empty(3)
    for i in range(first, segments):
        begin, end = path[i], path[min(i + 1, path.shape[0] - 1)]
        length = 0.0
        for j in range(3):
            length += ((end[j] - begin[j]) * scale) ** 2
        length = np.sqrt(length)
        pieces = max(np.int64(np.ceil(length / PIECE)), 1)
        for piece in range(pieces):
            start = max(piece / pieces - OVERLAP / max(length, OVERLAP), 0.0)
            stop = (piece + 1) / pieces
            for j in range(3):
                a[j] = (begin[j] + start * (end[j] - begin[j])) * scale + CENTRE_KEY
                d[j] = (stop - start) * (end[j] - begin[j]) * scale
            if carve_piece(words, a, d, reach) == NO_CAPACITY:
                return i
    return segments
