"""A set of voxels as a 64-tree on one flat array (kernels, private).

Each node splits its cube into 4 x 4 x 4. An inner node is a mask word (bit c: child c has voxels) and 64 links of 32
bits in the 32 words behind it, two a word, the even child's in the low half. A link is the child's place in the array,
or `FULL` when every voxel of the child's cube is set. A bottom node is one word: bit c is voxel c. All 64 of them stand
behind their parent's mask themselves, where a link would: neighbours share cache lines. Child c stands for
x + 4 y + 16 z of the two key bits of its level. Keys and their range are OctoMap's: floor(x / edge) + 32768, 16 bits an
axis, so eight levels. Nodes are never taken away, and a node whose cube has filled up is replaced by `FULL`, so that
equal sets of voxels have trees of equal shape.

Most ways to a voxel begin at the same few nodes above the bottom ones, so an index leads to these: `NEAR` entries ahead
of the root, one for each 16 x 16 x 16 pattern of their keys' last four bits, hold the node met last and its whole key.
An object of up to 256 voxels an axis has an entry for each of its nodes; beyond, and on a miss, the way begins at the
root. A node that was replaced by `FULL` stays where it was, full, so no entry ever misleads.

`words` is int64 throughout: mixed with uint64, sums would turn into floats. No array is viewed or sliced on the way to
a voxel: that costs more than the way.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel, kernel

USED = 0  # words in use
COUNT = 1  # voxels set
NODES = 2  # nodes made
SCALE = 3  # float64, 1 / edge
EDGE = 4  # float64, m
LOWER = 5  # three words: smallest key set on each axis
UPPER = 8  # three words: largest key set on each axis
INDEX = 11
NEAR = 4096
ROOT = INDEX + NEAR

INNER_WORDS = 33
LOW_WORDS = 65  # of an inner node of level 1
TOP = 7  # level of the root
FULL = -1  # link of a child whose cube is set throughout
CENTRE_KEY = 32768
KEYS = 65536
SPARE = (TOP - 2) * INNER_WORDS + LOW_WORDS  # words that one voxel can need
PLACE_BITS = 28  # of an index entry; the other 36 are the key of a node of level 1

KNOWN, NEW, OUTSIDE, NO_CAPACITY = 0, 1, -1, -2

_ONE, _TWO, _FOUR, _LAST = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)
_PAIRS, _FOURS = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333)
_BYTES, _SUM = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x0101010101010101)


@kernel
def bit_count(word):
    """Number of bits set in a 64-bit word; in this form the compiler makes it one instruction."""
    rest = np.uint64(word)
    rest = rest - ((rest >> _ONE) & _PAIRS)
    rest = (rest & _FOURS) + ((rest >> _TWO) & _FOURS)
    rest = (rest + (rest >> _FOUR)) & _BYTES
    return np.int64((rest * _SUM) >> _LAST)


@kernel
def lowest_bit(word):
    """Index of the lowest bit set; 64 for 0."""
    return bit_count((word & -word) - 1)


@allocation_free_kernel
def clear(words, edge):
    """Make `words` an empty tree with voxels of `edge` metres."""
    reals = words.view(np.float64)
    words[: ROOT + INNER_WORDS] = 0
    words[USED] = ROOT + INNER_WORDS
    words[NODES] = 1
    reals[SCALE] = 1.0 / edge
    reals[EDGE] = edge
    words[LOWER : LOWER + 3] = KEYS
    words[UPPER : UPPER + 3] = -1


@kernel
def key_of(x, scale):
    """Key of a coordinate, -1 outside the range and for NaN. A product with 1 / edge, as in OctoMap, for equal keys."""
    place = np.floor(x * scale)
    if place >= -CENTRE_KEY and place < CENTRE_KEY:
        return np.int64(place) + CENTRE_KEY
    return np.int64(-1)


@kernel
def child_of(kx, ky, kz, level):
    """Index of the child on the way to a key, seen from a node of `level`."""
    shift = 2 * level
    return ((kz >> shift) & 3) << 4 | ((ky >> shift) & 3) << 2 | ((kx >> shift) & 3)


@kernel
def real(word):
    """A word that holds a float."""
    return np.int64(word).view(np.float64)


@allocation_free_kernel
def link_at(words, node, child, level):
    """Link of a child of an inner node of `level`."""
    if level == 1:
        place = node + 1 + child
        return np.int64(FULL) if words[place] == -1 else place
    # half a word, selected by a shift, since a branch on the child's number cannot be predicted
    return (words[node + 1 + (child >> 1)] << (32 - ((child & 1) << 5))) >> 32


@allocation_free_kernel
def set_link(words, node, child, place):
    """Make `place` the link of a child of a node above level 1."""
    word = node + 1 + (child >> 1)
    if child & 1:
        words[word] = (words[word] & 0xFFFFFFFF) | place << 32
    else:
        words[word] = (words[word] >> 32) << 32 | (place & 0xFFFFFFFF)


@allocation_free_kernel
def enter(words, node, child, level):
    """Place of a child of an inner node of `level`, made where there is none; `FULL` where that is its link."""
    bit = np.int64(1) << child
    if words[node] & bit:
        return link_at(words, node, child, level)
    words[node] |= bit
    words[NODES] += 1
    if level == 1:
        return node + 1 + child
    place = words[USED]
    size = INNER_WORDS if level > 2 else LOW_WORDS
    words[place : place + size] = 0
    words[USED] = place + size
    set_link(words, node, child, place)
    return place


@allocation_free_kernel
def is_full(words, node, level):
    """Whether every voxel of a node's cube is set."""
    if words[node] != -1:
        return False
    if level > 0:
        for word in words[node + 1 : node + (INNER_WORDS if level > 1 else LOW_WORDS)]:
            if word != -1:  # two links, both FULL, or a bottom node
                return False
    return True


