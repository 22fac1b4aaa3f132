"""Between the two bit trees of a map (occupied, carved) and OctoMap's octree (kernels, private).

A node of the 64-tree spans two octree levels: itself, and its eight groups of 2 x 2 x 2 children. A cube counts as
occupied where its voxels all are, as free where all are carved and none is occupied, else as unknown or mixed.

Octree records come in OctoMap's order, a parent before its children, children by index (bit 0 = x, 1 = y, 2 = z):
`places`: key x, y, z (16 bits each), edge as a power of two (5 bits), strongest state inside (2 bits)
`codes`: two bits a child, low bits first: 0 unknown, 1 free leaf, 2 occupied leaf, 3 has children; 0 for a leaf
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel
from lwrprobe.mapping.kernels import FULL, NO_CAPACITY, ROOT, SPARE, TOP, USED, fill_cube, link_at

UNKNOWN, FREE, OCCUPIED, MIXED = 0, 1, 2, 3
ABSENT = 0  # link of a child that holds nothing
DONE, CUT_SHORT, TOO_DEEP, NO_NUMBER = 0, 1, 2, 3
LEVELS = 2 * (TOP + 1)
STACK = 8 * LEVELS + 8
NODE, GROUP, LEAF = 0, 1, 2


@kernel
def link_of(words, node, level, child):
    """Link of one child of a node, where the node may itself be `FULL` or `ABSENT`."""
    if node in (FULL, ABSENT):
        return node
    if not (words[node] >> child) & 1:
        return np.int64(ABSENT)
    if level == 0:
        return np.int64(FULL)
    return link_at(words, node, child, level)


@kernel
def state_of(occupied, carved):
    """State of a cube from its links in the two trees."""
    if occupied == FULL:
        return OCCUPIED
    if occupied != ABSENT:
        return MIXED
    if carved == FULL:
        return FREE
    return UNKNOWN if carved == ABSENT else MIXED


@kernel
def child_in_group(group, part):
    """Child index (4 x 4 x 4) of one of the eight parts of one of the eight groups."""
    x = 2 * (group & 1) + (part & 1)
    y = (group & 2) + ((part >> 1) & 1)
    z = 2 * (group >> 2) + (part >> 2)
    return x + 4 * y + 16 * z


@kernel
def group_code(occupied, carved, node, other, level, group):
    """Codes of a group's eight children."""
    code = 0
    for part in range(8):
        child = child_in_group(group, part)
        state = state_of(link_of(occupied, node, level, child), link_of(carved, other, level, child))
        code |= state << (2 * part)
    return code


@kernel
def uniform(code):
    """State that all eight children share, MIXED where they differ."""
    state = code & 3
    return state if code == state * 0x5555 else MIXED


@kernel
def octree(occupied, carved, places, codes):
    """Write the octree's records as far as they fit; their number. An empty map has none."""
    if occupied[ROOT] == 0 and carved[ROOT] == 0:
        return 0
    stack = np.empty((STACK, 8), np.int64)  # kind, level, x, y, z, then node, other, group or state
    stack[0] = 0
    stack[0, 1], stack[0, 5], stack[0, 6] = TOP, ROOT, ROOT
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        kind, level = stack[depth, 0], stack[depth, 1]
        kx, ky, kz = stack[depth, 2], stack[depth, 3], stack[depth, 4]
        node, other, group = stack[depth, 5], stack[depth, 6], stack[depth, 7]
        code, strongest, power = 0, FREE, 2 * level + 2
        if kind == LEAF:
            strongest, power = group, level
        else:
            if kind == GROUP:
                power -= 1
                code = group_code(occupied, carved, node, other, level, group)
            half = np.int64(1) << (power - 1)
            for part in range(7, -1, -1):
                child, inner, outer = part, node, other
                if kind == NODE:
                    below = group_code(occupied, carved, node, other, level, part)
                    state = uniform(below)
                    code |= state << (2 * part)
                    if below & 0xAAAA:  # MIXED or OCCUPIED somewhere; MIXED may still be all free
                        strongest = max(strongest, holds_occupied(occupied, node, level, part))
                else:
                    child = child_in_group(group, part)
                    state = (code >> (2 * part)) & 3
                    inner = link_of(occupied, node, level, child)
                    outer = link_of(carved, other, level, child)
                    if inner != ABSENT:
                        strongest = OCCUPIED
                if state == UNKNOWN:
                    continue
                stack[depth, 2] = kx + (part & 1) * half
                stack[depth, 3] = ky + ((part >> 1) & 1) * half
                stack[depth, 4] = kz + (part >> 2) * half
                stack[depth, 5], stack[depth, 6] = inner, outer
                if state != MIXED:
                    stack[depth, 0], stack[depth, 1], stack[depth, 7] = LEAF, power - 1, state
                elif kind == NODE:
                    stack[depth, 0], stack[depth, 1], stack[depth, 7] = GROUP, level, part
                else:
                    stack[depth, 0], stack[depth, 1], stack[depth, 7] = NODE, level - 1, 0
                depth += 1
        if count < places.size:
            places[count] = kx | ky << 16 | kz << 32 | power << 48 | np.int64(strongest) << 53
            codes[count] = code
        count += 1
    return count


