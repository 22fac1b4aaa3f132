"""Lines between two parts of the object, where no line has passed: they show where the body behind the stick may go.

Lines of the grid that turn level on both walls of a slot never pass over its floor. The body behind the stick may then
not come down there, and no floor is touched.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import CELL, BodySpace
from lwrprobe_strategies.planning.contact_memory import NORMAL_Y
from lwrprobe_strategies.planning.lines import Line, X, Z
from lwrprobe_strategies.planning.low_sides import FACING

SHORTEST = 0.6
"""Pitches of a line through what is not known, that are worth it."""


def unpassed_parts(contacts: np.ndarray, body: BodySpace, area: Area, height: float, pitch: float) -> list[Line]:
    """Lines along x, so many that nothing in `unknown_between` is farther than a pitch from one of them.

    Each begins on the nearer end of the area, and ends where what is not known ends. Where two of them are farther
    apart than the pitch, what lies between stays unknown, and is planned for the next time.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    body : where the body may be, as of its last survey
    height : m, at which the grid is driven
    pitch : m, between two lines
    """
    reach = round(pitch / CELL)
    left = unknown_between(contacts, body, reach)
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


def unknown_between(contacts: np.ndarray, body: BodySpace, reach: int) -> np.ndarray:
    """(n, m) bool, squares of which nothing is known, in gaps: of the contacts in a row along y the nearest ones on
    both sides face each other.

    `contacts` (k, 10) as in `ContactMemory.contacts`; those up to `reach` squares beside a row count as well.
    """
    unknown = body.unknown
    squares, onward = body.squares(contacts[:, :Z]), contacts[:, NORMAL_Y]
    inside = ((squares >= 0) & (squares < unknown.shape)).all(axis=1)
    (rows, columns), onward = squares[inside].T, onward[inside]
    before = _last_is(unknown.shape, rows, columns, onward > FACING, reach)
    beyond = _last_is(unknown.shape, rows, unknown.shape[1] - 1 - columns, onward < -FACING, reach)[:, ::-1]
    return np.asarray(unknown & before & beyond)


def _last_is(
    shape: tuple[int, ...], rows: np.ndarray, columns: np.ndarray, wanted: np.ndarray, reach: int
) -> np.ndarray:
    """`shape` bool, whether the last one of squares (k,) before each square in its row is `wanted` (k,)."""
    from scipy.ndimage import maximum_filter1d

    last = np.zeros((2, *shape), dtype=int)  # column, counted from 1, of those not wanted and of those
    last[wanted.astype(int), rows, columns] = columns + 1
    last = maximum_filter1d(last, 2 * reach + 1, axis=1, mode="constant")
    other, own = np.maximum.accumulate(last, axis=2)
    return np.asarray((own > 0) & (own >= other))