@allocation_free_kernel
def collapse(words, kx, ky, kz, level):
    """Replace the full node of `level` on the way to a key by `FULL`, then its parents as long as they are full."""
    while level < TOP:
        node = np.int64(ROOT)
        for above in range(TOP, level + 1, -1):
            node = link_at(words, node, child_of(kx, ky, kz, above), above)
        child = child_of(kx, ky, kz, level + 1)
        if level > 0:  # a full bottom node is its own link
            if not is_full(words, link_at(words, node, child, level + 1), level):
                return
            set_link(words, node, child, FULL)
        level += 1


@allocation_free_kernel
def reach_node(words, kx, ky, kz, level):
    """Node of `level` on the way to a key, made where there is none, or `FULL`."""
    node = np.int64(ROOT)
    for above in range(TOP, level, -1):
        node = enter(words, node, child_of(kx, ky, kz, above), above)
        if node == FULL:
            break
    return node


@kernel
def entry_of(kx, ky, kz):
    """Where the index would have the node of level 1 on the way to a key, and the entry but for the node's place."""
    slot = INDEX + ((kx >> 4) & 15 | ky & 0xF0 | (kz & 0xF0) << 4)
    return slot, ((kz >> 4) << 24 | (ky >> 4) << 12 | kx >> 4) << PLACE_BITS


@allocation_free_kernel
def indexed(words, slot, key):
    """Place of a node of level 1 by the index, 0 where the index does not hold it."""
    place = words[slot] ^ key
    return place if place >> PLACE_BITS == 0 else np.int64(0)


@allocation_free_kernel
def enter_near(words, kx, ky, kz):
    """Node of level 1 on the way to a key, made where there is none and put into the index, or `FULL`."""
    slot, key = entry_of(kx, ky, kz)
    node = indexed(words, slot, key)
    if node == 0:
        node = reach_node(words, kx, ky, kz, 1)
        if node != FULL:
            words[slot] = key | node
    return node


@allocation_free_kernel
def widen(words, kx, ky, kz, size):
    """Take a cube of `size` voxels from a key upwards into the bounds."""
    words[LOWER] = min(words[LOWER], kx)
    words[LOWER + 1] = min(words[LOWER + 1], ky)
    words[LOWER + 2] = min(words[LOWER + 2], kz)
    words[UPPER] = max(words[UPPER], kx + size - 1)
    words[UPPER + 1] = max(words[UPPER + 1], ky + size - 1)
    words[UPPER + 2] = max(words[UPPER + 2], kz + size - 1)


