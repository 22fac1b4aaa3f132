"""Lines up the sides of a tall object, below where the grid's lines touched it.

Over a tall object the grid is driven so high that the body behind the stick is above all that may be there. What the
grid has shown to be free lets the body come down beside the object, upright or leaning back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import NORMAL, NORMAL_X, NORMAL_Z, POINT, POINT_X, POINT_Z
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import ON_LINE, OVERLAP, Line, Z

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
GAP = 0.010
"""m between two sides that face each other, in which nothing was touched: they are two walls, no hollow. So wide that
the sphere in the middle is its radius off where it touched either."""
NEARER, SHORTEST = 0.010, 0.015
"""m by which a line begins nearer where the arm does not reach its beginning, and that it is long at least then."""
GRAIN = 0.0015
"""m between two places of a side that are looked at."""
WORTH = 0.4
"""Square pitches that a line must add to what is touched: other lines may have gone up the same side."""

RECEDES = -0.05
"""Share of the normal along z over that along the line, up to which a side recedes below."""
TOUCHED = 0.0015
"""m beyond half a pitch below a touch of a side, down to which its foot counts as touched."""
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
    """To each side that a line touched, as low as the body may go, and up to where it was touched.

    A line begins on the border, or nearer where the arm does not reach that. Where something else stands before the
    side, it begins in between, upright: what is known to be free there is known for an upright stick.

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
    for side in touched_sides(contacts, axis, places, area):
        low = side.lowest
        if low[Z] - floor <= 0.5 * pitch + TOUCHED:
            continue
        end = float(low[axis])
        whole = Line(axis, side.place, side.begin, end - side.sign * SPARE, floor, low=True)
        whole = replace(whole, ceiling=float(low[Z]) + OVERLAP)
        away, slope = side.away(), side.slope()
        widens = max(slope, 0.0)
        held = [rotation for rotation in orientations(away) if side.outer or -rotation[Z, Z] > UPRIGHT]
        best = _lowest_of(whole, held, float(low[Z]) - 0.5 * pitch, widens, body, reachable)
        if best is None or left_below(best, low[POINT], away, widens, contacts, pitch) <= WORTH * pitch * pitch:
            continue
        assert best.rotation is not None
        if slope < RECEDES and -best.rotation[Z, Z] > UPRIGHT:
            expected = max(float(low[Z]) + max(body.under - side.stands_out(), 0.0) / slope, floor)
            if best.height > floor + HIGHER and best.ceiling - max(expected, best.height) < LEAST * pitch:
                continue
            best = replace(best, expected=expected)
        lines.append(replace(best, end=end - side.sign * BEYOND))
    return lines


@dataclass(slots=True, frozen=True, eq=False)
class TouchedSide:
    """A side of the object that was touched on one line; there are several where gaps were left untouched between.

    Attributes
    ----------
    axis, place : of the line, and m on the other horizontal axis
    sign : -1 or +1, towards which end of the axis the side faces
    begin : m, where a line to it begins: that end of the area, or the middle of the gap before what stands in front
    on_line : (n, 10) contacts on the line, without what stands in front, as in `ContactMemory.contacts`
    facing : (m, 10) those of them that face to that side
    outer : nothing stands in front
    """

    axis: int
    place: float
    sign: float
    begin: float
    on_line: np.ndarray
    facing: np.ndarray
    outer: bool

    @property
    def lowest(self) -> np.ndarray:
        """(10,) the lowest contact."""
        lowest: np.ndarray = self.facing[np.argmin(self.facing[:, Z])]
        return lowest

    def away(self) -> np.ndarray:
        """(3,) unit, horizontal normal near the lowest contact."""
        out = np.median(self._near_lowest()[:, NORMAL], axis=0) * (1.0, 1.0, 0.0)
        return np.asarray(out / float(np.sqrt(out @ out)))

    def slope(self) -> float:
        """m by which the side goes out for each m below the lowest contact; negative where it recedes."""
        last = self._near_lowest()
        return float(np.median(last[:, NORMAL_Z] / (self.sign * last[:, NORMAL_X + self.axis])))

    def stands_out(self) -> float:
        """m by which the outermost contact on the line is farther out than the lowest one of the side.

        The stick stays beside that, and the sphere comes in under it by as much as it is wider.
        """
        out = self.sign * (self.on_line[:, POINT_X + self.axis] - self.lowest[POINT_X + self.axis])
        return float(out.max())

    def _near_lowest(self) -> np.ndarray:
        return self.facing[self.facing[:, Z] < self.lowest[Z] + ALIKE]


def touched_sides(contacts: np.ndarray, axis: int, places: np.ndarray, area: Area) -> Iterator[TouchedSide]:
    """Each side that was touched on the lines along an axis at `places` (n,) m; `contacts` (m, 10)."""
    for place in np.sort(places).tolist():
        own = contacts[np.abs(contacts[:, 1 - axis] - place) < ON_LINE]
        for sign, border in ((-1.0, float(area.lower[axis])), (1.0, float(area.upper[axis]))):
            outwards = own[np.argsort(sign * own[:, axis], kind="stable")]
            where, facing = sign * outwards[:, axis], sign * outwards[:, NORMAL_X + axis]
            gaps = np.flatnonzero((np.diff(where) > GAP) & (facing[:-1] > FACING) & (facing[1:] < -FACING)) + 1
            begins = [*(0.5 * (outwards[gaps - 1, axis] + outwards[gaps, axis])).tolist(), border]
            bounds = [0, *gaps.tolist(), len(own)]
            for begin, (first, last) in zip(begins, pairwise(bounds), strict=True):
                faces = outwards[first:last][facing[first:last] > FACING]
                if len(faces):
                    yield TouchedSide(axis, place, sign, begin, outwards[:last], faces, last == len(own))


def within_reach(line: Line, reachable: Callable[[Line], bool]) -> Line | None:
    """The line from as far out as the arm can drive it; None where that is right before the side, or nowhere."""
    for inwards in (0.0, *np.arange(NEARER, abs(line.end - line.begin) - SHORTEST, NEARER).tolist()):
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
    apart = ((there[:, None] - near) ** 2).sum(axis=2).min(axis=1, initial=np.inf)
    return float((apart > half * half).mean()) * pitch * max(line.ceiling - line.height + half, 0.0)


def _lowest_of(
    whole: Line,
    orientations: Sequence[np.ndarray],
    highest: float,
    slope: float,
    body: BodySpace,
    reachable: Callable[[Line], bool],
) -> Line | None:
    """The line in that of the orientations (3, 3) in which it is the lowest; the first of those that are alike."""
    best: Line | None = None
    for rotation in orientations:
        line = _lowest(replace(whole, rotation=rotation), highest, slope, body)
        if line is not None and (best is None or line.height < best.height - HIGHER):
            best = within_reach(line, reachable) or best
        if best is not None and best.height <= whole.height + HIGHER:
            break
    return best


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
