"""Curves in which two surfaces meet: put a point onto one, follow one, find its point nearest to another point."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.scene.program import ARC, EDGE_NUMBERS, EDGES, LINE
from lwrprobe.scene.surface_kernels import contains, surface_gradient, surface_value


@kernel
def onto_curve(numbers, i, j, x, y, z):
    """Point near (x, y, z) where surfaces i and j are both zero, by Newton steps of least length; found or not."""
    for _ in range(20):
        f = surface_value(numbers, i, x, y, z)
        h = surface_value(numbers, j, x, y, z)
        ax, ay, az = surface_gradient(numbers, i, x, y, z)
        bx, by, bz = surface_gradient(numbers, j, x, y, z)
        aa, bb = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
        ab = ax * bx + ay * by + az * bz
        determinant = aa * bb - ab * ab
        if determinant < 1e-10 * aa * bb:
            return x, y, z, False
        s, t = (bb * f - ab * h) / determinant, (aa * h - ab * f) / determinant
        sx, sy, sz = s * ax + t * bx, s * ay + t * by, s * az + t * bz
        x, y, z = x - sx, y - sy, z - sz
        if sx * sx + sy * sy + sz * sz < 1e-26:
            return x, y, z, True
    return x, y, z, abs(f) < 1e-11 and abs(h) < 1e-11


@kernel
def curve_tangent(numbers, i, j, x, y, z):
    """Unit tangent of the curve of surfaces i and j; zero where they touch without crossing."""
    ax, ay, az = surface_gradient(numbers, i, x, y, z)
    bx, by, bz = surface_gradient(numbers, j, x, y, z)
    tx, ty, tz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(tx * tx + ty * ty + tz * tz)
    if length < 1e-5:
        return 0.0, 0.0, 0.0
    return tx / length, ty / length, tz / length


@kernel
def follow_curve(numbers, i, j, start, step, box, out):
    """Points along the curve from `start` on, `step` apart, into out (n, 3) until it closes or leaves box (2, 3).

    Returns how many, and whether the curve closed.
    """
    x, y, z = start[0], start[1], start[2]
    for n in range(out.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = x, y, z
        tx, ty, tz = curve_tangent(numbers, i, j, x, y, z)
        x, y, z, found = onto_curve(numbers, i, j, x + step * tx, y + step * ty, z + step * tz)
        if not found or (tx == 0.0 and ty == 0.0 and tz == 0.0):
            return n + 1, False
        for axis, value in enumerate((x, y, z)):
            if value < box[0, axis] or value > box[1, axis]:
                return n + 1, False
        gap = (x - start[0]) ** 2 + (y - start[1]) ** 2 + (z - start[2]) ** 2
        if n > 2 and gap < step * step:
            return n + 1, True
    return out.shape[0], False


@kernel
def edge_point(numbers, indices, e, kind, i, j, x, y, z):
    """Point of edge e nearest to (x, y, z); the second answer tells whether it lies between the edge's ends."""
    row = indices[EDGES + 1] + EDGE_NUMBERS * e
    if kind == LINE:
        return _line_point(numbers, row, x, y, z)
    if kind == ARC:
        return _arc_point(numbers, row, x, y, z)
    return _curve_point(numbers, row, i, j, x, y, z)


@kernel
def _line_point(numbers, row, x, y, z):
    ux, uy, uz, length = numbers[row + 3], numbers[row + 4], numbers[row + 5], numbers[row + 6]
    along = (x - numbers[row]) * ux + (y - numbers[row + 1]) * uy + (z - numbers[row + 2]) * uz
    held = min(max(along, 0.0), length)
    return numbers[row] + held * ux, numbers[row + 1] + held * uy, numbers[row + 2] + held * uz, held == along


@kernel
def _arc_point(numbers, row, x, y, z):
    dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
    a = dx * numbers[row + 3] + dy * numbers[row + 4] + dz * numbers[row + 5]
    b = dx * numbers[row + 6] + dy * numbers[row + 7] + dz * numbers[row + 8]
    radius, span = numbers[row + 9], numbers[row + 10]
    angle = np.arctan2(b, a)
    if angle < 0.0:
        angle += 2.0 * np.pi
    between = angle <= span
    if not between:  # the end that is nearer by angle is nearer in space
        angle = span if angle - span < 2.0 * np.pi - angle else 0.0
    c, s = radius * np.cos(angle), radius * np.sin(angle)
    return (
        numbers[row] + c * numbers[row + 3] + s * numbers[row + 6],
        numbers[row + 1] + c * numbers[row + 4] + s * numbers[row + 7],
        numbers[row + 2] + c * numbers[row + 5] + s * numbers[row + 8],
        between,
    )


