"""The largest ball that still hides, by branch and bound (kernels, private).

Space is split into eight, cell by cell, from the cells of the certificate's grid on. In a cell no ball is larger than
one about its middle can be and half the cell's diagonal. A ball about c of radius s hides within reach if a covering
ball of radius R > s holds it, whose middle q lies no nearer than R to any contact: |c - q| <= R - s =: t.
A contact nearer to c than R excludes a cap of the directions in which q could lie at the distance t, and no less of
them at a smaller distance. So the ball does not hide if such caps cover all directions but those in which no covering
ball comes from above.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.mapping.certificate_kernels import link_distance

BLOCK = 8
"""Rows of swept places that are looked at together: the nearest to a grid point is seldom the nearest to all of its
cell."""
MANY = 1_000_000
"""Cells looked at, from which on the smallest cells are larger in proportion: a wide plateau has that many."""
DEPTH = 256
"""Of the stacks: cells that wait, eight a level at most, and four of directions a level and face."""


@kernel
def segment_distance(x, y, z, a, b):
    """m from a point to the segment from a to b."""
    d0, d1, d2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    u, v, w = x - a[0], y - a[1], z - a[2]
    length2 = d0 * d0 + d1 * d1 + d2 * d2
    t = 0.0
    if length2 > 0.0:
        t = min(max((u * d0 + v * d1 + w * d2) / length2, 0.0), 1.0)
    u, v, w = u - t * d0, v - t * d1, w - t * d2
    return np.sqrt(u * u + v * v + w * w)


@kernel
def placed_distance(x, y, z, pose, kind, size):
    """m from a point to a link whose own frame lies at `pose` (4, 4); 0 inside."""
    x, y, z = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    return link_distance(u, v, w, kind, size)


@kernel
def nearest_index(at, origin, edge, count):
    """Of the grid, nearest to a coordinate."""
    return min(max(np.int64(np.round((at - origin) / edge)), 0), count - 1)


@kernel
def cap(x, y, z, contact, closed, t, caps, n):
    """Appends to `caps` what a contact excludes of the directions at the distance t: unit vector and least cosine.

    The number of caps, -1 where no direction is left. `closed` is the distance that a covering ball keeps.
    """
    u, v, w = contact[0] - x, contact[1] - y, contact[2] - z
    square = u * u + v * v + w * w
    if square >= closed * closed:
        return n
    length = np.sqrt(square)
    if t + length <= closed:
        return -1
    if t - length >= closed:
        return n
    caps[n, 0], caps[n, 1], caps[n, 2] = u / length, v / length, w / length
    caps[n, 3] = (t * t + square - closed * closed) / (2.0 * t * length)
    return n + 1


@kernel
def nearest_middle(x, y, z, gap, origin, edge):
    """m from a point to where the middle of a covering ball may lie, at least; `gap` as of `uncovered`."""
    nx, ny, nz = gap.shape
    i, j = nearest_index(x, origin[0], edge, nx), nearest_index(y, origin[1], edge, ny)
    k = nearest_index(z, origin[2], edge, nz)
    u, v, w = origin[0] + i * edge - x, origin[1] + j * edge - y, origin[2] + k * edge - z
    return gap[i, j, k] - np.sqrt(u * u + v * v + w * w) - 0.5 * np.sqrt(3.0) * edge


@kernel
def borders(x, y, z, t, least, low, high, caps, n):
    """Appends to `caps` the directions in which no middle lies between the corners `low` and `high` (3,).

    A middle lies from `least` to t m away. The number of caps, -1 where no direction is left.
    """
    for axis in range(3):
        at = x if axis == 0 else y if axis == 1 else z
        for sign in (-1.0, 1.0):
            room = high[axis] - at if sign > 0.0 else at - low[axis]
            if room <= -t:
                return -1
            if room >= least:
                continue
            caps[n, 0], caps[n, 1], caps[n, 2] = 0.0, 0.0, 0.0
            caps[n, axis] = sign
            caps[n, 3] = room / (t if room < 0.0 else least)
            n += 1
    return n


@kernel
def uncovered(x, y, z, t, shell, caps, count, order, gap, origin, edge, fine, stack):
    """Whether a direction is left in which the middle of a covering ball may lie within the distance t.

    `gap` (nx, ny, nz) is the distance [m] of each grid point from those about which such a middle may lie, none of
    which is nearer than t - shell. Directions are told apart down to `fine` m at that distance.
    """
    for n in range(count):
        order[n] = n
    top = 0
    for face in range(6):
        stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3], stack[top, 4] = face, 0.0, 0.0, 1.0, count
        top += 1
    while top > 0:
        top -= 1
        face, a, b, size, active = np.int64(stack[top, 0]), stack[top, 1], stack[top, 2], stack[top, 3], stack[top, 4]
        scale = 1.0 / np.sqrt(1.0 + a * a + b * b)
        side = scale if face < 3 else -scale
        if face % 3 == 0:
            d0, d1, d2 = side, a * scale, b * scale
        elif face % 3 == 1:
            d0, d1, d2 = b * scale, side, a * scale
        else:
            d0, d1, d2 = a * scale, b * scale, side
        chord = np.sqrt(2.0) * size  # onto the unit sphere everything shrinks
        px, py, pz = x + t * d0, y + t * d1, z + t * d2
        if nearest_middle(px, py, pz, gap, origin, edge) > shell + t * chord:
            continue
        cosine = 1.0 - 0.5 * chord * chord
        sine = chord * np.sqrt(max(1.0 - 0.25 * chord * chord, 0.0))
        kept, covered = 0, False
        for n in range(np.int64(active)):
            c = order[n]
            along = d0 * caps[c, 0] + d1 * caps[c, 1] + d2 * caps[c, 2]
            across = np.sqrt(max(1.0 - along * along, 0.0)) * sine
            if along > -cosine and along * cosine - across > caps[c, 3]:
                covered = True
                break
            if along >= cosine or along * cosine + across > caps[c, 3]:
                order[n], order[kept] = order[kept], c
                kept += 1
        if covered:
            continue
        if t * chord <= fine:
            return True
        half_size = 0.5 * size
        for quarter in range(4):
            stack[top, 0], stack[top, 3], stack[top, 4] = face, half_size, kept
            stack[top, 1] = a + (half_size if quarter & 1 else -half_size)
            stack[top, 2] = b + (half_size if quarter & 2 else -half_size)
            top += 1
    return False


@kernel
def within_reach(
    x, y, z, t, fine, contacts, first, last, closed, low, high, caps, order, gap, origin, edge, stack
):  # fmt: skip
    """Whether the middle of a covering ball may lie within the distance t of a point.

    Contacts are those from row `first` up to `last`; the others are as of `cap`, `borders` and `uncovered`.
    """
    least = max(nearest_middle(x, y, z, gap, origin, edge), 0.0)
    if least > t:
        return False
    n = borders(x, y, z, t, least, low, high, caps, 0)
    for row in range(first, last):
        if n < 0:
            return False
        n = cap(x, y, z, contacts[row], closed, t, caps, n)
    return n >= 0 and uncovered(x, y, z, t, t - least, caps, n, order, gap, origin, edge, fine, stack)


@kernel
def largest_within_reach(x, y, z, least, most, cover, reach, about):
    """m, of the balls with radii between `least` and `most` about points no farther than `reach` from a place.

    `about` is what `within_reach` takes after `fine`. Of `least` is known that it is within reach; a ball wider than
    `cover` needs no covering one.
    """
    fine = max(2.0 * reach, 0.01 * cover)
    while most < cover and most - least > 0.125 * fine:
        middle = 0.5 * (least + most)
        if within_reach(x, y, z, cover - middle + reach, fine, *about):
            least = middle
        else:
            most = middle
    return most


@kernel
def contacts_about(x, reach, contacts):
    """First row of the contacts no farther than `reach` from x, and the row after the last."""
    return np.searchsorted(contacts[:, 0], x - reach), np.searchsorted(contacts[:, 0], x + reach)


@kernel
def outside(x, y, z, lower, upper):
    """m from a point to the area; inside it less than 0, by the distance from the border."""
    u, v = max(lower[0] - x, x - upper[0]), max(lower[1] - y, y - upper[1])
    w = max(lower[2] - z, z - upper[2])
    beyond = max(u, v, w)
    return np.sqrt(max(u, 0.0) ** 2 + max(v, 0.0) ** 2 + max(w, 0.0) ** 2) if beyond > 0.0 else beyond


@kernel
def blocks_about(i, j, k, owners, kinds, found):
    """Blocks of rows that hold what is nearest to a grid point or one of its 26 neighbours; how many.

    `owners` are numbers row * kinds + kind, negative where nothing is near; `found` rows are block and kind.
    """
    nx, ny, nz = owners.shape
    n = 0
    for a in range(max(i - 1, 0), min(i + 2, nx)):
        for b in range(max(j - 1, 0), min(j + 2, ny)):
            for c in range(max(k - 1, 0), min(k + 2, nz)):
                owner = owners[a, b, c]
                if owner < 0:
                    continue
                row, kind = owner // kinds, owner % kinds
                for shift in (-BLOCK // 2, BLOCK // 2):
                    block = (row + shift) // BLOCK
                    known = block < 0
                    for m in range(n):
                        known = known or (found[m, 0] == block and found[m, 1] == kind)
                    if not known:
                        found[n, 0], found[n, 1] = block, kind
                        n += 1
    return n


@kernel
def largest_hidden(
    cells, bounds, sizes, gap, owners, origin, edge, begins, ends, radius, placed, kinds, extents, shrink, contacts,
    lower, upper, deepest, low, high, cover, closed, finest, share,
):  # fmt: skip
    """(5,): m, radius of a ball such that no larger one hides, about its place; and how many cells were looked at.

    Parameters
    ----------
    cells : (m, 3) of the grid, those with the largest `bounds` (m,) first: m, of the balls about points in them
    sizes : (nx, ny, nz) m, of the balls about the grid points, by all that is not looked at here
    gap : (nx, ny, nz) m from each grid point to those about which the middle of a covering ball may lie
    owners : (nx, ny, nz) what was swept nearest, as of `blocks_about`; kind 0 is the sphere
    begins, ends, radius : (n, 3) and m, of the swept sphere's segments
    placed : (n, links, 4, 4) the links' own frames
    kinds, extents, shrink : of the links, as of `lower_to_link`
    contacts : (k, 3) m, in the order of x
    lower, upper, deepest : m, the area; how far outside it a ball's middle may lie, less its radius
    low, high : (3,) m, between which the middle of a covering ball lies
    cover, closed : m, radius of a covering ball, and distance that its middle keeps from contacts
    finest, share : m, and share of a ball's radius: half the diagonal of the smallest cells
    """
    best = np.zeros(5)
    count = len(contacts)
    caps, order, directions = np.empty((count + 6, 4)), np.empty(count + 6, np.int64), np.empty((DEPTH, 5))
    blocks, stack = np.empty((54, 2), np.int64), np.empty((DEPTH, 5))
    near, number = np.empty((54 * BLOCK, 2), np.int64), 0
    half = 0.5 * np.sqrt(3.0) * edge
    # What hides about a grid point: with that to begin with, few cells are split that hold nothing as large.
    for m in range(len(cells)):
        if bounds[m] - half <= best[0]:
            break
        x, y = origin[0] + cells[m, 0] * edge, origin[1] + cells[m, 1] * edge
        z = origin[2] + cells[m, 2] * edge
        first, last = contacts_about(x, closed, contacts)
        about = contacts, first, last, closed, low, high, caps, order, gap, origin, edge, directions
        if best[0] >= cover or within_reach(x, y, z, cover - best[0], 0.01 * cover, *about):
            best[0] = largest_within_reach(x, y, z, best[0], bounds[m] - half, cover, 0.0, about)
            best[1], best[2], best[3] = x, y, z
    for m in range(len(cells)):
        if bounds[m] <= best[0]:
            break
        i, j, k = cells[m, 0], cells[m, 1], cells[m, 2]
        gx, gy, gz = origin[0] + i * edge, origin[1] + j * edge, origin[2] + k * edge
        first, last = contacts_about(gx, closed + half, contacts)
        about = contacts, first, last, closed, low, high, caps, order, gap, origin, edge, directions
        number = 0
        for n in range(blocks_about(i, j, k, owners, len(kinds) + 1, blocks)):
            rows = len(begins) if blocks[n, 1] == 0 else len(placed)
            for row in range(BLOCK * blocks[n, 0], min(BLOCK * blocks[n, 0] + BLOCK, rows)):
                near[number, 0], near[number, 1] = row, blocks[n, 1]
                number += 1
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = gx, gy, gz, edge, number
        top = 1
        while top > 0:
            top -= 1
            x, y, z, width, active = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3], stack[top, 4]
            best[4] += 1
            reach = 0.5 * np.sqrt(3.0) * width
            off = np.sqrt((x - gx) ** 2 + (y - gy) ** 2 + (z - gz) ** 2)
            size = min(sizes[i, j, k] + off, deepest - outside(x, y, z, lower, upper))
            if size + reach <= best[0]:
                continue
            # What may be nearest somewhere in the cell comes to the front, for the cells within it.
            kept = 0
            for n in range(np.int64(active)):
                row, kind = near[n, 0], near[n, 1]
                if kind == 0:
                    distance = segment_distance(x, y, z, begins[row], ends[row]) - radius
                else:
                    distance = placed_distance(x, y, z, placed[row, kind - 1], kinds[kind - 1], extents[kind - 1])
                    distance += shrink
                if distance <= size + 2.0 * reach:
                    near[n, 0], near[n, 1] = near[kept, 0], near[kept, 1]
                    near[kept, 0], near[kept, 1] = row, kind
                    kept += 1
                    size = min(size, distance)
            size += reach
            if size <= best[0]:
                continue
            fine = max(2.0 * reach, 0.01 * cover)
            if best[0] < cover and not within_reach(x, y, z, cover - best[0] + reach, fine, *about):
                continue
            if reach > max(finest, share * size * max(best[4] / MANY, 1.0)):
                width *= 0.5
                for eighth in range(8):
                    stack[top, 0] = x + (0.5 * width if eighth & 1 else -0.5 * width)
                    stack[top, 1] = y + (0.5 * width if eighth & 2 else -0.5 * width)
                    stack[top, 2] = z + (0.5 * width if eighth & 4 else -0.5 * width)
                    stack[top, 3], stack[top, 4] = width, kept
                    top += 1
                continue
            best[0] = largest_within_reach(x, y, z, best[0], size, cover, reach, about)
            best[1], best[2], best[3] = x, y, z
    return best
