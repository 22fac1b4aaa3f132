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
from lwrprobe_strategies.encounter import beside_line, led_in_under
from lwrprobe_strategies.free_motion import FreeMotion
from lwrprobe_strategies.line_drive import LineDrive
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Jammed, Lost, Outcome, Overload, UnknownSpace
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.contour_end import past_end
from lwrprobe_strategies.planning.lean import horizontal
from lwrprobe_strategies.planning.lines import NEIGHBOUR, ON_FLOOR, Line, Y, Z
from lwrprobe_strategies.planning.paths import tip_pose
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.retraction_planner import RetractionPlanner
from lwrprobe_strategies.skills import Procedure, follow_contour, reapproach, release, slide_out, tried
from lwrprobe_strategies.supervisor import Program, SkillStrategy
from lwrprobe_strategies.tip import Tip

AT_TOP = 2e-4
"""m below the area's upper end, from which on what is touched reaches it."""
RAISE = 0.005
"""m by which the area's upper end is raised at a time: so much that the sphere fits in between."""
ROUNDING = 1e-9
"""m, of sums of lengths."""


class Coverage(SkillStrategy):
    """Covers the area with lines, and follows whatever a line meets.

    A strategy defines `avoid`, and may override `avoid_unknown_space`, `approach`, `line_ended`, `leaves_descents`,
    `end_found`, `side_orientations`, `scheduler` and `raise_area`. What it answers with is a method of `drive`, as
    `retract_onward`, `contour_level`, `contour_upright`, `turn` or `give_up`; `encounter` has what it may ask.

    Attributes
    ----------
    options : the task's options, or the defaults, with lines no farther apart than the task's detail is wide
    upright : (3, 3), orientation of the upright tip
    lines : which line comes next
    retractions : how the tip leaves what it touches
    free_motion : the motions before something is touched
    drive : the present line, and the skills with which it may go on
    """

    Config: ClassVar[type] = CoverageConfig

    def start(self, task: Task) -> None:
        """Take over: the tip rests in free space."""
        options = task.options or self.Config()
        self.options = options if task.detail is None else replace(options, step=min(options.step, task.detail))
        super().start(task)

    # Line after line

    def program(self) -> Program:
        """Line after line, until none is left (section 4.2.3, figure 4.6)."""
        tip, step = self.tip, self.options.step
        self.upright = tip.rotation
        tip.body = BodySpace(self.task, step) if BodySpace.needed(self.task) else None
        self.lines = self.scheduler()
        self.retractions = RetractionPlanner(tip, self.upright, self.options.retreat)
        self.free_motion = FreeMotion(tip, self.upright, step, self.retractions)
        watch = ContourWatch(tip, self.upright, self.lines, self.end_found, self.leaves_descents)
        self.drive = LineDrive(tip, self.options, self.lines, self.retractions, self.free_motion, watch)
        tip.expect_overhangs(NEIGHBOUR * step)
        dropped, unreached = False, 0
        while (line := self.lines.next(tip.here)) is not None:
            self.retractions.line_begins()
            yield from self.drive_line(line)
            self.retractions.line_driven()
            if self._reaches_the_top():
                yield from tried(self.free_motion.leave())  # what was swept leads off it; then upwards
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
                yield from tried(slide_out(tip, self.drive.frame, self.retractions.back_out()))
                self.retractions.slid_out(begin)
        if self.retractions.caught:
            vain = self.retractions.in_vain
            return Done(f"the probe cannot leave its place: {vain} lines in a row were not reached", complete=False)
        if not dropped:
            with suppress(UnknownSpace):  # nothing is left to do, and the tip may stay where it is
                yield from self.free_motion.leave()
        lines = "1 line" if unreached == 1 else f"{unreached} lines"
        but = f", but for {lines} that the arm cannot reach" if unreached else ""
        return Done(f"area covered{but}", complete=not dropped)

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

    def _reaches_the_top(self) -> bool:
        """Whether something was touched as high as the probe flies over all that may be there."""
        centres = self.tip.memory.contacts()[:, Z]
        return bool(centres.max(initial=-np.inf) > self.task.area.upper[Z] - AT_TOP)

    # Along one line

    def drive_line(self, line: Line) -> Procedure:
        """One line: the path to it, along it, and along whatever it meets, until it is done or given up."""
        self.free_motion.detours = 0
        skill: Procedure | None = self.approach(line)
        outcome: Outcome = Ended.ARRIVED
        while skill is not None:
            try:
                outcome = yield from skill
                skill = self.next_skill(outcome)
            except Overload:
                skill = release(self.tip, self.drive.frame)
            except (CollisionThreat, UnknownSpace) as why:
                skill = self.answer_interruption(why)
            except (Blocked, Jammed):
                skill = self.drive.give_up()
        return outcome

    def next_skill(self, outcome: Outcome) -> Procedure | None:
        """The skill that follows from how the last one ended; None = this line is done."""
        tip, drive = self.tip, self.drive
        frame, line = drive.frame, drive.frame.line
        match outcome:
            case Ended.TABLE | Ended.UNDERSIDE | Ended.LINE_END if frame.backward:
                return drive.contour_upright()
            case Ended.ARRIVED | Ended.RETRACTED | Ended.NOTHING_FOUND:  # nothing there: on along the line (4.2.4)
                return drive.along_line()
            case Ended.UNDERSIDE if line.axis == Y and tip.body is not None:  # see `outer_parts`
                return None
            case Ended.TABLE | Ended.UNDERSIDE:
                tip.leave()
                return drive.along_line()
            case Ended.CONTACT if beside_line(tip, line):
                return self.approach(line) if self.free_motion.detour() else drive.postpone()
            case Ended.CONTACT | Ended.RELEASED:  # figure 4.8
                return drive.along_surface()
            case Ended.TURNED:
                return drive.contour()
            case Lost(point):  # figure 4.9
                return reapproach(tip, frame, point, self.options.reapproach)
            case Ended.NEXT_LINE:
                return drive.next_in_passing()
            case Ended.SHAFT_CONTACT:
                return drive.stick_met()
            case Ended.NO_CONTACT | Ended.CEILING:
                return drive.give_up(met=False)
            case _:
                return None

    def answer_interruption(self, why: CollisionThreat | UnknownSpace) -> Procedure | None:
        """The skill that answers an interruption; None = leave the line."""
        tip, drive = self.tip, self.drive
        if drive.frame.backward:  # on the way down to a foot: up again, in every strategy
            return drive.contour_upright()
        if isinstance(why, CollisionThreat) and led_in_under(tip, drive.frame):
            return drive.raise_line()  # over what the stick has come near to
        drive.threats += 1
        if isinstance(why, CollisionThreat):
            return self.avoid()
        return self.avoid_unknown_space() if tip.trace.ended is follow_contour else drive.body_stopped()

    # What a strategy defines, and what it may override

    @abstractmethod
    def avoid(self) -> Procedure | None:
        """The answer to a collision threat, as a skill; None = leave the line."""

    def avoid_unknown_space(self) -> Procedure | None:
        """As `avoid`, where a surface leads the body behind the stick into unknown space."""
        return self.avoid()

    def approach(self, line: Line) -> Procedure:
        """A line becomes the present one: off what is touched, and to the line's beginning."""
        return self.drive.approach(line)

    def line_ended(self) -> None:
        """A line has been driven or was given up: what it has shown counts for the choice of the next one."""
        if self.tip.body is not None:
            self.tip.body.survey()

    def leaves_descents(self, line: Line) -> bool:
        """Whether a wall down which the line leads may be climbed from its other end instead."""
        return bool(self.options.climb) and line.free_end

    def end_found(self) -> bool:
        """Whether an outline has come to the end that it seeks."""
        return past_end(self.tip.control, self.drive.frame, self.tip.here, NEIGHBOUR * self.options.step)

    def side_orientations(self, away: np.ndarray) -> Sequence[np.ndarray]:
        """Orientations (3, 3) in which a side may be touched that faces along a horizontal unit vector (3,)."""
        return (self.upright,)

    def scheduler(self) -> LineScheduler:
        """Which line comes next."""
        return LineScheduler(self.task, self.tip.memory, self.options, self.tip.body, self.side_orientations)

    def raise_area(self, line: Line) -> bool:
        """Raise the area's upper end, and drive the line again; False where there is no headroom or the arm ends."""
        if self.raised + RAISE > self.task.headroom + ROUNDING:
            return False
        area = self.task.area.raised(RAISE)
        if not self.task.reachable(poses_above_contacts(self.tip, self.upright, float(area.upper[Z]))):
            return False
        self.raised += RAISE
        self.task = replace(self.task, area=area)
        self.tip.raise_area(self.task)
        self.lines.raise_area(self.task, line)
        return True

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
        kind = "grid line" if self.drive.frame.line.axis == Y else "line across"
        state = self.tip.trace.state
        doing = f"{kind}, {min(driven + 1, known)} of {known}: {state}"
        return Progress(doing, min(driven / max(known, 1), 1.0), state)


def poses_above_contacts(tip: Tip, upright: np.ndarray, height: float) -> list[np.ndarray]:
    """Upright tip poses (4, 4) at a height [m]: above the tip, and at the corners around all contacts."""
    places = tip.memory.contacts()[:, :Z]
    (left, front), (right, back) = places.min(axis=0), places.max(axis=0)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3], poses[:, :Z, 3], poses[:, Z, 3] = upright, tip.here[:Z], height
    poses[1:, :Z, 3] = (left, front), (left, back), (right, back), (right, front)
    return list(poses)
