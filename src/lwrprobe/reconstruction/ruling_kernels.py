"""Rulings through the cells of a grid, and what speaks against them (kernels, private)."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel

_FACES = 0.3  # cosine between a touch's normal and a ruling's, from which on the touch faces as that does


@kernel
def best_rulings(centres, normals, shortest, longest, cosine, offset, grow, origin, cell, worth, ends, share):
    """For each cell of a grid, the best straight line through it between two contacts.

    A line joins centres (n, 3) whose distance is from `shortest` to `longest` m, whose normals (n, 3) have at least
    this cosine, and that lie no farther from each other's mean tangent plane than `offset` m and `grow` of the line's
    length. The best one has the smallest length, up to twice as much where the normals differ. `worth` (nx, ny, nz), at
    first infinite, `ends` (nx, ny, nz, 2) and `share` (nx, ny, nz) of the length from the first end are changed.
    """
    shape = worth.shape
    across = np.empty(3)
    for j in range(centres.shape[0]):
        for i in range(j):
            squared, alike = 0.0, 0.0
            for m in range(3):
                across[m] = centres[j, m] - centres[i, m]
                squared += across[m] * across[m]
                alike += normals[i, m] * normals[j, m]
            if squared < shortest * shortest or squared > longest * longest or alike < cosine:
                continue
            length = np.sqrt(squared)
            height = 0.0
            for m in range(3):
                height += 0.5 * (normals[i, m] + normals[j, m]) * across[m]
            if abs(height) > offset + grow * length:
                continue
            score = length * (1.0 + (1.0 - alike) / (1.0 - cosine))
            pieces = int(np.ceil(2.0 * length / cell))
            for piece in range(1, pieces):
                part = piece / pieces
                a = int((centres[i, 0] + part * across[0] - origin[0]) / cell)
                b = int((centres[i, 1] + part * across[1] - origin[1]) / cell)
                c = int((centres[i, 2] + part * across[2] - origin[2]) / cell)
                if a < 0 or b < 0 or c < 0 or a >= shape[0] or b >= shape[1] or c >= shape[2]:
                    continue
                if score < worth[a, b, c]:
                    worth[a, b, c] = score
                    ends[a, b, c, 0] = i
                    ends[a, b, c, 1] = j
                    share[a, b, c] = part


@kernel
def _beside(point, begin, finish, normal, length, width):
    """m, height of a point above a ruling's surface; NaN farther beside it than `width` m, less at its ends."""
    along, height, squared = 0.0, 0.0, 0.0
    for m in range(3):
        step = point[m] - begin[m]
        along += step * (finish[m] - begin[m]) / length
        height += step * normal[m]
        squared += step * step
    beside = np.sqrt(max(squared - along * along - height * height, 0.0))
    return np.nan if beside > min(width, along, length - along) else height


@kernel
def _alike(one, other):
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@kernel
def refuted(begin, finish, normals, points, facing, width, tolerance, radius, deep, out):
    """Mark rulings (n,) in `out` beside which something shows that the surface is not there.

    They run from `begin` to `finish` (n, 3) on a surface with `normals` (n, 3). A point (k, 3) within `width` m of one
    counts when it is off the surface by more than `tolerance` m; near the ends the width is less. With `facing` (k, 3)
    it was touched, and counts where it faces about the same way; the sphere rolling over an edge, on an arc of its
    `radius`, does not, nor does what lies beyond a face towards the ruling: that is another part of the object, or the
    other side of a slot. Without, (0, 3), the sphere has passed it, and it counts below the surface. Either counts down
    to `deep` (n,) m below.
    """
    touched = facing.shape[0] > 0
    for i in range(begin.shape[0]):
        length = 0.0
        for m in range(3):
            length += (finish[i, m] - begin[i, m]) ** 2
        length = np.sqrt(length)
        above, below = np.inf, deep[i]  # up to where a touch counts, off the surface
        for k in range(facing.shape[0]):
            if _alike(facing[k], normals[i]) < -_FACES:
                height = _beside(points[k], begin[i], finish[i], normals[i], length, width)
                if height > 0.0:
                    above = min(above, height)
                elif height <= 0.0:  # not where it is farther beside the ruling
                    below = min(below, -height)
        for k in range(points.shape[0]):
            height = _beside(points[k], begin[i], finish[i], normals[i], length, width)
            if np.isnan(height):
                continue
            if touched:
                alike = _alike(facing[k], normals[i])
                arc = 2.0 * radius * (1.0 - alike)
                wrong = alike > _FACES and (tolerance < height < above or -below < height < -tolerance - arc)
            else:
                wrong = -below < height < -tolerance
            if wrong:
                out[i] = True
                break
