"""Exact nearest points of a solid, and the contacts of a sphere with it.

The boundary of a solid is made of faces (parts of smooth surfaces), edges and corners. Its nearest point to a point c
is the nearest among the feet of c on the surfaces, where they lie on the boundary, and on the edges. The contacts of a
sphere are all local minima of the distance: feet on faces, and points of convex edges and corners whose normal cone
holds the direction to c.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.scene.edge_kernels import edge_point
from lwrprobe.scene.mesh_kernels import Contacts, mesh_contacts, mesh_nearest, mesh_part
from lwrprobe.scene.program import (
    BALL_NUMBERS,
    BLEND,
    BOUNDS,
    CHAIN_INDICES,
    CHAIN_NUMBERS,
    CHAINS,
    INCIDENCE,
    MESHES,
    PLANE,
    SPHERE,
    SURFACE_NUMBERS,
    SURFACES,
    VERTEX_INDICES,
    VERTEX_NUMBERS,
    VERTICES,
)
from lwrprobe.scene.surface_kernels import (
    across,
    blend_nearest,
    blend_rows,
    contains,
    on_patch,
    surface_gradient,
    surface_kind,
    surface_nearest,
    surface_part,
    surface_value,
    tree_value,
)

_SKIN = 1e-8  # m, how far beside a point membership is asked
_SAME = 2e-6  # m, contacts closer than this are one: the edges of two faces that are all but flush
_TURNS = 8  # directions tried from a point on an axis


@kernel
def outside_bounds(numbers, indices, x, y, z):
    """Distance of a point from the box that holds the solid, 0 inside the box."""
    row = indices[BOUNDS + 1]
    square = 0.0
    for axis, value in enumerate((x, y, z)):
        gap = max(numbers[row + axis] - value, value - numbers[row + 3 + axis], 0.0)
        square += gap * gap
    return np.sqrt(square)


@kernel
def nearest(numbers, indices, x, y, z):
    """Signed distance (negative inside), nearest boundary point, outward normal there and object.

    (inf, nan, ...) for an empty solid.
    """
    inside = contains(numbers, indices, x, y, z)
    best, bx, by, bz, part = _nearest_face(numbers, indices, x, y, z)
    best, bx, by, bz, part = _nearest_edge(numbers, indices, (x, y, z), (best, bx, by, bz, part))
    sign = -1.0 if inside else 1.0
    nx, ny, nz = _away(numbers, indices, (x, y, z), (bx, by, bz), sign, best, part)
    best *= sign
    part = surface_part(numbers, part) if part >= 0 else -1
    for m in range(indices[MESHES]):
        distance, px, py, pz, mx, my, mz = mesh_nearest(numbers, indices, m, x, y, z)
        if distance < best:
            best, bx, by, bz, nx, ny, nz, part = distance, px, py, pz, mx, my, mz, mesh_part(indices, m)
    return best, bx, by, bz, nx, ny, nz, part


@kernel
def nearest_batch(numbers, indices, centres, distances, points, normals, parts):
    """`nearest` for centres (n, 3) into distances (n,), points (n, 3), normals (n, 3), parts (n,)."""
    for n in range(centres.shape[0]):
        d, px, py, pz, nx, ny, nz, part = nearest(numbers, indices, centres[n, 0], centres[n, 1], centres[n, 2])
        distances[n] = d
        points[n, 0], points[n, 1], points[n, 2] = px, py, pz
        normals[n, 0], normals[n, 1], normals[n, 2] = nx, ny, nz
        parts[n] = part


@kernel
def contains_batch(numbers, indices, points, out):
    """Membership of points (n, 3) into out (n,), 1 inside; meshes included."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        inside = contains(numbers, indices, x, y, z)
        for m in range(indices[MESHES]):
            inside = inside or mesh_nearest(numbers, indices, m, x, y, z)[0] < 0.0
        out[n] = 1 if inside else 0


