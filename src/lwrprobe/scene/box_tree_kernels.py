"""A tree of boxes over a mesh's faces."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel

_DEEP = 64  # nodes that wait; the tree is balanced, so that is enough for 2^60 faces


@kernel
def _select(values, axis, order, begin, end, middle):
    """Reorder order[begin:end) so that no value before `middle` is larger than any behind it (Hoare 1961)."""
    first, last = begin, end - 1
    while first < last:
        pivot = values[order[(first + last) // 2], axis]
        i, j = first, last
        while i <= j:
            while values[order[i], axis] < pivot:
                i += 1
            while values[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@kernel
def halve(lower, upper, centre, leaf, order, boxes, nodes):
    """Halve faces at the median of their centres along the longest side until at most `leaf` are left.

    Bounds `lower`, `upper` and `centre` (m, 3) of the faces; `order` (m,) comes in as 0..m-1 and goes out as the faces
    of the leaves; `boxes` (k, 6) and `nodes` (k, 2) are written: (first child, 0), or (first face, their number).
    Returns the nodes' number, at most 2 m + 1.
    """
    todo = np.empty((_DEEP, 3), dtype=np.int64)
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, 0, order.shape[0]
    waiting, count = 1, 1
    nodes[0, 0], nodes[0, 1] = 0, 0
    low, high = np.empty(3), np.empty(3)
    while waiting > 0:
        waiting -= 1
        node, begin, end = todo[waiting, 0], todo[waiting, 1], todo[waiting, 2]
        for m in range(3):
            boxes[node, m], boxes[node, 3 + m] = np.inf, -np.inf
            low[m], high[m] = np.inf, -np.inf
        for i in range(begin, end):
            for m in range(3):
                boxes[node, m] = min(boxes[node, m], lower[order[i], m])
                boxes[node, 3 + m] = max(boxes[node, 3 + m], upper[order[i], m])
                low[m] = min(low[m], centre[order[i], m])
                high[m] = max(high[m], centre[order[i], m])
        if end - begin <= leaf:
            nodes[node, 0], nodes[node, 1] = begin, end - begin
            continue
        axis = 0
        for m in range(1, 3):
            if high[m] - low[m] > high[axis] - low[axis]:
                axis = m
        middle = (begin + end) // 2
        _select(centre, axis, order, begin, end, middle)
        nodes[node, 0], nodes[node, 1] = count, 0
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = count, begin, middle
        todo[waiting + 1, 0], todo[waiting + 1, 1], todo[waiting + 1, 2] = count + 1, middle, end
        waiting += 2
        count += 2
    return count
