"""Runs a program of skills as a strategy, and raises what interrupts a skill in the innermost one.

The program and its skills are generators. They are sent each observation and yield the motion that answers it. The same
observations give the same motions: a run is replayed or resumed by showing a new program what the old one was shown.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import replace
from math import hypot
from typing import Any, ClassVar

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Bounds,
    Done,
    Goal,
    Motion,
    Observation,
    Progress,
    Task,
    VelocityCommand,
)
from lwrprobe_strategies.blind_start import BlindStart, bounded, widened
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Interruption, Jammed, Overload, UnknownSpace
from lwrprobe_strategies.planning.contact_memory import POINT_Z
from lwrprobe_strategies.skills.skill import Skill
from lwrprobe_strategies.tip import MAX_PERIOD, Tip
from lwrprobe_strategies.trace import Row

Program = Generator[Motion, Observation, Done]

OVERLOAD = 0.6
"""Share of the range from the wanted force to the limit, above which the force is overlarge: time to act remains."""
JAM_TIME, JAM_DISTANCE = 3.0, 0.002
"""s and m: a tip that follows a surface and has not come further than this in that time is stuck, if it was to come
much further."""
JAM_SHARE = 1.0 / 3.0
"""Share of the commanded path that a tip which is not stuck covers at least."""
JAM_LIMIT = 30.0
"""s, after which a tip is stuck however slowly it was to move."""
NEARER = 0.0005
"""m by which a link may come nearer after a threat has been answered, before that is a new threat."""

AHEAD = 0.1
"""s for which the body must be able to go on: no brake takes longer."""
MAX_REFUSED = 100
"""Motions in a row that are refused, after which the strategy has none that leads on."""


class Supervisor:
    """Decides with every sample whether the innermost skill is interrupted.

    Parameters
    ----------
    tip : what the skills share
    """

    def __init__(self, tip: Tip) -> None:
        self._tip = tip
        task = tip.task
        self._overload = task.force_target + OVERLOAD * (task.force_limit - task.force_target)
        self._answered = np.inf  # m, clearance at the last threat
        self._seen = -np.inf
        self._mark: tuple[float, np.ndarray] | None = None  # s and place, since when there is no progress
        self._speed, self._wanted = 0.0, 0.0  # m/s of the last command, and m that were commanded since the mark

    def interruption(self, seen: Observation) -> Interruption | None:
        """What to raise in the innermost skill instead of sending it the observation."""
        tip = self._tip
        skill: Skill[Any] = tip.trace.running[-1]  # type: ignore[assignment]
        concerns = skill.interruptions
        if skill.seeks_contact and tip.touches:
            return None
        if Overload in concerns and hypot(*seen.force.tolist()) > self._overload:
            return Overload()
        if CollisionThreat in concerns and self._threatened(seen):
            return CollisionThreat()
        if seen.blocked and Blocked in concerns:
            return Blocked()
        if Jammed not in concerns:
            self._mark = None
        elif self._jammed(seen):
            return Jammed()
        return None

    def note(self, motion: Motion) -> None:
        """The motion that answers the last observation."""
        self._speed = hypot(*motion.velocity.tolist()) if isinstance(motion, VelocityCommand) else 0.0

    def _threatened(self, seen: Observation) -> bool:
        """A link is nearer than it may come, and nearer than when the last threat was answered."""
        near = seen.clearance
        if near is None or not near.threatens:
            self._answered = np.inf
            return False
        if near.distance > self._answered - NEARER:
            return False
        self._answered = near.distance
        return True

    def _jammed(self, seen: Observation) -> bool:
        gap = seen.time - self._seen > MAX_PERIOD  # the probe has been elsewhere, as after a resumed run's return
        self._seen = seen.time
        if self._mark is None or gap:
            self._mark, self._wanted = (seen.time, seen.pose[:3, 3]), 0.0
        self._wanted += self._speed * self._tip.period
        since, place = self._mark
        here, time = seen.pose[:3, 3], seen.time - since
        left = bool(np.abs(here - place).max() >= JAM_DISTANCE)
        slow = JAM_SHARE * self._wanted < JAM_DISTANCE
        stuck = not left and time >= (JAM_LIMIT if slow else JAM_TIME)
        if left or stuck:
            self._mark, self._wanted = (seen.time, here), 0.0
        return stuck


class BodyCheck:
    """Decides with every motion whether it would take the body behind the stick where something may be.

    Parameters
    ----------
    tip : what the skills share
    """

    def __init__(self, tip: Tip) -> None:
        self._tip = tip

    def refuses(self, motion: Motion) -> bool:
        """Whether a motion from where the tip is must not be sent."""
        body, here = self._tip.body, self._tip.seen.pose
        if body is None or isinstance(motion, Done):
            return False
        turned = here if motion.pose is None else motion.pose
        if isinstance(motion, Goal):
            shift = turned[:3, 3] - here[:3, 3]
            if body.clears(here, turned, shift):
                return False  # all the way, and so with each sample until it is reached
            shift = min(AHEAD * motion.speed / max(float(np.sqrt(shift @ shift)), 1e-9), 1.0) * shift
        else:
            shift = AHEAD * motion.velocity
            if body.clears(here, turned, shift):
                return False
        ahead = turned.copy()
        ahead[:3, 3] = here[:3, 3] + shift
        return not body.allows(here, ahead)


class SkillStrategy(ABC):
    """A strategy written as a program of skills; `program` is all that it has to define.

    Where the object's place is not known, it is found and bounded before the program begins.

    Attributes
    ----------
    task : what is to be explored, from `start` on; what was found, once the program runs
    tip : what the skills share, from `start` on
    bounds : of an object that was searched for, else None
    raised : m by which the area's upper end was raised
    """

    Config: ClassVar[type]
    contract: ClassVar[int] = STRATEGY_CONTRACT
    task: Task
    tip: Tip
    bounds: Bounds | None
    raised: float

    @abstractmethod
    def program(self) -> Program:
        """Yields motions, most of them from skills, and returns how the exploration has ended."""

    def again(self) -> bool:
        """Whether the program is to run again, after what a complete run of it has shown."""
        return False

    @property
    def line_spacing(self) -> float | None:
        """m between neighbouring lines of contacts, None where the strategy has no such distance."""
        return None

    @property
    def trace(self) -> Sequence[Row]:
        """(time s, skill, event, next skill) of each change of skill so far."""
        return self.tip.trace.rows

    def start(self, task: Task) -> None:
        """Take over: the tip rests in free space. The program runs up to its first motion."""
        self.task, self.tip = task, Tip(task)
        self._supervisor, self._check = Supervisor(self.tip), BodyCheck(self.tip)
        self.bounds, self.raised = None, 0.0
        self._program = self._repeated() if task.search_for is None else self._blind_program()
        self._done: Done | None = None
        self._advance(None)

    def step(self, observation: Observation) -> Motion:
        """Answer one observation."""
        if self._done is not None:
            return self._done
        self.tip.observe(observation)
        return self._advance(observation)

    @property
    def searching(self) -> bool:
        """The object is still to be found."""
        return self.task.search_for is not None

    def _blind_program(self) -> Program:
        """Find the object, bound it, and do what is to be done with it."""
        start, given = BlindStart(self.tip), self.task
        found = yield from start.program()
        if found is None:
            return self._nothing_found(start.missed)
        self.task = bounded(given, found)
        self.tip.confine(self.task)
        self.bounds = Bounds(found.found_at, self.tip.seen.time, found.area)
        while True:
            done = yield from self._repeated()
            if not done.complete or not self._widen(given):
                return done

    def _repeated(self) -> Program:
        """The program, as often as it is complete and there is more to do."""
        while True:
            done = yield from self.program()
            if not done.complete or not self.again():
                return done

    def _widen(self, given: Task) -> bool:
        """Explore more of the `given` area where the object goes on beyond what was bounded; whether it does."""
        tip, bounds, by = self.tip, self.bounds, given.search_for
        assert bounds is not None
        assert by is not None
        contacts = tip.memory.contacts()
        area = widened(bounds.area, given.area, contacts, given.probe.radius, by)
        if area is None:
            return False
        self.bounds = replace(bounds, area=area)
        self.task = replace(self.task, area=area.raised(self.raised), tallest=float(contacts[:, POINT_Z].max()))
        tip.rotation = given.orientation
        tip.confine(self.task)
        return True

    def _nothing_found(self, missed: float) -> Done:
        """What a search says that found nothing; it is complete where it came down wherever it had to."""
        wanted = self.task.search_for
        assert wanted is not None
        if missed == np.inf:
            return Done("nothing found: the search came down nowhere", complete=False)
        reason = f"nothing found; nothing was missed over which a level circle of {np.ceil(1e3 * missed):.0f} mm fits"
        return Done(reason if missed <= wanted else f"{reason}, not {1e3 * wanted:g} mm", missed <= wanted)

    def _advance(self, seen: Observation | None) -> Motion:
        trace = self.tip.trace
        motion: Motion
        try:
            interruption = self._supervisor.interruption(seen) if seen is not None and trace.running else None
            if seen is None:
                motion = next(self._program)
            elif interruption is None:
                motion = self._program.send(seen)
            else:
                trace.event = interruption.event
                motion = self._program.throw(interruption)
            refused = 0
            while self._check.refuses(motion):
                refused += 1
                if refused == MAX_REFUSED:
                    raise UnknownSpace
                trace.event = UnknownSpace.event
                motion = self._program.throw(UnknownSpace())
        except StopIteration as stop:
            motion = self._done = stop.value
        except Interruption as escaped:
            motion = self._done = Done(f"stopped in the skill '{trace.state}': {escaped}", complete=False)
        trace.settle(finished=self._done is not None)
        self._supervisor.note(motion)
        return motion

    def progress(self) -> Progress:
        """The skill that runs."""
        return Progress(self.tip.trace.state, 0.0, self.tip.trace.state)
