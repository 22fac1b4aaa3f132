"""Lines that close what the lines along y leave out: faces that lie along them, and feet of near sides.

Where two neighbouring lines touched at very different heights, the face between them lies along the lines and has no
line of its own. The thesis leaves it out (Rau 2017, section 6.3). Here such places are crossed by lines along x.
So are hollows between two lines: one of them touched a surface that falls towards the other, which is no lower.

A line over a tall object begins at a height at which the body above the stick clears whatever may be there, and goes
up; what lies below is touched afterwards, when it is known what the body has to clear. All these lines lead upwards
where they can: a foot that has not been touched yet has to be approached slowly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.contact_memory import GRID_X, NORMAL_X, NORMAL_Y, NORMAL_Z, POINT_Y
from lwrprobe_strategies.planning.lines import ON_LINE, Line, X, Y, Z

ROUGH = 0.002
"""m, by which the path from contact to contact between two lines may exceed the lines' distance."""
OVER = 0.8
"""Share of the normal along z, from which on a touch is one of the top."""
UNDER = -0.5
"""Share of the normal along z, up to which a touch is one of an underside."""
FALLS, UPWARDS = 0.3, 0.3
"""Share of the normal across a line, and along z, from which on a touch is one of a surface that falls beside the line:
normals are known to a few degrees."""
RUN = 3
"""Such touches in a row at least."""
PLACES = 3
"""Lines over a short hollow: its walls along x and along y."""
APART = 0.002
"""m at least between two lines over one hollow: a nearer one would show nothing that the other does not."""


def lines_across(
    contacts: np.ndarray,
    trail: np.ndarray,
    places: np.ndarray,
    pitch: float,
    floor: float,
    lowest: Callable[[Line], float],
    radius: float = 0.0,
) -> list[Line]:
    """Lines along x over every face that the lines along y, at `places` (n,) m, left out; in the order to drive them.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    pitch : m, between two lines across
    floor : m, lowest height of the sphere's centre: where a line touched nothing
    lowest : m, height at which a line that begins in free space may be driven
    radius : m, of the sphere: on its way down it may still touch above where it passed below, by as much farther out;
        and on its way up a wall may stand where the line above touched, which ends by as much behind it
    """
    if not len(contacts):
        return []
    xs = np.sort(places)
    runs: dict[tuple[int, int], list[tuple[float, np.ndarray]]] = {}
    for y in _places_across(contacts, pitch):
        heights = _heights(contacts, xs, y, floor)
        for first, last in _left_out(xs, heights, pitch, floor):
            runs.setdefault((first, last), []).append((y, heights))
    for pair, y in _hollows(contacts, xs, pitch, floor):
        where = runs.setdefault(pair, [])
        if all(abs(y - other) >= APART for other, _ in where):  # it is often seen from both lines
            where.append((y, _heights(contacts, xs, y, floor)))
    lines: list[Line] = []
    for (first, last), where in sorted(runs.items()):
        for y, heights in where:
            one, other = (_end(trail, xs, heights, i, y, floor) for i in (first, last))
            line = _upwards(one, other, radius)
            if not line.on_surface:
                line = _from_passed(line, trail, xs, heights > floor + 1e-4)
                line = replace(line, height=lowest(up_to(line, pitch)))
            lines.append(line)
    return lines


def _upwards(one: Line, other: Line, radius: float) -> Line:
    """The line between two ends from the lower one to the higher one, with the way down as its fallback.

    From its foot up a wall is followed faster than down from its top. `radius` m as in `lines_across`.
    """
    low, high = sorted((one, other), key=lambda end: end.height)
    past = 0.0 if low.on_surface else float(np.copysign(radius, low.begin - high.begin))
    down = replace(high, end=low.begin + past) if high.on_surface else None
    behind = past if high.on_surface else 0.0
    return replace(low, end=high.begin - behind, fallback=down, free_end=down is None)


def _from_passed(line: Line, trail: np.ndarray, xs: np.ndarray, touched: np.ndarray) -> Line:
    """A line that begins in free space, from the nearest line of the grid that has passed there.

    The line of the grid on which it begins may have been given up, or a level contour has led away from it. What lies
    between that one and the next is then not known, and would keep the body of the probe away from the side.
    `touched` (n,) says on which of the grid's lines, at `xs` (n,) m, something was touched there.
    """
    passed = np.isin(xs, trail[np.abs(trail[:, Y] - line.place) < ON_LINE, GRID_X])
    order = np.argsort(-line.sign * xs)
    for i in order[line.sign * (line.begin - xs[order]) > -ON_LINE]:
        if passed[i] or touched[i]:
            return line if touched[i] else replace(line, begin=float(xs[i]))
    return line


def up_to(line: Line, farthest: float) -> Line:
    """The part of a line on which it meets the wall for which it is driven."""
    return replace(line, end=line.begin + line.sign * min(abs(line.end - line.begin), farthest))


