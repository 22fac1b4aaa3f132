"""Closed triangle meshes: signed distance through a tree of boxes, and the local minima of the distance.

The sign comes from the normal of the nearest face, edge or corner, the latter two weighted by angle (Baerentzen and
Aanaes, IEEE TVCG 11(3), 2005).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.scene.program import (
    MESH_CORNERS,
    MESH_EDGE_NORMALS,
    MESH_FACE_NORMALS,
    MESH_FACES,
    MESH_INDICES,
    MESH_NEIGHBOURS,
    MESH_NODE_BOXES,
    MESH_NODES,
    MESH_PART,
    MESH_RING_STARTS,
    MESH_RINGS,
    MESH_VERTEX_NORMALS,
    MESHES,
)

_STACK_SIZE = 64  # nodes of a tree on the path
_SAME_DIRECTION = 0.966  # cosine of 15 degrees: facets of one smooth hollow count as one contact


@kernel
def mesh_offset(indices, m, field):
    """Where a mesh's data begin, in numbers or in indices."""
    return indices[indices[MESHES + 2] + MESH_INDICES * m + field]


@kernel
def mesh_part(indices, m):
    return mesh_offset(indices, m, MESH_PART)


@kernel
def mesh_nearest(numbers, indices, m, x, y, z):
    """Signed distance, nearest point and unit normal out of mesh m."""
    square, bx, by, bz, face, feature = _nearest_triangle(numbers, indices, m, x, y, z)
    nx, ny, nz = _feature_normal(numbers, indices, m, face, feature)
    distance = np.sqrt(square)
    sign = 1.0 if (x - bx) * nx + (y - by) * ny + (z - bz) * nz >= 0.0 else -1.0
    if distance > 1e-9:
        return (
            sign * distance, bx, by, bz,
            sign * (x - bx) / distance, sign * (y - by) / distance, sign * (z - bz) / distance,
        )  # fmt: skip
    length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-30)
    return sign * distance, bx, by, bz, nx / length, ny / length, nz / length


@kernel
def mesh_gaps(numbers, indices, points, out):
    """Distances of points (n, 3) from the triangles of mesh 0, without sign, into out (n,)."""
    for n in range(points.shape[0]):
        out[n] = np.sqrt(_nearest_triangle(numbers, indices, 0, points[n, 0], points[n, 1], points[n, 2])[0])


@kernel
def column_crossings(vertices, faces, columns, heights, winding):
    """Winding numbers at columns (n, 2) of x, y and rising heights (n, m) of z, into winding (n, m).

    Each face that spans a column adds its turn to all heights below it.
    """
    winding[:] = 0.0
    order = np.argsort(columns[:, 0])
    ranked = columns[order, 0]
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
        vx, vy = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1]
        turn = ux * vy - uy * vx
        if turn == 0.0:
            continue
        left = min(vertices[a, 0], vertices[b, 0], vertices[c, 0])
        right = max(vertices[a, 0], vertices[b, 0], vertices[c, 0])
        bottom = min(vertices[a, 1], vertices[b, 1], vertices[c, 1])
        top = max(vertices[a, 1], vertices[b, 1], vertices[c, 1])
        for k in range(np.searchsorted(ranked, left), np.searchsorted(ranked, right, side="right")):
            n = order[k]
            if columns[n, 1] < bottom or columns[n, 1] > top:
                continue
            wx, wy = columns[n, 0] - vertices[a, 0], columns[n, 1] - vertices[a, 1]
            s, t = (wx * vy - wy * vx) / turn, (ux * wy - uy * wx) / turn
            if s < 0.0 or t < 0.0 or s + t > 1.0:
                continue
            z = vertices[a, 2] + s * (vertices[b, 2] - vertices[a, 2]) + t * (vertices[c, 2] - vertices[a, 2])
            step = 1.0 if turn > 0.0 else -1.0
            for h in range(np.searchsorted(heights[n], z)):
                winding[n, h] += step


