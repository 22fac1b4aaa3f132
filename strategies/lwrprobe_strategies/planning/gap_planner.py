"""Lines that close what the grid of lines has left out, planned pass after pass from the contacts so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import GRID_X, NORMAL, NORMAL_X, NORMAL_Z, ContactMemory
from lwrprobe_strategies.planning.floor_lines import floor_lines
from lwrprobe_strategies.planning.gap_lines import OVER, lines_across, near_sides, up_to
from lwrprobe_strategies.planning.leaning_lines import leaning_lines
from lwrprobe_strategies.planning.left_strips import left_strips
from lwrprobe_strategies.planning.lines import NEIGHBOUR, ON_LINE, Line, X, Y, Z
from lwrprobe_strategies.planning.low_lines import low_lines
from lwrprobe_strategies.planning.low_sides import ALIKE, FACING, HIGHER, RECEDES, SideOrientations, low_sides
from lwrprobe_strategies.planning.outer_parts import AT_BORDER, outer_parts
from lwrprobe_strategies.planning.outlines import outlines
from lwrprobe_strategies.planning.paths import tip_pose
from lwrprobe_strategies.planning.survey_lines import survey_lines
from lwrprobe_strategies.planning.treads import hollow_floors, treads
from lwrprobe_strategies.planning.unpassed_parts import unpassed_parts
from lwrprobe_strategies.planning.upright_body import line_height

ONWARD = 0.3
"""Share of a normal along a line, from which on a contact is on the far side of the object."""

SAME = 0.4
"""Line spacings across two lines up one side, below which one of them is enough."""
LOWER = 6
"""Times in a row that sides are tried lower, and what no line has passed is led through: below what overhangs each time
shows a little more, and takes as long."""


class GapPlanner:
    """Plans one pass of lines after another. Each pass looks for one kind of gap that the lines before it have left.

    Parameters
    ----------
    task : the area, the probe and where it stands
    memory : the contacts so far
    options : how far lines are apart, and which passes are wanted
    grid_x : (n,) m, x of the lines of the grid
    lowest : m, height at which a line may be driven beside what was touched
    body : where the body of the probe may go; None = it is above all there is
    orientations : how the probe may be held beside a side

    Attributes
    ----------
    height : m, of the lines of the grid
    stopped : lines of the grid that were given up, or end where they meet something; the scheduler adds to them
    raised : lines that had to be raised over what the stick met; the scheduler adds to them
    """

    def __init__(
        self,
        task: Task,
        memory: ContactMemory,
        options: CoverageConfig,
        grid_x: np.ndarray,
        lowest: Callable[[Line], float],
        body: BodySpace | None,
        orientations: SideOrientations,
    ) -> None:
        self._task, self._memory, self._options, self._spacing = task, memory, options, options.step
        self._grid_x, self._lowest, self._body, self._orientations = grid_x, lowest, body, orientations
        self.height = line_height(task)
        self.stopped: list[Line] = []
        self.raised: list[Line] = []
        self._across_y = np.empty(0)  # m, y of the lines across
        self._turned: list[Line] = []  # of the grid from the other end, planned so far
        self._unpassed: list[Line] = []  # likewise
        self._treads: list[Line] = []  # likewise
        self._strips: list[Line] = []  # likewise
        self._sides: list[Line] = []  # up sides, likewise
        self._before_floor = 0  # contacts, before the first lines on the floor
        tall, sides, across = body is not None, options.near_sides, options.across
        passes = (
            (True, self._from_the_other_end),
            (tall and sides, self._outer_parts),
            (tall and sides, self._unpassed_parts),
            (sides, self._near_sides),
            (options.low_lines, self._low_lines),
            (across, self._lines_across),
            (tall and across, self._from_the_other_end),
            (across and sides, self._left_strips),
            (tall and across and sides, self._low_ends),
            (tall and across and sides, self._lower_sides),
            (across and sides, self._leaning_lines),
            (options.find_ends, self._outlines),
            (tall and sides, self._floor_lines),
            (tall and sides, self._floor_lines_between),
            (tall and sides, self._hollow_floors),
            (tall and sides, self._left_treads),
            (tall and across and sides, self._lower_sides),
            (across and sides, self._left_strips),
        )
        self._last, self._rounds = self._from_the_other_end, 0  # the latest pass, and times in a row that it came
        self._held: list[Line] = []  # planned, and to be driven after what shows where they may go fast
        self._passes: deque[Callable[[], list[Line]]] = deque(plan for wanted, plan in passes if wanted)
        self._again: dict[Callable[[], list[Line]], float] = {  # times in a row that a pass comes
            self._from_the_other_end: np.inf,
            self._unpassed_parts: LOWER,
            self._lower_sides: LOWER,
            self._hollow_floors: np.inf,
            self._left_treads: np.inf,
        }

    def next_pass(self) -> list[Line] | None:
        """The lines of the next pass, in the order of planning; None when no pass is left."""
        if self._held:
            held, self._held = self._held, []
            return held
        if not self._passes:
            return None
        plan = self._passes.popleft()
        lines = plan()
        self._rounds = self._rounds + 1 if plan == self._last else 1
        self._last = plan
        if lines and self._rounds < self._again.get(plan, 0):
            self._passes.appendleft(plan)  # each of its lines shows more
        if self._body is None:
            return lines
        surveys = survey_lines(lines, self._task.area, self._body, self._reachable)
        if surveys:
            self._held = lines
        return surveys or lines

    def raise_area(self, task: Task) -> None:
        """The area of the task reaches higher than before."""
        self._task, self.height = task, line_height(task)

    # The passes

    def _from_the_other_end(self) -> list[Line]:
        """The grid's lines that ended on the side of the object where they met it, each the other way round.

        Of the others as well those that have left something out (`_unfinished`).
        """
        contacts, lines = self._memory.contacts(), []
        for line in self.stopped:
            normals = contacts[contacts[:, GRID_X] == line.place, NORMAL]
            came_over = (normals[:, Z] > OVER) | (normals @ line.ahead > ONWARD)
            if len(normals) and not came_over.any():
                other = next(other for other in self._from_borders(line.place) if other.sign != line.sign)
                lines.append(replace(other, ceiling=line.ceiling))
        planned = [line.place for line in lines]
        lines += [line for line in self._unfinished() if line.place not in planned]
        return self._not_planned_before(lines, self._turned)

    def _unfinished(self) -> list[Line]:
        """The grid's lines that did not come to one of the borders, from there.

        Beside what is lower than the stick is long, these are all that came to the other border. Else they are those
        that ended within a hollow: on the line beside, farther than they came, something was touched that faces them.
        """
        trail, contacts, lines = self._memory.trail(), self._memory.contacts(), []
        for x in self._grid_x.tolist():
            own = trail[(trail[:, GRID_X] == x) & (np.abs(trail[:, X] - x) < ON_LINE), Y]
            left = [line for line in self._from_borders(x) if (line.sign * (own - line.begin) > AT_BORDER).all()]
            if self._body is None:
                lines += left if len(left) == 1 else []
                continue
            beside = contacts[np.abs(contacts[:, X] - x) < self._spacing + ON_LINE]
            for line in left:
                came = float((line.sign * own).min(initial=np.inf))
                facing = beside[beside[:, NORMAL] @ line.ahead > ONWARD, Y]
                if (line.sign * facing < came - self._spacing).any():
                    lines.append(line)
        return lines

    def _from_borders(self, x: float) -> tuple[Line, Line]:
        """The grid's line at x [m], from both ends."""
        low, high = float(self._task.area.lower[Y]), float(self._task.area.upper[Y])
        line = Line(Y, x, low, high, self.height, free_end=True)
        return line, line.turned()

    def _outer_parts(self) -> list[Line]:
        """Beside the object, where no line of the grid has passed."""
        contacts, trail = self._memory.contacts(), self._memory.trail()
        return outer_parts(contacts, trail, self._grid_x, self._task, self.height, self._spacing)

    def _unpassed_parts(self) -> list[Line]:
        """Along x, between two parts of the object, where no line has passed."""
        body = self._body
        assert body is not None
        body.survey()
        lines = unpassed_parts(self._memory.contacts(), body, self._task.area, self.height, self._spacing)
        return self._not_planned_before(lines, self._unpassed)

    def _near_sides(self) -> list[Line]:
        """Along y, up the sides that a line of the grid met above their foot."""
        if self._body is not None:
            return self._low_sides(Y, self._grid_x)
        contacts, trail = self._memory.contacts(), self._memory.trail()
        raised = np.array([line.place for line in self.raised if line.axis == Y])
        return near_sides(contacts, trail, self._task.area, self._spacing, self._lowest, raised)

    def _low_lines(self) -> list[Line]:
        """Along y, lower than the grid, beside what is tall."""
        contacts, trail = self._memory.contacts(), self._memory.trail()
        return low_lines(contacts, trail, self._grid_x, self._spacing, self._task)

    def _lines_across(self) -> list[Line]:
        """Along x, over the faces that lie along the lines of the grid."""
        contacts, trail, floor = self._memory.contacts(), self._memory.trail(), float(self._task.area.lower[Z])
        radius = self._task.probe.radius
        lowest = self._lowest_before_receding if self._body is not None and self._options.near_sides else self._lowest
        lines = lines_across(contacts, trail, self._grid_x, self._spacing, floor, lowest, radius)
        if self._body is not None:
            lines = [self._begun_upright(line) for line in lines]
        self._across_y = np.unique([line.place for line in lines])
        return lines

    def _left_strips(self) -> list[Line]:
        """Up what is left between two touched strips of one steep face."""
        lines = left_strips(self._memory.contacts(), self._task.area, self._spacing, self._lowest)
        return self._not_planned_before(lines, self._strips)

    def _low_ends(self) -> list[Line]:
        """Along x, up the sides that face along it."""
        return self._low_sides(X, self._places(X))

    def _lower_sides(self) -> list[Line]:
        """What the lines since then have shown to be free may let the body come lower beside some sides."""
        return self._low_sides(Y, self._places(Y)) + self._low_sides(X, self._places(X))

    def _leaning_lines(self) -> list[Line]:
        """In under what stands out over a side, with a leaning probe."""
        contacts, lines = self._memory.contacts(), []
        for axis in (Y, X):
            lines += leaning_lines(
                contacts, axis, self._places(axis), self._spacing, self._task, self._orientations, self._reachable
            )
        return lines

    def _outlines(self) -> list[Line]:
        """Around the object's ends in x."""
        return outlines(self._memory.contacts(), self._grid_x, self.height)

    def _floor_lines(self) -> list[Line]:
        """On the floor, where a plate may lie below all lines so far."""
        self._before_floor = len(self._memory)
        return self._on_floor(np.empty((0, 2)))

    def _floor_lines_between(self) -> list[Line]:
        """Those in between as well, where the first ones have met a plate."""
        met = self._memory.contacts()[self._before_floor :]
        plate = met[met[:, NORMAL_Z] > OVER, :Z]
        return self._on_floor(plate) if len(plate) else []

    def _hollow_floors(self) -> list[Line]:
        """Down to the floors between walls of which nothing was touched: over the longest one at a time."""
        body = self._body
        assert body is not None
        body.survey()
        contacts, trail, lines = self._memory.contacts(), self._memory.trail(), []
        floors = hollow_floors(self._task, self._spacing)
        for axis, places in ((Y, self._grid_x), (X, self._across())):
            lines += treads(contacts, trail, axis, places, self._task, self._spacing, body, floors)
        for line in sorted(lines, key=lambda line: abs(line.end - line.begin), reverse=True):
            if new := self._not_planned_before([line], self._treads):
                return new
        return []

    def _left_treads(self) -> list[Line]:
        """Over plates that the grid has passed above: along y, and along x where no line along y is left.

        Where none is left, past the sides before which a plate goes on: what that shows lets the body come down there.
        """
        body = self._body
        assert body is not None
        body.survey()
        contacts, trail = self._memory.contacts(), self._memory.trail()
        for axis, places in ((Y, self._grid_x), (X, self._across())):
            lines = treads(contacts, trail, axis, places, self._task, self._spacing, body)
            if new := self._not_planned_before(lines, self._treads):
                return new
        return self._not_planned_before(self._outer_parts(), self._treads)

    # What passes have in common

    def _across(self) -> np.ndarray:
        """(n,) m, y of lines along x all over the area."""
        return np.arange(float(self._task.area.lower[Y]), float(self._task.area.upper[Y]), self._spacing)

    def _low_sides(self, axis: int, places: np.ndarray) -> list[Line]:
        """Up the sides at places (n,) m, as low as the body may go: lower than any line up the same side before."""
        body = self._body
        assert body is not None
        body.survey()
        contacts, area, orientations = self._memory.contacts(), self._task.area, self._orientations
        lines = low_sides(contacts, axis, places, area, self._spacing, body, orientations, self._reachable)
        before = len(self._sides)
        for line in lines:
            if not any(self._no_lower(line, other) for other in self._sides):
                self._sides.append(line)
        return self._sides[before:]

    def _on_floor(self, plate: np.ndarray) -> list[Line]:
        """On the floor; nearer to each other around the places (n, 2) m of a plate."""
        body = self._body
        assert body is not None
        body.survey()
        contacts, trail, places = self._memory.contacts(), self._memory.trail(), (self._across(), self._grid_x)
        return floor_lines(contacts, trail, places, self._task, self.height, self._spacing, body, plate)

    def _places(self, axis: int) -> np.ndarray:
        """(n,) m, of the lines along an axis, those up left strips included."""
        lines = self._grid_x if axis == Y else self._across_y
        return np.concatenate([lines, [line.place for line in self._strips if line.axis == axis]])

    def _not_planned_before(self, lines: list[Line], planned: list[Line]) -> list[Line]:
        """The lines that begin and end where none was `planned` before; they are added to those."""
        apart = 0.5 * self._spacing
        new = [line for line in lines if not any(_alike(line, other, apart) for other in planned)]
        planned += new
        return new

    def _no_lower(self, line: Line, other: Line) -> bool:
        """Whether a line leads up the same side as another, as good as beside it, and begins no lower."""
        same = (line.axis, line.sign) == (other.axis, other.sign) and abs(line.end - other.end) < self._spacing
        same &= abs(line.place - other.place) < SAME * self._spacing
        return same and line.height >= other.height - HIGHER

    def _reachable(self, line: Line) -> bool:
        """Whether the arm can go over the line's beginning, and down and along it."""
        over = np.array([*line.start[:2], self._task.area.upper[Z]])
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = line.rotation, (over, line.start, line.at(line.end))
        return self._task.reachable(list(poses))

    def _begun_upright(self, line: Line) -> Line:
        """A line across that begins in free space where the body may not come down to the place that was touched.

        A leaning probe has touched it, whose body was elsewhere.
        """
        body = self._body
        assert body is not None
        line = line if line.fallback is None else replace(line, fallback=self._begun_upright(line.fallback))
        if not line.on_surface or body.knows(tip_pose(line.start, body.upright)):
            return line
        free = replace(line, on_surface=False, free_to=np.inf)
        return replace(free, height=self._lowest(up_to(free, self._spacing)))

    def _lowest_before_receding(self, line: Line) -> float:
        """m, height at which a line across may be driven: that of the grid where the side that it meets recedes below.

        There the grid's lines have shown the path to be free. Farther down nothing would be met; what can be touched
        there is left to the lines up the sides.
        """
        lowest, contacts = self._lowest(line), self._memory.contacts()
        along, aside = (contacts[:, axis] for axis in (line.axis, line.aside))
        low, high = sorted((line.begin, line.end))
        near = (np.abs(aside - line.place) < NEIGHBOUR * self._spacing) & (along > low - self._spacing)
        near &= (along < high + self._spacing) & (line.sign * contacts[:, NORMAL_X + line.axis] < -FACING)
        side = contacts[near]
        if not len(side):
            return lowest
        last = side[side[:, Z] < side[:, Z].min() + ALIKE]
        recedes = float(np.median(last[:, NORMAL_Z])) < RECEDES
        tall = float(side[:, Z].max()) > self.height + self._task.probe.radius
        return max(lowest, self.height) if recedes and tall else lowest


def _alike(line: Line, other: Line, apart: float) -> bool:
    """Whether two lines along one axis begin and end in the same places, up to `apart` m."""
    ends = np.stack([line.start - other.start, line.at(line.end) - other.at(other.end)])
    return line.axis == other.axis and bool(np.abs(ends).max() < apart)