@kernel
def _curve_point(numbers, row, i, j, x, y, z):
    px, py, pz = numbers[row], numbers[row + 1], numbers[row + 2]
    qx, qy, qz = numbers[row + 3], numbers[row + 4], numbers[row + 5]
    low = (px - x) * numbers[row + 6] + (py - y) * numbers[row + 7] + (pz - z) * numbers[row + 8]
    high = (qx - x) * numbers[row + 9] + (qy - y) * numbers[row + 10] + (qz - z) * numbers[row + 11]
    if low > 0.0 or high < 0.0:  # not a minimum within this piece
        nearer = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2 <= (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
        return (px, py, pz, False) if nearer else (qx, qy, qz, False)
    length = np.sqrt((qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2)
    slope = (high - low) / max(length, 1e-30)
    share = low / min(low - high, -1e-30)
    sx, sy, sz = px + share * (qx - px), py + share * (qy - py), pz + share * (qz - pz)
    for _ in range(8):
        sx, sy, sz, _ = onto_curve(numbers, i, j, sx, sy, sz)
        tx, ty, tz = curve_tangent(numbers, i, j, sx, sy, sz)
        if tx * (qx - px) + ty * (qy - py) + tz * (qz - pz) < 0.0:
            tx, ty, tz = -tx, -ty, -tz
        short = -((sx - x) * tx + (sy - y) * ty + (sz - z) * tz) / max(slope, 0.1)
        if abs(short) < 1e-12:
            break
        sx, sy, sz = sx + short * tx, sy + short * ty, sz + short * tz
    return sx, sy, sz, True


@kernel
def edge_sectors(numbers, indices, i, j, point, reach, skin, out):
    """What the two surfaces bound around a point of their curve, into out (k, 3) rows (sign i, sign j, convex).

    A half of surface i, on one side of the curve, bounds the solid when a step of `skin` through it at the distance
    `reach` from the curve changes membership; its sign turns the surface's gradient outwards. A half of i and a half
    of j make an edge when the sector between them is wholly inside (convex) or wholly outside (concave).
    """
    x, y, z = point[0], point[1], point[2]
    tx, ty, tz = curve_tangent(numbers, i, j, x, y, z)
    if tx == 0.0 and ty == 0.0 and tz == 0.0:
        return 0
    count = 0
    for side_i in (1.0, -1.0):
        sign_i, ax, ay, az, nx, ny, nz = _half(numbers, indices, i, x, y, z, tx, ty, tz, side_i * reach, skin)
        if sign_i == 0.0:
            continue
        for side_j in (1.0, -1.0):
            sign_j, bx, by, bz, mx, my, mz = _half(numbers, indices, j, x, y, z, tx, ty, tz, side_j * reach, skin)
            if sign_j == 0.0:
                continue
            over_i = sign_i * (nx * bx + ny * by + nz * bz)
            over_j = sign_j * (mx * ax + my * ay + mz * az)
            if over_i * over_j <= 0.0:
                continue
            convex = over_i < 0.0
            whole = True
            for share in (0.25, 0.5, 0.75):
                cx, cy, cz = (1 - share) * ax + share * bx, (1 - share) * ay + share * by, (1 - share) * az + share * bz
                length = max(np.sqrt(cx * cx + cy * cy + cz * cz), 1e-9)
                s = reach / length
                whole = whole and contains(numbers, indices, x + s * cx, y + s * cy, z + s * cz) == convex
            if whole and count < out.shape[0]:
                out[count, 0], out[count, 1], out[count, 2] = sign_i, sign_j, 1.0 if convex else 0.0
                count += 1
    return count


@kernel
def _half(numbers, indices, k, x, y, z, tx, ty, tz, reach, skin):
    """Sign of one half of surface k beside a curve (0 when it bounds nothing), its direction, the unit gradient."""
    nx, ny, nz = surface_gradient(numbers, k, x, y, z)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    side = 1.0 if reach > 0.0 else -1.0
    ax, ay, az = side * (ty * nz - tz * ny), side * (tz * nx - tx * nz), side * (tx * ny - ty * nx)
    far = abs(reach)
    px, py, pz = x + far * ax, y + far * ay, z + far * az
    above = contains(numbers, indices, px + skin * nx, py + skin * ny, pz + skin * nz)
    below = contains(numbers, indices, px - skin * nx, py - skin * ny, pz - skin * nz)
    sign = 0.0 if above == below else (-1.0 if above else 1.0)
    return sign, ax, ay, az, nx, ny, nz
