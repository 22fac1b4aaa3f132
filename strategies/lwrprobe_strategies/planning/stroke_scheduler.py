"""The stroke scheduler: which stroke is driven next, by the error that it is expected to remove per second.

Strokes go no lower than where the body behind the stick is above all that the area may hold. An object that is taller
than that goes on below them: its sides may lean out, and low parts may stand beside it, of which no contact tells
anything. There the lines of the grid show what is free, and let the body come down.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe.mapping.estimate import P95, REACH, Faces, SurfaceEstimate
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.free_space import FreeSpace
from lwrprobe_strategies.planning.lines import OVERLAP, Line, Y, Z
from lwrprobe_strategies.planning.low_sides import SideOrientations
from lwrprobe_strategies.planning.outward_lines import outward_lines
from lwrprobe_strategies.planning.paths import Speeds, seconds
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.planning.strokes import LIFT, Stroke, StrokePlanner
from lwrprobe_strategies.planning.unseen_places import longest_unseen
from lwrprobe_strategies.planning.upright_body import body as parts_of_body

SHORTLIST = 12
"""Strokes whose path to the start is computed: those with the best scores without it."""
PATIENCE, ROUNDS, PROGRESS = 200.0, 2.0, 0.9
"""s of strokes, and times what strokes two reaches apart take over all of the surface, whichever is longer: the mean
expected error has to fall meanwhile to this share of the least that it was before. What is left is out of reach."""
FOUND_ANEW = 1.5
"""Times that least, to which the mean rises meanwhile where a surface is found anew: no reason to end."""
FEW = 30
"""Contacts 2 mm apart, below which too little is known for strokes to be chosen by it."""
COARSE = 5.0
"""Times the error that is aimed at, below which the lines of the grid come first: strokes remove less and less."""
LITTLE_PATIENCE = 60.0
"""s of strokes without progress, after which they come first as well; and after which nothing more is expected once
they are done: strokes go where those before them have shown nothing new, and so have the lines."""
KNOWN = 2.0
"""Times that error, up to which a line of the grid leads no farther than to the side that it meets."""
MANY = 15
"""Lines of the grid, from which on they are driven in passes from coarse to fine: a few strokes then tell more of a
large object. Fewer lines are sooner driven one beside the other."""
UNSEEN = 2.0
"""Reaches of a contact, up to which the longest line may be through a part of the area of which nothing is known."""
ASIDE = np.array([0.0, 1.0, 0.0])


class StrokeScheduler(LineScheduler):
    """Chooses the stroke with the largest gain per second, until the expected error is small.

    Parameters
    ----------
    task, memory : as of `LineScheduler`
    spacing : m, between two lines, as long as nothing is touched
    estimate : of the surface and its error
    free : what the probe has shown to be free
    speeds : how fast a motion of the upright probe may be
    descent : m/s, down a wall in contact
    beneath : m/s, at which the stick may be met as far above the sphere's centre as is given, m
    aim : m, mean expected error at which nothing is left to do
    body, orientations : as of `LineScheduler`
    """

    def __init__(
        self,
        task: Task,
        memory: ContactMemory,
        spacing: float,
        estimate: SurfaceEstimate,
        free: FreeSpace,
        speeds: Speeds,
        descent: float,
        beneath: Callable[[float], float],
        aim: float,
        body: BodySpace | None = None,
        orientations: SideOrientations = lambda away: (),
    ) -> None:
        super().__init__(task, memory, CoverageConfig(spacing, find_ends=False), body, orientations)
        self._estimate, self._free, self._speeds, self._aim = estimate, free, speeds, aim
        self._planner = StrokePlanner(task, estimate.edge, descent, speeds.guarded(ASIDE), beneath)
        self.touched: np.ndarray | None = None
        """(3,) unit, normal of the surface on which the last stroke has ended, None where it ended in free space."""
        self.chained = False
        """The present stroke begins there, in contact."""
        if len(self.grid) >= MANY:
            self.grid = self.grid.coarse_to_fine()
        self._outward = deque(outward_lines(task.area, self.height))
        self._faces = estimate.faces()  # down to as low as strokes go, before the last choice
        self._tall = body is not None  # the object may go on below what strokes touch
        self._grid_left = True  # its lines, and those that close its gaps, are still to be driven
        self.grid_now = False
        """They are being driven."""
        self._spent = 0.0  # s, of all strokes as expected
        self._means: list[tuple[float, float]] = []  # that, and the mean expected error [m], before each stroke
        self.expected = np.inf
        """m, mean expected error of what the upright probe can reach, before the last choice."""
        self.share = 0.0
        """Of the work that is done, by the expected error."""

    def next(self, here: np.ndarray) -> Line | None:
        """The next line from `here` (3,) m; None when the expected error is as small as wanted."""
        self.chained = False
        if self._inserted is not None:
            return super().next(here)
        self._estimate.update()
        if len(self._estimate) >= FEW:
            self._outward.clear()
        if self._outward:  # presses on the top show how stiff the arm is
            self._driven += 1
            return self._outward.popleft()
        whole = self._estimate.faces()
        # Where the upright probe cannot come as low as that, no stroke removes any error.
        self._faces = faces = whole.above(self.height)
        if not len(faces.areas):  # nothing touched yet, or beside the border: lines through the middle of what is left
            line = super().next(here)
            return line if line is None else replace(line, outline=1)
        self.expected = faces.error()[0]
        self.share = min(self._aim / max(self.expected, 1e-9), 1.0)
        self._means.append((self._spent, self.expected))
        strokes_now = not self.grid_now
        stroke = self._best(faces, here) if strokes_now else None
        if stroke is not None and not (self._grid_left and self._grid_is_worth_more(whole, stroke)):
            return self._line_of_stroke(stroke)
        if self._grid_left:
            self.grid_now = True
            if (line := self._line_of_grid(here)) is not None:
                return line
            if not strokes_now:  # the lines have shown more
                stroke = self._best(faces, here)
        return None if stroke is None else self._line_of_stroke(stroke)

    # Lines of the grid, where the object goes on below what strokes touch

    def _much_unseen(self) -> bool:
        """Whether another part of the object may stand where the probe has not been, of which no contact tells."""
        reach = max(self._faces.reach, REACH)  # parts of an object are larger than its detail
        trail, contacts = self._memory.trail(), self._memory.contacts()
        seen = np.concatenate([trail[trail[:, Z] < self.height + reach, :Z], contacts[:, :Z]])
        there = self._estimate.footprint(self.height)
        return longest_unseen(self._area, seen, there, reach) > UNSEEN * reach

    def _grid_is_worth_more(self, whole: Faces, stroke: Stroke) -> bool:
        """Whether the lines of the grid, and those after them, are expected to remove more per second than a stroke.

        They remove all that is expected where the probe comes, if the object is as it is estimated.
        """
        if not self._tall:
            return False
        if self.expected < COARSE * self._aim or self._stalled(LITTLE_PATIENCE):
            return True
        heights, lowest = whole.centres[:, Z], np.full(len(whole.areas), -np.inf)
        keep = self._task.clearance_threshold - self._task.probe.radius
        for half, bottom in parts_of_body(self._task):
            lowest = np.maximum(lowest, self._estimate.tallest_beside(whole.centres, half) + keep - bottom)
        reached = heights >= np.minimum(lowest, self.height)
        worth, area = (float(values[reached].sum()) for values in (whole.expected() * whole.areas, whole.areas))
        return worth > stroke.score * self._seconds_of_grid(area)

    def _seconds_of_grid(self, area: float) -> float:
        """s, about, of all lines of the grid and those after them, over a surface of an `area`, m^2.

        Most lines of the grid are driven from both ends, and each leaves the surface and comes to it.
        """
        task, along = self._task, float(self._area.upper[Y] - self._area.lower[Y])
        over = 2.0 * len(self.grid) * (2.0 * LIFT + along / self._speeds.guarded(ASIDE))
        return over + area / (self._spacing * task.contour_speed)

    def _line_of_grid(self, here: np.ndarray) -> Line | None:
        """The next line of the grid, or of those that close its gaps; None when none is left.

        Over a low object only lines of the grid, and as long as much was not seen: strokes close its gaps.
        """
        self._means.clear()  # they show to strokes what was of no use to them before
        done = not self._tall and (self._number + 1 >= len(self.grid) or not self._much_unseen())
        line = None if done else super().next(here)
        self.grid_now = self._grid_left = line is not None
        return line

    def _grid_line(self, here: np.ndarray) -> Line:
        """As a line of the grid; only up to the side that it meets, where the surface above is known.

        What it has met is then touched from the other end as well.
        """
        line, faces = super()._grid_line(here), self._faces
        near = np.abs(faces.centres[:, line.aside] - line.place) < 0.5 * self._spacing
        expected = float((faces.expected() * faces.areas)[near].sum())
        if not self.grid_now or expected > KNOWN * self._aim * float(faces.areas[near].sum()):
            return line
        line = replace(line, ceiling=line.height + OVERLAP)
        self._gaps.stopped.append(line)
        return line

    # Strokes

    def _line_of_stroke(self, stroke: Stroke) -> Line:
        """The line of a stroke that is driven now."""
        self._driven += 1
        self._spent += stroke.seconds
        self._planner.driven(self._faces, stroke)
        self.chained = stroke.chained
        return stroke.line if stroke.chained else self._above(stroke.line)

    def _best(self, faces: Faces, here: np.ndarray) -> Stroke | None:
        success = self._planner.success(faces)
        mean, p95 = faces.error(success)
        patience = self.patience(faces) if self._grid_left else LITTLE_PATIENCE
        if self._stalled(patience) or (mean <= self._aim and p95 <= P95 * self._aim):
            return None
        strokes = self._planner.strokes(faces, success, self.height, here, self.touched)
        departure = Departure(here, self._task.orientation, self._task.area, self._free, self._speeds)
        best: Stroke | None = None
        for stroke in sorted(strokes, key=lambda stroke: -stroke.score)[:SHORTLIST]:
            if best is not None and best.score >= stroke.score:  # the path to it makes it worth less still
                break
            timed = replace(stroke, seconds=stroke.seconds + self._seconds_to(stroke, departure))
            if best is None or timed.score > best.score:
                best = timed
        return best

    def _seconds_to(self, stroke: Stroke, departure: Departure) -> float:
        """s, of the path to the start of a stroke."""
        if stroke.chained:
            return 0.0
        return seconds(departure.path_to(stroke.line), departure.here, self._speeds)

    def _stalled(self, patience: float) -> bool:
        """Whether the mean expected error has fallen no further in so many seconds of strokes."""
        spent, means = np.array(self._means).reshape(-1, 2).T
        before = means[spent <= self._spent - patience]
        if not 0 < len(before) < len(means):
            return False
        meanwhile, least = means[len(before) :], before.min()
        return bool(meanwhile.min() > PROGRESS * least and meanwhile.max() < FOUND_ANEW * least)

    def patience(self, faces: Faces) -> float:
        """s of strokes without progress, after which nothing more is expected: longer on a larger surface."""
        swept = 2.0 * faces.reach * self._task.contour_speed
        return max(PATIENCE, ROUNDS * float(faces.areas.sum()) / swept)

    def count(self) -> tuple[int, int]:
        """Strokes done, and as many as one more."""
        return max(self._driven, 0), max(self._driven, 0) + 1
