"""A path collected position by position, as long as it is straight (kernels, private).

Row 0 of a path holds the number of its places and the map's voxel edge, the rows below the places.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel

MAX_PLACES = 32
LONGEST = 8.0
"""Voxels: longer pieces would be carved in parts anyway."""
STRAIGHT = 0.005
"""Voxels, largest distance from the line: 10 um for voxels of 2 mm, a fifth of the arm's repeatability."""


@kernel
def extend(path, x, y, z):
    """Add a position, unless the path would no longer be one straight piece; returns whether it was added.

    A place where the sphere already is, is not added once there are two.
    """
    count, edge = np.int64(path[0, 0]), path[0, 1]
    if count >= 2:
        if abs(x - path[count, 0]) + abs(y - path[count, 1]) + abs(z - path[count, 2]) <= STRAIGHT * edge:
            return True
        if count == MAX_PLACES:
            return False
        dx, dy, dz = x - path[1, 0], y - path[1, 1], z - path[1, 2]
        length2 = dx * dx + dy * dy + dz * dz
        if not length2 <= (LONGEST * edge) ** 2:
            return False
        done = 0.0
        for i in range(2, count + 1):
            ux, uy, uz = path[i, 0] - path[1, 0], path[i, 1] - path[1, 1], path[i, 2] - path[1, 2]
            share = (ux * dx + uy * dy + uz * dz) / length2 if length2 > 0.0 else 0.0
            if not done <= share <= 1.0:
                return False  # it has reversed
            done = share
            off2 = (ux - share * dx) ** 2 + (uy - share * dy) ** 2 + (uz - share * dz) ** 2
            if off2 > (STRAIGHT * edge) ** 2:
                return False
    path[count + 1, 0], path[count + 1, 1], path[count + 1, 2] = x, y, z
    path[0, 0] = count + 1
    return True
