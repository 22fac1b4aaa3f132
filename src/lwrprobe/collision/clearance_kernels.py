"""The nearest pair between links and the voxels of a bit tree (kernels, private).

Depth first over pairs of link and cube, nearest first, one best distance for all links. A link's signed distance s is
convex, so the plane that touches it at one point is below it everywhere: with n its gradient at the centre of a box
with half edges h, no point of the box is nearer than s - (|n_x| h_x + |n_y| h_y + |n_z| h_z). The plane of a node sorts
its children; each gets its own when its turn comes. What survives down to a voxel, or to a filled cube, is measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lwrprobe.collision.gjk_kernels import TOLERANCE, core_distance
from lwrprobe.collision.shape_kernels import CUBE, KIND, ROW, SIZE, TRANSLATION, distance_to, margin, place, support
from lwrprobe.compiled import allocation_free_kernel, kernel
from lwrprobe.mapping.kernels import (
    CENTRE_KEY,
    COUNT,
    EDGE,
    FULL,
    LOWER,
    ROOT,
    TOP,
    UPPER,
    bit_count,
    link_at,
    lowest_bit,
    real,
)

DISTANCE, ON_ROBOT, ON_MAP, WHO, ANSWER = 0, 1, 4, 7, 8  # places in an answer, and its length
PENDING = 64 * (TOP + 1)
FIRST_SET = sum(((flags & -flags).bit_length() - 1) << (2 * flags) for flags in range(1, 16))
LAST_SET = sum(flags.bit_length() << (4 * flags) for flags in range(1, 16))
"""Of four flags the first that is set, and one past the last: a table in the bits of a number, without a branch."""
PROJECTIONS, MAX_STEPS = 2, 8  # of the steps from a cube towards a link


class Plane(NamedTuple):
    """The plane that touches a link's signed distance: (x, y, z) of its gradient, and its value at the origin."""

    x: float
    y: float
    z: float
    offset: float


class Cell(NamedTuple):
    """A cube of 4^level voxels' edge: its node, 0 for a filled cube, and its lowest key along each axis."""

    node: int
    level: int
    kx: int
    ky: int
    kz: int


class Scratch(NamedTuple):
    """Arrays that a search works in; `search` makes them."""

    bounds: np.ndarray  # (PENDING + links,), of the entries on the stack
    stack: np.ndarray  # (PENDING + links, 2), link and cell, packed
    cube: np.ndarray  # (ROW,), a cell as a shape
    simplex: np.ndarray  # (4, 6)
    work: np.ndarray  # (16, 4)
    pair: np.ndarray  # (6,)


@allocation_free_kernel
def forget(answer):
    """An answer that holds nothing yet."""
    for k in range(ANSWER):
        answer[k] = np.nan
    answer[DISTANCE], answer[WHO] = np.inf, -1.0


@allocation_free_kernel
def take_nearer(a, b, who, simplex, work, pair, answer):
    """Measure shapes a and b, from row 0 of `simplex` on, and take them into the answer if they are nearer."""
    first, second = margin(a), margin(b)
    length = core_distance(a, b, simplex, work, answer[DISTANCE] + first + second, pair)
    distance = length - first - second
    if distance >= answer[DISTANCE]:
        return
    if distance > TOLERANCE:
        on_a, on_b = first / length, 1.0 - second / length
    else:
        # In collision both witnesses are one point, inside both.
        distance, on_a = 0.0, first / (first + second) if first > 0.0 else 0.0
        on_b = on_a
    answer[DISTANCE], answer[WHO] = distance, who
    for k in range(3):
        apart = pair[3 + k] - pair[k]
        answer[ON_ROBOT + k] = pair[k] + on_a * apart
        answer[ON_MAP + k] = pair[k] + on_b * apart


@allocation_free_kernel(forceinline=True)
def box_around(words, edge, node, level, kx, ky, kz):
    """Box around what a cube of 4^level voxels' edge holds: centre, then half edges."""
    size = np.int64(1) << (2 * level)
    x0, x1, y0, y1, z0, z1 = kx, kx + size, ky, ky + size, kz, kz + size
    if node != 0:
        size >>= 2
        (ax, bx), (ay, by), (az, bz) = extents(words[node])
        # High up a node's children are wider than all that there is.
        x0, x1 = max(kx + ax * size, words[LOWER]), min(kx + bx * size, words[UPPER] + 1)
        y0, y1 = max(ky + ay * size, words[LOWER + 1]), min(ky + by * size, words[UPPER + 1] + 1)
        z0, z1 = max(kz + az * size, words[LOWER + 2]), min(kz + bz * size, words[UPPER + 2] + 1)
    half = 0.5 * edge
    x, y, z = half * (x0 + x1 - 2 * CENTRE_KEY), half * (y0 + y1 - 2 * CENTRE_KEY), half * (z0 + z1 - 2 * CENTRE_KEY)
    return x, y, z, half * (x1 - x0), half * (y1 - y0), half * (z1 - z0)