@kernel
def holds_occupied(occupied, node, level, group):
    """OCCUPIED where a group has an occupied voxel, else FREE."""
    for part in range(8):
        if link_of(occupied, node, level, child_in_group(group, part)) != ABSENT:
            return OCCUPIED
    return FREE


@kernel
def has_capacity(words):
    """Whether eight cubes can be filled without growing."""
    return words.size - words[USED] >= 8 * SPARE


@kernel
def push(state, kx, ky, kz, power):
    """Remember a node that is still to be read. `state`: bytes read, nodes seen, stack height, then packed nodes."""
    state[3 + state[2]] = kx | ky << 16 | kz << 32 | power << 48
    state[2] += 1


@kernel
def read_bt(data, occupied, carved, state):
    """Decode the binary part of a `.bt` from where `state` stands; DONE, NO_CAPACITY (grow, call again) or an error."""
    while state[2] > 0:
        if not (has_capacity(occupied) and has_capacity(carved)):
            return NO_CAPACITY
        at = state[0]
        if at + 2 > data.size:
            return CUT_SHORT
        state[2] -= 1
        packed = state[3 + state[2]]
        kx, ky, kz, power = packed & 0xFFFF, (packed >> 16) & 0xFFFF, (packed >> 32) & 0xFFFF, packed >> 48
        code = np.int64(data[at]) | np.int64(data[at + 1]) << 8
        half = np.int64(1) << (power - 1)
        for part in range(7, -1, -1):
            child = (code >> (2 * part)) & 3
            if child == UNKNOWN:
                continue
            x, y, z = kx + (part & 1) * half, ky + ((part >> 1) & 1) * half, kz + (part >> 2) * half
            state[1] += 1
            if child == OCCUPIED:
                fill_cube(occupied, x, y, z, power - 1)
            elif child == FREE:
                fill_cube(carved, x, y, z, power - 1)
            elif power == 1:
                return TOO_DEEP
            else:
                push(state, x, y, z, power - 1)
        state[0] = at + 2
    return DONE


@kernel
def read_ot(data, occupied, carved, state):
    """Decode the binary part of a `.ot` likewise: float32 log-odds and one byte of children a node."""
    real = np.empty(1, np.float32)
    raw = real.view(np.uint8)
    while state[2] > 0:
        if not (has_capacity(occupied) and has_capacity(carved)):
            return NO_CAPACITY
        at = state[0]
        if at + 5 > data.size:
            return CUT_SHORT
        state[2] -= 1
        packed = state[3 + state[2]]
        kx, ky, kz, power = packed & 0xFFFF, (packed >> 16) & 0xFFFF, (packed >> 32) & 0xFFFF, packed >> 48
        raw[:] = data[at : at + 4]
        children = np.int64(data[at + 4])
        if np.isnan(real[0]):
            return NO_NUMBER
        if children == 0:
            if real[0] >= 0.0:
                fill_cube(occupied, kx, ky, kz, power)
            else:
                fill_cube(carved, kx, ky, kz, power)
        elif power == 0:
            return TOO_DEEP
        half = np.int64(1) << max(power - 1, 0)
        for part in range(7, -1, -1):
            if (children >> part) & 1:
                state[1] += 1
                push(state, kx + (part & 1) * half, ky + ((part >> 1) & 1) * half, kz + (part >> 2) * half, power - 1)
        state[0] = at + 5
    return DONE