@kernel
def sphere_contacts(numbers, indices, centre, radius, points, normals, parts):
    """Contacts of a sphere with the solid: all distinct local minima of the distance below `radius`.

    centre (3,); points (k, 3), normals (k, 3) out of the solid and parts (k,) (index of the object) are filled.
    With the centre inside, the nearest boundary point is the one contact. The depth of a contact is
    radius - (centre - point) . normal. Returns the count and a lower bound on the centre's distance from the solid,
    which holds wherever the sphere is: a caller may skip calls until it has moved by bound - radius.
    """
    x, y, z = centre[0], centre[1], centre[2]
    bound = outside_bounds(numbers, indices, x, y, z)
    if bound >= radius or parts.shape[0] == 0:
        return 0, bound
    value = tree_value(numbers, indices, x, y, z)
    lowest = value
    for m in range(indices[MESHES]):
        lowest = min(lowest, mesh_nearest(numbers, indices, m, x, y, z)[0])
    if lowest >= radius:
        return 0, lowest
    if lowest < 0.0:
        distance, px, py, pz, nx, ny, nz, part = nearest(numbers, indices, x, y, z)
        points[0, 0], points[0, 1], points[0, 2] = px, py, pz
        normals[0, 0], normals[0, 1], normals[0, 2] = nx, ny, nz
        parts[0] = part
        return 1, distance
    at, contacts, count = (x, y, z), Contacts(points, normals, parts), 0
    if value < radius:
        count = _face_contacts(numbers, indices, at, radius, contacts)
        count = _edge_contacts(numbers, indices, at, radius, contacts, count)
        count = _corner_contacts(numbers, indices, at, radius, contacts, count)
    for m in range(indices[MESHES]):
        count = mesh_contacts(numbers, indices, m, at, radius, contacts, count)
    if indices[MESHES] > 0:
        count = _drop_buried(numbers, indices, contacts, count)
    return count, lowest


@kernel
def _drop_buried(numbers, indices, contacts, count):
    """Keep the contacts that lie on the outside of the union of surfaces and meshes."""
    points, normals, parts = contacts
    kept = 0
    for n in range(count):
        x = points[n, 0] + _SKIN * normals[n, 0]
        y = points[n, 1] + _SKIN * normals[n, 1]
        z = points[n, 2] + _SKIN * normals[n, 2]
        buried = contains(numbers, indices, x, y, z)
        for m in range(indices[MESHES]):
            buried = buried or mesh_nearest(numbers, indices, m, x, y, z)[0] < 0.0
        if not buried:
            for i in range(3):
                points[kept, i], normals[kept, i] = points[n, i], normals[n, i]
            parts[kept] = parts[n]
            kept += 1
    return kept


@kernel
def _face_contacts(numbers, indices, centre, radius, contacts):
    count, (x, y, z) = 0, centre
    for k in range(indices[SURFACES]):
        value = surface_value(numbers, k, x, y, z)
        if abs(value) >= radius:
            continue
        px, py, pz, found = surface_nearest(numbers, k, x, y, z)
        if not found:
            continue
        part = surface_part(numbers, k)
        gx, gy, gz = _unit_gradient(numbers, k, px, py, pz)
        side = 1.0 if value >= 0.0 else -1.0
        nx, ny, nz = side * gx, side * gy, side * gz
        if _faces(numbers, indices, k, px, py, pz, nx, ny, nz):
            count = _add(centre, (px, py, pz), (nx, ny, nz), radius, part, contacts, count)
        elif _on_axis(numbers, k, x, y, z):
            for turn in range(1, _TURNS):
                px, py, pz, gx, gy, gz = _turned(numbers, k, x, y, z, turn)
                if _faces(numbers, indices, k, px, py, pz, -gx, -gy, -gz):
                    count = _add(centre, (px, py, pz), (-gx, -gy, -gz), radius, part, contacts, count)
                    break
    return count