@allocation_free_kernel
def insert_key(words, kx, ky, kz):
    """Set one voxel: NEW, KNOWN or NO_CAPACITY."""
    if words.size - words[USED] < SPARE:
        return NO_CAPACITY
    node = enter_near(words, kx, ky, kz)
    if node == FULL:
        return KNOWN
    child, bit = child_of(kx, ky, kz, 1), np.int64(1) << child_of(kx, ky, kz, 0)
    voxels = words[node + 1 + child]
    if voxels & bit:
        return KNOWN
    if voxels == 0:
        enter(words, node, child, 1)
    words[node + 1 + child] = voxels | bit
    words[COUNT] += 1
    widen(words, kx, ky, kz, 1)
    if voxels | bit == -1:
        collapse(words, kx, ky, kz, 0)
    return NEW


@allocation_free_kernel
def insert_point(words, x, y, z):
    """Set the voxel of one point: NEW, KNOWN, OUTSIDE or NO_CAPACITY."""
    scale = real(words[SCALE])
    kx, ky, kz = key_of(x, scale), key_of(y, scale), key_of(z, scale)
    if kx < 0 or ky < 0 or kz < 0:
        return OUTSIDE
    return insert_key(words, kx, ky, kz)


@allocation_free_kernel
def insert_points(words, points, first):
    """Set the voxels of points[first:]; number of the first point that did not fit, or the number of points."""
    scale = real(words[SCALE])
    for i in range(first, points.shape[0]):
        kx, ky, kz = key_of(points[i, 0], scale), key_of(points[i, 1], scale), key_of(points[i, 2], scale)
        if insert_key(words, kx, ky, kz) == NO_CAPACITY:
            return i
    return points.shape[0]


@allocation_free_kernel
def first_outside(words, points):
    """Row of the first point that is NaN or outside the range of keys, -1 where all are inside."""
    scale = real(words[SCALE])
    for i in range(points.shape[0]):
        if min(key_of(points[i, 0], scale), key_of(points[i, 1], scale), key_of(points[i, 2], scale)) < 0:
            return i
    return -1


