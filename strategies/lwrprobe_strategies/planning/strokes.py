"""Strokes: long lines and outlines over the estimated surface, and the error that each is expected to remove.

A stroke is worth the expected error that it removes, integrated over the surface, for each second that it takes. A face
beside a stroke is afterwards no farther from a contact than from the stroke.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe.mapping.estimate import EXTRUDED, Faces
from lwrprobe_strategies.planning.lines import Line, X, Y, Z
from lwrprobe_strategies.planning.paths import STOP
from lwrprobe_strategies.planning.stroke_profile import StrokeProfile

LIFT = 1.5
"""s, of leaving a surface and of coming to rest on another one, besides the path itself."""
CLIMB_BACK = 4.0
"""s, of leaving the upper edge of a wall and coming to its foot, from where it is climbed."""
INSIDE = 0.006
"""m from the edge of the top, at which a stroke over the top begins: the edge is known to a few millimetres."""
OVER_EDGE = 0.005
"""m before the wall's plane, at which a stroke over the top ends: the sphere stands on the edge there, and has not yet
rolled over it."""
SHORTEST = 0.010
"""m of a stroke: a shorter one takes longer to reach than to drive."""
UPRIGHT = 0.7
"""Share of the normal along a line, from which on a face is one of the walls at its ends."""
SQUARE = 0.9
"""Share of the normal along the approach, from which on a wall is met squarely."""
LEVELS = 0.008
"""m between the heights of outlines that are considered."""
BELOW = 0.008
"""m under the top, down to which an outline would run along the top's rounded edge."""
RETRY_WEIGHT = 0.3
"""Weight of error that a stroke was expected to remove and did not, each time."""
CELL = 0.006
"""m, of the cells in which that is remembered."""


@dataclass(slots=True, frozen=True)
class Stroke:
    """A line and what it is expected to bring.

    Attributes
    ----------
    line : to drive
    gain : m^3, expected error removed, integrated over the surface
    seconds : of the stroke, without the path to its start
    chained : it begins where the last one has ended, in contact
    """

    line: Line
    gain: float
    seconds: float
    chained: bool = False

    @property
    def score(self) -> float:
        """m^3/s"""
        return self.gain / self.seconds


