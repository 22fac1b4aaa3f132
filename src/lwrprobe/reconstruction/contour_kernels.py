"""From a sampled field to a closed mesh: dual contouring (Ju, Losasso, Schaefer, Warren 2002).

One vertex a cell that the surface crosses, one quad an edge that it crosses. The vertex is where the tangent planes
of the cell's crossings meet, which keeps sharp edges. The mesh is a closed manifold when the grid's border is
outside and the inside is well-composed (Latecki, Eckhardt, Rosenfeld 1995): no two of its voxels touch in an edge
or a corner alone.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel


@kernel
def compose(values, tiny):
    """One pass that makes the inside (values < 0) well-composed by adding nodes to it; how many were added."""
    nx, ny, nz = values.shape
    added = 0
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                for axis in range(3):
                    added += _mend_face(values, i, j, k, axis, tiny)
                added += _mend_corner(values, i, j, k, tiny)
    return added


@kernel
def _mend_face(values, i, j, k, axis, tiny):
    ai, aj, ak = (0, 1, 0) if axis == 0 else (1, 0, 0)
    bi, bj, bk = (0, 1, 0) if axis == 2 else (0, 0, 1)
    near, far = values[i, j, k] < 0.0, values[i + ai + bi, j + aj + bj, k + ak + bk] < 0.0
    one, two = values[i + ai, j + aj, k + ak] < 0.0, values[i + bi, j + bj, k + bk] < 0.0
    if near != far or one != two or near == one:
        return 0
    if near:
        if values[i + ai, j + aj, k + ak] < values[i + bi, j + bj, k + bk]:
            values[i + ai, j + aj, k + ak] = -tiny
        else:
            values[i + bi, j + bj, k + bk] = -tiny
    elif values[i, j, k] < values[i + ai + bi, j + aj + bj, k + ak + bk]:
        values[i, j, k] = -tiny
    else:
        values[i + ai + bi, j + aj + bj, k + ak + bk] = -tiny
    return 1


@kernel
def _mend_corner(values, i, j, k, tiny):
    inside = 0
    for di in range(2):
        for dj in range(2):
            for dk in range(2):
                if values[i + di, j + dj, k + dk] < 0.0:
                    inside += 1
    if inside != 2 and inside != 6:
        return 0
    for dj in range(2):
        for dk in range(2):
            this, that = values[i, j + dj, k + dk] < 0.0, values[i + 1, j + 1 - dj, k + 1 - dk] < 0.0
            if this and that and inside == 2:
                values[i + 1, j + dj, k + dk] = -tiny
                return 1
            if not this and not that and inside == 6:
                values[i, j + dj, k + dk] = -tiny
                return 1
    return 0


@kernel
def crossings(values, lookup, edges):
    """Number the grid edges whose ends differ in sign: edges (m, 4) as (i, j, k, axis), lookup (nx, ny, nz, 3).

    With `edges` too short only counts. `lookup` is -1 elsewhere.
    """
    nx, ny, nz = values.shape
    found = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                here = values[i, j, k] < 0.0
                for axis in range(3):
                    oi, oj, ok = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    if oi < nx and oj < ny and ok < nz and here != (values[oi, oj, ok] < 0.0):
                        if found < edges.shape[0]:
                            edges[found, 0], edges[found, 1], edges[found, 2], edges[found, 3] = i, j, k, axis
                            lookup[i, j, k, axis] = found
                        found += 1
    return found


@kernel
def interpolate(values, edges, positions, normals):
    """Crossing positions in units of the grid, and unit normals from central differences of the values."""
    gradient = np.empty(3)
    for e in range(edges.shape[0]):
        i, j, k, axis = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        oi, oj, ok = i + (axis == 0), j + (axis == 1), k + (axis == 2)
        t = values[i, j, k] / (values[i, j, k] - values[oi, oj, ok])
        positions[e, 0], positions[e, 1], positions[e, 2] = i + t * (oi - i), j + t * (oj - j), k + t * (ok - k)
        square = 0.0
        for m in range(3):
            gradient[m] = (1.0 - t) * _slope(values, i, j, k, m) + t * _slope(values, oi, oj, ok, m)
            square += gradient[m] * gradient[m]
        for m in range(3):
            normals[e, m] = gradient[m] / np.sqrt(max(square, 1e-300))


@kernel
def _slope(values, i, j, k, axis):
    at = (i, j, k)[axis]
    low, high = max(at - 1, 0), min(at + 1, values.shape[axis] - 1)
    if axis == 0:
        rise = values[high, j, k] - values[low, j, k]
    elif axis == 1:
        rise = values[i, high, k] - values[i, low, k]
    else:
        rise = values[i, j, high] - values[i, j, low]
    return rise / (high - low)


@kernel
def place(lookup, positions, normals, sharpness, owner, vertices):
    """One vertex for each cell with crossings, in units of the grid; owner (nx-1, ny-1, nz-1) takes its number.

    The vertex minimises the squared distances to the tangent planes; directions whose eigenvalue is below
    `sharpness` of the largest are taken from the crossings' mean. With `vertices` too short only counts.
    """
    nx, ny, nz = owner.shape
    found = 0
    local, facing = np.empty((12, 3)), np.empty((12, 3))
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                owner[i, j, k] = -1
                count = 0
                for axis in range(3):
                    for side in range(4):
                        one, two = side & 1, side >> 1
                        ei = i + (0 if axis == 0 else one)
                        ej = j + (one if axis == 0 else (0 if axis == 1 else two))
                        ek = k + (0 if axis == 2 else two)
                        e = lookup[ei, ej, ek, axis]
                        if e >= 0:
                            for m in range(3):
                                local[count, m], facing[count, m] = positions[e, m], normals[e, m]
                            count += 1
                if count == 0:
                    continue
                if found < vertices.shape[0]:
                    owner[i, j, k] = found
                    _meet(local[:count], facing[:count], sharpness, vertices[found])
                    vertices[found, 0] = min(max(vertices[found, 0], i), i + 1)
                    vertices[found, 1] = min(max(vertices[found, 1], j), j + 1)
                    vertices[found, 2] = min(max(vertices[found, 2], k), k + 1)
                found += 1
    return found


@kernel
def _meet(points, normals, sharpness, out):
    n = points.shape[0]
    matrix, right, vectors = np.zeros((3, 3)), np.zeros(3), np.eye(3)
    for m in range(3):
        out[m] = 0.0
        for p in range(n):
            out[m] += points[p, m] / n
    for p in range(n):
        height = 0.0
        for m in range(3):
            height += normals[p, m] * (points[p, m] - out[m])
        for m in range(3):
            right[m] += normals[p, m] * height
            for q in range(3):
                matrix[m, q] += normals[p, m] * normals[p, q]
    _diagonalise(matrix, vectors)
    largest = max(matrix[0, 0], matrix[1, 1], matrix[2, 2])
    for v in range(3):
        if matrix[v, v] > sharpness * largest:
            along = (vectors[0, v] * right[0] + vectors[1, v] * right[1] + vectors[2, v] * right[2]) / matrix[v, v]
            for m in range(3):
                out[m] += along * vectors[m, v]


@kernel
def _diagonalise(matrix, vectors):
    """Jacobi rotations of a symmetric (3, 3) matrix in place; eigenvectors in the columns of `vectors`."""
    for _ in range(12):
        if abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2]) < 1e-14:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0.0:
                    continue
                theta = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for m in range(3):
                    a, b = matrix[m, p], matrix[m, q]
                    matrix[m, p], matrix[m, q] = c * a - s * b, s * a + c * b
                for m in range(3):
                    a, b = matrix[p, m], matrix[q, m]
                    matrix[p, m], matrix[q, m] = c * a - s * b, s * a + c * b
                for m in range(3):
                    a, b = vectors[m, p], vectors[m, q]
                    vectors[m, p], vectors[m, q] = c * a - s * b, s * a + c * b


@kernel
def connect(values, edges, owner, vertices, faces):
    """Two triangles for each crossed edge, split along the flatter diagonal; (2m, 3), outward where values rise."""
    quad = np.empty(4, np.int64)
    for e in range(edges.shape[0]):
        i, j, k, axis = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        if axis == 0:
            quad[0], quad[1] = owner[i, j - 1, k - 1], owner[i, j, k - 1]
            quad[2], quad[3] = owner[i, j, k], owner[i, j - 1, k]
        elif axis == 1:
            quad[0], quad[1] = owner[i - 1, j, k - 1], owner[i - 1, j, k]
            quad[2], quad[3] = owner[i, j, k], owner[i, j, k - 1]
        else:
            quad[0], quad[1] = owner[i - 1, j - 1, k], owner[i, j - 1, k]
            quad[2], quad[3] = owner[i, j, k], owner[i - 1, j, k]
        if values[i, j, k] >= 0.0:
            quad[1], quad[3] = quad[3], quad[1]
        turn = 0 if _fold(vertices, quad, 0) >= _fold(vertices, quad, 1) else 1
        for t in range(2):
            faces[2 * e + t, 0] = quad[turn]
            faces[2 * e + t, 1] = quad[(turn + 1 + t) % 4]
            faces[2 * e + t, 2] = quad[(turn + 2 + t) % 4]


@kernel
def _fold(vertices, quad, turn):
    """Cosine between the two triangles that a quad falls into when it is split from corner `turn`."""
    product, first, second = 0.0, 0.0, 0.0
    a, b, c, d = quad[turn], quad[(turn + 1) % 4], quad[(turn + 2) % 4], quad[(turn + 3) % 4]
    for m in range(3):
        n, o = (m + 1) % 3, (m + 2) % 3
        one = (vertices[b, n] - vertices[a, n]) * (vertices[c, o] - vertices[a, o])
        one -= (vertices[b, o] - vertices[a, o]) * (vertices[c, n] - vertices[a, n])
        two = (vertices[c, n] - vertices[a, n]) * (vertices[d, o] - vertices[a, o])
        two -= (vertices[c, o] - vertices[a, o]) * (vertices[d, n] - vertices[a, n])
        product += one * two
        first += one * one
        second += two * two
    return product / np.sqrt(max(first * second, 1e-300))
