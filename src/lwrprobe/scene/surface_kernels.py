"""Single smooth surfaces of a solid: signed value, gradient, nearest point; membership in the whole.

A surface's value is negative inside; it is the exact signed distance except for a blend, where it is smooth and
never larger than the distance. Points travel as scalars: no array is made per call.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.compiled import kernel as allocating_kernel
from lwrprobe.scene.program import (
    BALL_NUMBERS,
    BLEND,
    CAPSULE,
    DIFFERENCE,
    GROUP,
    HEADER,
    INSIDE,
    INTERSECTION,
    PLANE,
    SPHERE,
    STEP_INDICES,
    STEPS,
    SURFACE_BALLS,
    SURFACE_GROUP,
    SURFACE_KIND,
    SURFACE_NUMBERS,
    SURFACE_PART,
    TREE,
    TREE_INDICES,
    UNION,
)

_NEWTON_STEPS = 30


@kernel
def surface_kind(numbers, k):
    return int(numbers[SURFACE_NUMBERS * k + SURFACE_KIND])


@kernel
def surface_part(numbers, k):
    return int(numbers[SURFACE_NUMBERS * k + SURFACE_PART])


@kernel
def surface_value(numbers, k, x, y, z):
    """Signed value of surface k at a point."""
    row = SURFACE_NUMBERS * k
    dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
    kind = surface_kind(numbers, k)
    if kind == PLANE:
        return dx * numbers[row + 3] + dy * numbers[row + 4] + dz * numbers[row + 5]
    if kind == BLEND:
        return _blend(numbers, k, x, y, z)[0]
    if kind != SPHERE:
        along = dx * numbers[row + 3] + dy * numbers[row + 4] + dz * numbers[row + 5]
        if kind == CAPSULE:
            along = min(max(along, 0.0), numbers[row + 7])
        dx -= along * numbers[row + 3]
        dy -= along * numbers[row + 4]
        dz -= along * numbers[row + 5]
    return np.sqrt(dx * dx + dy * dy + dz * dz) - numbers[row + 6]


@kernel
def surface_gradient(numbers, k, x, y, z):
    """Gradient of surface k's value: unit length except for a blend; on an axis or in a centre some direction."""
    row = SURFACE_NUMBERS * k
    kind = surface_kind(numbers, k)
    ux, uy, uz = numbers[row + 3], numbers[row + 4], numbers[row + 5]
    if kind == PLANE:
        return ux, uy, uz
    if kind == BLEND:
        _, gx, gy, gz = _blend(numbers, k, x, y, z)
        return gx, gy, gz
    dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
    if kind != SPHERE:
        along = dx * ux + dy * uy + dz * uz
        if kind == CAPSULE:
            along = min(max(along, 0.0), numbers[row + 7])
        dx, dy, dz = dx - along * ux, dy - along * uy, dz - along * uz
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length < 1e-13:
        return across(ux, uy, uz)
    return dx / length, dy / length, dz / length


@kernel
def surface_nearest(numbers, k, x, y, z):
    """Nearest point of surface k (a local minimum of the distance for a blend), and whether it was found."""
    if surface_kind(numbers, k) == BLEND:
        return blend_nearest(numbers, k, x, y, z, x, y, z)
    value = surface_value(numbers, k, x, y, z)
    gx, gy, gz = surface_gradient(numbers, k, x, y, z)
    return x - value * gx, y - value * gy, z - value * gz, True


@kernel
def surface_values(numbers, k, points, out):
    """Values of surface k at points (n, 3) into out (n,)."""
    for i in range(points.shape[0]):
        out[i] = surface_value(numbers, k, points[i, 0], points[i, 1], points[i, 2])


@kernel
def surface_nearest_batch(numbers, k, points, feet, gradients):
    """`surface_nearest` of points (n, 3) into feet (n, 3), with unit gradients (n, 3); NaN where none was found."""
    for i in range(points.shape[0]):
        x, y, z, found = surface_nearest(numbers, k, points[i, 0], points[i, 1], points[i, 2])
        if not found:
            x, y, z = np.nan, np.nan, np.nan
        gx, gy, gz = surface_gradient(numbers, k, x, y, z)
        length = np.sqrt(gx * gx + gy * gy + gz * gz)
        feet[i, 0], feet[i, 1], feet[i, 2] = x, y, z
        gradients[i, 0], gradients[i, 1], gradients[i, 2] = gx / length, gy / length, gz / length


@kernel
def on_patch(numbers, k, x, y, z, slack):
    """Whether a point of surface k lies on the primitive that the surface bounds, to within `slack` m."""
    row = SURFACE_NUMBERS * k + SURFACE_GROUP
    outermost = -slack
    for other in range(int(numbers[row]), int(numbers[row + 1])):
        if other != k:
            outermost = max(outermost, surface_value(numbers, other, x, y, z))
    return outermost <= slack


