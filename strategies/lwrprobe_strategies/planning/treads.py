"""Lines over treads that the grid has passed above: what goes on beside a tread that was touched, and was not touched.

Over a tall object the grid is driven so high that it passes above a plate on which walls stand. Where something has led
a line down to the plate, the plate most likely goes on beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.contact_memory import NORMAL_X, NORMAL_Y, NORMAL_Z, POINT, POINT_X, POINT_Y, POINT_Z
from lwrprobe_strategies.planning.lines import ON_LINE, Line, X, Y, Z

CELL = 0.002
"""m along a line, for which one height is kept."""
UPWARDS = 0.7
"""Share of the normal along z, from which on a touch is one of a tread."""
GOES_ON = 1.2
"""Pitches from a touch of a tread, within which the tread is expected to go on."""
PASSED = 0.001
"""m above a sphere on a tread, from which on a line has passed it."""
ALIKE = 0.003
"""m in height, within which two touches are of one tread."""
BESIDE = 0.002
"""m from the sphere to a wall, beside which it comes down."""
SHORTEST = 0.6
"""Pitches of a tread that are worth a line."""


def treads(
    contacts: np.ndarray, trail: np.ndarray, places: np.ndarray, area: Area, radius: float, pitch: float
) -> list[Line]:
    """Lines along y at `places` (n,) m, over each stretch where a tread goes on that no line has come down to.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    radius : m, of the sphere
    pitch : m, between two lines
    """
    flat = contacts[contacts[:, NORMAL_Z] > UPWARDS]
    ys = np.arange(float(area.lower[Y]), float(area.upper[Y]) + CELL, CELL)
    lines: list[Line] = []
    for place in np.sort(places).tolist() if len(flat) else ():
        tread = _lowest_within(flat[:, POINT], place, ys, GOES_ON * pitch)
        own = trail[np.abs(trail[:, X] - place) < ON_LINE]
        passed = _lowest_within(own[:, :3], place, ys, CELL)
        wall = contacts[:, POINT]
        tall = -_lowest_within(wall * (1.0, 1.0, -1.0), place, ys, radius + BESIDE)
        left = np.isfinite(tread) & (passed > tread + radius + PASSED) & (tall < tread + ALIKE)
        left &= ~_touched(flat, place, ys, tread, 0.5 * pitch) & ~_beyond(contacts, place, ys, tread, GOES_ON * pitch)
        for first, last in _runs(left):
            if (last - first) * CELL >= SHORTEST * pitch:
                line = _line_over(first, last, place, ys, tread, passed, wall, radius)
                height, free_to = max(line.height, float(area.lower[Z])), min(line.free_to, float(area.upper[Z]))
                lines.append(replace(line, height=height, free_to=free_to, expected=height))
    return lines


def _line_over(
    first: int,
    last: int,
    place: float,
    ys: np.ndarray,
    tread: np.ndarray,
    passed: np.ndarray,
    wall: np.ndarray,
    radius: float,
) -> Line:
    """A line along y at a `place` m over the stretch from index `first` to `last` of `ys` (n,) m.

    It begins at the end of the stretch that is farther from what is taller, `wall` (m, 3), and leads over the other end
    to where a line has come down before. The `tread` (n,) m is as high as that, and `passed` (n,) m the sphere.
    """
    height = float(tread[first : last + 1].min()) + radius - ALIKE
    ceiling = float(tread[first : last + 1].max()) + 2.0 * radius
    if _room(wall, place, float(ys[first]), ceiling) < _room(wall, place, float(ys[last]), ceiling):
        begin, onward = last, range(first, -1, -1)
    else:
        begin, onward = first, range(last, len(ys))
    low = passed < ceiling - radius + PASSED
    end = next((k for k in onward if low[k]), onward[-1])
    free_to = float(passed[begin])
    line = Line(Y, place, float(ys[begin]), float(ys[end]), height, on_surface=True, free_to=free_to)
    return replace(line, low=True, ceiling=ceiling)


def _lowest_within(points: np.ndarray, place: float, ys: np.ndarray, reach: float) -> np.ndarray:
    """(n,) m, least height of the points (m, 3) within a reach [m] of (place, ys (n,)) in the plan view; else inf."""
    near = points[np.abs(points[:, X] - place) < reach]
    if not len(near):
        return np.full(len(ys), np.inf)
    apart = np.hypot(near[:, X] - place, near[:, Y] - ys[:, None])
    return np.where(apart < reach, near[:, Z], np.inf).min(axis=1)


def _touched(flat: np.ndarray, place: float, ys: np.ndarray, tread: np.ndarray, reach: float) -> np.ndarray:
    """(n,) bool, where a tread as high as expected was touched within a reach [m]."""
    near = flat[np.abs(flat[:, POINT_X] - place) < reach]
    apart = np.hypot(near[:, POINT_X] - place, near[:, POINT_Y] - ys[:, None])
    with np.errstate(invalid="ignore"):
        return ((apart < reach) & (near[:, POINT_Z] < tread[:, None] + ALIKE)).any(axis=1)


def _beyond(contacts: np.ndarray, place: float, ys: np.ndarray, tread: np.ndarray, reach: float) -> np.ndarray:
    """(n,) bool, where a side below a tread has been touched, within a reach [m], between the tread and the place."""
    near = contacts[np.abs(contacts[:, POINT_X] - place) < reach]
    x, y = place - near[:, POINT_X], ys[:, None] - near[:, POINT_Y]
    apart = np.hypot(x, y)
    flat, outside = near[:, NORMAL_Z] > UPWARDS, x * near[:, NORMAL_X] + y * near[:, NORMAL_Y] > 0.0
    below = near[:, POINT_Z] < tread[:, None] - PASSED
    side = np.where(~flat & outside & below, apart, np.inf).min(axis=1, initial=np.inf)
    found: np.ndarray = side < np.minimum(reach, np.where(flat, apart, np.inf).min(axis=1, initial=np.inf))
    return found


def _room(points: np.ndarray, place: float, y: float, height: float) -> float:
    """m from (place, y) in the plan view to the nearest point (n, 3) above a height."""
    tall = points[points[:, Z] > height]
    return float(np.hypot(tall[:, X] - place, tall[:, Y] - y).min(initial=np.inf))


def _runs(wanted: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2])]
