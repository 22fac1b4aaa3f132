"""The line scheduler: the lines of the grid, and after them those that close what the grid has left out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import GRID_X, NORMAL, NORMAL_X, NORMAL_Z, POINT, ContactMemory
from lwrprobe_strategies.planning.gap_lines import OVER, lines_across, near_sides
from lwrprobe_strategies.planning.leaning_lines import leaning_lines
from lwrprobe_strategies.planning.left_strips import left_strips
from lwrprobe_strategies.planning.lines import Grid, Line, X, Y, Z
from lwrprobe_strategies.planning.low_lines import low_lines
from lwrprobe_strategies.planning.low_sides import ALIKE, FACING, HIGHER, RECEDES, Leans, low_sides
from lwrprobe_strategies.planning.outer_parts import outer_parts
from lwrprobe_strategies.planning.outlines import outlines
from lwrprobe_strategies.planning.treads import treads
from lwrprobe_strategies.planning.upright_body import line_height, lowest_beside

HALF = 0.25
"""Line spacings by which a second line up a side must begin higher than the first one, which touched nothing."""
BESIDE = 1.5
"""Line spacings across a line, within which another line is its neighbour."""
ONWARD = 0.3
"""Share of a normal along a line, from which on a contact is on the far side of the object."""


class LineScheduler:
    """Which line is driven next. It plans; it moves nothing.

    Parameters
    ----------
    task : the area, the probe and where it stands
    memory : the contacts so far; read when the grid is done
    options : how far lines are apart, which one is first, and which follow those of the grid
    body, leans : where the body of the probe may go, and how it may be held there; None = it is above all there is
    """

    def __init__(
        self,
        task: Task,
        memory: ContactMemory,
        options: CoverageConfig,
        body: BodySpace | None = None,
        leans: Leans = lambda away: (),
    ) -> None:
        self._body, self._leans = body, leans
        self._task, self._area, self._memory, self._spacing = task, task.area, memory, options.step
        self._options = options
        first = None if options.first_line == "border" else float(task.start[0])
        self.grid = Grid.over(task.area, options.step, first, task.probe.radius)
        self.height = line_height(task)
        self._number = self._driven = -1  # of the present line of the grid; of lines done
        self._inserted: Line | None = None
        self._coming: deque[Line] = deque()
        self._given_up: list[Line] = []
        self._stopped: list[Line] = []  # of the grid, given up
        self._raised: list[Line] = []
        self._missed: list[Line] = []  # up sides, on which nothing was touched
        self._across = np.empty(0)
        self._treads: list[Line] = []  # planned so far
        self._strips: list[Line] = []  # likewise
        self._sides: dict[tuple[int, float, float], float] = {}  # m, height of the lowest line up each side
        gaps = (
            (True, self._from_the_other_end), (options.near_sides, self._outer_parts),
            (options.near_sides, self._near_sides),
            (options.low_lines, self._low_lines),
            (options.across, self._lines_across), (options.across and options.near_sides, self._left_strips),
            (options.across and options.near_sides, self._low_ends),
            (options.across and options.near_sides, self._lower_sides),
            (options.across and options.near_sides, self._leaning_lines),
            (options.find_ends, self._outlines), (options.near_sides, self._left_treads),
            (options.across and options.near_sides, self._left_strips),
        )  # fmt: skip
        self._passes: deque[Callable[[], list[Line]]] = deque(plan for wanted, plan in gaps if wanted)

    def next(self, here: np.ndarray) -> Line | None:
        """The next line from `here` (3,) m, where the tip is; None when nothing is left out."""
        if self._inserted is not None:
            line, self._inserted = self._inserted, None
            return line if line.axis == Y else self._above(line)  # along y even the free part has to be driven
        self._driven += 1
        self._number += 1
        if self._number < len(self.grid):
            return self._grid_line(here)
        while not self._coming and self._passes:
            plan = self._passes.popleft()
            self._coming.extend(plan())
            if self._coming and plan in (self._lower_sides, self._left_treads):
                self._passes.appendleft(plan)  # each of its lines shows more
        if not self._coming:
            return None
        line = self._nearest(here)
        if line.fallback is not None and self.blocked_before(line):
            return line.fallback
        if line.low and self._missed_beside(line):
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
        self.insert(replace(line, height=self.height) if line.height == before else line)

    def give_up(self, line: Line, touched: bool = True, lost: bool = False) -> None:
        """The line cannot be driven to its end: its fallback comes next, where it has one.

        Where a side has not been `touched` by a line up to where it was touched before, half of the way up comes next:
        what overhangs may let nothing be touched farther down. Where the side was seen to recede, that is once, from as
        low as it is expected to be touched. A line of the grid comes again from its other end, unless nothing was
        `touched` last or what it followed was `lost`: nothing was in its way.
        """
        if line.low and not touched:
            self._missed.append(line)
            higher = self._higher(line)
            if higher is not None:
                self.insert(higher)
                return
        self.insert(line.fallback)
        if line.fallback is not None:
            self._given_up.append(line)
        elif self._number < len(self.grid) and line.axis == Y and line.free_end and touched and not lost:
            self._stopped.append(line)

    def _higher(self, line: Line) -> Line | None:
        """A line up a side from where that may be touched, when it is not as low as the line begins; None = nowhere."""
        up = 0.5 * (line.ceiling - line.height) if line.expected is None else line.expected - line.height
        worth = HALF * self._spacing < up < line.ceiling - line.height - HALF * self._spacing
        return replace(line, height=line.height + up) if worth else None

    def _missed_beside(self, line: Line) -> bool:
        """Whether the line beside one up a side, as low as that, touched nothing, and this side recedes as well."""
        return line.expected is not None and any(
            (other.axis, other.sign) == (line.axis, line.sign)
            and abs(other.height - line.height) < HIGHER
            and abs(other.place - line.place) < BESIDE * self._spacing
            for other in self._missed
        )

    def blocked_before(self, line: Line) -> bool:
        """Whether one like it had to be given up beside it."""
        return any(
            other.axis == line.axis
            and abs(other.begin - line.begin) < self._spacing
            and abs(other.place - line.place) < BESIDE * self._spacing
            for other in self._given_up
        )

    def raise_line(self, line: Line) -> None:
        """Go on with the same line higher up: at least as high as one beside it had to be driven."""
        self.insert(self._above(replace(line, raised=True)))

    def lowest(self, line: Line) -> float:
        """m, height at which a line may be driven beside what was touched."""
        if self._body is not None:
            self._body.survey()
            needed = float(self._body.lowest(line, self._task.orientation)[1][-1]) + self._task.clearance_threshold
            return min(max(needed, float(self._area.lower[Z])), float(self._area.upper[Z]))
        return lowest_beside(line, self._memory.contacts()[:, POINT], self._task)

    def _above_receding(self, line: Line) -> float:
        """m, height at which a line across may be driven: that of the grid where the side that it meets recedes below.

        There the grid's lines have shown the path to be free. Farther down nothing would be met; what can be touched
        there is left to the lines up the sides.
        """
        lowest, contacts = self.lowest(line), self._memory.contacts()
        along, aside = (contacts[:, axis] for axis in (line.axis, line.aside))
        low, high = sorted((line.begin, line.end))
        near = (np.abs(aside - line.place) < BESIDE * self._spacing) & (along > low - self._spacing)
        near &= (along < high + self._spacing) & (line.sign * contacts[:, NORMAL_X + line.axis] < -FACING)
        side = contacts[near]
        if not len(side):
            return lowest
        last = side[side[:, Z] < side[:, Z].min() + ALIKE]
        recedes = float(np.median(last[:, NORMAL_Z])) < RECEDES
        tall = float(side[:, Z].max()) > self.height + self._task.probe.radius
        return max(lowest, self.height) if recedes and tall else lowest

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
            for other in self._raised
            if (other.axis, other.sign) == (line.axis, line.sign)
            and abs(other.end - line.end) < self._spacing
            and abs(other.place - line.place) < BESIDE * self._spacing
        ]
        if beside and not line.on_surface:
            line = replace(line, height=max(line.height, *beside), raised=True)
        if line.raised:
            self._raised.append(line)
        return line

    def _grid_line(self, here: np.ndarray) -> Line:
        """The present line of the grid, from the border that is nearer."""
        low, high = float(self._area.lower[Y]), float(self._area.upper[Y])
        line = Line(Y, float(self.grid.x[self._number]), low, high, self.height, free_end=True)
        return line if here[Y] <= 0.5 * (low + high) else line.turned()

    def _from_the_other_end(self) -> list[Line]:
        """The grid's lines that were given up on the side of the object where they met it, each the other way round."""
        contacts, lines = self._memory.contacts(), []
        for line in self._stopped:
            normals = contacts[contacts[:, GRID_X] == line.place, NORMAL]
            came_over = (normals[:, Z] > OVER) | (normals @ line.ahead > ONWARD)
            if len(normals) and not came_over.any():
                low, high = sorted((float(self._area.lower[Y]), float(self._area.upper[Y])), reverse=line.sign > 0.0)
                lines.append(Line(Y, line.place, low, high, self.height, free_end=True))
        return lines

    def _outer_parts(self) -> list[Line]:
        if self._body is None:
            return []
        contacts, trail = self._memory.contacts(), self._memory.trail()
        return outer_parts(contacts, trail, self.grid.x, self._task, self.height, self._spacing)

    def _near_sides(self) -> list[Line]:
        if self._body is not None:
            return self._low_sides(Y, self.grid.x, self._body)
        contacts, trail = self._memory.contacts(), self._memory.trail()
        raised = np.array([line.place for line in self._raised if line.axis == Y])
        return near_sides(contacts, trail, self._area, self._spacing, self.lowest, raised)

    def _reachable(self, line: Line) -> bool:
        """Whether the arm can go over the line's beginning, and down and along it."""
        over = np.array([*line.start[:2], self._area.upper[Z]])
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = line.rotation, (over, line.start, line.at(line.end))
        return self._task.reachable(list(poses))

    def _low_lines(self) -> list[Line]:
        contacts, trail = self._memory.contacts(), self._memory.trail()
        return low_lines(contacts, trail, self.grid.x, self._spacing, self._task)

    def _lines_across(self) -> list[Line]:
        contacts, trail, floor = self._memory.contacts(), self._memory.trail(), float(self._area.lower[Z])
        radius = self._task.probe.radius
        lowest = self._above_receding if self._body is not None and self._options.near_sides else self.lowest
        lines = lines_across(contacts, trail, self.grid.x, self._spacing, floor, lowest, radius)
        self._across = np.unique([line.place for line in lines])
        return lines

    def _low_ends(self) -> list[Line]:
        return [] if self._body is None else self._low_sides(X, self._places(X), self._body)

    def _lower_sides(self) -> list[Line]:
        """What the lines since then have shown to be free may let the body come lower beside some sides."""
        if self._body is None:
            return []
        return self._low_sides(Y, self._places(Y), self._body) + self._low_sides(X, self._places(X), self._body)

    def _leaning_lines(self) -> list[Line]:
        """In under what stands out."""
        contacts, lines = self._memory.contacts(), []
        for axis in (Y, X):
            lines += leaning_lines(
                contacts, axis, self._places(axis), self._spacing, self._task, self._leans, self._reachable
            )
        return lines

    def _places(self, axis: int) -> np.ndarray:
        """(n,) m, of the lines along an axis, those up what others had left included."""
        lines = self.grid.x if axis == Y else self._across
        return np.concatenate([lines, [line.place for line in self._strips if line.axis == axis]])

    def _low_sides(self, axis: int, places: np.ndarray, body: BodySpace) -> list[Line]:
        """Those that are lower than any that was driven up the same side before."""
        body.survey()
        contacts, leans = self._memory.contacts(), self._leans
        lines = low_sides(contacts, axis, places, self._area, self._spacing, body, leans, self._reachable)
        lower = [line for line in lines if line.height < self._sides.get(_side(line), np.inf) - HIGHER]
        self._sides |= {_side(line): line.height for line in lower}
        return lower

    def _left_treads(self) -> list[Line]:
        """Those over which none was planned before."""
        if self._body is None:
            return []
        contacts, trail, apart = self._memory.contacts(), self._memory.trail(), 0.5 * self._spacing
        lines = treads(contacts, trail, self.grid.x, self._area, self._task.probe.radius, self._spacing)
        lines = [line for line in lines if not any(_alike(line, other, apart) for other in self._treads)]
        self._treads += lines
        return lines

    def _left_strips(self) -> list[Line]:
        """Those over which none was planned before."""
        lines = left_strips(self._memory.contacts(), self._area, self._spacing, self.lowest)
        apart = 0.5 * self._spacing
        lines = [line for line in lines if not any(_alike(line, other, apart) for other in self._strips)]
        self._strips += lines
        return lines

    def _outlines(self) -> list[Line]:
        return outlines(self._memory.contacts(), self.grid.x, self.height)


def _alike(line: Line, other: Line, apart: float) -> bool:
    """Whether two lines begin in the same place, up to `apart` m."""
    return line.axis == other.axis and bool(np.abs(line.start - other.start).max() < apart)


def _side(line: Line) -> tuple[int, float, float]:
    """Which side a line leads up to: axis, place [m], and sign of the travel."""
    return line.axis, line.place, line.sign
