"""Covering an area by lines and following whatever a line meets: what the thesis's three strategies share.

Rau 2017, sections 4.2 and 5.3. Deviations, each because the thesis's way loses surface or risks the arm:

- Lines are driven at the lowest height at which the wide part of the probe stays above everything the area may
  hold; the thesis leaves that height to the operator.
- A lost contact is sought on an arc around the point last touched (`skills.reapproach`).
- A wall that would have to be descended is climbed from the line's other end instead (`planning.climb`).
- Where a line began above the lowest height, the near side is touched afterwards, and beside the object the probe
  passes again as low as it can (`planning.low_lines`).
- The return to the first contact runs along the area's border, where nothing stands.
- Faces that lie along the lines are crossed by lines of their own afterwards (`planning.gap_lines`), and the object's
  ends in x are sought (`planning.outlines`); the thesis misses up to a line's distance at each end.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import Done, Progress, Task
from lwrprobe_strategies.contour_watch import ContourWatch
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.encounter import BESIDE_LINE, above_foot, beside_line, led_in_under, shows_stiffness
from lwrprobe_strategies.outcomes import (
    Blocked,
    CollisionThreat,
    Ended,
    Interruption,
    Jammed,
    Lost,
    Outcome,
    Overload,
    UnknownSpace,
)
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import POINT, ContactMemory
from lwrprobe_strategies.planning.contour_end import past_end
from lwrprobe_strategies.planning.lean import horizontal
from lwrprobe_strategies.planning.lines import NEIGHBOUR, ON_FLOOR, Line, Y, Z
from lwrprobe_strategies.planning.paths import tip_pose
from lwrprobe_strategies.planning.raised_line import above_what_was_met, height_met
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.planning.shaft import stick_led_to, stretch
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.planning.upright_body import clear_of
from lwrprobe_strategies.retraction_planner import RetractionPlanner
from lwrprobe_strategies.skills import (
    Procedure,
    follow_contour,
    guarded_move,
    press,
    reapproach,
    release,
    reorient,
    retract,
    slide_out,
    transit,
    tried,
)
from lwrprobe_strategies.supervisor import Program, SkillStrategy

AT_TOP = 2e-4
"""m below the area's upper end, from which on what is touched reaches it."""
RAISE = 0.005
"""m by which the area's upper end is raised at a time: so much that the sphere fits in between."""
ROUNDING = 1e-9
"""m, of sums of lengths."""
MAX_DETOURS = 2
"""Times that the path to one line is begun again."""
ASLANT = 0.8
"""Share of the normal across the line, up to which a surface is left in the line's plane: at 37 degrees or more."""
BACK = 2.0
"""Times the distance to a line, over which the tip comes back to it: only what lies between lines that keep their
distance counts as known."""
SET_OUT = 0.001
"""m from where a path begins, within which what it meets keeps the tip where it is, and does not stand in its way."""
WORTH = 0.003
"""m that are known to be free ahead, from which on they are driven fast, in a piece of their own."""
ONWARD = 0.2
"""Share of a retraction along the line: the grid's direction is kept."""


