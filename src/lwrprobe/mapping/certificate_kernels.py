"""Distances of grid points from what a probe has swept and from what it has touched (kernels, private).

A grid is an array (nx, ny, nz) of values at origin + edge * (i, j, k). A value is lowered to a distance where that is
smaller; what is farther away than the value is left alone. `owners` says of each grid point what is nearest to it, by
number: row * kinds + kind, where kind 0 is the sphere.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel

CYLINDER, BOX, CAPSULE = 0, 1, 2


@kernel
def first_index(low, origin, edge):
    """First grid index whose coordinate is at least `low`, 0 at least."""
    return max(np.int64(np.ceil((low - origin) / edge)), 0)


@kernel
def last_index(high, origin, edge, count):
    """Last grid index whose coordinate is at most `high`, below `count`."""
    return min(np.int64(np.floor((high - origin) / edge)), count - 1)


@kernel
def lower_to_sphere(values, owners, number, origin, edge, a, b, radius, band):
    """Distances, up to `band`, from a sphere swept along the segment from a to b, which has a number."""
    d0, d1, d2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length2 = d0 * d0 + d1 * d1 + d2 * d2
    far = radius + band
    nx, ny, nz = values.shape
    for i in range(
        first_index(min(a[0], b[0]) - far, origin[0], edge), last_index(max(a[0], b[0]) + far, origin[0], edge, nx) + 1
    ):
        x = origin[0] + i * edge - a[0]
        for j in range(
            first_index(min(a[1], b[1]) - far, origin[1], edge),
            last_index(max(a[1], b[1]) + far, origin[1], edge, ny) + 1,
        ):
            y = origin[1] + j * edge - a[1]
            for k in range(
                first_index(min(a[2], b[2]) - far, origin[2], edge),
                last_index(max(a[2], b[2]) + far, origin[2], edge, nz) + 1,
            ):
                z = origin[2] + k * edge - a[2]
                t = 0.0
                if length2 > 0.0:
                    t = min(max((x * d0 + y * d1 + z * d2) / length2, 0.0), 1.0)
                u, v, w = x - t * d0, y - t * d1, z - t * d2
                limit = values[i, j, k] + radius
                square = u * u + v * v + w * w
                if limit > 0.0 and square < limit * limit:
                    values[i, j, k] = np.sqrt(square) - radius
                    owners[i, j, k] = number


@kernel
def lower_to_path(values, owners, first, kinds, origin, edge, begins, ends, radius, band):
    """Distances from a sphere along segments from `begins` to `ends` (n, 3), whose rows count from `first` on."""
    for row in range(begins.shape[0]):
        number = (first + row) * kinds
        lower_to_sphere(values, owners, number, origin, edge, begins[row], ends[row], radius, band)


@kernel
def lower_to_points(squares, origin, edge, points, reach):
    """Squares of the distances from points (n, 3), up to `reach`."""
    nx, ny, nz = squares.shape
    reach2 = reach * reach
    above2 = np.empty(nz)
    for row in range(points.shape[0]):
        px, py, pz = points[row, 0], points[row, 1], points[row, 2]
        first = first_index(pz - reach, origin[2], edge)
        count = last_index(pz + reach, origin[2], edge, nz) + 1 - first
        for k in range(count):
            z = origin[2] + (first + k) * edge - pz
            above2[k] = z * z
        for i in range(first_index(px - reach, origin[0], edge), last_index(px + reach, origin[0], edge, nx) + 1):
            x = origin[0] + i * edge - px
            for j in range(first_index(py - reach, origin[1], edge), last_index(py + reach, origin[1], edge, ny) + 1):
                y = origin[1] + j * edge - py
                beside = x * x + y * y
                if beside > reach2:
                    continue
                column = squares[i, j, first : first + count]
                for k in range(count):  # without a root and a branch: the processor does several of them at once
                    column[k] = min(column[k], beside + above2[k])


@kernel
def link_distance(x, y, z, kind, size):
    """Distance of a point in the link's own frame from it; 0 inside."""
    if kind == BOX:
        u = max(abs(x) - 0.5 * size[0], 0.0)
        v = max(abs(y) - 0.5 * size[1], 0.0)
        w = max(abs(z) - 0.5 * size[2], 0.0)
        return np.sqrt(u * u + v * v + w * w)
    along = max(abs(z) - 0.5 * size[1], 0.0)
    across = np.sqrt(x * x + y * y)
    if kind == CAPSULE:
        return max(np.sqrt(across * across + along * along) - size[0], 0.0)
    across = max(across - size[0], 0.0)
    return np.sqrt(across * across + along * along)


@kernel
def lower_to_link(values, owners, first, kinds, which, origin, edge, poses, kind, size, shrink, band):
    """Distances, up to `band`, from one link at the poses (n, 4, 4) of its own frame, rows from `first` on.

    The link counts as `shrink` farther away than it is, and as the kind `which` in `owners`.
    """
    nx, ny, nz = values.shape
    half = np.empty(3)
    if kind == BOX:
        half[0], half[1], half[2] = 0.5 * size[0], 0.5 * size[1], 0.5 * size[2]
    else:
        half[0], half[1], half[2] = size[0], size[0], 0.5 * size[1]
        if kind == CAPSULE:
            half[2] += size[0]
    reach = np.empty(3)
    for row in range(poses.shape[0]):
        pose = poses[row]
        for i in range(3):
            reach[i] = band
            for j in range(3):
                reach[i] += abs(pose[i, j]) * half[j]
        px, py, pz = pose[0, 3], pose[1, 3], pose[2, 3]
        for i in range(first_index(px - reach[0], origin[0], edge), last_index(px + reach[0], origin[0], edge, nx) + 1):
            x = origin[0] + i * edge - px
            for j in range(
                first_index(py - reach[1], origin[1], edge), last_index(py + reach[1], origin[1], edge, ny) + 1
            ):
                y = origin[1] + j * edge - py
                for k in range(
                    first_index(pz - reach[2], origin[2], edge), last_index(pz + reach[2], origin[2], edge, nz) + 1
                ):
                    if values[i, j, k] <= shrink:
                        continue
                    z = origin[2] + k * edge - pz
                    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
                    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
                    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
                    distance = link_distance(u, v, w, kind, size) + shrink
                    if distance < values[i, j, k]:
                        values[i, j, k] = distance
                        owners[i, j, k] = (first + row) * kinds + which
