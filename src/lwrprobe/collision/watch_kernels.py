"""The most urgent of several groups of links, for repeated queries (kernels, private).

From one call to the next little changes, and that is used twice. A group cannot have come nearer than its distance then
less the travel of its farthest point since: while that bound says enough, nothing is measured. And the place on the map
that was nearest then is a first answer now.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.collision.clearance_kernels import (
    ANSWER,
    DISTANCE,
    ON_MAP,
    forget,
    nearest_among,
    nearest_to_plane,
    record,
    search,
)
from lwrprobe.collision.shape_kernels import ROW, distance_to, place
from lwrprobe.compiled import allocation_free_kernel, kernel
from lwrprobe.mapping.kernels import COUNT

# A group in numbers: what its links keep a distance from, which distance [m], their rows and pairs, how many voxels
# there were when it was measured (NaN before that), the smallest distance ever, a bound of the distance now, a plane,
# the last answer, and what that stands on: of each carrier the farthest reach of a link (-1 where it carries none) and
# the pose then, as rotation (9) and translation (3).
KIND, KEEP, FIRST, LAST, FIRST_PAIR, LAST_PAIR, SEEN, LEAST, LOW, PLANE = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
HELD = PLANE + 4
CARRIERS = HELD + ANSWER
CARRIER, TURNED, MOVED = 13, 1, 10

MAP, TABLE, EACH_OTHER = 0.0, 1.0, 2.0

ENOUGH = 0.5
"""A bound that is a smaller share of the distance measured last is measured anew."""


@allocation_free_kernel
def motion_since(group, tip, frames):
    """Upper bound of how much nearer the group may have come since it was measured."""
    travel = 0.0
    for c in range((group.size - CARRIERS) // CARRIER):
        at = CARRIERS + c * CARRIER
        if group[at] < 0.0:
            continue
        pose = tip if c == 0 else frames[c - 1]
        shift, turn = 0.0, 0.0
        for i in range(3):
            shift += (pose[i, 3] - group[at + MOVED + i]) ** 2
            for j in range(3):
                turn += (pose[i, j] - group[at + TURNED + 3 * i + j]) ** 2
        # no vector grows, from one rotation to another, by more than the root of half the sum of squares
        travel = max(travel, np.sqrt(shift) + group[at] * np.sqrt(0.5 * turn))
    return 2.0 * travel if group[KIND] == EACH_OTHER else travel  # two links may move towards each other


@allocation_free_kernel
def stand(group, tip, frames):
    """Store the present poses of the carriers."""
    for c in range((group.size - CARRIERS) // CARRIER):
        at = CARRIERS + c * CARRIER
        pose = tip if c == 0 else frames[c - 1]
        for i in range(3):
            group[at + MOVED + i] = pose[i, 3]
            for j in range(3):
                group[at + TURNED + 3 * i + j] = pose[i, j]


@kernel
def measure_to_map(words, shapes, held):
    """Nearest pair of links and voxels, starting from the last answer."""
    x, y, z = held[ON_MAP], held[ON_MAP + 1], held[ON_MAP + 2]
    forget(held)
    if x == x:  # not NaN: a place in a voxel, and voxels stay
        for who in range(shapes.shape[0]):
            s, gx, gy, gz = distance_to(shapes[who], x, y, z)
            if s <= 0.0:
                record(held, who, 0.0, x, y, z, x, y, z)
                break
            if s < held[DISTANCE]:
                record(held, who, s, x - s * gx, y - s * gy, z - s * gz, x, y, z)
    search(words, shapes, held)


@kernel
def measure(words, rows, pairs, group, tip, frames):
    """Put the nearest pair of a group's links and what they keep a distance from into its memory."""
    first, last = np.int64(group[FIRST]), np.int64(group[LAST])
    shapes = np.empty((last - first, ROW))
    place(rows[first:last], tip, frames, shapes)
    held = group[HELD : HELD + ANSWER]
    if group[KIND] == MAP:
        measure_to_map(words, shapes, held)
    elif group[KIND] == TABLE:
        nearest_to_plane(shapes, group[PLANE : PLANE + 4], held)
    else:
        nearest_among(shapes, pairs[np.int64(group[FIRST_PAIR]) : np.int64(group[LAST_PAIR])], held)
    stand(group, tip, frames)
    group[SEEN], group[LOW] = words[COUNT], held[DISTANCE]
    group[LEAST] = min(group[LEAST], held[DISTANCE])


@allocation_free_kernel
def estimate(words, group, tip, frames):
    """Bound the group's distance from below; whether the bound says enough: no threat, no new smallest distance, and
    not much less than there is.
    """
    if group[SEEN] != (words[COUNT] if group[KIND] == MAP else group[SEEN]):  # as is a NaN from itself
        return False
    distance = group[HELD + DISTANCE]
    group[LOW] = distance - motion_since(group, tip, frames)
    return group[LOW] >= max(group[KEEP], group[LEAST], ENOUGH * distance)


@kernel
def most_urgent(words, rows, pairs, groups, tip, frames, answer):
    """The pair with the least distance above what its group keeps, to `answer`; the group's number."""
    urgent, reserve = 0, np.inf
    for k in range(groups.shape[0]):
        group = groups[k]
        if not estimate(words, group, tip, frames):
            measure(words, rows, pairs, group, tip, frames)
        if group[LOW] - group[KEEP] < reserve:
            urgent, reserve = k, group[LOW] - group[KEEP]
    for i in range(ANSWER):
        answer[i] = groups[urgent, HELD + i]
    answer[DISTANCE] = groups[urgent, LOW]
    return urgent
