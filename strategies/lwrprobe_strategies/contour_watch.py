"""Where the contour of a line ends: asked with every sample, it moves nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot

import numpy as np

from lwrprobe_strategies.encounter import shows_stiffness
from lwrprobe_strategies.outcomes import Ended, Outcome
from lwrprobe_strategies.planning.circling_watch import CirclingWatch
from lwrprobe_strategies.planning.climb import DescentWatch
from lwrprobe_strategies.planning.contour_end import at_table, turned_back, under
from lwrprobe_strategies.planning.lines import Line, X, Z
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.tip import Tip


@dataclass(eq=False)
class ContourWatch:
    """Says where a contour ends, beyond what `follow_contour` ends it for by itself.

    Attributes
    ----------
    tip : what the skills share
    upright : (3, 3), the orientation of the upright tip
    lines : the grid; the line up a wall that is left to be climbed is inserted there
    end_found : whether an outline has come to the end that it seeks
    leaves_descents : whether a wall down which a line leads may be climbed from the line's other end instead
    """

    tip: Tip
    upright: np.ndarray
    lines: LineScheduler
    end_found: Callable[[], bool]
    leaves_descents: Callable[[Line], bool]

    def begin_line(self) -> None:
        """The path along contours is measured anew."""
        self._circling = CirclingWatch(self.tip.task.area)

    def until(self, frame: TrackingFrame) -> Callable[[], Outcome | None]:
        """What says, with every sample of a contour in the frame's plane, with which outcome it ends there, if so."""
        descent = DescentWatch(self.tip.task, self.tip.control, self.lines.lowest, self.tip.free)
        return lambda: self._outcome(frame, descent)

    def _outcome(self, frame: TrackingFrame, descent: DescentWatch) -> Outcome | None:
        step = self.tip.period * hypot(*self.tip.seen.velocity.tolist())
        if self._circling.circles(frame, self.tip.here, step):
            return Ended.CIRCLING
        if frame.line.outline:
            return Ended.END_FOUND if self.end_found() else None
        if shows_stiffness(self.tip):
            return Ended.CONTACT  # as one that is touched anew: it is pressed first
        return self._level_outcome(frame) if frame.level else self._upright_outcome(frame, descent)

    def _level_outcome(self, frame: TrackingFrame) -> Outcome | None:
        """In a horizontal plane: at the next line, or where it leads away from that again."""
        if self._at_next_line():
            return Ended.NEXT_LINE
        return Ended.LINE_END if turned_back(self.tip.control, frame, self.lines.towards_next()) else None

    def _upright_outcome(self, frame: TrackingFrame, descent: DescentWatch) -> Outcome | None:
        """In the vertical plane of the line."""
        tip = self.tip
        if tip.here[Z] > frame.line.ceiling and tip.control.tangent(frame.binormal)[Z] > 0.0:
            return Ended.LINE_END
        if at_table(tip.control, frame, tip.here):
            return Ended.TABLE
        if tip.rotation is self.upright and under(tip.control, frame):
            return Ended.UNDERSIDE
        if frame.backward and tip.body is not None and not tip.body.keeps_clear(tip.seen.pose):
            return Ended.LINE_END
        return Ended.DESCENT if self._climbs_from_other_end(frame, descent) else None

    def _at_next_line(self) -> bool:
        """Whether the tip has come as far in x as the next line of the grid."""
        neighbours = self.lines.neighbours()
        if neighbours is None:
            return False
        here, there = neighbours
        return bool((self.tip.here[X] - there) * (there - here) >= 0.0)

    def _climbs_from_other_end(self, frame: TrackingFrame, descent: DescentWatch) -> bool:
        """Whether the wall that is descended is left here, to be climbed from the line's other end."""
        if frame.backward or self.tip.seen.contact is None or not self.leaves_descents(frame.line):
            return False
        up = descent.climb(self.tip.seen, frame, self.upright)
        if up is None:
            return False
        if self.lines.blocked_before(up):
            self.lines.leave_out(up)
            return False
        self.lines.insert(up)
        return True