@dataclass(slots=True)
class StrokePlanner:
    """Lists strokes over an estimated surface.

    Parameters
    ----------
    task : area, probe and speeds
    edge : m, of the estimate's grid
    down : m/s, of a descent along a wall
    across : m/s, at which something may be met from the side
    beneath : m/s, at which the stick may be met as far above the sphere's centre as is given, m
    """

    task: Task
    edge: float
    down: float
    across: float
    beneath: Callable[[float], float]
    _failed: dict[tuple[int, ...], float] = field(default_factory=dict)
    _driven: list[Line] = field(default_factory=list)

    def strokes(
        self, faces: Faces, success: np.ndarray, low: float, here: np.ndarray, normal: np.ndarray | None
    ) -> list[Stroke]:
        """All strokes that are worth anything.

        Parameters
        ----------
        faces : the estimated surface
        success : (n,) as of `success`
        low : m, height at which the body is clear of all that the area may hold
        here : (3,) m, of the tip
        normal : (3,) unit, of the surface that is touched there; None where none is
        """
        worth = faces.expected() * faces.areas * success
        if not len(worth):
            return []
        found: list[Stroke] = []
        for axis in (X, Y):
            across = faces.centres[:, 1 - axis]
            for place in np.arange(across.min(), across.max() + self.edge, 2.0 * self.edge).tolist():
                profile = self._profile(faces, worth, axis, place)
                if profile is not None:
                    found += self._cuts(profile, axis, place, low)
            if normal is not None:
                profile = self._profile(faces, worth, axis, float(here[1 - axis]))
                if profile is not None:
                    found += self._chained(profile, axis, here, normal)
        for level in np.arange(low, faces.centres[:, Z].max() - BELOW, LEVELS).tolist():
            found += self._outlines(faces, worth, level, here)
        return [stroke for stroke in found if stroke.gain > 0.0 and not self._again(stroke.line)]

    def _again(self, line: Line) -> bool:
        """Whether nearly the same stroke has been driven: what it has not shown, it will not show the next time."""
        if line.outline:
            return any(abs(line.height - other.height) < LEVELS for other in self._driven if other.outline)
        low, high = min(line.begin, line.end) + SHORTEST, max(line.begin, line.end) - SHORTEST
        return any(
            other.axis == line.axis
            and not other.outline
            and abs(line.place - other.place) < self.edge
            and min(other.begin, other.end) <= low
            and max(other.begin, other.end) >= high
            for other in self._driven
        )

    def driven(self, faces: Faces, stroke: Stroke) -> None:
        """A stroke is driven: error that it was to remove and does not, counts less from now on."""
        line = stroke.line
        self._driven.append(line)
        near = self._apart(faces, stroke) < 0.5 * faces.reach
        for key in set(self._cells(faces.centres[near])):
            self._failed[key] = RETRY_WEIGHT * self._failed.get(key, 1.0)

    def _apart(self, faces: Faces, stroke: Stroke) -> np.ndarray:
        """(n,) m, from each face to the path of a stroke that touches it; infinite where that touches none like it."""
        line, axis = stroke.line, stroke.line.axis
        if line.outline:
            return np.where(faces.axes == Z, np.inf, np.abs(faces.centres[:, Z] - line.height))
        apart = _beside(faces, axis, line.place, self.edge, float(faces.centres[:, axis].min(initial=np.inf)))
        if not line.on_surface:
            return apart
        low, high = min(line.begin, line.end), max(line.begin, line.end)
        along = faces.centres[:, axis]
        apart = np.maximum(apart, np.maximum(low - along, along - high))
        return apart if stroke.chained else np.where(_walls(faces, axis) == 0, apart, np.inf)

    def success(self, faces: Faces) -> np.ndarray:
        """(n,) weight of the expected error of each face, by how often a touch nearby has failed."""
        success, far = np.ones(len(faces.areas)), faces.distances > 0.6 * faces.reach
        if self._failed:
            success[far] = [self._failed.get(key, 1.0) for key in self._cells(faces.centres[far])]
        return success

    @staticmethod
    def _cells(places: np.ndarray) -> list[tuple[int, ...]]:
        return list(map(tuple, np.floor(places / CELL).astype(np.int64).tolist()))

    def _profile(self, faces: Faces, worth: np.ndarray, axis: int, place: float) -> StrokeProfile | None:
        """Along the line at `place` m on the other axis; None where there is no surface under it."""
        within = np.abs(faces.centres[:, 1 - axis] - place) < faces.reach
        faces, worth, begin = faces.only(within), worth[within], float(faces.centres[:, axis].min())
        path = _under(faces, axis, place, self.edge)
        if not path.any():
            return None
        beside, wall = _beside(faces, axis, place, self.edge, begin), _walls(faces, axis)
        near = beside < faces.reach
        return StrokeProfile(
            along=faces.centres[near, axis],
            removed=faces.removed(worth, near, beside[near]),
            wall=wall[near],
            path_along=faces.centres[path, axis],
            lengths=faces.areas[path] / self.edge,
            path_wall=wall[path],
        )

    def _cuts(self, profile: StrokeProfile, axis: int, place: float, low: float) -> Iterator[Stroke]:
        """Lines both ways: from the side to the other side, from the side over the top, and over the top alone."""
        task, top = self.task, profile.top()
        if top is None:
            return
        speed, roof = task.contour_speed, float(task.area.upper[Z])
        sides = float(task.area.lower[axis]), float(task.area.upper[axis])
        for sign in (1, -1):
            (start, finish), (first, last) = (sides, top) if sign > 0 else (sides[::-1], top[::-1])
            up, climbed = profile.beyond(first, -sign)
            down, descended = profile.beyond(last, sign)
            over, length, into = profile.between(first, last)
            climb = LIFT + abs(first - start) / self.across + (climbed + length) / speed + into / self.down + 3.0 * STOP
            descent = min(descended / self.down, descended / speed + CLIMB_BACK) + abs(finish - last) / self.across
            yield Stroke(Line(axis, place, start, finish, low), up + over + down, climb + descent)
            end = last - sign * OVER_EDGE
            yield Stroke(Line(axis, place, start, end, low), up + over, climb)
            begin, stop = profile.clipped(first + sign * INSIDE, end)
            if (stop - begin) * sign >= SHORTEST:
                gain, length, into = profile.between(begin, stop)
                line = Line(axis, place, begin, stop, low, on_surface=True, free_to=roof)
                yield Stroke(line, gain, LIFT + length / speed + into / self.down)

    def _chained(self, profile: StrokeProfile, axis: int, here: np.ndarray, normal: np.ndarray) -> Iterator[Stroke]:
        """Lines both ways from where the tip touches: over the top, and up the wall that it touches before."""
        top = profile.top()
        if top is None:
            return
        place, height = float(here[1 - axis]), float(here[Z])
        for sign in (1, -1):
            begin = float(here[axis])
            end = (top[1] if sign > 0 else top[0]) - sign * OVER_EDGE
            climbs = normal[axis] * sign < -UPRIGHT
            if not climbs and normal[Z] < UPRIGHT:
                continue
            _, end = profile.clipped(begin, end)
            if (end - begin) * sign >= SHORTEST:
                gain, length, into = profile.between(begin - sign * self.edge if climbs else begin, end)
                line = Line(axis, place, begin, end, height, on_surface=True)
                seconds = STOP + length / self.task.contour_speed + into / self.down
                yield Stroke(line, gain, seconds, True)

    def _outlines(self, faces: Faces, worth: np.ndarray, level: float, here: np.ndarray) -> Iterator[Stroke]:
        """Around the object at a height, from the nearest place where a wall is met squarely."""
        beside = np.abs(faces.centres[:, Z] - level)
        walls = faces.axes != Z
        path = np.flatnonzero(walls & (beside <= 0.51 * self.edge))
        if not len(path):
            return
        near = walls & (EXTRUDED * beside < faces.reach)
        gain = float(faces.removed(worth, near, EXTRUDED * beside[near]).sum())
        square = path[np.abs(faces.normals[path, :2]).max(axis=1) > SQUARE]
        square = square if len(square) else path
        first = square[np.argmin(np.hypot(*(faces.centres[square, :2] - here[:2]).T))]
        place, normal = faces.centres[first], faces.normals[first]
        axis = X if abs(normal[X]) > abs(normal[Y]) else Y
        side = float((self.task.area.upper if normal[axis] > 0.0 else self.task.area.lower)[axis])
        inwards = -np.sign(normal[axis]) * 4.0 * faces.reach
        end = np.clip(place[axis] + inwards, self.task.area.lower[axis], self.task.area.upper[axis])
        line = Line(axis, float(place[1 - axis]), side, float(end), level, outline=1)
        length = float(faces.areas[path].sum() / self.edge)
        # What was touched above the outline may stand out over it: there the stick is what meets it. It does not from
        # where the stick has stood on an outline above.
        above = float(faces.centres[faces.distances < self.edge, Z].max(initial=level))
        stood = [other.height for other in self._driven if other.outline and other.height > level]
        reach, speed = min([above, *stood]) - level, self.task.contour_speed
        if reach > self.task.probe.radius:
            speed = min(speed, self.beneath(reach))
        yield Stroke(line, gain, LIFT + abs(side - place[axis]) / self.across + length / speed)


