"""The line scheduler: the lines of the grid, and after them those that close what the grid has left out."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import NORMAL_X, POINT, ContactMemory
from lwrprobe_strategies.planning.gap_planner import GapPlanner
from lwrprobe_strategies.planning.lines import NEIGHBOUR, Grid, Line, X, Y, Z
from lwrprobe_strategies.planning.low_sides import HIGHER, SideOrientations
from lwrprobe_strategies.planning.upright_body import line_height, lowest_beside

FACES = -0.5
"""Share of a normal along a line, up to which a touch is one of a wall that the line meets."""
HALF = 0.5
"""Line spacings by which a second line up a side must begin higher than the first one, which touched nothing."""
FARTHER = 0.003
"""m that a line up a side goes on where it has to be higher."""


class LineScheduler:
    """Which line is driven next. It plans; it moves nothing.

    Parameters
    ----------
    task : the area, the probe and where it stands
    memory : the contacts so far; read when the grid is done
    options : how far lines are apart, which one is first, and which follow those of the grid
    body : where the body of the probe may go; None = it is above all there is
    orientations : how the probe may be held beside a side
    """

    def __init__(
        self,
        task: Task,
        memory: ContactMemory,
        options: CoverageConfig,
        body: BodySpace | None = None,
        orientations: SideOrientations = lambda away: (),
    ) -> None:
        self._task, self._area, self._memory, self._body, self._spacing = task, task.area, memory, body, options.step
        first = None if options.first_line == "border" else float(task.start[X])
        self.grid = Grid.over(task.area, options.step, first, task.probe.radius)
        self.height = line_height(task)
        self._gaps = GapPlanner(task, memory, options, self.grid.x, self.lowest, body, orientations)
        self._number = self._driven = -1  # of the present line of the grid; of lines done
        self._inserted: Line | None = None
        self._coming: deque[Line] = deque()
        self._given_up: list[Line] = []
        self._postponed: deque[Line] = deque()  # not reached from where the tip was
        self._tried: list[Line] = []  # those that were postponed before
        self._missed: list[Line] = []  # up sides, on which nothing was touched
        self._before = 0  # contacts, before the present line

    def next(self, here: np.ndarray) -> Line | None:
        """The next line from `here` (3,) m, where the tip is; None when nothing is left out."""
        self._before = len(self._memory)
        if self._inserted is not None:
            line, self._inserted = self._inserted, None
            return line if line.axis == Y else self._above(line)  # along y even the free part has to be driven
        self._driven += 1
        self._number += 1
        if self._number < len(self.grid):
            return self._grid_line(here)
        if not self._coming:
            self._coming, self._postponed = self._postponed, self._coming
        while not self._coming and (lines := self._gaps.next_pass()) is not None:
            self._coming.extend(lines)
        if not self._coming:
            return None
        line = self._nearest(here)
        if line.fallback is not None and self.blocked_before(line):
            beside = self._from_beside(line)
            if beside is None:
                return line.fallback
            self.leave_out(line)
            return beside
        if line.low and line.expected is not None and self._missed_beside(line):
            line = self._higher(line) or line
        return self._above(line)

    def in_passing(self, here: np.ndarray) -> Line:
        """The grid's next line, which a contour has reached by itself."""
        self._driven += 1
        self._number += 1
        return self._grid_line(here)

    def insert(self, line: Line | None) -> None:
        """Drive this next, and then go on as if it belonged to the present line."""
        self._inserted = line

    def raise_area(self, task: Task, line: Line) -> None:
        """The task's area reaches higher than before: the line on which that was found comes again."""
        before, self.height = self.height, line_height(task)
        self._task, self._area = task, task.area
        self._gaps.raise_area(task)
        self.insert(replace(line, height=self.height) if line.height == before else line)

    def give_up(self, line: Line, touched: bool = True, lost: bool = False, met: bool = False) -> None:
        """The line cannot be driven to its end: its fallback comes next, unless it was touched to where that begins.

        A line up a side that has not `touched` it comes again, from half of the way up to where the side was touched
        before: what overhangs may let nothing be touched farther down. Where the side recedes, it comes again once,
        from as low as the side is expected to be touched, and from half of the way as well if it has `met` something
        else than its side. It does not where the line beside it touched nothing up there either. A line of the grid
        comes again from its other end, unless nothing was `touched` last or what it followed was `lost`: then nothing
        has blocked it.
        """
        if line.survey:
            return
        if line.low and not touched:
            self._missed.append(line)
            higher = self._higher(line, met)
            if higher is not None and not self._missed_beside(higher):
                self.insert(higher)
                return
        instead = line.fallback
        if instead is not None and self._touched_at(instead.start):
            instead = None
        self.insert(instead)
        if instead is not None:
            self._given_up.append(line)
        elif self._number < len(self.grid) and line.axis == Y and line.free_end and touched and not lost:
            self._gaps.stopped.append(line)

    def postpone(self, line: Line) -> bool:
        """Drive the line after those that come next; False where that was done before."""
        # Rotations are arrays, which do not compare as a whole.
        if any(replace(line, rotation=None) == replace(other, rotation=None) for other in self._tried):
            return False
        self._tried.append(line)
        self._postponed.append(line)
        return True

    def _higher(self, line: Line, met: bool = False) -> Line | None:
        """A line up a side from where that may be touched, when it is not as low as the line begins; None = nowhere.

        One that was as low as its side is expected, and has `met` something there, comes from half of the way up.
        """
        least, whole = HALF * self._spacing, line.ceiling - line.height
        up = 0.5 * whole if line.expected is None else line.expected - line.height
        if met and up <= least:
            up = 0.5 * whole
        return replace(line, height=line.height + up) if least < up < whole - least else None

    def _touched_at(self, place: np.ndarray) -> bool:
        """Whether the present line has touched something within a line spacing of a place (3,) m."""
        centres = self._memory.contacts()[self._before :, : Z + 1]
        return bool((np.linalg.norm(centres - place, axis=1) < self._spacing).any())

    def highest_touch(self) -> float:
        """m, the largest height of the sphere's centre at which the present line touched something; else -inf."""
        return float(self._memory.contacts()[self._before :, Z].max(initial=-np.inf))

    def _missed_beside(self, line: Line) -> bool:
        """Whether the line beside one up a side, as high as that or higher, touched nothing: this side recedes, too."""
        return any(
            (other.axis, other.sign) == (line.axis, line.sign)
            and other.height > line.height - HIGHER
            and 0.0 < abs(other.place - line.place) < NEIGHBOUR * self._spacing
            for other in self._missed
        )

    def blocked_before(self, line: Line) -> bool:
        """Whether one like it had to be given up beside it."""
        return any(
            other.axis == line.axis
            and abs(other.begin - line.begin) < NEIGHBOUR * self._spacing
            and abs(other.place - line.place) < NEIGHBOUR * self._spacing
            for other in self._given_up
        )

    def leave_out(self, line: Line) -> None:
        """Not driven, because one beside it was blocked: neither is the next one beside it."""
        self._given_up.append(line)

    def _from_beside(self, line: Line) -> Line | None:
        """The line from as low as the wall was touched beside it; None where that is hardly below its upper end.

        From its foot the wall could not be reached there: it had to be followed down from its top.
        """
        assert line.fallback is not None
        touched = self._memory.contacts()
        along, facing = line.sign * touched[:, line.axis], line.sign * touched[:, NORMAL_X + line.axis]
        near = np.abs(touched[:, line.aside] - line.place) < NEIGHBOUR * self._spacing
        wall = near & (facing < FACES) & (along > line.sign * line.begin) & (along < line.sign * line.end)
        lowest = float(touched[wall, Z].min(initial=np.inf))
        if lowest > line.fallback.height - HALF * self._spacing:
            return None
        return replace(line, height=max(lowest, line.height), foot_followed=True)

    def raise_line(self, line: Line) -> None:
        """Go on with the same line higher up: at least as high as one beside it had to be driven."""
        self.insert(self._above(replace(line, raised=True)))

    def go_on_higher(self, line: Line, here: np.ndarray, rotation: np.ndarray) -> bool:
        """Go on with a line up a side from `here` (3,) m, where the body may come no farther as low as that, so high
        that it may come a little farther, held by `rotation` (3, 3); False where that leaves nothing to touch.
        """
        body = self._body
        if body is None or not line.low:
            return False
        body.survey()
        begin = float(here[line.axis])
        ahead = replace(line, begin=begin, end=begin + line.sign * FARTHER)
        needed = float(body.lowest(ahead, rotation)[1][-1])
        height = max(needed, float(here[Z]) + HIGHER)
        if height > line.ceiling - HALF * self._spacing:
            return False
        self.insert(replace(line, begin=begin, height=height))
        return True

    def lowest(self, line: Line) -> float:
        """m, height at which a line may be driven beside what was touched."""
        if self._body is not None:
            self._body.survey()
            needed = float(self._body.lowest(line, self._task.orientation)[1][-1])
            return min(max(needed, float(self._area.lower[Z])), float(self._area.upper[Z]))
        return lowest_beside(line, self._memory.contacts()[:, POINT], self._task)

    def neighbours(self) -> tuple[float, float] | None:
        """x of the present line of the grid and of the next one on the same side, m; None at the end of a side."""
        following = self._number + 1
        if following >= len(self.grid) or following == self.grid.second_side:
            return None
        return float(self.grid.x[self._number]), float(self.grid.x[following])

    def towards_next(self) -> float:
        """Sign of x in which the grid goes on."""
        last = min(self._number + 1, len(self.grid) - 1)
        return 1.0 if self.grid.x[last] >= self.grid.x[last - 1] else -1.0

    def count(self) -> tuple[int, int]:
        """Lines done, and lines known of."""
        driven = max(self._driven, 0)
        return driven, driven + len(self._coming) + max(len(self.grid) - max(self._number, 0), 0)

    def _nearest(self, here: np.ndarray) -> Line:
        """Of the lines that come, the one that begins nearest to `here` (3,) m in the plan view; it comes no more."""
        apart = [float(np.hypot(*(line.start - here)[:Z])) for line in self._coming]
        nearest = int(np.argmin(apart))
        line = self._coming[nearest]
        del self._coming[nearest]
        return line

    def _above(self, line: Line) -> Line:
        """The line, as high as lines beside it had to be raised."""
        beside = [
            other.height
            for other in self._gaps.raised
            if (other.axis, other.sign) == (line.axis, line.sign)
            and abs(other.end - line.end) < self._spacing
            and abs(other.place - line.place) < NEIGHBOUR * self._spacing
        ]
        if beside and not line.on_surface:
            line = replace(line, height=max(line.height, *beside), raised=True)
        if line.raised:
            self._gaps.raised.append(line)
        return line

    def _grid_line(self, here: np.ndarray) -> Line:
        """The present line of the grid, from the border that is nearer."""
        low, high = float(self._area.lower[Y]), float(self._area.upper[Y])
        line = Line(Y, float(self.grid.x[self._number]), low, high, self.height, free_end=True)
        return line if here[Y] <= 0.5 * (low + high) else line.turned()
