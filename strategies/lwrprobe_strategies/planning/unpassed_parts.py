"""Lines between two parts of the object, where no line has passed: they show where the body behind the stick may go.

Lines of the grid that turn level on both walls of a slot never pass over its floor. The body behind the stick may then
not come down there, and no floor is touched.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import CELL, BodySpace
from lwrprobe_strategies.planning.lines import Line, X

SHORTEST = 0.6
"""Pitches of a line through what is not known, that are worth it."""


def unpassed_parts(contacts: np.ndarray, body: BodySpace, area: Area, height: float, pitch: float) -> list[Line]:
    """Lines along x, so many that nothing in `BodySpace.between_facing` is farther than a pitch from one of them.

    Each begins on the nearer end of the area, and ends where what is not known ends. Where two of them are farther
    apart than the pitch, what lies between stays unknown, and is planned for the next time.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    body : where the body may be, as of its last survey
    height : m, at which the grid is driven
    pitch : m, between two lines
    """
    left = body.between_facing(contacts)
    reach = round(pitch / CELL)
    low, high = (float(border[X]) for border in (area.lower, area.upper))
    lines: list[Line] = []
    while left.any():
        shown = np.array([left[:, max(j - reach, 0) : j + reach + 1][left[:, j]].sum() for j in range(left.shape[1])])
        best = np.flatnonzero(shown == shown.max())
        j = int(best[len(best) // 2] if shown.max() == left.sum() else best[0])  # in the middle of what is left at last
        squares = body.places(np.flatnonzero(left[:, j]), j)
        (first, place), (last, _) = squares[[0, -1]].tolist()
        if last - first < SHORTEST * pitch:
            break
        begin, end = (low, last) if first - low < high - last else (high, first)
        lines.append(Line(X, place, begin, end, height))
        left[left[:, j], max(j - reach, 0) : j + reach + 1] = False
    return lines