@allocation_free_kernel
def fill_cube(words, kx, ky, kz, depth):
    """Set an octree cube of 2^depth voxels' edge that holds nothing yet: NEW or NO_CAPACITY."""
    if words.size - words[USED] < SPARE:
        return NO_CAPACITY
    level = min(depth >> 1, TOP)
    node = reach_node(words, kx, ky, kz, level)
    first, span = child_of(kx, ky, kz, level), 1 << (depth - 2 * level)
    for part in range(span * span * span):
        child = first + part % span + 4 * (part // span % span) + 16 * (part // (span * span))
        words[node] |= np.int64(1) << child
        if level > 1:
            set_link(words, node, child, FULL)
        elif level == 1:
            words[node + 1 + child] = FULL
    words[COUNT] += np.int64(1) << (3 * depth)
    widen(words, kx, ky, kz, np.int64(1) << depth)
    if is_full(words, node, level):
        collapse(words, kx, ky, kz, level)
    return NEW


@allocation_free_kernel
def find_near(words, kx, ky, kz):
    """Node of level 1 on the way to a key, `FULL`, or 0 where there is none."""
    slot, key = entry_of(kx, ky, kz)
    node = indexed(words, slot, key)
    if node != 0:
        return node
    node = np.int64(ROOT)
    for level in range(TOP, 1, -1):
        child = child_of(kx, ky, kz, level)
        if not (words[node] >> child) & 1:
            return np.int64(0)
        node = link_at(words, node, child, level)
        if node == FULL:
            break
    return node


@allocation_free_kernel(forceinline=True)
def holds_key(words, kx, ky, kz):
    """Whether a voxel is set."""
    node = find_near(words, kx, ky, kz)
    if node <= 0:
        return node == FULL
    voxels = words[node + 1 + child_of(kx, ky, kz, 1)]
    return ((voxels >> child_of(kx, ky, kz, 0)) & 1) == 1


@allocation_free_kernel
def holds_point(words, x, y, z):
    """Whether the voxel of a point is set, None outside: Python is handed the answer itself."""
    scale = real(words[SCALE])
    kx, ky, kz = key_of(x, scale), key_of(y, scale), key_of(z, scale)
    if kx < 0 or ky < 0 or kz < 0:
        return None
    return holds_key(words, kx, ky, kz)


@allocation_free_kernel
def states_of(occupied, carved, points, states):
    """states[i] = 2 occupied, 1 free, 0 unknown; row of the first point outside the range, where it ends, or -1."""
    scale = real(occupied[SCALE])
    for i in range(points.shape[0]):
        kx, ky, kz = key_of(points[i, 0], scale), key_of(points[i, 1], scale), key_of(points[i, 2], scale)
        if kx < 0 or ky < 0 or kz < 0:
            return i
        if holds_key(occupied, kx, ky, kz):
            states[i] = 2
        elif holds_key(carved, kx, ky, kz):
            states[i] = 1
        else:
            states[i] = 0
    return -1


@kernel
def gap(place, low, size):
    """Distance along one axis, in voxels, from a place to the nearest voxel centre low .. low + size - 1."""
    return max(low - place, 0.0, place - (low + size - 1))


@kernel
def nearest_voxel(words, point, centre):
    """Distance from a point (3,) to the nearest centre of a set voxel, put into `centre`; inf for none, or OUTSIDE.

    Depth first, nearest child first. Bounds are exact squared distances, in voxels, to a cube's voxel centres.
    """
    scale, edge = real(words[SCALE]), real(words[EDGE])
    x, y, z = point[0], point[1], point[2]
    px = x * scale + (CENTRE_KEY - 0.5)
    py = y * scale + (CENTRE_KEY - 0.5)
    pz = z * scale + (CENTRE_KEY - 0.5)
    if min(key_of(x, scale), key_of(y, scale), key_of(z, scale)) < 0:
        return float(OUTSIDE)
    bounds = np.empty(64 * (TOP + 1))
    stack = np.empty((64 * (TOP + 1), 5), np.int64)  # node, level, keys of its lowest corner
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = ROOT, TOP, 0, 0, 0
    bounds[0] = 0.0
    depth = 1
    best, bx, by, bz = np.inf, 0.0, 0.0, 0.0
    while depth > 0:
        depth -= 1
        if bounds[depth] >= best:
            continue
        node, level = stack[depth, 0], stack[depth, 1]
        kx, ky, kz = stack[depth, 2], stack[depth, 3], stack[depth, 4]
        base = depth
        size = np.int64(1) << (2 * level)
        rest = words[node]
        while rest != 0:
            child = lowest_bit(rest)
            rest &= rest - 1
            cx = kx + (child & 3) * size
            cy = ky + ((child >> 2) & 3) * size
            cz = kz + (child >> 4) * size
            bound = gap(px, cx, size) ** 2 + gap(py, cy, size) ** 2 + gap(pz, cz, size) ** 2
            if bound >= best:
                continue
            link = FULL if level == 0 else link_at(words, node, child, level)
            if link == FULL:
                best = bound
                bx = min(max(np.rint(px), cx), cx + size - 1)
                by = min(max(np.rint(py), cy), cy + size - 1)
                bz = min(max(np.rint(pz), cz), cz + size - 1)
                continue
            slot = depth
            while slot > base and bounds[slot - 1] < bound:
                bounds[slot] = bounds[slot - 1]
                for i in range(5):
                    stack[slot, i] = stack[slot - 1, i]
                slot -= 1
            bounds[slot] = bound
            stack[slot, 0], stack[slot, 1], stack[slot, 2], stack[slot, 3], stack[slot, 4] = link, level - 1, cx, cy, cz
            depth += 1
    if best == np.inf:
        centre[:] = np.nan
        return np.inf
    centre[0] = (bx - CENTRE_KEY + 0.5) * edge
    centre[1] = (by - CENTRE_KEY + 0.5) * edge
    centre[2] = (bz - CENTRE_KEY + 0.5) * edge
    return np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2)


@allocation_free_kernel
def expand(cubes, sizes, edge, centres):
    """Centres of all voxels in cubes given by their lowest keys (n, 3) and edges in voxels (n,)."""
    row = 0
    for i in range(cubes.shape[0]):
        for dz in range(sizes[i]):
            for dy in range(sizes[i]):
                for dx in range(sizes[i]):
                    centres[row, 0] = (cubes[i, 0] + dx - CENTRE_KEY + 0.5) * edge
                    centres[row, 1] = (cubes[i, 1] + dy - CENTRE_KEY + 0.5) * edge
                    centres[row, 2] = (cubes[i, 2] + dz - CENTRE_KEY + 0.5) * edge
                    row += 1