@kernel
def extent(flags):
    """First and one past the last of the four flags (bits), of which one is set at least."""
    return (FIRST_SET >> (2 * flags)) & 3, (LAST_SET >> (4 * flags)) & 7


@kernel
def extents(mask):
    """Extents of the children in a mask along x, y, z."""
    z = (
        (mask & 0xFFFF != 0)
        | (mask & 0xFFFF0000 != 0) << 1
        | (mask & 0xFFFF00000000 != 0) << 2
        | (mask >> 48 != 0) << 3
    )
    layer = (mask | mask >> 16 | mask >> 32 | mask >> 48) & 0xFFFF
    y = (layer & 0xF != 0) | (layer & 0xF0 != 0) << 1 | (layer & 0xF00 != 0) << 2 | (layer & 0xF000 != 0) << 3
    row = (layer | layer >> 4 | layer >> 8 | layer >> 12) & 0xF
    return extent(row), extent(y), extent(z)


@kernel
def zero_of(x, g, before, slope, low, high):
    """Where a growing function is zero that is g at x and was `slope` at `before`; the end it points to where flat."""
    if (g - slope) * (x - before) > 0.0:
        return x - g * (x - before) / (g - slope)
    return low if g > 0.0 else high


@allocation_free_kernel(forceinline=True)
def take_cube(shape, who, plane, centre, half, scratch, answer):
    """Measure a link and a cube of half edge `half`, given the link's plane with the cube's centre as its origin.

    Back and forth between the nearest point of the link and that point's nearest in the cube; where the two are nearly
    parallel that crawls, and the gradient's zero is sought along each axis by itself. What is left goes on to GJK.
    """
    (x, y, z), gx, gy, gz = centre, plane.x, plane.y, plane.z
    s = plane.offset  # at the centre
    x0, x1, y0, y1, z0, z1 = x - half, x + half, y - half, y + half, z - half, z + half
    ox, oy, oz, hx, hy, hz = x, y, z, gx, gy, gz  # the place and the gradient before
    for step in range(MAX_STEPS):
        if s <= 0.0:
            record(answer, who, 0.0, x, y, z, x, y, z)
            return
        px, py, pz = x - s * gx, y - s * gy, z - s * gz
        low = s + gx * ((x0 if gx > 0.0 else x1) - x)
        low += gy * ((y0 if gy > 0.0 else y1) - y)
        low += gz * ((z0 if gz > 0.0 else z1) - z)
        if low >= answer[DISTANCE] - TOLERANCE:
            return
        if s - low <= TOLERANCE:
            record(answer, who, s, px, py, pz, x, y, z)
            return
        if step >= PROJECTIONS:
            px, py, pz = zero_of(x, gx, ox, hx, x0, x1), zero_of(y, gy, oy, hy, y0, y1), zero_of(z, gz, oz, hz, z0, z1)
        ox, oy, oz, hx, hy, hz = x, y, z, gx, gy, gz
        x, y, z = min(max(px, x0), x1), min(max(py, y0), y1), min(max(pz, z0), z1)
        s, gx, gy, gz = distance_to(shape, x, y, z)
    back = s + margin(shape)
    simplex, cube = scratch.simplex, scratch.cube
    simplex[0, 0], simplex[0, 1], simplex[0, 2] = -back * gx, -back * gy, -back * gz
    simplex[0, 3], simplex[0, 4], simplex[0, 5] = x - back * gx, y - back * gy, z - back * gz
    cube[KIND], cube[SIZE], cube[SIZE + 1], cube[SIZE + 2] = CUBE, half, half, half
    cube[TRANSLATION], cube[TRANSLATION + 1], cube[TRANSLATION + 2] = x0 + half, y0 + half, z0 + half
    take_nearer(shape, cube, who, simplex, scratch.work, scratch.pair, answer)


