"""Which line comes next: the grid's, and after them those that find what the grid has left out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.across import lines_across, near_sides, rims
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.lines import Grid, Line
from lwrprobe_strategies.touched import Touched
from lwrprobe_strategies.way import line_height, lowest_beside

Y = 1
ALMOST = 0.003
"""m above the area's floor, up to which a line that begins there counts as one on the floor."""


class Itinerary:
    """The lines in the order in which they are driven.

    Parameters
    ----------
    task : the area, the probe and where it stands
    touched : what has been felt so far; looked at when the grid is done
    step : m, between two lines
    first_line : `border` or `middle`
    near_side_feet, across, ends : which lines follow those of the grid
    """

    def __init__(
        self,
        task: Task,
        touched: Touched,
        step: float,
        first_line: str,
        *,
        near_side_feet: bool,
        across: bool,
        ends: bool,
    ) -> None:
        self._task, self._area, self._touched, self._step = task, task.area, touched, step
        first = None if first_line == "border" else float(task.start[0])
        self.grid = Grid.over(task.area, step, first, task.probe.radius)
        self.height = line_height(task)
        self._number = 0  # of the present line of the grid
        self._driven = 0
        self._coming: deque[Line] = deque()
        self._interposed: Line | None = None
        self._given_up: list[Line] = []
        self._raised: list[Line] = []
        self._passes: deque[Callable[[], list[Line]]] = deque()
        if near_side_feet:
            self._passes.append(lambda: near_sides(*self._felt(), self._area, step, self.lowest))
        if across:
            self._passes.append(self._lines_across)
        if ends:
            self._passes.append(lambda: rims(self._touched.table(), self.grid.x, self.height))

    def first(self, here: np.ndarray) -> Line:
        """The grid's first line."""
        return self._grid_line(here)

    def interpose(self, line: Line | None) -> None:
        """Drive this next and go on behind it, as if it belonged to the present line."""
        self._interposed = line

    def give_up(self, line: Line) -> None:
        """The line cannot be driven to its end: on with what is to be driven instead."""
        self.interpose(line.instead)
        if line.instead is not None:
            self._given_up.append(line)

    def raise_line(self, line: Line) -> None:
        """Go on with the same line higher up: at least as high as one beside it had to be driven."""
        self.interpose(self._above(replace(line, raised=True)))

    def _above(self, line: Line) -> Line:
        beside = [
            other.height
            for other in self._raised
            if (other.axis, other.sign) == (line.axis, line.sign)
            and abs(other.end - line.end) < self._step
            and abs(other.place - line.place) < 1.5 * self._step
        ]
        if beside and not line.on_surface:
            line = replace(line, height=max(line.height, *beside), raised=True)
        if line.raised:
            self._raised.append(line)
        return line

    def hopeless(self, line: Line) -> bool:
        """Whether one like it had to be given up right beside it."""
        return any(
            other.axis == line.axis
            and abs(other.begin - line.begin) < self._step
            and abs(other.place - line.place) < 1.5 * self._step
            for other in self._given_up
        )

    def lowest(self, line: Line) -> float:
        """m, height at which a line may be driven beside what has been touched."""
        return lowest_beside(line, self._touched.table()[:, 3:6], self._task)

    def after(self, here: np.ndarray) -> Line | None:
        """The present line is done; the next one, None when nothing is left out. `here` (3,) m is where the tip is."""
        if self._interposed is not None:
            line, self._interposed = self._interposed, None
            return line if line.axis == Y else self._above(line)  # along y even the free part has to be driven
        self._driven += 1
        self._number += 1
        if self._number < len(self.grid):
            return self._grid_line(here)
        while not self._coming and self._passes:
            self._coming.extend(self._passes.popleft()())
        if not self._coming:
            return None
        line = self._coming.popleft()
        if line.instead is not None and self.hopeless(line):
            return line.instead
        return self._above(line)

    def in_passing(self, here: np.ndarray) -> Line:
        """The grid's next line, to which a contour has come by itself."""
        self._driven += 1
        self._number += 1
        return self._grid_line(here)

    def neighbours(self) -> tuple[float, float] | None:
        """x of the present line of the grid and of the next one on the same side, m; None at the end of a side."""
        following = self._number + 1
        if following >= len(self.grid) or following == self.grid.second_side:
            return None
        return float(self.grid.x[self._number]), float(self.grid.x[following])

    def towards_next(self) -> float:
        """Sign of x, in which the grid goes on."""
        last = min(self._number + 1, len(self.grid) - 1)
        return 1.0 if self.grid.x[last] >= self.grid.x[last - 1] else -1.0

    def count(self) -> tuple[int, int]:
        """Lines done, and lines known of."""
        known = self._driven + len(self._coming) + max(len(self.grid) - self._number, 0)
        return self._driven, known

    def _grid_line(self, here: np.ndarray) -> Line:
        """The present line of the grid, from the border that is nearer."""
        low, high = float(self._area.lower[Y]), float(self._area.upper[Y])
        line = Line(Y, float(self.grid.x[self._number]), low, high, self.height, free_end=True)
        return line if here[Y] <= 0.5 * (low + high) else line.turned()

    def _felt(self) -> tuple[np.ndarray, np.ndarray]:
        return self._touched.table(), self._touched.way()

    def _lines_across(self) -> list[Line]:
        return lines_across(*self._felt(), self.grid.x, self._step, float(self._area.lower[Z]), self.lowest)
