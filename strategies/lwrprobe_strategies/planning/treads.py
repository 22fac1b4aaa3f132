"""Lines over treads that the grid has passed above: what goes on beside a tread that was touched, and was not touched.

Over a tall object the grid is driven so high that it passes above a plate on which walls stand. Where something has led
a line down to the plate, the plate most likely goes on beside it. And between walls there is a floor, though no line
has come down to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.body_space import BodySpace
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
DEEP = 0.5
"""Pitches below where the sphere has passed, from which on a floor is worth a line."""
SHORTEST = 0.6
"""Pitches of a tread that are worth a line."""
ROUNDING = 1e-9
"""m, of differences of places."""
MIRRORED = [1, 0, 2, 4, 3, 5, 7, 6, 8, 9]
"""Columns of a row with x and y exchanged."""


class Along(NamedTuple):
    """What is known of the places along a line, (n,) m each.

    Attributes
    ----------
    tread : height of the lowest tread that was touched around a place, inf where none was
    passed : of the lowest centre of the sphere on the line, inf where it has not been
    lowest : of the sphere's centre, below which the body may not come
    walls : of the lower one of what the line meets before and behind the place, -inf where one is missing
    """

    tread: np.ndarray
    passed: np.ndarray
    lowest: np.ndarray
    walls: np.ndarray


def treads(
    contacts: np.ndarray,
    trail: np.ndarray,
    axis: int,
    places: np.ndarray,
    task: Task,
    pitch: float,
    body: BodySpace,
    expected: Callable[[Along], np.ndarray] = attrgetter("tread"),
) -> list[Line]:
    """Lines along an axis at `places` (n,) m, over each stretch where a tread goes on that no line has come down to.

    Only where the body of an upright probe may come as low.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    pitch : m, between two lines
    body : where the body may be
    expected : how high a tread is expected along a line, (n,) m, inf where none is: as it was touched around there
    """
    if axis == X:
        contacts, trail = contacts[:, MIRRORED], trail[:, MIRRORED]
    area, radius = task.area, task.probe.radius
    flat = contacts[contacts[:, NORMAL_Z] > UPWARDS]
    lines: list[Line] = []
    for place in np.sort(places).tolist() if len(contacts) else ():
        whole = Line(axis, place, float(area.lower[axis]), float(area.upper[axis]), float(area.lower[Z]))
        ys, lowest = body.lowest_at(whole, task.orientation)
        own = trail[np.abs(trail[:, X] - place) < ON_LINE]
        passed = _lowest_within(own[:, :3], place, ys, CELL)
        wall = contacts[:, POINT]
        tall = -_lowest_within(wall * (1.0, 1.0, -1.0), place, ys, radius + BESIDE)
        walls = np.minimum(np.maximum.accumulate(tall), np.maximum.accumulate(tall[::-1])[::-1])
        tread = expected(Along(_lowest_within(flat[:, POINT], place, ys, GOES_ON * pitch), passed, lowest, walls))
        beside = _lowest_within(trail[:, :3], place, ys, 0.5 * pitch)
        left = np.isfinite(tread) & (passed > tread + radius + PASSED) & (tall < tread + ALIKE)
        left &= (lowest < tread + radius) & (beside > tread + radius - ALIKE)
        left &= ~_touched(flat, place, ys, tread, 0.5 * pitch) & ~_beyond(contacts, place, ys, tread, GOES_ON * pitch)
        for first, last in _runs(left):
            if float(ys[last] - ys[first]) > SHORTEST * pitch - ROUNDING:
                bottom, top = float(tread[first : last + 1].min()), float(tread[first : last + 1].max())
                height = max(bottom + radius - ALIKE, whole.height)
                line = replace(whole, height=height, expected=height, ceiling=top + 2.0 * radius, low=True)
                bars = (tall > line.ceiling) | (lowest > bottom + radius)
                ends = bars | (passed < top + radius + PASSED)
                lines.append(_line_over(first, last, line, ys, np.minimum(passed, area.upper[Z]), bars, ends, wall))
    return lines


def hollow_floors(task: Task, pitch: float) -> Callable[[Along], np.ndarray]:
    """What is `expected` of the floors between walls of which nothing was touched: as low as the body may come.

    What is not between walls is left to the lines on the floor, which come from the border.
    """
    radius, floor = task.probe.radius, float(task.area.lower[Z])

    def expected(known: Along) -> np.ndarray:
        centre = np.maximum(known.lowest, floor) + ROUNDING
        hollow = np.isinf(known.tread) & (known.passed > centre + DEEP * pitch) & (known.walls > centre + radius)
        return np.where(hollow, centre - radius, np.inf)

    return expected


def _line_over(
    first: int,
    last: int,
    whole: Line,
    ys: np.ndarray,
    passed: np.ndarray,
    bars: np.ndarray,
    ends: np.ndarray,
    wall: np.ndarray,
) -> Line:
    """The part of a `whole` line that leads over the stretch from index `first` to `last` of `ys` (n,) m.

    It begins on the border where nothing `bars` (n,) the way from there. Otherwise it comes down on the tread from
    where the sphere `passed` (n,) m, at the end of the stretch that is farther from what is taller, `wall` (m, 3). It
    leads over the other end to where something `ends` (n,) it.
    """
    if not bars[: first + 1].any():
        begin, onward = 0, range(last, len(ys))
    elif not bars[last:].any():
        begin, onward = len(ys) - 1, range(first, -1, -1)
    else:
        room = [_room(wall, whole.place, float(ys[k]), whole.ceiling) for k in (first, last)]
        begin, onward = (last, range(first, -1, -1)) if room[0] < room[1] else (first, range(last, len(ys)))
    end = next((k for k in onward if ends[k]), onward[-1])
    line = replace(whole, begin=float(ys[begin]), end=float(ys[end]))
    if begin in (0, len(ys) - 1):
        return line
    return replace(line, on_surface=True, free_to=float(passed[begin]))


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