@kernel
def contains(numbers, indices, x, y, z):
    """Membership of a point in the solid made of surfaces; decides on as few surfaces as it can."""
    at = 0 if indices[STEPS] > 0 else -2
    while at >= 0:
        row = HEADER + STEP_INDICES * at
        inside = surface_value(numbers, indices[row], x, y, z) <= 0.0
        at = indices[row + 1] if inside else indices[row + 2]
    return at == INSIDE


@allocating_kernel
def tree_value(numbers, indices, x, y, z):
    """Negative inside the solid, positive outside, never further from zero than the boundary is from the point."""
    stack = np.empty(32)
    top = -1
    for t in range(indices[TREE]):
        row = indices[TREE + 2] + TREE_INDICES * t
        operation = indices[row]
        if operation == GROUP:
            value = -np.inf
            for k in range(indices[row + 1], indices[row + 2]):
                value = max(value, surface_value(numbers, k, x, y, z))
            top += 1
            stack[top] = value
            continue
        last = stack[top]
        top -= 1
        if operation == UNION:
            stack[top] = min(stack[top], last)
        elif operation == INTERSECTION:
            stack[top] = max(stack[top], last)
        elif operation == DIFFERENCE:
            stack[top] = max(stack[top], -last)
    return stack[0] if top == 0 else np.inf


@kernel
def blend_nearest(numbers, k, x, y, z, px, py, pz):
    """Point of blend k nearest to (x, y, z), sought from (px, py, pz) on.

    Newton's method on the conditions p - c + m g(p) = 0, s(p) = 0 with g the gradient of s and m the multiplier.
    """
    for _ in range(4):
        value, gx, gy, gz = _blend(numbers, k, px, py, pz)
        scale = value / max(gx * gx + gy * gy + gz * gz, 1e-12)
        px, py, pz = px - scale * gx, py - scale * gy, pz - scale * gz
    value, gx, gy, gz = _blend(numbers, k, px, py, pz)
    m = ((x - px) * gx + (y - py) * gy + (z - pz) * gz) / max(gx * gx + gy * gy + gz * gz, 1e-12)
    for _ in range(_NEWTON_STEPS):
        hxx, hxy, hxz, hyy, hyz, hzz = _blend_hessian(numbers, k, px, py, pz)
        matrix = (1.0 + m * hxx, m * hxy, m * hxz, 1.0 + m * hyy, m * hyz, 1.0 + m * hzz)
        rest = (px - x + m * gx, py - y + m * gy, pz - z + m * gz)
        sx, sy, sz, sm = _kkt_step(matrix, (gx, gy, gz), rest, value)
        size = np.sqrt(sx * sx + sy * sy + sz * sz)
        shrink = min(1.0, 0.003 / max(size, 1e-30))
        px, py, pz, m = px + shrink * sx, py + shrink * sy, pz + shrink * sz, m + shrink * sm
        value, gx, gy, gz = _blend(numbers, k, px, py, pz)
        if size < 1e-9:  # the last step's error is of the order of its square
            break
    return px, py, pz, size < 1e-9 and abs(value) < 1e-9


@kernel
def _kkt_step(matrix, g, r, value):
    """Solve [[A, g], [g', 0]] (s, t) = -(r, value) with A = [[a, b, c], [b, d, e], [c, e, f]] by cofactors."""
    (a, b, c, d, e, f), (gx, gy, gz), (rx, ry, rz) = matrix, g, r
    cxx, cxy, cxz = d * f - e * e, c * e - b * f, b * e - c * d
    cyy, cyz, czz = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * cxx + b * cxy + c * cxz
    if abs(determinant) < 1e-9:
        return 0.0, 0.0, 0.0, 0.0
    agx = (cxx * gx + cxy * gy + cxz * gz) / determinant
    agy = (cxy * gx + cyy * gy + cyz * gz) / determinant
    agz = (cxz * gx + cyz * gy + czz * gz) / determinant
    arx = (cxx * rx + cxy * ry + cxz * rz) / determinant
    ary = (cxy * rx + cyy * ry + cyz * rz) / determinant
    arz = (cxz * rx + cyz * ry + czz * rz) / determinant
    gag = gx * agx + gy * agy + gz * agz
    if abs(gag) < 1e-12:
        return 0.0, 0.0, 0.0, 0.0
    t = (value - (gx * arx + gy * ary + gz * arz)) / gag
    return -arx - t * agx, -ary - t * agy, -arz - t * agz, t


@kernel
def _blend(numbers, k, x, y, z):
    """Value and gradient of a blend: soft minimum over balls, soft maximum with the hollows turned inside out."""
    first, last = blend_rows(numbers, k)
    smoothing = numbers[SURFACE_NUMBERS * k + 6]
    s, gx, gy, gz = _soft_minimum(numbers, first, last, smoothing, x, y, z)
    if not _has_hollows(numbers, first, last):
        return s, gx, gy, gz
    top = s
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] < 0.0:
            top = max(top, -_ball(numbers, row, x, y, z)[0])
    weight = np.exp((s - top) / smoothing)
    total = weight
    gx, gy, gz = weight * gx, weight * gy, weight * gz
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] < 0.0:
            d, nx, ny, nz, _ = _ball(numbers, row, x, y, z)
            weight = np.exp((-d - top) / smoothing)
            total += weight
            gx, gy, gz = gx - weight * nx, gy - weight * ny, gz - weight * nz
    return top + smoothing * np.log(total), gx / total, gy / total, gz / total


