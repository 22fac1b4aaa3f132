"""Parts of the area where nothing was touched or passed: a second part of the object may stand there.

An estimate of the surface knows what was touched. The place beside it counts as free, and no stroke is worth anything
there.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy import ndimage

from lwrprobe.contracts import Area


def longest_unseen(area: Area, seen: np.ndarray, object_there: np.ndarray, reach: float) -> float:
    """m, length of the longest line along x or y of which nothing within `reach` m is known.

    Beyond the area's border nothing is.

    Parameters
    ----------
    area : of the sphere's centre
    seen : (n, 2) m, in the plan view, where the sphere was or touched something
    object_there : (i, j) bool, squares that cover the area evenly, in which the object is taken to stand
    reach : m
    """
    edge = (area.upper[:2] - area.lower[:2]) / object_there.shape
    known = object_there.copy()
    cells = np.floor((seen - area.lower[:2]) / edge).astype(np.int64)
    known[tuple(np.clip(cells, 0, np.array(known.shape) - 1).T)] = True
    unseen = ndimage.distance_transform_edt(~np.pad(known, 1, constant_values=True), sampling=edge)[1:-1, 1:-1] > reach
    longest = 0.0
    for rows, square in ((unseen, edge[1]), (unseen.T, edge[0])):
        for row in rows:
            changes = np.flatnonzero(np.diff(np.pad(row, 1).astype(np.int8))).tolist()
            longest = max([longest, *(square * (end - begin) for begin, end in list(pairwise(changes))[::2])])
    return longest