class Coverage(SkillStrategy):
    """Covers the area with lines and follows whatever a line meets; `avoid` is what a strategy adds.

    Attributes
    ----------
    options : the task's options, or the defaults, with lines no farther apart than the task's detail is wide
    upright : (3, 3), orientation of the upright tip
    lines : which line comes next
    retractions : how the tip leaves what it touches
    frame : the present line, and the plane in which a contact on it is followed
    line_rotation : (3, 3), the orientation in which the present line was begun
    threats : collision threats on the present line so far
    detours : how often the path to the present line was begun again
    foot_followed : the wall that the present line meets has been followed down to its foot
    """

    Config: ClassVar[type] = CoverageConfig

    def start(self, task: Task) -> None:
        """Take over: the tip rests in free space."""
        options = task.options or self.Config()
        self.options = options if task.detail is None else replace(options, step=min(options.step, task.detail))
        super().start(task)

    def program(self) -> Program:
        """Line after line, until none is left (section 4.2.3, figure 4.6)."""
        tip, task = self.tip, self.task
        self.upright = self.line_rotation = tip.rotation
        tip.body = BodySpace(task, self.options.step) if BodySpace.needed(task) else None
        self.lines = self.scheduler()
        self.retractions = RetractionPlanner(tip, self.upright, self.options.retreat)
        self._watch = ContourWatch(tip, self.upright, self.lines, self.end_found, self.leaves_descents)
        self._stand_still_first = False
        self._led: tuple[Line, float] | None = None  # the last line that met nothing, and m on its axis, how far
        self._met: list[np.ndarray] = []  # (3,) m, where paths to a line have met something
        self._neighbour_distance = NEIGHBOUR * self.options.step
        tip.expect_overhangs(self._neighbour_distance)
        dropped, unreached = False, 0
        while (line := self.lines.next(tip.here)) is not None:
            self.retractions.line_begins()
            yield from self.drive_line(line)
            self.retractions.line_driven()
            if self._reaches_the_top():
                with suppress(Interruption):  # what was swept leads off it; from there the area is left upwards
                    yield from transit(tip, self.retractions.path(), self.line_rotation)
                if not self.raise_area(line):
                    top = f"{1e3 * self.task.area.upper[Z]:.1f} mm"
                    return Done(f"the object is as high as the area's upper end, {top}: no path leads over it", False)
            self.retractions.line_ends()
            self.line_ended()
            dropped = self.retractions.exhausted
            if dropped and not self.retractions.free:
                return Done("the probe cannot leave its place: no path off the contact is free", complete=False)
            if dropped:
                self.retractions.line_dropped()
                unreached += 1
            elif self.retractions.stays:
                self.lines.insert(line)
                begin = tip.here
                yield from tried(slide_out(tip, self.frame, self.retractions.back_out()))
                self.retractions.slid_out(begin)
        if self.retractions.caught:
            vain = self.retractions.in_vain
            return Done(f"the probe cannot leave its place: {vain} lines in a row were not reached", complete=False)
        if not dropped:
            with suppress(UnknownSpace):  # nothing is left to do, and the tip may stay where it is
                yield from transit(tip, self.retractions.path(), self.line_rotation)
        lines = "1 line" if unreached == 1 else f"{unreached} lines"
        but = f", but for {lines} that the arm cannot reach" if unreached else ""
        return Done(f"area covered{but}", complete=not dropped)

    def scheduler(self) -> LineScheduler:
        """Which line comes next."""
        return LineScheduler(self.task, self.tip.memory, self.options, self.tip.body, self.side_orientations)

    def again(self) -> bool:
        """Once more, lower, where all lines have passed above what the area may still hold."""
        tip, task = self.tip, self.task
        if len(tip.memory) or self.lines.height <= task.area.lower[Z] + ON_FLOOR:
            return False
        self.task = replace(task, tallest=self.lines.height - task.probe.radius)
        tip.rotation = self.upright
        tip.memory = ContactMemory()  # what lines have passed higher up is not passed by the lines that follow
        tip.confine(self.task)
        return True

    def drive_line(self, line: Line) -> Procedure:
        """One line: the path to it, along it, and along whatever it meets, until it is done or given up."""
        self.detours = 0
        skill: Procedure | None = self.approach(line)
        outcome: Outcome = Ended.ARRIVED
        while skill is not None:
            try:
                outcome = yield from skill
                skill = self.next_skill(outcome)
            except Overload:
                skill = release(self.tip, self.frame)
            except (CollisionThreat, UnknownSpace) as why:
                skill = self.answer_interruption(why)
            except (Blocked, Jammed):
                skill = self.give_up()
        return outcome

    def next_skill(self, outcome: Outcome) -> Procedure | None:
        """The skill that follows from how the last one ended; None = this line is done."""
        match outcome:
            case Ended.TABLE | Ended.UNDERSIDE | Ended.LINE_END if self.frame.backward:
                return self.contour_upright()
            case Ended.ARRIVED | Ended.RETRACTED | Ended.NOTHING_FOUND:  # nothing there: on along the line (4.2.4)
                return self.along_line()
            case Ended.UNDERSIDE if self.frame.line.axis == Y and self.tip.body is not None:  # see `outer_parts`
                return None
            case Ended.TABLE | Ended.UNDERSIDE:
                self.tip.leave()
                return self.along_line()
            case Ended.CONTACT if beside_line(self.tip, self.frame.line):
                return self.approach_again()
            case Ended.CONTACT | Ended.RELEASED:  # figure 4.8
                return self.along_surface()
            case Ended.TURNED:
                return self.contour()
            case Lost(point):  # figure 4.9
                return reapproach(self.tip, self.frame, point, self.options.reapproach)
            case Ended.NEXT_LINE:
                return self.next_in_passing()
            case Ended.SHAFT_CONTACT if self.frame.level:  # back the way it came: what is above the sphere stands out
                self.tip.overhangs.stick_met(self.tip.here, height_met(self.tip.seen))
                self.retractions.go_back()
                return self.give_up()
            case Ended.SHAFT_CONTACT:
                self._stand_still_first = True
                return self.raise_line()
            case Ended.NO_CONTACT | Ended.CEILING:
                return self.give_up(met=False)
            case _:
                return None

    def line_ended(self) -> None:
        """A line has been driven or was given up: what it has shown counts for the choice of the next one."""
        if self.tip.body is not None:
            self.tip.body.survey()

    @abstractmethod
    def avoid(self) -> Procedure | None:
        """The answer to a collision threat, as a skill; None = leave the line. The strategies differ in this alone."""

    # What a strategy may also change

    def side_orientations(self, away: np.ndarray) -> Sequence[np.ndarray]:
        """Orientations (3, 3) in which a side may be touched that faces along a horizontal unit vector (3,)."""
        return (self.upright,)

    def leaves_descents(self, line: Line) -> bool:
        """Whether a wall down which the line leads may be climbed from its other end instead."""
        return bool(self.options.climb) and line.free_end

    def end_found(self) -> bool:
        """Whether an outline has come to the end that it seeks."""
        return past_end(self.tip.control, self.frame, self.tip.here, self._neighbour_distance)

    def raise_area(self, line: Line) -> bool:
        """Raise the area's upper end, and drive the line again; False where there is no headroom or the arm ends."""
        if self.raised + RAISE > self.task.headroom + ROUNDING:
            return False
        area = self.task.area.raised(RAISE)
        if not self.task.reachable(self._poses_above_contacts(float(area.upper[Z]))):
            return False
        self.raised += RAISE
        self.task = replace(self.task, area=area)
        self.tip.raise_area(self.task)
        self.lines.raise_area(self.task, line)
        return True

    def _poses_above_contacts(self, height: float) -> list[np.ndarray]:
        """Upright tip poses (4, 4) at a height [m]: above the tip, and at the corners around all contacts."""
        places = self.tip.memory.contacts()[:, :Z]
        (left, front), (right, back) = places.min(axis=0), places.max(axis=0)
        poses = np.tile(np.eye(4), (5, 1, 1))
        poses[:, :3, :3], poses[:, :Z, 3], poses[:, Z, 3] = self.upright, self.tip.here[:Z], height
        poses[1:, :Z, 3] = (left, front), (left, back), (right, back), (right, front)
        return list(poses)

    # Skills with what they need here

    def begin_line(self, line: Line) -> None:
        """A line becomes the present one; its contours are counted and measured anew."""
        self.threats, self.retractions.line = 0, line
        self.frame = TrackingFrame(line, self.task.area)
        self._watch.begin_line()
        self.tip.overhangs.survey(line.height)

    def approach(self, line: Line) -> Procedure:
        """Off what is touched, and to the beginning of a line."""
        tip = self.tip
        self._set_out = tip.here
        retraction = self.retractions.path()
        self.begin_line(line)
        self.foot_followed = line.foot_followed
        start = retraction[-1].place if retraction else tip.here
        before = tip.rotation
        tip.rotation = self.line_rotation = self.upright if line.rotation is None else line.rotation
        speeds, clear = tip.expected_speeds(tip.rotation), clear_of(tip.memory.contacts()[:, POINT], self.task)
        met = np.array(self._met).reshape(-1, 3)
        held = before if not retraction or retraction[-1].rotation is None else retraction[-1].rotation
        departure = Departure(
            start, tip.rotation, self.task.area, tip.free, speeds, clear, self._may_go, tip.body, held, met
        )
        return transit(tip, retraction + departure.path_to(line), before)

    def _may_go(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether a path may lead from one pose (4, 4) to another: the arm can, and the body may."""
        body = self.tip.body
        return self.task.reachable([begin, end]) and (body is None or body.allows(begin, end))

    def approach_again(self) -> Procedure | None:
        """Back from what the path met to the beginning of the line, and there by what is known now."""
        self.detours += 1
        if np.abs(self.tip.here - self._set_out).max() < SET_OUT:
            self.retractions.go_back()
        else:
            self._met.append(self.tip.here.copy())
        if self.detours > MAX_DETOURS:
            return self.postpone()
        self.tip.rotation = self.tip.seen.pose[:3, :3].copy()  # it may have been interrupted while it turned
        return self.approach(self.frame.line)

    def along_line(self) -> Procedure:
        """On along the line until something is touched."""
        self.frame = self.frame.upright()
        line, known = self.frame.line, self._known_to()

        def next_stretch(here: np.ndarray) -> tuple[np.ndarray, float | None]:
            aside, along = abs(float(here[line.aside]) - line.place), float(here[line.axis])
            on_line = aside <= BESIDE_LINE and float(here[Z]) >= line.height - BESIDE_LINE
            times: float | None = None
            if on_line and line.sign * (known - along) > WORTH:
                end = known
            else:
                before = self._neighbour_distance if self.tip.overhangs.found else 0.0
                end, times = stretch(line, here, self.tip.memory, self._neighbour_distance, before)
            if aside > BESIDE_LINE:
                end = line.sign * min(line.sign * along + BACK * aside, line.sign * end)
            target = line.at(end)
            target[Z] = here[Z]
            return target, times

        rest, self._stand_still_first = self._stand_still_first, False
        return guarded_move(self.tip, line.at(line.end), line.ahead, next_stretch, line.grid_x, rest)

    def _known_to(self) -> float:
        """m on the present line's axis, up to which all of the probe is known to fit; asked for where it leans."""
        line, body, held = self.frame.line, self.tip.body, self.tip.rotation
        if body is None or held is self.upright or held is not self.line_rotation:
            return line.begin
        known = [body.fits_to(line), None if self._led is None else stick_led_to(line, *self._led)]
        return line.sign * max(line.sign * place for place in known if place is not None)

    def along_surface(self) -> Procedure:
        """Along a surface that is touched anew; around the object where its outline is sought."""
        line, normal = self.frame.line, self.tip.control.normal
        if above_foot(self.tip, self.frame) and not self.foot_followed:
            self.foot_followed, self.frame = True, self.frame.back_down()
        elif line.outline:
            sense = -line.outline * (1.0 if normal[line.axis] > 0.0 else -1.0)
            self.frame = self.frame.horizontal(sense, line.height)
        return self._press_first() if shows_stiffness(self.tip) else self.contour()

    def _press_first(self) -> Procedure:
        yield from press(self.tip, self.tip.normal())
        return (yield from self.contour())

    def contour(self) -> Procedure:
        """On along the surface, in the plane of the frame."""
        return follow_contour(self.tip, self.frame, self._watch.until(self.frame))

    def contour_level(self) -> Procedure:
        """On along the surface in a horizontal plane, towards the next grid line."""
        sense = self.lines.towards_next() * (1.0 if self.tip.control.normal[Y] >= 0.0 else -1.0)
        self.frame = self.frame.horizontal(sense)
        return self.contour()

    def contour_upright(self) -> Procedure:
        """On along the surface in the vertical plane of the line."""
        self.frame = self.frame.upright()
        return self.contour()

    def turn(self) -> Procedure:
        """To the orientation that is wanted now."""
        return reorient(self.tip, self.frame, touching=self.tip.trace.ended is follow_contour)

    # Decisions

    def answer_interruption(self, why: CollisionThreat | UnknownSpace) -> Procedure | None:
        """The skill that answers an interruption; None = leave the line."""
        if self.frame.backward:  # on the way down to a foot: up again, in every strategy
            return self.contour_upright()
        return self.answer_threat() if isinstance(why, CollisionThreat) else self.answer_unknown_space()

    def answer_threat(self) -> Procedure | None:
        """Over what the stick has come near to, where the line leads in under it; else the strategy's own answer."""
        if led_in_under(self.tip, self.frame):
            return self.raise_line()
        self.threats += 1
        return self.avoid()

    def answer_unknown_space(self) -> Procedure | None:
        """The strategy's answer to a threat, where a surface is followed; nothing leads on from elsewhere."""
        self.threats += 1
        return self.avoid() if self.tip.trace.ended is follow_contour else self.give_up()

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
            self._led = self.frame.line, float(self.tip.here[self.frame.line.axis])
        self.lines.give_up(self.frame.line, ended is not guarded_move, ended is reapproach, met)
        return None

    def postpone(self) -> Procedure | None:
        """Leave the line, whose beginning no path from here has reached, until the tip is elsewhere."""
        if self.frame.line.fallback is not None or not self.lines.postpone(self.frame.line):
            return self.give_up()
        return None

    def raise_line(self) -> Procedure | None:
        """Go on along the line from here, but higher: under what the stick touches nothing can be touched."""
        line, here = self.frame.line, self.tip.here
        self.tip.overhangs.stick_met(here, height_met(self.tip.seen))
        if line.fallback is not None or line.low:
            return self.give_up()
        self.retractions.go_back()
        touched = self.lines.highest_touch()
        higher = above_what_was_met(line, self.tip.seen, self.task, self.options.retreat, touched)
        if higher is None:
            return self.give_up()
        self.lines.raise_line(replace(higher, foot_followed=self.foot_followed))
        return None

    def next_in_passing(self) -> Procedure:
        """A level contour has come to the next grid line: along that, from the side it is on."""
        line = self.lines.in_passing(self.tip.here)
        inward = -1.0 if self.tip.control.normal[Y] > 0.0 else 1.0
        self.begin_line(line if line.sign == inward else line.turned())
        return self.contour()

    def _reaches_the_top(self) -> bool:
        """Whether something was touched as high as the probe flies over all that may be there."""
        centres = self.tip.memory.contacts()[:, Z]
        return bool(centres.max(initial=-np.inf) > self.task.area.upper[Z] - AT_TOP)

    # For the runner

    def touching_poses(self, centre: np.ndarray, facing: np.ndarray) -> Sequence[tuple[np.ndarray, bool]]:
        """Tip poses (4, 4) at a `centre` (3,) m in which a side would be touched that faces along `facing` (3,).

        With each, whether the body would be in known space; see `CarefulStrategy`.
        """
        if self.searching:
            return []
        body, away, poses = self.tip.body, horizontal(facing), []
        if body is not None:
            body.survey()
        for rotation in self.side_orientations(away) if away.any() else (self.upright,):
            pose = tip_pose(centre, rotation)
            poses.append((pose, body is None or body.knows(pose)))
        return poses

    @property
    def line_spacing(self) -> float:
        """m between two lines."""
        return float(self.options.step)

    def progress(self) -> Progress:
        """The line, the skill, and the share of the lines done."""
        if self.searching:
            return super().progress()
        driven, known = self.lines.count()
        kind = "grid line" if self.frame.line.axis == Y else "line across"
        state = self.tip.trace.state
        doing = f"{kind}, {min(driven + 1, known)} of {known}: {state}"
        return Progress(doing, min(driven / max(known, 1), 1.0), state)
