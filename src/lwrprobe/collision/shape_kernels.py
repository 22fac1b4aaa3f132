"""Convex shapes as rows of numbers: where they stand, how far a point is, how far they reach (kernels, private).

A row holds: kind, three dimensions, carrier frame, rotation (9, row by row), translation (3). Dimensions are half sizes
of a box, or radius and half length. A capsule is its axis, thickened by a margin.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel, kernel

CYLINDER, CAPSULE, BOX, CUBE = 0.0, 1.0, 2.0, 3.0  # a CUBE is a BOX along the world's axes
KIND, SIZE, CARRIER, ROTATION, TRANSLATION, ROW = 0, 1, 4, 5, 14, 17


@allocation_free_kernel
def place(links, tip, frames, placed):
    """Rows of `links`, from their carriers' frames to the world: carrier 0 is `tip`, carrier i is frames[i - 1]."""
    for i in range(links.shape[0]):
        carrier = np.int64(links[i, CARRIER])
        frame = tip if carrier == 0 else frames[carrier - 1]
        for k in range(CARRIER + 1):
            placed[i, k] = links[i, k]
        for row in range(3):
            x, y, z = frame[row, 0], frame[row, 1], frame[row, 2]
            for k in range(3):
                column = ROTATION + k
                placed[i, column + 3 * row] = x * links[i, column] + y * links[i, column + 3] + z * links[i, column + 6]
            t = TRANSLATION
            placed[i, t + row] = x * links[i, t] + y * links[i, t + 1] + z * links[i, t + 2] + frame[row, 3]


@allocation_free_kernel
def is_rigid(pose):
    """Whether a (4, 4) matrix is a rigid motion to 1e-6: orthonormal, right-handed, finite."""
    for i in range(3):
        if not abs(pose[i, 3]) < np.inf or pose[3, i] != 0.0:
            return False
        j, k = (i + 1) % 3, (i + 2) % 3
        for row in range(3):
            # Columns that are the cross products of the next two, and not zero, can only be a rotation's.
            across = pose[(row + 1) % 3, j] * pose[(row + 2) % 3, k] - pose[(row + 2) % 3, j] * pose[(row + 1) % 3, k]
            if not abs(across - pose[row, i]) <= 1e-7:
                return False
    length2 = pose[0, 0] ** 2 + pose[1, 0] ** 2 + pose[2, 0] ** 2
    return abs(length2 - 1.0) <= 1e-7 and pose[3, 3] == 1.0


@allocation_free_kernel
def margin(shape):
    """Thickness around the core that `support` and GJK see."""
    return shape[SIZE] if shape[KIND] == CAPSULE else 0.0


@allocation_free_kernel
def to_local(shape, x, y, z):
    """A world vector in the shape's frame."""
    r = ROTATION
    return (
        shape[r] * x + shape[r + 3] * y + shape[r + 6] * z,
        shape[r + 1] * x + shape[r + 4] * y + shape[r + 7] * z,
        shape[r + 2] * x + shape[r + 5] * y + shape[r + 8] * z,
    )


@allocation_free_kernel
def to_world(shape, x, y, z):
    """A vector of the shape's frame in the world."""
    r = ROTATION
    return (
        shape[r] * x + shape[r + 1] * y + shape[r + 2] * z,
        shape[r + 3] * x + shape[r + 4] * y + shape[r + 5] * z,
        shape[r + 6] * x + shape[r + 7] * y + shape[r + 8] * z,
    )


@kernel
def distance_to_cylinder(radius, half, x, y, z):
    """Signed distance and its gradient, in the cylinder's frame."""
    rho = np.sqrt(x * x + y * y)
    outward, upward = rho - radius, abs(z) - half
    uz = 1.0 if z >= 0.0 else -1.0
    if outward <= 0.0 and upward > outward:
        return upward, 0.0, 0.0, uz
    share = 1.0 / rho if rho > 0.0 else 0.0
    if upward <= 0.0:
        return outward, (x * share if rho > 0.0 else 1.0), y * share, 0.0
    s = np.sqrt(outward * outward + upward * upward)
    share *= outward / s
    return s, x * share, y * share, uz * upward / s


