"""Heights in the plan view, what a sphere sweeps there, and a rigid body above them (kernels, private).

The body is given by `points` (k, 3) of its surface, from the tip's origin on and in the world's axes, and by a state:
the elements of `state` are named below. Its extents and its points belong to one rotation, and hold for any that is
alike.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel

ROTATION = 0
"""The first of nine elements of the rotation that the points were turned by."""
PLACED = 9
"""The first of twelve elements of the pose in which the body was last entered."""
LOWEST, LEFT, RIGHT, FRONT, BACK = 21, 22, 23, 24, 25
"""m from the tip's origin: the body's lowest point, and how far it reaches along x and y."""
LOW_X, LOW_Y, CELL, TOP = 26, 27, 28, 29
"""m: the middle of the first square, the edge of one, and the height above which there is nothing."""
BOX_LEFT, BOX_RIGHT, BOX_FRONT, BOX_BACK, BOX_TALLEST = 30, 31, 32, 33, 34
"""m: a rectangle for the tip, and the largest height below or beside the body wherever in it the tip is."""
SIZE = 35

ALIKE = 1e-3
"""Largest difference between two rotation matrices that count as one: a fifth of a millimetre 0.2 m from the tip."""
MOVED = 0.001
"""m, or element of the rotation, from which on a body has moved."""
AROUND = 0.005
"""m to all sides of a motion for which the tallest is looked up at once, for those that follow."""
UNSURE, YES, OTHERWISE = 0, 1, 2
"""What `enter` and `clears` find out; `OTHERWISE`: the points were turned for another rotation."""


@kernel
def held(state, pose):
    """Whether the points were turned for the orientation of a pose (4, 4)."""
    for i in range(3):
        for j in range(3):
            if not abs(pose[i, j] - state[ROTATION + 3 * i + j]) <= ALIKE:
                return False
    return True


@kernel
def enter(state, points, lowest, pose):
    """The body is at a pose (4, 4): lower the heights (n, m) of the inner squares that it is over; whether it moved."""
    if not held(state, pose):
        return OTHERWISE
    z = pose[2, 3]
    if z + state[LOWEST] >= state[TOP]:
        return UNSURE
    moved = 0.0
    for i in range(3):
        for j in range(4):
            moved = max(moved, abs(pose[i, j] - state[PLACED + 4 * i + j]))
    if moved < MOVED:
        return UNSURE
    for i in range(3):
        for j in range(4):
            state[PLACED + 4 * i + j] = pose[i, j]
    last_i, last_j = lowest.shape[0] - 1, lowest.shape[1] - 1
    x, y, cell = pose[0, 3] - state[LOW_X], pose[1, 3] - state[LOW_Y], state[CELL]
    for k in range(len(points)):
        height = points[k, 2] + z
        if height >= state[TOP]:
            continue
        i, j = np.rint((points[k, 0] + x) / cell), np.rint((points[k, 1] + y) / cell)
        if 0 < i < last_i and 0 < j < last_j and height < lowest[np.int64(i), np.int64(j)]:
            lowest[np.int64(i), np.int64(j)] = height
    return YES


@kernel
def depth(state, points, heights, x, y, z):
    """m, how far the body below the top is in the heights (n, m), with the tip at a place; -inf where it is above."""
    if z + state[LOWEST] >= state[TOP]:
        return -np.inf
    last_i, last_j = float(heights.shape[0] - 1), float(heights.shape[1] - 1)
    x, y, cell, deepest = x - state[LOW_X], y - state[LOW_Y], state[CELL], -np.inf
    for k in range(len(points)):
        height = points[k, 2] + z
        if height >= state[TOP]:
            continue
        i, j = np.rint((points[k, 0] + x) / cell), np.rint((points[k, 1] + y) / cell)
        row, column = np.int64(min(max(i, 0.0), last_i)), np.int64(min(max(j, 0.0), last_j))
        deepest = max(deepest, heights[row, column] - height)
    return deepest


@kernel
def clears(state, heights, begin, turned, shift):
    """Whether the body's lowest point is above all heights (n, m) within a rectangle around a motion.

    The tip goes from the pose `begin` (4, 4) by `shift` (3,), in the orientation of `turned` (4, 4).
    """
    for i in range(3):
        for j in range(3):
            if not abs(turned[i, j] - begin[i, j]) <= ALIKE:
                return UNSURE
    if not held(state, begin):
        return OTHERWISE
    x, y, z = begin[0, 3], begin[1, 3], begin[2, 3]
    lowest = min(z, z + shift[2]) + state[LOWEST]
    if lowest >= state[TOP]:
        return YES
    left, right = min(x, x + shift[0]), max(x, x + shift[0])
    front, back = min(y, y + shift[1]), max(y, y + shift[1])
    inside = state[BOX_LEFT] <= left and right <= state[BOX_RIGHT]
    if inside and state[BOX_FRONT] <= front and back <= state[BOX_BACK] and state[BOX_TALLEST] <= lowest:
        return YES
    if _remembered(state, heights, left - AROUND, right + AROUND, front - AROUND, back + AROUND, lowest):
        return YES
    return YES if _remembered(state, heights, left, right, front, back, lowest) else UNSURE


@kernel
def _remembered(state, heights, left, right, front, back, lowest):
    """Whether nothing is taller than `lowest` m below or beside the body, for a tip within a rectangle; it is kept."""
    low_x, low_y, cell = state[LOW_X], state[LOW_Y], state[CELL]
    last_i, last_j = heights.shape[0] - 1, heights.shape[1] - 1
    first_i = min(max(np.int64((left + state[LEFT] - low_x) / cell), 0), last_i)
    first_j = min(max(np.int64((front + state[FRONT] - low_y) / cell), 0), last_j)
    end_i = min(max(np.int64((right + state[RIGHT] - low_x) / cell) + 2, 1), last_i + 1)
    end_j = min(max(np.int64((back + state[BACK] - low_y) / cell) + 2, 1), last_j + 1)
    tallest = -np.inf
    for i in range(first_i, end_i):
        for j in range(first_j, end_j):
            tallest = max(tallest, heights[i, j])
        if tallest > lowest:
            return False
    state[BOX_LEFT], state[BOX_RIGHT], state[BOX_FRONT], state[BOX_BACK] = left, right, front, back
    state[BOX_TALLEST] = tallest
    return True


@kernel
def tallest(heights, first_i, end_i, first_j, end_j):
    """Largest of the heights (n, m) in a window, -inf where that is empty; the window may reach beyond the end."""
    found = -np.inf
    for i in range(first_i, min(end_i, heights.shape[0])):
        for j in range(first_j, min(end_j, heights.shape[1])):
            found = max(found, heights[i, j])
    return found


@kernel
def lowest_facing(heights, normals, first_i, end_i, first_j, end_j, x, y, share):
    """Least of the heights (n, m) in a window whose normal (n, m, 2) has less than `share` along (x, y); else inf."""
    found = np.inf
    for i in range(first_i, min(end_i, heights.shape[0])):
        for j in range(first_j, min(end_j, heights.shape[1])):
            if heights[i, j] < found and normals[i, j, 0] * x + normals[i, j, 1] * y < share:
                found = heights[i, j]
    return found


@kernel
def bridge(heights, known, touched, hidden, along_x, nearest, out):
    """Lower `out` (n, m) between two known squares along one axis that are fewer than `hidden` (k,) has squares apart.

    It becomes no taller than the taller of both, each with half as many squares to both sides of it as they are apart,
    where those are known; and where one of both is `touched`, by the m that are `hidden` between squares so far apart.
    No touched square lies in between, and if they are `nearest` to each other no known one. A height that is known is
    finite or -inf.
    """
    lines, length = (out.shape[1], out.shape[0]) if along_x else (out.shape[0], out.shape[1])
    for line in range(lines):
        for begin in range(length):
            if not _at(known, begin, line, along_x):
                continue
            for end in range(begin + 1, min(begin + len(hidden), length)):
                met = _at(known, end, line, along_x)
                if met and end > begin + 1:
                    half, between = (end - begin + 1) // 2, -np.inf
                    for beside in range(max(line - half, 0), min(line + half, lines - 1) + 1):
                        for place in (begin, end):
                            if _at(known, place, beside, along_x):
                                between = max(between, _at(heights, place, beside, along_x))
                    if _at(touched, begin, line, along_x) or _at(touched, end, line, along_x):
                        between += hidden[end - begin]
                    for inside in range(begin + 1, end):
                        if along_x:
                            out[inside, line] = min(out[inside, line], between)
                        else:
                            out[line, inside] = min(out[line, inside], between)
                if _at(touched, end, line, along_x) or (met and nearest):
                    break


@kernel
def _at(values, place, line, along_x):
    """The value at a place along one axis, on a line across it."""
    return values[place, line] if along_x else values[line, place]


@kernel
def lower(heights, i, j, around, height):
    """Lower a square and so many to all sides of it to a height [m]; the heights are (n, m)."""
    for row in range(max(i - around, 0), min(i + around + 1, heights.shape[0])):
        for column in range(max(j - around, 0), min(j + around + 1, heights.shape[1])):
            heights[row, column] = min(heights[row, column], height)


@kernel
def lower_around(lowest, around, above, out):
    """Lower `out` (n, m) to what is `above` m over the finite heights (n, m), in so many squares around each."""
    for i in range(lowest.shape[0]):
        for j in range(lowest.shape[1]):
            height = lowest[i, j] + above
            if height < np.inf:
                lower(out, i, j, around, height)


@kernel
def sweep(spans, i, j, half, height):
    """A sphere at a height in a square: what it sweeps joins the spans (n, m, 2, 2) of the squares around, low and high
    of the upper and of the lower one; it is `half` (2k + 1, 2k + 1) m high above and below its centre, if more than 0.

    A span that touches neither replaces the lower one, unless it lies above both.
    """
    around = half.shape[0] // 2
    for row in range(max(i - around, 0), min(i + around + 1, spans.shape[0])):
        for column in range(max(j - around, 0), min(j + around + 1, spans.shape[1])):
            reach = half[row - i + around, column - j + around]
            if not reach > 0.0:
                continue
            low, high = height - reach, height + reach
            upper, lower = spans[row, column, 0], spans[row, column, 1]
            if low <= upper[1] and high >= upper[0]:
                upper[0], upper[1] = min(upper[0], low), max(upper[1], high)
            elif low <= lower[1] and high >= lower[0]:
                lower[0], lower[1] = min(lower[0], low), max(lower[1], high)
            elif low > upper[1]:
                lower[0], lower[1] = upper[0], upper[1]
                upper[0], upper[1] = low, high
            else:
                lower[0], lower[1] = low, high
            if lower[1] >= upper[0]:
                upper[0], upper[1] = min(upper[0], lower[0]), max(upper[1], lower[1])
                lower[0], lower[1] = np.inf, -np.inf