@kernel
def _nearest_triangle(numbers, indices, m, x, y, z):
    """Squared distance, point, face and where on the face it lies (see `_triangle_point`)."""
    best, face, feature = np.inf, -1, 0
    bx, by, bz = np.nan, np.nan, np.nan
    boxes, nodes = mesh_offset(indices, m, MESH_NODE_BOXES), mesh_offset(indices, m, MESH_NODES)
    stack = np.empty(_STACK_SIZE, np.int64)
    gaps = np.empty(_STACK_SIZE)
    stack[0], gaps[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if gaps[top] >= best:
            continue
        first, count = indices[nodes + 2 * node], indices[nodes + 2 * node + 1]
        if count > 0:
            for t in range(first, first + count):
                px, py, pz, where = _triangle_point(numbers, indices, m, t, x, y, z)
                square = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
                if square < best:
                    best, face, feature, bx, by, bz = square, t, where, px, py, pz
            continue
        left, right = first, first + 1
        a, b = _box_gap(numbers, boxes + 6 * left, x, y, z), _box_gap(numbers, boxes + 6 * right, x, y, z)
        if a < b:  # the nearer one on top
            left, right, a, b = right, left, b, a
        for child, gap in ((left, a), (right, b)):
            if gap < best and top < _STACK_SIZE:
                stack[top], gaps[top] = child, gap
                top += 1
    return best, bx, by, bz, face, feature


class Contacts(NamedTuple):
    """Contacts of a sphere, m: how many there may be is the arrays' length."""

    points: np.ndarray  # (k, 3)
    normals: np.ndarray  # (k, 3), out of the solid
    parts: np.ndarray  # (k,), index of the object


@kernel
def mesh_contacts(numbers, indices, m, centre, radius, contacts, count):
    """Append the local minima of the distance from outside to mesh m below `radius`; returns the new count.

    Of minima whose normals differ by less than 15 degrees the nearest stays.
    """
    begin, (x, y, z) = count, centre
    boxes, nodes = mesh_offset(indices, m, MESH_NODE_BOXES), mesh_offset(indices, m, MESH_NODES)
    stack = np.empty(_STACK_SIZE, np.int64)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _box_gap(numbers, boxes + 6 * node, x, y, z) >= radius * radius:
            continue
        first, inside = indices[nodes + 2 * node], indices[nodes + 2 * node + 1]
        if inside == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for t in range(first, first + inside):
            px, py, pz, feature = _triangle_point(numbers, indices, m, t, x, y, z)
            dx, dy, dz = x - px, y - py, z - pz
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            if distance >= radius or distance < 1e-12:
                continue
            if _is_minimum(numbers, indices, m, t, feature, px, py, pz, x, y, z):
                normal = dx / distance, dy / distance, dz / distance
                count = _keep_nearest(centre, (px, py, pz), normal, mesh_part(indices, m), contacts, begin, count)
    return count


@kernel
def _keep_nearest(centre, point, normal, part, contacts, begin, count):
    """Append a contact, or put it in place of one from `begin` on with the same direction that is farther away."""
    (x, y, z), (px, py, pz), (nx, ny, nz) = centre, point, normal
    points, normals, parts = contacts
    place = count
    depth = -((x - px) * nx + (y - py) * ny + (z - pz) * nz)
    for n in range(begin, count):
        along = normals[n, 0] * nx + normals[n, 1] * ny + normals[n, 2] * nz
        if along > _SAME_DIRECTION:
            other = (x - points[n, 0]) * normals[n, 0] + (y - points[n, 1]) * normals[n, 1]
            if depth <= -(other + (z - points[n, 2]) * normals[n, 2]):
                return count
            place = n
            break
    if place >= parts.shape[0]:
        return count
    points[place, 0], points[place, 1], points[place, 2] = px, py, pz
    normals[place, 0], normals[place, 1], normals[place, 2] = nx, ny, nz
    parts[place] = part
    return max(count, place + 1)


@kernel
def _is_minimum(numbers, indices, m, t, feature, px, py, pz, x, y, z):
    """Whether the nearest point of triangle t is nearest on all triangles around that point, too, from outside."""
    nx, ny, nz = _feature_normal(numbers, indices, m, t, feature)
    if (x - px) * nx + (y - py) * ny + (z - pz) * nz <= 0.0:
        return False
    if feature == 0:
        return True
    if feature <= 3:
        other = indices[mesh_offset(indices, m, MESH_NEIGHBOURS) + 3 * t + feature - 1]
        return other > t and _same_foot(numbers, indices, m, other, px, py, pz, x, y, z)
    corner = indices[mesh_offset(indices, m, MESH_FACES) + 3 * t + feature - 4]
    starts, rings = mesh_offset(indices, m, MESH_RING_STARTS), mesh_offset(indices, m, MESH_RINGS)
    for n in range(indices[starts + corner], indices[starts + corner + 1]):
        other = indices[rings + n]
        if other < t or not _same_foot(numbers, indices, m, other, px, py, pz, x, y, z):
            return False
    return True


@kernel
def _same_foot(numbers, indices, m, t, px, py, pz, x, y, z):
    qx, qy, qz, _ = _triangle_point(numbers, indices, m, t, x, y, z)
    return abs(qx - px) + abs(qy - py) + abs(qz - pz) < 1e-10


@kernel
def _feature_normal(numbers, indices, m, t, feature):
    """Outward direction of a triangle (0), of its edge (1 to 3) or of its corner (4 to 6)."""
    if feature == 0:
        row = mesh_offset(indices, m, MESH_FACE_NORMALS) + 3 * t
    elif feature <= 3:
        row = mesh_offset(indices, m, MESH_EDGE_NORMALS) + 9 * t + 3 * (feature - 1)
    else:
        corner = indices[mesh_offset(indices, m, MESH_FACES) + 3 * t + feature - 4]
        row = mesh_offset(indices, m, MESH_VERTEX_NORMALS) + 3 * corner
    return numbers[row], numbers[row + 1], numbers[row + 2]


@kernel
def _box_gap(numbers, row, x, y, z):
    """Squared distance of a point from a box."""
    dx = max(numbers[row] - x, x - numbers[row + 3], 0.0)
    dy = max(numbers[row + 1] - y, y - numbers[row + 4], 0.0)
    dz = max(numbers[row + 2] - z, z - numbers[row + 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def _triangle_point(numbers, indices, m, t, x, y, z):
    """Nearest point of a triangle and where it lies: 0 inside, 1 to 3 on edge ab, bc, ca, 4 to 6 at a, b, c.

    Regions as in Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    faces, corners = mesh_offset(indices, m, MESH_FACES) + 3 * t, mesh_offset(indices, m, MESH_CORNERS)
    a, b, c = corners + 3 * indices[faces], corners + 3 * indices[faces + 1], corners + 3 * indices[faces + 2]
    ax, ay, az = numbers[a], numbers[a + 1], numbers[a + 2]
    ux, uy, uz = numbers[b] - ax, numbers[b + 1] - ay, numbers[b + 2] - az
    vx, vy, vz = numbers[c] - ax, numbers[c + 1] - ay, numbers[c + 2] - az
    d1 = ux * (x - ax) + uy * (y - ay) + uz * (z - az)
    d2 = vx * (x - ax) + vy * (y - ay) + vz * (z - az)
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, 4
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d3, d4 = d1 - uu, d2 - uv
    if d3 >= 0.0 and d4 <= d3:
        return ax + ux, ay + uy, az + uz, 5
    wc = d1 * d4 - d3 * d2
    if wc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
        return ax + s * ux, ay + s * uy, az + s * uz, 1
    d5, d6 = d1 - uv, d2 - vv
    if d6 >= 0.0 and d5 <= d6:
        return ax + vx, ay + vy, az + vz, 6
    wb = d5 * d2 - d1 * d6
    if wb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / (d2 - d6)
        return ax + s * vx, ay + s * vy, az + s * vz, 3
    wa = d3 * d6 - d5 * d4
    if wa <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return ax + ux + s * (vx - ux), ay + uy + s * (vy - uy), az + uz + s * (vz - uz), 2
    total = 1.0 / (wa + wb + wc)
    s, r = wb * total, wc * total
    return ax + s * ux + r * vx, ay + s * uy + r * vy, az + s * uz + r * vz, 0
