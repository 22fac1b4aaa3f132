"""Nearest places of grid points (kernel, private)."""

from __future__ import annotations

from lwrprobe.compiled import kernel

BLOCK = 32
"""Places in a row, which lie near one another: grid points far from all of them are passed over at once."""


@kernel
def lower_to_nearest(square, owner, origin, edge, places, weights, first):
    """Lower squared distances (nx, ny, nz) of grid points to those from `places` (n, 3) where these are nearer.

    `weights` (n, 3) are those of a squared difference in x or y, of one upwards, and of one downwards from each place.
    `owner` becomes the number of the place, counted from `first`. Grid points lie at origin + edge * (i, j, k).
    """
    nx, ny, nz = square.shape
    for begin in range(0, places.shape[0], BLOCK):
        end = min(begin + BLOCK, places.shape[0])
        low, high, least_weights = places[begin].copy(), places[begin].copy(), weights[begin].copy()
        for row in range(begin, end):
            for m in range(3):
                low[m], high[m] = min(low[m], places[row, m]), max(high[m], places[row, m])
                least_weights[m] = min(least_weights[m], weights[row, m])
        vertical = min(least_weights[1], least_weights[2])
        for i in range(nx):
            x = origin[0] + i * edge
            beside = max(low[0] - x, x - high[0], 0.0)
            for j in range(ny):
                y = origin[1] + j * edge
                aside = max(low[1] - y, y - high[1], 0.0)
                level = least_weights[0] * (beside * beside + aside * aside)
                for k in range(nz):
                    z = origin[2] + k * edge
                    off = max(low[2] - z, z - high[2], 0.0)
                    least = square[i, j, k]
                    if level + vertical * off * off > least:
                        continue
                    nearest = -1
                    for row in range(begin, end):
                        u, v, w = x - places[row, 0], y - places[row, 1], z - places[row, 2]
                        distance = weights[row, 0] * (u * u + v * v) + weights[row, 1 if w > 0.0 else 2] * w * w
                        if distance < least:
                            least = distance
                            nearest = row
                    if nearest >= 0:
                        square[i, j, k] = least
                        owner[i, j, k] = first + nearest
