"""The drive along one line: the skills with which it may go on, and what becomes of a line that is left."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lwrprobe_strategies.contour_watch import ContourWatch
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.encounter import above_foot, shows_stiffness
from lwrprobe_strategies.free_motion import FreeMotion
from lwrprobe_strategies.planning.lines import Line, Y, Z
from lwrprobe_strategies.planning.raised_line import above_what_was_met, height_met
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.retraction_planner import RetractionPlanner
from lwrprobe_strategies.skills import Procedure, follow_contour, guarded_move, press, reapproach, reorient, retract
from lwrprobe_strategies.tip import Tip

ASLANT = 0.8
"""Share of the normal across the line, up to which a surface is left in the line's plane: at 37 degrees or more."""
ONWARD = 0.2
"""Share of a retraction along the line: the grid's direction is kept."""


@dataclass(eq=False)
class LineDrive:
    """The present line, and how it goes on: each method but `begin_line` answers with a skill; None = leave the line.

    Attributes
    ----------
    tip : what the skills share
    options : the strategy's
    lines : which line comes next
    retractions : how the tip leaves what it touches
    free_motion : the motions before something is touched
    watch : where a contour ends
    frame : the present line, and the plane in which a contact on it is followed
    threats : collision threats on the present line so far
    foot_followed : the wall that the present line meets has been followed down to its foot
    """

    tip: Tip
    options: CoverageConfig
    lines: LineScheduler
    retractions: RetractionPlanner
    free_motion: FreeMotion
    watch: ContourWatch
    frame: TrackingFrame = field(init=False)
    threats: int = field(init=False)
    foot_followed: bool = field(init=False)

    def begin_line(self, line: Line) -> None:
        """A line becomes the present one; its threats and contours are counted and measured anew."""
        self.threats, self.frame, self.retractions.line = 0, TrackingFrame(line, self.tip.task.area), line
        self.foot_followed = line.foot_followed
        self.watch.begin_line()
        self.tip.overhangs.survey(line.height)

    # Before something is touched

    def approach(self, line: Line) -> Procedure:
        """Off what is touched, and to the beginning of a line."""
        path = self.free_motion.approach(line)
        self.begin_line(line)
        return path

    def along_line(self) -> Procedure:
        """On along the line until something is touched."""
        self.frame = self.frame.upright()
        return self.free_motion.along(self.frame.line)

    # Along a surface

    def along_surface(self) -> Procedure:
        """Along a surface that is touched anew; around the object where its outline is sought."""
        line = self.frame.line
        if above_foot(self.tip, self.frame) and not self.foot_followed:
            self.foot_followed, self.frame = True, self.frame.back_down()
        elif line.outline:
            sense = -line.outline * (1.0 if self.tip.control.normal[line.axis] > 0.0 else -1.0)
            self.frame = self.frame.horizontal(sense, line.height)
        return self._press_first() if shows_stiffness(self.tip) else self.contour()

    def _press_first(self) -> Procedure:
        yield from press(self.tip, self.tip.normal())
        return (yield from self.contour())

    def contour(self) -> Procedure:
        """On along the surface, in the plane of the frame."""
        return follow_contour(self.tip, self.frame, self.watch.until(self.frame))

    def contour_level(self) -> Procedure:
        """On along the surface in a horizontal plane, towards the next grid line."""
        sense = self.lines.towards_next() * (1.0 if self.tip.control.normal[Y] >= 0.0 else -1.0)
        self.frame = self.frame.horizontal(sense)
        return self.contour()

    def contour_upright(self) -> Procedure:
        """On along the surface in the vertical plane of the line."""
        self.frame = self.frame.upright()
        return self.contour()

    def next_in_passing(self) -> Procedure:
        """A level contour has come to the next grid line: along that, from the side it is on."""
        line = self.lines.in_passing(self.tip.here)
        inward = -1.0 if self.tip.control.normal[Y] > 0.0 else 1.0
        self.begin_line(line if line.sign == inward else line.turned())
        return self.contour()

    def turn(self, rotation: np.ndarray) -> Procedure:
        """To another orientation (3, 3), in which the tip is held from then on."""
        self._before_turn, self.tip.rotation = self.tip.rotation, rotation
        return reorient(self.tip, self.frame, touching=self.tip.trace.ended is follow_contour)

    # Off a surface, and off the line

    def retract_onward(self) -> Procedure:
        """Off the surface, and on along the line: in its plane, where that leads off the surface as well.

        Between two lines, space counts as free for the body only where both were driven.
        """
        away, aside = self.tip.control.normal.copy(), self.frame.line.aside
        away[Z] = max(away[Z], 0.0)
        if abs(away[aside]) < ASLANT:
            away[aside] = 0.0
        return retract(self.tip, self.frame, away + ONWARD * self.frame.line.ahead, self.options.retreat)

    def give_up(self, met: bool = True) -> Procedure | None:
        """Leave the line where the tip is, because of what it has `met` or not; its fallback comes next, or another."""
        ended = self.tip.trace.ended
        if ended is guarded_move:
            self.free_motion.met_nothing(self.frame.line)
        self.lines.give_up(self.frame.line, ended is not guarded_move, ended is reapproach, met)
        return None

    def body_stopped(self) -> Procedure | None:
        """The body may come no farther here: on along a line up a side, higher; else leave the line.

        The side was expected farther out than it is.
        """
        line, tip = self.frame.line, self.tip
        if tip.trace.ended is guarded_move and self.lines.go_on_higher(line, tip.here, tip.rotation):
            self.free_motion.met_nothing(line)
            return None
        return self.give_up()

    def postpone(self) -> Procedure | None:
        """Leave the line, whose beginning no path from here has reached, until the tip is elsewhere."""
        if self.frame.line.fallback is not None or not self.lines.postpone(self.frame.line):
            return self.give_up()
        return None

    def stick_met(self) -> Procedure | None:
        """The stick touches and not the sphere: leave the line, and go on higher where that led in under something."""
        tip = self.tip
        if tip.trace.ended is reorient:  # a turn: back as it was held
            tip.rotation = self._before_turn
            return self.give_up()
        if self.frame.level:  # back the way it came: what is above the sphere stands out
            tip.overhangs.stick_met(tip.here, height_met(tip.seen))
            self.retractions.go_back()
            return self.give_up()
        self.free_motion.rests_first = True
        return self.raise_line()

    def raise_line(self) -> Procedure | None:
        """Go on along the line from here, but higher: under what the stick touches nothing can be touched."""
        line, tip = self.frame.line, self.tip
        tip.overhangs.stick_met(tip.here, height_met(tip.seen))
        if line.fallback is not None or line.low:
            return self.give_up()
        self.retractions.go_back()
        touched = self.lines.highest_touch()
        higher = above_what_was_met(line, tip.seen, tip.task, self.options.retreat, touched)
        if higher is None:
            return self.give_up()
        self.lines.raise_line(replace(higher, foot_followed=self.foot_followed))
        return None