@kernel
def _soft_minimum(numbers, first, last, smoothing, x, y, z):
    low = np.inf
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] > 0.0:
            low = min(low, _ball(numbers, row, x, y, z)[0])
    total, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] > 0.0:
            d, nx, ny, nz, _ = _ball(numbers, row, x, y, z)
            weight = np.exp((low - d) / smoothing)
            total += weight
            gx, gy, gz = gx + weight * nx, gy + weight * ny, gz + weight * nz
    return low - smoothing * np.log(total), gx / total, gy / total, gz / total


@kernel
def _blend_hessian(numbers, k, x, y, z):
    """Second derivatives (xx, xy, xz, yy, yz, zz) of a blend.

    For a log-sum-exp with weights w_i over values with gradients n_i and Hessians H_i, the Hessian is
    sum w_i H_i + c (sum w_i n_i n_i' - g g') with c = -1/k for a soft minimum and +1/k for a soft maximum.
    """
    first, last = blend_rows(numbers, k)
    smoothing = numbers[SURFACE_NUMBERS * k + 6]
    s, gx, gy, gz = _soft_minimum(numbers, first, last, smoothing, x, y, z)
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    total = 0.0
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] > 0.0:
            d, nx, ny, nz, bend = _ball(numbers, row, x, y, z)
            weight = np.exp((s - d) / smoothing)
            total += weight
            own, outer = weight * bend, -weight * (bend + 1.0 / smoothing)
            xx, yy, zz = xx + own + outer * nx * nx, yy + own + outer * ny * ny, zz + own + outer * nz * nz
            xy, xz, yz = xy + outer * nx * ny, xz + outer * nx * nz, yz + outer * ny * nz
    xx, yy, zz = xx / total + gx * gx / smoothing, yy / total + gy * gy / smoothing, zz / total + gz * gz / smoothing
    xy, xz, yz = xy / total + gx * gy / smoothing, xz / total + gx * gz / smoothing, yz / total + gy * gz / smoothing
    if not _has_hollows(numbers, first, last):
        return xx, xy, xz, yy, yz, zz
    value, hx, hy, hz = _blend(numbers, k, x, y, z)
    weight = np.exp((s - value) / smoothing)
    stretch = weight / smoothing
    xx, yy, zz = weight * xx + stretch * gx * gx, weight * yy + stretch * gy * gy, weight * zz + stretch * gz * gz
    xy, xz, yz = weight * xy + stretch * gx * gy, weight * xz + stretch * gx * gz, weight * yz + stretch * gy * gz
    for row in range(first, last, BALL_NUMBERS):
        if numbers[row + 4] < 0.0:
            d, nx, ny, nz, bend = _ball(numbers, row, x, y, z)
            weight = np.exp((-d - value) / smoothing)
            own, outer = -weight * bend, weight * (bend + 1.0 / smoothing)
            xx, yy, zz = xx + own + outer * nx * nx, yy + own + outer * ny * ny, zz + own + outer * nz * nz
            xy, xz, yz = xy + outer * nx * ny, xz + outer * nx * nz, yz + outer * ny * nz
    xx, yy, zz = xx - hx * hx / smoothing, yy - hy * hy / smoothing, zz - hz * hz / smoothing
    return xx, xy - hx * hy / smoothing, xz - hx * hz / smoothing, yy, yz - hy * hz / smoothing, zz


@kernel
def blend_rows(numbers, k):
    """Where a blend's balls begin and end in numbers."""
    row = SURFACE_NUMBERS * k + SURFACE_BALLS
    return int(numbers[row]), int(numbers[row + 1])


@kernel
def _has_hollows(numbers, first, last):
    return last > first and numbers[last - 1] < 0.0  # hollows come last


@kernel
def _ball(numbers, row, x, y, z):
    """Signed distance to a ball, its gradient, and one over the distance from the centre."""
    dx, dy, dz = x - numbers[row], y - numbers[row + 1], z - numbers[row + 2]
    length = max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-9)
    return length - numbers[row + 3], dx / length, dy / length, dz / length, 1.0 / length


@kernel
def across(ux, uy, uz):
    """Some unit vector at right angles to u."""
    if abs(ux) <= abs(uy) and abs(ux) <= abs(uz):
        x, y, z = 0.0, uz, -uy
    elif abs(uy) <= abs(uz):
        x, y, z = -uz, 0.0, ux
    else:
        x, y, z = uy, -ux, 0.0
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-30:
        return 0.0, 0.0, 1.0
    return x / length, y / length, z / length