@kernel
def _edge_contacts(numbers, indices, centre, radius, contacts, count):
    x, y, z = centre
    for chain in range(indices[CHAINS]):
        row = indices[CHAINS + 2] + CHAIN_INDICES * chain
        if indices[row + 6] == 0 or chain_bound(numbers, indices, chain, x, y, z) >= radius:
            continue
        i, j, kind = indices[row + 2], indices[row + 3], indices[row + 7]
        for e in range(indices[row], indices[row + 1]):
            px, py, pz, between = edge_point(numbers, indices, e, kind, i, j, x, y, z)
            if not between:
                continue
            dx, dy, dz = x - px, y - py, z - pz
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            if distance >= radius or distance < 1e-12:
                continue
            dx, dy, dz = dx / distance, dy / distance, dz / distance
            part = surface_part(numbers, i)
            if _in_cone(numbers, (i, j), (indices[row + 4], indices[row + 5]), (px, py, pz), (dx, dy, dz)):
                count = _add(centre, (px, py, pz), (dx, dy, dz), radius, part, contacts, count)
    return count


@kernel
def _corner_contacts(numbers, indices, centre, radius, contacts, count):
    x, y, z = centre
    for v in range(indices[VERTICES]):
        row = indices[VERTICES + 1] + VERTEX_NUMBERS * v
        px, py, pz = numbers[row], numbers[row + 1], numbers[row + 2]
        dx, dy, dz = x - px, y - py, z - pz
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        if distance >= radius or distance < 1e-12:
            continue
        dx, dy, dz = dx / distance, dy / distance, dz / distance
        if _corner_faces(numbers, indices, v, (px, py, pz), (dx, dy, dz)):
            first = indices[indices[VERTICES + 2] + VERTEX_INDICES * v]
            part = surface_part(numbers, indices[indices[INCIDENCE + 2] + first])
            count = _add(centre, (px, py, pz), (dx, dy, dz), radius, part, contacts, count)
    return count


@kernel
def _add(centre, point, normal, radius, part, contacts, count):
    """Append a contact unless it is too far, already there, or the arrays are full."""
    (x, y, z), (px, py, pz), (nx, ny, nz) = centre, point, normal
    points, normals, parts = contacts
    if (x - px) * nx + (y - py) * ny + (z - pz) * nz >= radius or count >= parts.shape[0]:
        return count
    for n in range(count):
        gap = abs(points[n, 0] - px) + abs(points[n, 1] - py) + abs(points[n, 2] - pz)
        if gap < _SAME:
            return count
    points[count, 0], points[count, 1], points[count, 2] = px, py, pz
    normals[count, 0], normals[count, 1], normals[count, 2] = nx, ny, nz
    parts[count] = part
    return count + 1


@kernel
def _nearest_face(numbers, indices, x, y, z):
    """Distance, point and surface of the nearest foot on a face; (inf, nan, nan, nan, -1) without one."""
    best, bx, by, bz, part = np.inf, np.nan, np.nan, np.nan, -1
    for k in range(indices[SURFACES]):
        if abs(surface_value(numbers, k, x, y, z)) >= best:
            continue
        if surface_kind(numbers, k) == BLEND:
            best, bx, by, bz, part = _nearest_on_blend(numbers, indices, k, (x, y, z), (best, bx, by, bz, part))
            continue
        px, py, pz, _ = surface_nearest(numbers, k, x, y, z)
        gx, gy, gz = _unit_gradient(numbers, k, px, py, pz)
        on = _bounds(numbers, indices, k, px, py, pz, gx, gy, gz)
        if not on and _on_axis(numbers, k, x, y, z):
            for turn in range(1, _TURNS):
                px, py, pz, gx, gy, gz = _turned(numbers, k, x, y, z, turn)
                on = _bounds(numbers, indices, k, px, py, pz, gx, gy, gz)
                if on:
                    break
        distance = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
        if on and distance < best:
            best, bx, by, bz, part = distance, px, py, pz, k
    return best, bx, by, bz, part