@allocation_free_kernel
def record(answer, who, distance, ax, ay, az, bx, by, bz):
    """An answer with its witness points."""
    answer[DISTANCE], answer[WHO] = distance, who
    answer[ON_ROBOT], answer[ON_ROBOT + 1], answer[ON_ROBOT + 2] = ax, ay, az
    answer[ON_MAP], answer[ON_MAP + 1], answer[ON_MAP + 2] = bx, by, bz


@allocation_free_kernel
def push(bounds, stack, depth, base, bound, who, cell):
    """Put a link and a cell on the entries from `base` upwards, so that the nearest of them is on top.

    Those below are in no order: most of them are never looked at again, and to sort them costs more than it saves.
    """
    slot = depth
    if slot > base and bounds[slot - 1] < bound:
        bounds[slot] = bounds[slot - 1]
        stack[slot, 0], stack[slot, 1] = stack[slot - 1, 0], stack[slot - 1, 1]
        slot -= 1
    bounds[slot] = bound
    stack[slot, 0] = cell.node | who << 32
    stack[slot, 1] = cell.kx | cell.ky << 16 | cell.kz << 32 | cell.level << 48


@allocation_free_kernel(forceinline=True)
def descend(words, node, level, child, kx, ky, kz):
    """Where the path down from a child first forks: node (0 for a filled cube), level whose cube it is, lowest key."""
    while True:
        size = np.int64(1) << (2 * level)
        kx, ky, kz = kx + (child & 3) * size, ky + ((child >> 2) & 3) * size, kz + (child >> 4) * size
        if level == 0:
            return np.int64(0), level, kx, ky, kz
        node = link_at(words, node, child, level)
        if node == FULL:
            return np.int64(0), level, kx, ky, kz
        if bit_count(words[node]) != 1:
            return node, level, kx, ky, kz
        child = lowest_bit(words[node])
        level -= 1


@allocation_free_kernel
def expand(words, edge, who, cell, plane, best, scratch, depth):
    """Push all children of a cell's node that may be nearer than `best` by the cell's plane; the stack's new height."""
    base, bounds, stack = depth, scratch.bounds, scratch.stack
    gx, gy, gz, offset = plane
    node, level, kx, ky, kz = cell
    # the plane's least value in a child's own cube: worth asking before looking into the child
    size = edge * (np.int64(1) << (2 * (level - 1)))
    low = (kx - CENTRE_KEY) * gx + (ky - CENTRE_KEY) * gy + (kz - CENTRE_KEY) * gz
    low = offset + edge * low + size * (min(gx, 0.0) + min(gy, 0.0) + min(gz, 0.0))
    rest = words[node]
    while rest != 0:
        child = lowest_bit(rest)
        rest &= rest - 1
        if low + size * ((child & 3) * gx + ((child >> 2) & 3) * gy + (child >> 4) * gz) >= best:
            continue
        below, at_level, cx, cy, cz = descend(words, node, level - 1, child, kx, ky, kz)
        x, y, z, hx, hy, hz = box_around(words, edge, below, at_level, cx, cy, cz)
        bound = gx * x + gy * y + gz * z + offset - (abs(gx) * hx + abs(gy) * hy + abs(gz) * hz)
        if bound < best:
            push(bounds, stack, depth, base, bound, who, Cell(below, at_level, cx, cy, cz))
            depth += 1
    return depth


@allocation_free_kernel
def expand_bottom(words, edge, who, cell, plane, best, scratch, depth):
    """The same for a node whose children are voxels: their bounds are the plane's values, stepped along three axes."""
    base, bounds, stack = depth, scratch.bounds, scratch.stack
    gx, gy, gz, offset = plane
    node, _, kx, ky, kz = cell
    low = (kx - CENTRE_KEY + 0.5) * gx + (ky - CENTRE_KEY + 0.5) * gy + (kz - CENTRE_KEY + 0.5) * gz
    low = offset + edge * (low - 0.5 * (abs(gx) + abs(gy) + abs(gz)))
    rest = words[node]
    while rest != 0:
        child = lowest_bit(rest)
        rest &= rest - 1
        cx, cy, cz = child & 3, (child >> 2) & 3, child >> 4
        bound = low + edge * (cx * gx + cy * gy + cz * gz)
        if bound < best:
            push(bounds, stack, depth, base, bound, who, Cell(0, 0, kx + cx, ky + cy, kz + cz))
            depth += 1
    return depth