def _end(trail: np.ndarray, xs: np.ndarray, heights: np.ndarray, index: int, y: float, floor: float) -> Line:
    """A line across that begins on a line of the grid, where that touched or in free space; it leads nowhere yet."""
    x = float(xs[index])
    if heights[index] <= floor + 1e-4:
        return Line(X, float(y), x, x, floor)
    # Where the probe has stood its stick filled the column above.
    near = (trail[:, GRID_X] == x) & (np.abs(trail[:, Y] - y) < ON_LINE)
    stood = trail[near, Z].max(initial=heights[index])
    return Line(X, float(y), x, x, float(heights[index]), on_surface=True, free_to=float(stood))


def near_sides(
    contacts: np.ndarray,
    trail: np.ndarray,
    area: Area,
    pitch: float,
    lowest: Callable[[Line], float],
    raised: np.ndarray,
) -> list[Line]:
    """Lines along y up every wall that a line met well above the area's floor, from its foot to where it came over.

    Where the foot is out of reach, the wall is touched from the top down instead. `contacts` and `trail` as above,
    those of one line in the order in which they were made; `pitch` m, between two lines; `lowest` m, height at which
    one may be driven.
    """
    lines: list[Line] = []
    for x in np.unique(contacts[~np.isnan(contacts[:, GRID_X]), GRID_X]):
        own = contacts[contacts[:, GRID_X] == x]
        over = own[own[:, NORMAL_Z] > OVER]
        # The far side was followed as far down as the links allow; no lower than that goes the near one.
        overhangs = bool((np.abs(raised - x) < 1e-6).any())
        bottom = float(area.lower[Z]) if overhangs else own[:, Z].min()
        if not (own[0, Z] - bottom > 0.5 * pitch and UNDER < own[0, NORMAL_Z] < OVER and len(over)):
            continue
        top = over[0]
        stood = trail[(trail[:, GRID_X] == x) & (np.abs(trail[:, Y] - top[Y]) < ON_LINE), Z].max()
        out = float(area.lower[Y] if own[0, NORMAL_Y] < 0.0 else area.upper[Y])
        down = Line(Y, float(x), float(top[Y]), out, float(top[Z]), on_surface=True, free_to=float(stood))
        if overhangs:
            lines.append(down)
            continue
        up = Line(Y, float(x), out, float(top[Y]), float(top[Z]), fallback=down)
        lines.append(replace(up, height=lowest(up)))
    return lines


def _places_across(contacts: np.ndarray, pitch: float) -> np.ndarray:
    """(k,) m in y, no more than a pitch apart and half of that from the ends of what was touched."""
    low, high = contacts[:, POINT_Y].min(), contacts[:, POINT_Y].max()
    count = max(int(np.ceil((high - low) / pitch - 1e-6)), 1)
    return low + (np.arange(count) + 0.5) * (high - low) / count


def _heights(contacts: np.ndarray, xs: np.ndarray, y: float, floor: float) -> np.ndarray:
    """(n,) m, the highest place of the sphere's centre on each grid line at `y`; `floor` where nothing was touched."""
    near = contacts[np.abs(contacts[:, Y] - y) < ON_LINE]
    heights = np.full(len(xs), floor)
    for i, x in enumerate(xs):
        own = near[near[:, GRID_X] == x]
        if len(own):
            heights[i] = own[:, Z].max()
    return heights


def _hollows(
    contacts: np.ndarray, xs: np.ndarray, pitch: float, floor: float
) -> Iterator[tuple[tuple[int, int], float]]:
    """Index pairs of neighbouring lines with a hollow in between, and m in y where it is to be crossed."""
    for i, beside in chain(pairwise(range(len(xs))), pairwise(range(len(xs) - 1, -1, -1))):
        own = contacts[contacts[:, GRID_X] == xs[i]]
        falls = np.sign(xs[beside] - xs[i]) * own[:, NORMAL_X]
        own = own[(falls > FALLS) & (own[:, NORMAL_Z] > UPWARDS)]
        own = own[np.argsort(own[:, Y])]
        for run in np.split(own, np.flatnonzero(np.diff(own[:, Y]) > 2.0 * ON_LINE) + 1):
            if len(run) < RUN:
                continue
            low, high = run[0, Y], run[-1, Y]
            count = max(int(np.ceil((high - low) / pitch)), min(int((high - low) / APART), PLACES), 1)
            for y in (low + (np.arange(count) + 0.5) * (high - low) / count).tolist():
                heights = _heights(contacts, xs, y, floor)
                if heights[i] > floor + 1e-4 and heights[beside] > heights[i] - ROUGH:
                    yield (min(i, beside), max(i, beside)), y


def _left_out(xs: np.ndarray, heights: np.ndarray, pitch: float, floor: float) -> list[tuple[int, int]]:
    """Index pairs of lines between which the surface is steep along x; pairs up to two lines apart become one."""
    length = np.hypot(np.diff(xs), np.diff(heights))
    steep = np.flatnonzero(length > np.maximum(np.diff(xs), pitch) + ROUGH)
    pairs: list[tuple[int, int]] = []
    for i in steep:
        low_between = pairs and (heights[pairs[-1][1] : i + 1] <= floor + 1e-4).all()
        if pairs and i - pairs[-1][1] <= 2 and not (low_between and i > pairs[-1][1]):
            pairs[-1] = (pairs[-1][0], int(i) + 1)
        else:
            pairs.append((int(i), int(i) + 1))
    return pairs
