"""Lines up the sides of a tall object, below where the grid's lines touched it.

Over a tall object the grid is driven so high that the body behind the stick is above all that may be there. What the
grid has shown to be free lets the body come down beside the object, upright or leaning back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import NORMAL, NORMAL_X, NORMAL_Z, POINT, POINT_X, POINT_Z
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import Line, Z

NEAR = 0.0015
"""m across a line, within which a touch is one of it."""
FACING = 0.2
"""Share of the normal along the line, from which on a touch is one of that side."""
BEYOND = 0.004
"""m by which a line leads in under what was touched above it."""
SPARE = 0.0015
"""m farther than to where the side is expected, that the body must be able to go."""
HIGHER = 0.0025
"""m between two heights that are tried."""
ALIKE = 0.005
"""m above the lowest touch of a side, up to which touches show its slope: the normal of a single one is too noisy to be
taken as far down as a line is high."""
NEARER, ROOM = 0.010, 0.015
"""m by which a line begins nearer where the arm does not reach its beginning, and that it is long at least."""
GRAIN = 0.0015
"""m between two places of a side that are looked at."""
WORTH = 0.4
"""Square pitches that a line must add to what is touched: other lines may have gone up the same side."""
OVERLAP = 0.001
"""m, by which both contours overlap."""

RECEDES = -0.05
"""Share of the normal along z over that along the line, up to which a side recedes below."""
LEAST = 0.5
"""Pitches in height that a line up a side must add, where no foot may be below it."""

SideOrientations = Callable[[np.ndarray], Sequence[np.ndarray]]
"""Orientations (3, 3) in which the side may be driven that faces along a horizontal unit vector (3,), best first.

The side's own normal counts, not the line's axis: an object stands as it likes."""


def low_sides(
    contacts: np.ndarray,
    axis: int,
    places: np.ndarray,
    area: Area,
    pitch: float,
    body: BodySpace,
    orientations: SideOrientations,
    reachable: Callable[[Line], bool],
) -> list[Line]:
    """From the border to each side that a line touched, as low as the body may go, and up to where it was touched.

    Where the arm does not reach a line's beginning on the border, the line begins nearer.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    axis : along which the lines lead
    places : (n,) m, of the lines on the other horizontal axis
    pitch : m, between two lines
    body : where the body may be
    orientations : how the probe may be held
    reachable : whether the arm can drive a line
    """
    floor = float(area.lower[Z])
    lines: list[Line] = []
    for place, side, border, own, facing in touched_sides(contacts, axis, places, area):
        low = facing[np.argmin(facing[:, Z])]
        if low[Z] - floor <= 0.5 * pitch:
            continue
        end = float(low[axis])
        whole = Line(axis, place, border, end - side * SPARE, floor, low=True, ceiling=float(low[Z]) + OVERLAP)
        last = facing[facing[:, Z] < low[Z] + ALIKE]
        out = np.median(last[:, NORMAL], axis=0) * (1.0, 1.0, 0.0)
        away = out / float(np.sqrt(out @ out))
        onwards = float(np.median(last[:, NORMAL_Z] / (side * last[:, NORMAL_X + axis])))
        slope = max(onwards, 0.0)
        best: Line | None = None
        for rotation in orientations(away):
            line = _lowest(replace(whole, rotation=rotation), float(low[Z]) - 0.5 * pitch, slope, body)
            if line is not None and (best is None or line.height < best.height - HIGHER):
                best = within_reach(line, reachable) or best
            if best is not None and best.height <= floor + HIGHER:
                break
        if best is None or left_below(best, low[POINT], away, slope, contacts, pitch) <= WORTH * pitch * pitch:
            continue
        assert best.rotation is not None
        if onwards < RECEDES and -best.rotation[Z, Z] > UPRIGHT:
            # The stick stays beside what stands out farthest, and the sphere comes in under that by as much.
            room = body.under - float((side * (own[:, POINT_X + axis] - low[POINT_X + axis])).max())
            expected = max(float(low[Z]) + max(room, 0.0) / onwards, floor)
            if best.height > floor + HIGHER and best.ceiling - max(expected, best.height) < LEAST * pitch:
                continue
            best = replace(best, expected=expected)
        lines.append(replace(best, end=end - side * BEYOND))
    return lines


def touched_sides(
    contacts: np.ndarray, axis: int, places: np.ndarray, area: Area
) -> Iterator[tuple[float, float, float, np.ndarray, np.ndarray]]:
    """Place m, sign of the side, and its border m, for each side that was touched on lines along an axis.

    With them the rows of `contacts` (m, 10) that are on that line, and those of them that face to that side.
    """
    for place in np.sort(places).tolist():
        own = contacts[np.abs(contacts[:, 1 - axis] - place) < NEAR]
        for side, border in ((-1.0, float(area.lower[axis])), (1.0, float(area.upper[axis]))):
            facing = own[side * own[:, NORMAL_X + axis] > FACING]
            if len(facing):
                yield place, side, border, own, facing


def within_reach(line: Line, reachable: Callable[[Line], bool]) -> Line | None:
    """The line from as far out as the arm can drive it; None where that is right before the side, or nowhere."""
    for inwards in np.arange(0.0, abs(line.end - line.begin) - ROOM, NEARER).tolist():
        nearer = replace(line, begin=line.begin + line.sign * inwards)
        if reachable(nearer):
            return nearer
    return None


def left_below(
    line: Line, touch: np.ndarray, away: np.ndarray, slope: float, contacts: np.ndarray, pitch: float
) -> float:
    """m^2 that a line up a side would touch and nothing has touched yet: no more than half a pitch beside and below it.

    The side goes on below and beside a `touch` (3,) with the horizontal normal `away` (3,), and out by `slope` m for
    each m below.
    """
    half = 0.5 * pitch
    beside = np.linspace(-half, half, max(round(pitch / GRAIN), 2))
    heights = np.arange(line.height - half, line.ceiling, GRAIN)
    s, z = (ticks.ravel() for ticks in np.meshgrid(beside, heights, indexing="ij"))
    out = slope * (touch[Z] - z)
    there = np.stack([touch[0] + out * away[0] - s * away[1], touch[1] + out * away[1] + s * away[0], z], axis=1)
    near = contacts[contacts[:, NORMAL] @ away > FACING]
    near = near[np.abs(near[:, POINT_X:POINT_Z] - touch[:Z]).max(axis=1) < 2.0 * pitch, POINT]
    apart = ((there[:, None] - near) ** 2).sum(axis=2).min(axis=1)
    return float((apart > half * half).mean()) * pitch * max(line.ceiling - line.height + half, 0.0)


def _lowest(line: Line, highest: float, slope: float, body: BodySpace) -> Line | None:
    """The line at the least height, up to `highest` m, at which the body may go to where the side is expected.

    The side goes out by `slope` m for each m below where it was touched, at the line's end.
    """
    assert line.rotation is not None
    places, needed = body.lowest(line, line.rotation)
    distance = np.abs(places - line.begin)
    for height in np.arange(line.height, highest, HIGHER).tolist():
        out = slope * (line.ceiling - height)
        expected = max(float(distance[-1]) - out, 0.0)
        if needed[np.searchsorted(distance, expected - 1e-9)] <= height:
            return replace(line, height=height)
    return None