@kernel
def nearest(words, rows, tip, frames, answer):
    """Nearest pair of links, given as rows in their carriers' frames, and voxels at a tip pose and link frames."""
    shapes = np.empty(rows.shape)
    place(rows, tip, frames, shapes)
    forget(answer)
    search(words, shapes, answer)


@kernel
def search(words, shapes, answer):
    """Nearest pair of links that stand in the world and voxels, if it is nearer than what the answer holds."""
    if words[COUNT] > 0:
        simplex, work, pair, cube = np.empty((4, 6)), np.empty((16, 4)), np.empty(6), np.empty(ROW)
        bounds, stack = np.empty(PENDING + shapes.shape[0]), np.empty((PENDING + shapes.shape[0], 2), np.int64)
        search_through(words, shapes, Scratch(bounds, stack, cube, simplex, work, pair), answer)


@allocation_free_kernel
def search_through(words, shapes, scratch, answer):
    """The search itself, given the arrays that it works in."""
    edge, depth, bounds, stack = real(words[EDGE]), 0, scratch.bounds, scratch.stack
    x, y, z, hx, hy, hz = box_around(words, edge, ROOT, TOP + 1, 0, 0, 0)
    for who in range(shapes.shape[0]):
        s, gx, gy, gz = distance_to(shapes[who], x, y, z)
        bound = s - (abs(gx) * hx + abs(gy) * hy + abs(gz) * hz)
        push(bounds, stack, depth, 0, bound, who, Cell(ROOT, TOP + 1, 0, 0, 0))
        depth += 1
    while depth > 0 and answer[DISTANCE] > 0.0:
        depth -= 1
        best = answer[DISTANCE] - TOLERANCE
        if bounds[depth] >= best:
            continue
        node, who = stack[depth, 0] & 0xFFFFFFFF, stack[depth, 0] >> 32
        packed = stack[depth, 1]
        kx, ky, kz, level = packed & 0xFFFF, (packed >> 16) & 0xFFFF, (packed >> 32) & 0xFFFF, packed >> 48
        x, y, z, hx, hy, hz = box_around(words, edge, node, level, kx, ky, kz)
        shape = shapes[who]
        s, gx, gy, gz = distance_to(shape, x, y, z)
        if node == 0:
            take_cube(shape, who, Plane(gx, gy, gz, s), (x, y, z), hx, scratch, answer)
            continue
        if s - (abs(gx) * hx + abs(gy) * hy + abs(gz) * hz) >= best:
            continue
        plane, cell = Plane(gx, gy, gz, s - (gx * x + gy * y + gz * z)), Cell(node, level, kx, ky, kz)
        if level == 1:
            depth = expand_bottom(words, edge, who, cell, plane, best, scratch, depth)
        else:
            depth = expand(words, edge, who, cell, plane, best, scratch, depth)


@kernel
def nearest_batch(words, rows, tips, frames, answers):
    """The same at tip poses (n, 4, 4) and link frames (n, m, 4, 4); answers (n, 8)."""
    for i in range(tips.shape[0]):
        nearest(words, rows, tips[i], frames[i], answers[i])


@kernel
def nearest_among(shapes, pairs, answer):
    """Nearest of the given pairs (k, 2) of links that stand in the world; `WHO` is the pair's number."""
    forget(answer)
    simplex, work, pair = np.empty((4, 6)), np.empty((16, 4)), np.empty(6)
    for i in range(pairs.shape[0]):
        a, b = shapes[pairs[i, 0]], shapes[pairs[i, 1]]
        for k in range(3):
            simplex[0, k] = a[TRANSLATION + k] - b[TRANSLATION + k]
            simplex[0, 3 + k] = a[TRANSLATION + k]
        take_nearer(a, b, i, simplex, work, pair, answer)


@allocation_free_kernel
def nearest_to_plane(shapes, plane, answer):
    """Link that reaches farthest down to a plane: unit normal, then the distance of the plane from the origin."""
    forget(answer)
    lowest, x, y, z = np.inf, plane[0], plane[1], plane[2]
    for i in range(shapes.shape[0]):
        px, py, pz = support(shapes[i], -x, -y, -z)
        thick = margin(shapes[i])
        height = px * x + py * y + pz * z - plane[3] - thick
        if height < lowest:
            lowest, above = height, max(height, 0.0)
            px, py, pz = px - thick * x, py - thick * y, pz - thick * z
            record(answer, i, above, px, py, pz, px - above * x, py - above * y, pz - above * z)