@kernel
def _nearest_on_blend(numbers, indices, k, place, found_before):
    """As `_nearest_face`: the search starts from the point itself and from its feet on all balls."""
    (x, y, z), (best, bx, by, bz, part) = place, found_before
    first, last = blend_rows(numbers, k)
    swell = numbers[SURFACE_NUMBERS * k + 6] * np.log((last - first) / BALL_NUMBERS)
    for row in range(first - BALL_NUMBERS, last, BALL_NUMBERS):
        sx, sy, sz = x, y, z
        if row >= first:
            dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            if abs(length - numbers[row + 3]) - swell >= best:  # no part of the surface near this ball is nearer
                continue
            scale = numbers[row + 3] / max(length, 1e-12)
            sx, sy, sz = numbers[row] + scale * dx, numbers[row + 1] + scale * dy, numbers[row + 2] + scale * dz
        px, py, pz, found = blend_nearest(numbers, k, x, y, z, sx, sy, sz)
        distance = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
        if found and distance < best:
            gx, gy, gz = _unit_gradient(numbers, k, px, py, pz)
            if _bounds(numbers, indices, k, px, py, pz, gx, gy, gz):
                best, bx, by, bz, part = distance, px, py, pz, k
    return best, bx, by, bz, part


@kernel
def _nearest_edge(numbers, indices, place, found_before):
    (x, y, z), (best, bx, by, bz, part) = place, found_before
    for chain in range(indices[CHAINS]):
        if chain_bound(numbers, indices, chain, x, y, z) >= best:
            continue
        row = indices[CHAINS + 2] + CHAIN_INDICES * chain
        i, j, kind = indices[row + 2], indices[row + 3], indices[row + 7]
        for e in range(indices[row], indices[row + 1]):
            px, py, pz, _ = edge_point(numbers, indices, e, kind, i, j, x, y, z)
            distance = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
            if distance < best:
                best, bx, by, bz, part = distance, px, py, pz, i
    return best, bx, by, bz, part


@kernel
def chain_bound(numbers, indices, chain, x, y, z):
    row = indices[CHAINS + 1] + CHAIN_NUMBERS * chain
    dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz) - numbers[row + 3]


@kernel
def _bounds(numbers, indices, k, px, py, pz, gx, gy, gz):
    """Whether the solid begins or ends where direction g passes through point p of surface k."""
    if not on_patch(numbers, k, px, py, pz, _SKIN):
        return False
    above = contains(numbers, indices, px + _SKIN * gx, py + _SKIN * gy, pz + _SKIN * gz)
    return above != contains(numbers, indices, px - _SKIN * gx, py - _SKIN * gy, pz - _SKIN * gz)


@kernel
def _faces(numbers, indices, k, px, py, pz, nx, ny, nz):
    """Whether point p of surface k is on the boundary with n pointing out."""
    if not on_patch(numbers, k, px, py, pz, _SKIN):
        return False
    if contains(numbers, indices, px + _SKIN * nx, py + _SKIN * ny, pz + _SKIN * nz):
        return False
    return contains(numbers, indices, px - _SKIN * nx, py - _SKIN * ny, pz - _SKIN * nz)


@kernel
def _unit_gradient(numbers, k, x, y, z):
    gx, gy, gz = surface_gradient(numbers, k, x, y, z)
    length = np.sqrt(gx * gx + gy * gy + gz * gz)
    return gx / length, gy / length, gz / length


@kernel
def _on_axis(numbers, k, x, y, z):
    """Whether every direction across leads to surface k by the same way."""
    kind = surface_kind(numbers, k)
    if kind in (PLANE, BLEND):
        return False
    gx, gy, gz = surface_gradient(numbers, k, x, y, z)
    value = surface_value(numbers, k, x, y, z)
    back = surface_value(numbers, k, x - 1e-9 * gx, y - 1e-9 * gy, z - 1e-9 * gz)
    return back > value  # off the axis a step against the gradient would lower it


@kernel
def _turned(numbers, k, x, y, z, turn):
    """Foot of an axis point on surface k in the given one of `_TURNS` directions, and the gradient there."""
    gx, gy, gz = surface_gradient(numbers, k, x, y, z)
    row = SURFACE_NUMBERS * k
    ux, uy, uz = numbers[row + 3], numbers[row + 4], numbers[row + 5]
    if surface_kind(numbers, k) == SPHERE:
        ux, uy, uz = across(gx, gy, gz)
    hx, hy, hz = uy * gz - uz * gy, uz * gx - ux * gz, ux * gy - uy * gx
    angle = 2.0 * np.pi * turn / _TURNS
    c, s = np.cos(angle), np.sin(angle)
    sx, sy, sz = x + 1e-6 * (c * gx + s * hx), y + 1e-6 * (c * gy + s * hy), z + 1e-6 * (c * gz + s * hz)
    px, py, pz, _ = surface_nearest(numbers, k, sx, sy, sz)
    gx, gy, gz = surface_gradient(numbers, k, px, py, pz)
    return px, py, pz, gx, gy, gz


