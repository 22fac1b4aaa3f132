"""Distance between two convex shapes, certified from both sides (kernels, private).

Gilbert, Johnson, Keerthi (1988): walk towards the point of the shapes' difference that is nearest to the origin. Each
support point bounds the distance from below, each simplex from above; the walk ends when both agree. A row of `simplex`
is a point of the first shape minus one of the second (3), then the point of the first (3). Row s of `work` holds the
cofactors of the subset of rows with the bits s; row 0, of no subset, the weights found.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.collision.shape_kernels import support
from lwrprobe.compiled import allocation_free_kernel

TOLERANCE = 1e-7  # m, between upper and lower bound
MAX_STEPS = 100


@allocation_free_kernel
def cofactor(simplex, work, count, rest, j):
    """Cofactor of row j in the subset `rest` with j added: the sum of delta_i y_i (y_k - y_j), k any row of `rest`."""
    k = 0
    while not (rest >> k) & 1:
        k += 1
    x, y, z = simplex[k, 0] - simplex[j, 0], simplex[k, 1] - simplex[j, 1], simplex[k, 2] - simplex[j, 2]
    total = 0.0
    for i in range(count):
        if (rest >> i) & 1:
            total += work[rest, i] * (simplex[i, 0] * x + simplex[i, 1] * y + simplex[i, 2] * z)
    return total


@allocation_free_kernel
def weigh(simplex, work, count):
    """Weights of the point nearest to the origin in the hull of `count` rows; its squared length.

    Johnson's subalgorithm: of all subsets that hold their own nearest point inside, the one that comes nearest.
    """
    best = np.inf
    for s in range(1, 1 << count):
        total, fits = 0.0, True
        for j in range(count):
            if (s >> j) & 1:
                rest = s & ~(1 << j)
                work[s, j] = 1.0 if rest == 0 else cofactor(simplex, work, count, rest, j)
                total += work[s, j]
                fits = fits and work[s, j] > 0.0
        if not fits:
            continue
        x, y, z = 0.0, 0.0, 0.0
        for j in range(count):
            if (s >> j) & 1:
                share = work[s, j] / total
                x += share * simplex[j, 0]
                y += share * simplex[j, 1]
                z += share * simplex[j, 2]
        length2 = x * x + y * y + z * z
        if s == 15 and length2 > TOLERANCE * TOLERANCE:
            continue  # a whole tetrahedron holds the origin; one that does not is too flat to decide
        if length2 < best:
            best = length2
            for j in range(4):
                work[0, j] = work[s, j] / total if (s >> j) & 1 else 0.0
    return best


@allocation_free_kernel
def core_distance(a, b, simplex, work, cutoff, pair):
    """Distance between the cores of shapes a and b, at most `TOLERANCE` too long; witness points (3), (3) to `pair`.

    Row 0 of `simplex` is where the walk starts: any two points of both. It ends early, with what it has, once the
    distance is known to be at least `cutoff`.
    """
    count = 1
    v0, v1, v2 = simplex[0, 0], simplex[0, 1], simplex[0, 2]
    p0, p1, p2 = simplex[0, 3], simplex[0, 4], simplex[0, 5]
    length2 = v0 * v0 + v1 * v1 + v2 * v2
    for _ in range(MAX_STEPS):
        length = np.sqrt(length2)
        if length <= TOLERANCE:
            break
        a0, a1, a2 = support(a, -v0, -v1, -v2)
        b0, b1, b2 = support(b, v0, v1, v2)
        d0, d1, d2 = a0 - b0, a1 - b1, a2 - b2
        lower = (v0 * d0 + v1 * d1 + v2 * d2) / length
        if lower >= cutoff or length - lower <= TOLERANCE:
            break
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = d0, d1, d2
        simplex[count, 3], simplex[count, 4], simplex[count, 5] = a0, a1, a2
        shorter = weigh(simplex, work, count + 1)
        if shorter >= length2:
            break  # only rounding is left: keep the older, shorter vector
        length2 = shorter
        v0, v1, v2, p0, p1, p2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        kept = 0
        for i in range(count + 1):
            w = work[0, i]
            if w > 0.0:
                for k in range(6):
                    simplex[kept, k] = simplex[i, k]
                v0 += w * simplex[kept, 0]
                v1 += w * simplex[kept, 1]
                v2 += w * simplex[kept, 2]
                p0 += w * simplex[kept, 3]
                p1 += w * simplex[kept, 4]
                p2 += w * simplex[kept, 5]
                kept += 1
        count = kept
    pair[0], pair[1], pair[2] = p0, p1, p2
    pair[3], pair[4], pair[5] = p0 - v0, p1 - v1, p2 - v2
    return np.sqrt(length2)