@kernel
def distance_to_capsule(radius, half, x, y, z):
    """Signed distance and a subgradient, in the capsule's frame."""
    dz = z - min(max(z, -half), half)
    length = np.sqrt(x * x + y * y + dz * dz)
    if length > 0.0:
        return length - radius, x / length, y / length, dz / length
    return -radius, 1.0, 0.0, 0.0


@kernel
def distance_to_box(hx, hy, hz, x, y, z):
    """Signed distance and a subgradient, in the box's frame."""
    dx, dy, dz = abs(x) - hx, abs(y) - hy, abs(z) - hz
    sx, sy, sz = (1.0 if x >= 0.0 else -1.0), (1.0 if y >= 0.0 else -1.0), (1.0 if z >= 0.0 else -1.0)
    deepest = max(dx, dy, dz)
    if deepest > 0.0:
        ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
        s = np.sqrt(ox * ox + oy * oy + oz * oz)
        return s, sx * ox / s, sy * oy / s, sz * oz / s
    if dx == deepest:
        return dx, sx, 0.0, 0.0
    if dy == deepest:
        return dy, 0.0, sy, 0.0
    return dz, 0.0, 0.0, sz


@allocation_free_kernel(forceinline=True)
def distance_to(shape, x, y, z):
    """Signed distance from a world point to a shape and its gradient in the world; negative inside.

    It is a convex function of the point: its tangent plane is below it everywhere. All bounds rest on that.
    """
    t = TRANSLATION
    lx, ly, lz = to_local(shape, x - shape[t], y - shape[t + 1], z - shape[t + 2])
    if shape[KIND] == CYLINDER:
        s, gx, gy, gz = distance_to_cylinder(shape[SIZE], shape[SIZE + 1], lx, ly, lz)
    elif shape[KIND] == CAPSULE:
        s, gx, gy, gz = distance_to_capsule(shape[SIZE], shape[SIZE + 1], lx, ly, lz)
    else:
        s, gx, gy, gz = distance_to_box(shape[SIZE], shape[SIZE + 1], shape[SIZE + 2], lx, ly, lz)
    wx, wy, wz = to_world(shape, gx, gy, gz)
    return s, wx, wy, wz


@allocation_free_kernel
def support(shape, x, y, z):
    """World point of the shape's core that reaches farthest in a direction (not necessarily of unit length)."""
    t = TRANSLATION
    if shape[KIND] == CUBE:
        return (
            shape[t] + (shape[SIZE] if x >= 0.0 else -shape[SIZE]),
            shape[t + 1] + (shape[SIZE + 1] if y >= 0.0 else -shape[SIZE + 1]),
            shape[t + 2] + (shape[SIZE + 2] if z >= 0.0 else -shape[SIZE + 2]),
        )
    lx, ly, lz = to_local(shape, x, y, z)
    if shape[KIND] == BOX:
        px = shape[SIZE] if lx >= 0.0 else -shape[SIZE]
        py = shape[SIZE + 1] if ly >= 0.0 else -shape[SIZE + 1]
        pz = shape[SIZE + 2] if lz >= 0.0 else -shape[SIZE + 2]
    else:
        px, py = 0.0, 0.0
        pz = shape[SIZE + 1] if lz >= 0.0 else -shape[SIZE + 1]
        rho = np.sqrt(lx * lx + ly * ly)
        if shape[KIND] == CYLINDER and rho > 0.0:
            px, py = shape[SIZE] * lx / rho, shape[SIZE] * ly / rho
    wx, wy, wz = to_world(shape, px, py, pz)
    return wx + shape[t], wy + shape[t + 1], wz + shape[t + 2]


@allocation_free_kernel
def reach(link):
    """Farthest that any point of a link is from its carrier's origin (bounded by the link's ball)."""
    if link[KIND] == CYLINDER:
        ball = np.sqrt(link[SIZE] ** 2 + link[SIZE + 1] ** 2)
    elif link[KIND] == CAPSULE:
        ball = link[SIZE] + link[SIZE + 1]
    else:
        ball = np.sqrt(link[SIZE] ** 2 + link[SIZE + 1] ** 2 + link[SIZE + 2] ** 2)
    t = TRANSLATION
    return np.sqrt(link[t] ** 2 + link[t + 1] ** 2 + link[t + 2] ** 2) + ball