@kernel
def _in_cone(numbers, faces, signs, point, direction):
    """Whether a direction is a combination of both faces' outward normals at a point with no negative part."""
    (i, j), (sign_i, sign_j), (px, py, pz), (dx, dy, dz) = faces, signs, point, direction
    ax, ay, az = _unit_gradient(numbers, i, px, py, pz)
    bx, by, bz = _unit_gradient(numbers, j, px, py, pz)
    ab = (ax * bx + ay * by + az * bz) * sign_i * sign_j
    ad, bd = (ax * dx + ay * dy + az * dz) * sign_i, (bx * dx + by * dy + bz * dz) * sign_j
    return ad - ab * bd >= -1e-9 and bd - ab * ad >= -1e-9


@kernel
def _corner_faces(numbers, indices, v, corner, direction):
    """Whether no path along the solid at a corner leads nearer to a point in a direction.

    The steepest are the direction itself, its shadows on the surfaces that meet there, and the curves in which those
    meet.
    """
    (px, py, pz), (dx, dy, dz) = corner, direction
    reach = 1e-6
    if contains(numbers, indices, px + reach * dx, py + reach * dy, pz + reach * dz):
        return False
    first = indices[INCIDENCE + 2]
    row = indices[VERTICES + 2] + VERTEX_INDICES * v
    for m in range(first + indices[row], first + indices[row + 1]):
        ax, ay, az = _unit_gradient(numbers, indices[m], px, py, pz)
        across = ax * dx + ay * dy + az * dz
        sx, sy, sz = dx - across * ax, dy - across * ay, dz - across * az
        if _leads_on(numbers, indices, corner, (sx, sy, sz), (ax, ay, az), (0.0, 0.0, 0.0)):
            return False
        for n in range(m + 1, first + indices[row + 1]):
            bx, by, bz = _unit_gradient(numbers, indices[n], px, py, pz)
            tx, ty, tz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            toward = 1.0 if tx * dx + ty * dy + tz * dz > 0.0 else -1.0
            tx, ty, tz = toward * tx, toward * ty, toward * tz
            if tx * dx + ty * dy + tz * dz < 1e-6:
                continue
            if _leads_on(numbers, indices, corner, (tx, ty, tz), (ax, ay, az), (bx, by, bz)):
                return False
    return True


@kernel
def _leads_on(numbers, indices, point, along, a, b):
    """Whether a small step from a point, a hair to either side along a and b, arrives in the solid."""
    (px, py, pz), (sx, sy, sz), (ax, ay, az), (bx, by, bz) = point, along, a, b
    length = np.sqrt(sx * sx + sy * sy + sz * sz)
    if length < 1e-6:
        return False
    scale = 1e-6 / length
    qx, qy, qz = px + scale * sx, py + scale * sy, pz + scale * sz
    for u in (-_SKIN, _SKIN):
        for w in (-_SKIN, _SKIN):
            if contains(numbers, indices, qx + u * ax + w * bx, qy + u * ay + w * by, qz + u * az + w * bz):
                return True
    return False


@kernel
def _away(numbers, indices, place, nearest_point, sign, distance, k):
    """Unit vector out of the solid from the nearest point towards a place (or away from it, inside)."""
    (x, y, z), (bx, by, bz) = place, nearest_point
    if distance > 1e-9 and distance < np.inf:
        return sign * (x - bx) / distance, sign * (y - by) / distance, sign * (z - bz) / distance
    if k < 0:
        return 0.0, 0.0, 1.0
    gx, gy, gz = _unit_gradient(numbers, k, bx, by, bz)
    if contains(numbers, indices, bx + _SKIN * gx, by + _SKIN * gy, bz + _SKIN * gz):
        return -gx, -gy, -gz
    return gx, gy, gz
