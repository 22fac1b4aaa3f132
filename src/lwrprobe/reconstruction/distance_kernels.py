"""Distance to a triangle mesh, near it: nearest vertex by scattering, then the triangles around that vertex."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lwrprobe.compiled import kernel


class Mesh(NamedTuple):
    """Triangles, and `corner_lists` of them."""

    vertices: np.ndarray  # (n, 3) m
    faces: np.ndarray  # (m, 3)
    starts: np.ndarray  # (n + 1,)
    members: np.ndarray  # (3 m,)


class Nodes(NamedTuple):
    """A grid of nodes near a mesh."""

    nearest: np.ndarray  # (i, j, k) vertex nearest to each node, -1 where none is near
    origin: np.ndarray  # (3,) m
    step: float  # m


@kernel
def scatter(vertices, origin, step, radius, distance, nearest):
    """Nearest vertex of each grid node within `radius`: squared distance and number, where it is nearer than before."""
    shape = distance.shape
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for v in range(vertices.shape[0]):
        for m in range(3):
            first[m] = max(0, int(np.ceil((vertices[v, m] - radius - origin[m]) / step)))
            last[m] = min(shape[m], int(np.floor((vertices[v, m] + radius - origin[m]) / step)) + 1)
        for i in range(first[0], last[0]):
            dx = origin[0] + step * i - vertices[v, 0]
            for j in range(first[1], last[1]):
                dy = origin[1] + step * j - vertices[v, 1]
                flat = dx * dx + dy * dy
                if flat > radius * radius:
                    continue
                for k in range(first[2], last[2]):
                    dz = origin[2] + step * k - vertices[v, 2]
                    square = flat + dz * dz
                    if square < distance[i, j, k]:
                        distance[i, j, k] = square
                        nearest[i, j, k] = v


@kernel
def corner_lists(faces, starts, members):
    """Faces around each vertex: members[starts[v]:starts[v + 1]]; starts (n + 1,) comes in zeroed."""
    for f in range(faces.shape[0]):
        for m in range(3):
            starts[faces[f, m] + 1] += 1
    for v in range(starts.shape[0] - 1):
        starts[v + 1] += starts[v]
    filled = starts[:-1].copy()
    for f in range(faces.shape[0]):
        for m in range(3):
            v = faces[f, m]
            members[filled[v]] = f
            filled[v] += 1


@kernel
def foot_around(mesh, v, place, foot):
    """Nearest point `foot` (3,) to `place` (3,) on the triangles around vertex v; returns the squared distance."""
    vertices, faces, starts, members = mesh
    best = np.inf
    for c in range(starts[v], starts[v + 1]):
        f = members[c]
        x, y, z = foot_on_triangle(vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]], place)
        square = (x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2
        if square < best:
            best = square
            foot[0], foot[1], foot[2] = x, y, z
    return best


@kernel
def foot_on_triangle(a, b, c, p):
    """Nearest point of triangle abc to p (Ericson, Real-Time Collision Detection, 2005, section 5.1.5)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2]
    bpx, bpy, bpz = p[0] - b[0], p[1] - b[1], p[2] - b[2]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2]
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 - d3 > 0.0:
        t = d1 / (d1 - d3)
        return a[0] + t * abx, a[1] + t * aby, a[2] + t * abz
    cpx, cpy, cpz = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2]
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 - d6 > 0.0:
        t = d2 / (d2 - d6)
        return a[0] + t * acx, a[1] + t * acy, a[2] + t * acz
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0 and (d4 - d3) + (d5 - d6) > 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return b[0] + t * (c[0] - b[0]), b[1] + t * (c[1] - b[1]), b[2] + t * (c[2] - b[2])
    total = va + vb + vc
    if total <= 0.0:
        return a[0], a[1], a[2]
    v, w = vb / total, vc / total
    return a[0] + v * abx + w * acx, a[1] + v * aby + w * acy, a[2] + v * abz + w * acz


