"""Gaussian-process interpolation of a distance field from values and gradients (Hermite data).

Covariance: Matern 5/2, k(r) = (1 + a r + a^2 r^2 / 3) exp(-a r) with a = sqrt(5) / length, times the variance s2.
With A = k'(r) / r and B = (k''(r) - A) / r^2, and d = x - y,

    cov(f(x), f(y)) = k,   cov(f(x), df/dy_j) = -A d_j,   cov(df/dx_i, df/dy_j) = -A delta_ij - B d_i d_j.

Unknowns of n points are ordered value, d/dx, d/dy, d/dz, a block of n each. Symmetric matrices keep their upper
half, so that the inner loops of the factorisation run along rows.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel


@kernel
def radial(distance, length, s2):
    """k, A and B at one distance."""
    a = np.sqrt(5.0) / length
    ar = a * distance
    fall = s2 * np.exp(-ar)
    return fall * (1.0 + ar + ar * ar / 3.0), -fall * a * a / 3.0 * (1.0 + ar), fall * a**4 / 3.0


@kernel
def assemble(points, value_variance, gradient_variance, length, s2, out):
    """Upper half of the covariance (4n, 4n) of values and gradients at points (n, 3), noise on the diagonal."""
    n = points.shape[0]
    d = np.empty(3)
    for i in range(n):
        for j in range(i, n):
            for m in range(3):
                d[m] = points[i, m] - points[j, m]
            k, a, b = radial(np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), length, s2)
            out[i, j] = k
            for m in range(3):
                out[i, n * (m + 1) + j] = -a * d[m]
                out[j, n * (m + 1) + i] = a * d[m]
                for q in range(m, 3):
                    both = -b * d[m] * d[q]
                    if m == q:
                        both -= a
                    out[n * (m + 1) + i, n * (q + 1) + j] = both
                    out[n * (m + 1) + j, n * (q + 1) + i] = both
        out[i, i] += value_variance[i]
        for m in range(3):
            out[n * (m + 1) + i, n * (m + 1) + i] += gradient_variance[i]


@kernel
def factorise(matrix):
    """Cholesky factor U with U'U = matrix in the upper half, in place; False when it is not positive definite.

    Row by row, four earlier rows at a time, so that a row is loaded and stored a quarter as often.
    """
    n = matrix.shape[0]
    for i in range(n):
        k = 0
        while k + 4 <= i:
            a, b, c, d = matrix[k, i], matrix[k + 1, i], matrix[k + 2, i], matrix[k + 3, i]
            for j in range(i, n):
                matrix[i, j] -= a * matrix[k, j] + b * matrix[k + 1, j] + c * matrix[k + 2, j] + d * matrix[k + 3, j]
            k += 4
        while k < i:
            a = matrix[k, i]
            for j in range(i, n):
                matrix[i, j] -= a * matrix[k, j]
            k += 1
        if not matrix[i, i] > 0.0:
            return False
        scale = 1.0 / np.sqrt(matrix[i, i])
        for j in range(i, n):
            matrix[i, j] *= scale
    return True


@kernel
def solve_lower(factor, vector):
    """U' y = vector, in place."""
    n = factor.shape[0]
    for k in range(n):
        vector[k] /= factor[k, k]
        value = vector[k]
        for j in range(k + 1, n):
            vector[j] -= factor[k, j] * value


@kernel
def solve_upper(factor, vector):
    """U x = vector, in place."""
    for k in range(factor.shape[0] - 1, -1, -1):
        value = vector[k]
        for j in range(k + 1, factor.shape[0]):
            value -= factor[k, j] * vector[j]
        vector[k] = value / factor[k, k]