def _under(faces: Faces, axis: int, place: float, edge: float) -> np.ndarray:
    """(n,) bool: the faces under a line at `place` m on the other axis."""
    return np.abs(faces.centres[:, 1 - axis] - place) <= 0.51 * edge


def _walls(faces: Faces, axis: int) -> np.ndarray:
    """(n,) -1 and +1 for faces of the walls that look along an axis towards - and +, else 0."""
    facing = faces.normals[:, axis]
    return np.where((np.abs(facing) > UPRIGHT) & (faces.axes == axis), np.sign(facing), 0.0).astype(np.int64)


def _beside(faces: Faces, axis: int, place: float, edge: float, begin: float) -> np.ndarray:
    """(n,) m, from each face to the path of a line at `place` m on the other axis; no face lies before `begin` m.

    A wall beside the line is passed at the height of what is under the line there.
    """
    aside, heights = np.abs(faces.centres[:, 1 - axis] - place), faces.centres[:, Z]
    column = np.rint((faces.centres[:, axis] - begin) / edge).astype(np.int64)
    under, path = _under(faces, axis, place, edge), np.full(column.max(initial=0) + 1, -np.inf)
    np.maximum.at(path, column[under], heights[under])
    path[np.isinf(path)] = np.inf  # nothing is under the line there
    below = np.where(faces.axes == 1 - axis, np.maximum(path[column] - heights, 0.0), 0.0)
    return np.hypot(aside, below)