@kernel
def erode(mesh, nodes, radius, band, outer, out):
    """Signed distance to the surface `radius` below the mesh, at grid nodes, into `out`; negative inside.

    `outer` is negative inside the mesh. Beyond `band` from the eroded surface the value is cut to -band or, outside
    the mesh, to the distance plus radius at most `band`.
    """
    nearest, origin, step = nodes
    nx, ny, nz = out.shape
    place, foot = np.empty(3), np.empty(3)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                inside = outer[i, j, k] < 0.0
                v = nearest[i, j, k]
                if v < 0 or not inside:
                    out[i, j, k] = -band if inside else band
                    continue
                place[0], place[1], place[2] = origin[0] + step * i, origin[1] + step * j, origin[2] + step * k
                distance = np.sqrt(foot_around(mesh, v, place, foot))
                out[i, j, k] = min(max(radius - distance, -band), band)


@kernel
def eroded_crossings(mesh, nodes, radius, floor, values, edges, positions, normals):
    """Where edges cross the eroded surface or the floor plane: positions and unit normals (m, 3), in grid units.

    `floor` is -inf where there is none.
    """
    nearest, origin, step = nodes
    place, foot, other = np.empty(3), np.empty(3), np.empty(3)
    for e in range(edges.shape[0]):
        i, j, k, axis = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        oi, oj, ok = i + (axis == 0), j + (axis == 1), k + (axis == 2)
        first, last = nearest[i, j, k], nearest[oi, oj, ok]
        t = values[i, j, k] / (values[i, j, k] - values[oi, oj, ok])
        level = (floor - origin[2]) / step
        on_floor = axis == 2 and values[i, j, k] >= 0.0 and k <= level <= ok
        if on_floor or (first < 0 and last < 0):
            positions[e, 0], positions[e, 1], positions[e, 2] = i + t * (oi - i), j + t * (oj - j), k + t * (ok - k)
            if on_floor:
                positions[e, 2] = level
            for m in range(3):
                normals[e, m] = 0.0
            normals[e, axis] = 1.0 if values[i, j, k] < 0.0 else -1.0
            continue
        low, high = 0.0, 1.0
        f_low, f_high = values[i, j, k], values[oi, oj, ok]
        for _ in range(3):
            t = low + (high - low) * f_low / (f_low - f_high)
            place[0] = origin[0] + step * (i + t * (oi - i))
            place[1] = origin[1] + step * (j + t * (oj - j))
            place[2] = origin[2] + step * (k + t * (ok - k))
            square = np.inf
            if first >= 0:
                square = foot_around(mesh, first, place, foot)
            if last >= 0 and last != first:
                second = foot_around(mesh, last, place, other)
                if second < square:
                    square = second
                    foot[0], foot[1], foot[2] = other[0], other[1], other[2]
            value = radius - np.sqrt(square)
            if abs(value) < 1e-4 * step:
                break
            if (value < 0.0) == (f_low < 0.0):
                low, f_low = t, value
            else:
                high, f_high = t, value
        length = max(np.sqrt(square), 1e-300)
        positions[e, 0], positions[e, 1], positions[e, 2] = i + t * (oi - i), j + t * (oj - j), k + t * (ok - k)
        for m in range(3):
            normals[e, m] = (foot[m] - place[m]) / length


@kernel
def feet_of(places, mesh, near, out):
    """Nearest points on the mesh of places (n, 3), searched around the vertices `near` (n,), into `out` (n, 3)."""
    for p in range(places.shape[0]):
        foot_around(mesh, near[p], places[p], out[p])


@kernel
def crowding(vertices, faces, feet, out):
    """For each vertex the least ratio, over its edges, of the distance between the ends' feet to the edge's length."""
    for f in range(faces.shape[0]):
        for m in range(3):
            a, b = faces[f, m], faces[f, (m + 1) % 3]
            apart, length = 0.0, 0.0
            for q in range(3):
                apart += (feet[a, q] - feet[b, q]) ** 2
                length += (vertices[a, q] - vertices[b, q]) ** 2
            if length > 0.0:
                ratio = np.sqrt(apart / length)
                out[a] = min(out[a], ratio)
                out[b] = min(out[b], ratio)