@kernel
def fit(points, normals, value_variance, gradient_variance, length, s2, factor, weights):
    """Factor (4n, 4n) and weights (4n,) of the process with zero value and the normals as gradient at points (n, 3)."""
    n = points.shape[0]
    assemble(points, value_variance, gradient_variance, length, s2, factor)
    if not factorise(factor):
        return False
    for i in range(n):
        weights[i] = 0.0
        for m in range(3):
            weights[n * (m + 1) + i] = normals[i, m]
    solve_lower(factor, weights)
    solve_upper(factor, weights)
    return True


@kernel
def value_at(points, weights, length, s2, x, y, z):
    """Interpolated value at one place, from weights (4n,)."""
    n = points.shape[0]
    total = 0.0
    for i in range(n):
        dx, dy, dz = x - points[i, 0], y - points[i, 1], z - points[i, 2]
        k, a, _ = radial(np.sqrt(dx * dx + dy * dy + dz * dz), length, s2)
        slope = dx * weights[n + i] + dy * weights[2 * n + i] + dz * weights[3 * n + i]
        total += k * weights[i] - a * slope
    return total


@kernel
def deviations(points, value_variance, gradient_variance, near, length, s2, places, out):
    """Standard deviation of the interpolated value at places (m, 3) into out (m,).

    Each place has its own process over the data in its row of `near` (m, k), which ends at the first number beyond
    the data. False when a covariance is not positive definite.
    """
    most, total = near.shape[1], points.shape[0]
    local, values, slopes = np.empty((most, 3)), np.empty(most), np.empty(most)
    for p in range(places.shape[0]):
        n = 0
        while n < most and near[p, n] < total:
            i = near[p, n]
            for m in range(3):
                local[n, m] = points[i, m]
            values[n], slopes[n] = value_variance[i], gradient_variance[i]
            n += 1
        factor, column = np.empty((4 * n, 4 * n)), np.empty(4 * n)
        assemble(local[:n], values[:n], slopes[:n], length, s2, factor)
        if not factorise(factor):
            return False
        for i in range(n):
            dx, dy, dz = places[p, 0] - local[i, 0], places[p, 1] - local[i, 1], places[p, 2] - local[i, 2]
            k, a, _ = radial(np.sqrt(dx * dx + dy * dy + dz * dz), length, s2)
            column[i] = k
            column[n + i], column[2 * n + i], column[3 * n + i] = -a * dx, -a * dy, -a * dz
        solve_lower(factor, column)
        explained = 0.0
        for i in range(4 * n):
            explained += column[i] * column[i]
        out[p] = np.sqrt(max(s2 - explained, 0.0))
    return True


@kernel
def hat(distance, half, overlap):
    """Partition weight along one axis: 1 in the cube's core, falling smoothly to 0 at `half` + `overlap`."""
    t = min(max((half + overlap - abs(distance)) / (2.0 * overlap), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def add_block(points, weights, scales, centre, origin, step, wanted, total, share):
    """Add one block's weighted values to the nodes in its reach.

    scales = (length, s2, half, overlap); `wanted` (nx, ny, nz) marks the nodes to evaluate; `total` and `share` of
    the same shape collect the weighted values and the weights.
    """
    length, s2, half, overlap = scales[0], scales[1], scales[2], scales[3]
    reach = half + overlap
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for m in range(3):
        first[m] = max(0, int(np.ceil((centre[m] - reach - origin[m]) / step)))
        last[m] = min(wanted.shape[m], int(np.floor((centre[m] + reach - origin[m]) / step)) + 1)
    for i in range(first[0], last[0]):
        x = origin[0] + step * i
        along_x = hat(x - centre[0], half, overlap)
        for j in range(first[1], last[1]):
            y = origin[1] + step * j
            along_xy = along_x * hat(y - centre[1], half, overlap)
            for k in range(first[2], last[2]):
                if not wanted[i, j, k]:
                    continue
                z = origin[2] + step * k
                weight = along_xy * hat(z - centre[2], half, overlap)
                if weight > 0.0:
                    total[i, j, k] += weight * value_at(points, weights, length, s2, x, y, z)
                    share[i, j, k] += weight
