"""Nearest places of grid points (kernel, private)."""

from __future__ import annotations

from lwrprobe.compiled import kernel


@kernel
def lower_to_nearest(square, owner, origin, edge, places, weights, first):
    """Lower squared distances (nx, ny, nz) of grid points to those from `places` (n, 3) where these are nearer.

    `weights` (n, 3) are those of a squared difference in x or y, of one upwards, and of one downwards from each place.
    `owner` becomes the number of the place, counted from `first`. Grid points lie at origin + edge * (i, j, k).
    """
    nx, ny, nz = square.shape
    count = places.shape[0]
    for i in range(nx):
        x = origin[0] + i * edge
        for j in range(ny):
            y = origin[1] + j * edge
            for k in range(nz):
                z = origin[2] + k * edge
                least = square[i, j, k]
                nearest = -1
                for row in range(count):
                    u, v, w = x - places[row, 0], y - places[row, 1], z - places[row, 2]
                    distance = weights[row, 0] * (u * u + v * v) + weights[row, 1 if w > 0.0 else 2] * w * w
                    if distance < least:
                        least = distance
                        nearest = row
                if nearest >= 0:
                    square[i, j, k] = least
                    owner[i, j, k] = first + nearest
