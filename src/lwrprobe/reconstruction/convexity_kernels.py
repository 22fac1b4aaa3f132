"""Kernels of what lies beyond tangent planes: points (k, 3) m, unit normals (k, 3), and their errors (k,) rad."""

import numpy as np

from lwrprobe.compiled import kernel

AGREE = 3
"""Planes of which a node has to lie beyond, before it counts: single ones may be wrong."""


@kernel
def beyond(places, points, normals, angle, sd, least):
    """(k,) how many of the places (n, 3) lie beyond each plane, by more than `least` m and `sd` times what its normal's
    error explains at their distance."""
    count = np.zeros(len(points), dtype=np.int64)
    for i in range(len(points)):
        for j in range(len(places)):
            x, y, z = places[j, 0] - points[i, 0], places[j, 1] - points[i, 1], places[j, 2] - points[i, 2]
            above = x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2] - least
            if above > 0.0 and above * above > (sd * angle[i]) ** 2 * (x * x + y * y + z * z):
                count[i] += 1
    return count


@kernel
def beyond_planes(origin, step, values, points, normals, angle, noise, out):
    """out (nx, ny, nz) = m, how far nodes with values <= 0 lie beyond `AGREE` planes at least, less what the normals'
    errors explain at their distance."""
    best = np.empty(AGREE)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                if values[i, j, k] > 0.0:
                    continue
                best[:] = -np.inf
                for p in range(len(points)):
                    x = origin[0] + step * i - points[p, 0]
                    y = origin[1] + step * j - points[p, 1]
                    z = origin[2] + step * k - points[p, 2]
                    above = x * normals[p, 0] + y * normals[p, 1] + z * normals[p, 2] - noise
                    if above <= best[AGREE - 1]:
                        continue
                    above -= angle[p] * np.sqrt(x * x + y * y + z * z)
                    q = AGREE - 1
                    if above > best[q]:
                        while q > 0 and best[q - 1] < above:
                            best[q] = best[q - 1]
                            q -= 1
                        best[q] = above
                out[i, j, k] = best[AGREE - 1]
