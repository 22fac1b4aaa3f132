"""What the three strategies of the source share: grid lines, contouring, re-approach, release, table height.

Rau 2017, sections 4.2 and 5.3. Departures, each because the source's way loses surface or risks the arm:

- Lines are driven at the lowest height at which the wide part of the probe stays above everything the area may
  hold; the source leaves that height to the operator.
- A lost contact is sought on an arc around the point last touched, not on the straight line against the last
  force: past an edge that line leads over the top without a touch.
- A wall that would have to be descended is climbed from the line's other end instead (`climbing.py`).
- Where a line came in above the lowest height, the near side is felt afterwards.
- The return to the first contact runs along the area's border, where nothing stands.
- Faces that lie along the lines are crossed by lines of their own afterwards, and the object's ends in x are sought
  (`across.py`); the source misses up to a line's distance at each end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Done,
    Goal,
    InputError,
    Motion,
    Observation,
    Progress,
    Task,
    VelocityCommand,
)
from lwrprobe_strategies.climbing import Climbing
from lwrprobe_strategies.course import Course, Z
from lwrprobe_strategies.felt import believed, maybe_stick, surface_normal
from lwrprobe_strategies.following import Follower, rolling
from lwrprobe_strategies.inner_edge import InnerEdge
from lwrprobe_strategies.itinerary import Itinerary, Y
from lwrprobe_strategies.leaving import UNDER, back, off
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.states import TRANSITIONS, Event, Plane, State
from lwrprobe_strategies.stick import Stick
from lwrprobe_strategies.touched import Touched
from lwrprobe_strategies.way import Feeling, Pace, Waypoint, held, way_to

DOWN = np.array([0.0, 0.0, -1.0])
LEAVES = (Event.LINE_END, Event.BLOCKED, Event.END_FOUND, Event.DESCENT, Event.STICK)
"""Events after which the line is left."""
JAM_TIME = 3.0
JAM_DISTANCE = 0.002
"""s and m: a contour that has not come further than this in that time is stuck."""
BEARABLE = 0.0005
"""m, by which a link may come nearer after a threat has been answered before that is a new threat."""
DOUBTED = 2
"""Samples after which a touch that may be one of the stick is one: the first of a touch may be too weak to tell."""
RAISE = 0.0025
"""m, by which a line is raised where the stick has met something."""
YIELDING = 0.7
"""Share of a way along the force, from which on it gives way to that."""
PAST = 0.03
"""Share of the normal across the line, from which on the end of the object counts as passed."""


@dataclass(slots=True, frozen=True)
class ContouringConfig:
    """Options that the contouring strategies share.

    Attributes
    ----------
    step : m, between two lines
    first_line : `border` starts at the area's end in -x; `middle` as in the source's figure 4.6, with a return to
        the first contact for the other side
    reapproach : m, way along which a lost contact is sought before the grid takes over
    retreat : m, way off a collision threat
    climb : leave a wall that leads down and come up it from the line's other end, where that is quicker
    near_sides : feel walls that a line met above the lowest height down to their foot
    across : cross the faces that lie along the lines by lines along x
    find_ends : follow the object around its ends in x to where it reaches furthest
    """

    step: float = 0.010
    first_line: str = "middle"
    reapproach: float = 0.025
    retreat: float = 0.010
    climb: bool = True
    near_sides: bool = True
    across: bool = True
    find_ends: bool = True

    def __post_init__(self) -> None:
        for name in ("step", "reapproach", "retreat"):
            value = getattr(self, name)
            if not (np.isfinite(value) and 0.0 < value <= 1.0):
                raise InputError(f"strategy.{name}", value, "a length in metres, above 0 and at most 1")
        if self.first_line not in ("border", "middle"):
            raise InputError("strategy.first_line", self.first_line, "border, middle")


class Contouring(ABC):
    """Covers the area with lines and follows whatever a line meets; `avoid` is what a strategy adds."""

    Config: ClassVar[type] = ContouringConfig
    contract: ClassVar[int] = STRATEGY_CONTRACT

    def start(self, task: Task) -> None:
        """Take over in free space."""
        self.task = task
        self.options = task.options or self.Config()
        options = self.options
        self.touched = Touched()
        self.itinerary = Itinerary(
            task, self.touched, options.step, options.first_line,
            near_side_feet=options.near_sides, across=options.across, ends=options.find_ends,
        )  # fmt: skip
        self.upright = np.array(task.orientation, dtype=np.float64)
        self.rotation = self.upright
        self._carried = self.upright  # how the tip is held on the way between two lines
        self.follower = Follower(task)
        self.climbing = Climbing(task, self.follower, self.touched)
        self.state = State.TRANSFER
        self.trace: list[tuple[float, str, str, str]] = []
        self.first_contact: np.ndarray | None = None
        self._finished = False
        self._last_time: float | None = None
        self._period = 0.008
        self._sought = 0.0
        self._touched_at = np.array(task.start)
        self._retreat_left = 0.0
        self._retreat_along = np.zeros(3)
        self._aborts = 0
        self._borne = np.inf
        self._leaving = False
        self._touching_tilt = False
        self._stick = Stick(1.5 * options.step)
        self._doubts = 0
        self._edge = InnerEdge(task.force_target)
        self._mark: tuple[float, np.ndarray] | None = None
        self._goal: Goal | None = None  # asked for until something happens: a goal that never changes costs nothing
        self._handlers: dict[State, Callable[[Observation], Event | None]] = {
            State.TRANSFER: self._event_transfer,
            State.LINE: self._event_line,
            State.CONTOUR: self._event_contour,
            State.REAPPROACH: self._event_reapproach,
            State.RELEASE: self._event_release,
            State.RETREAT: self._event_retreat,
            State.TILT: self._event_tilt,
            State.FINISHED: lambda _: None,
        }
        here = np.asarray(task.start)
        self._take(self.itinerary.first(here), here)

    def _take(self, line: Line, here: np.ndarray) -> None:
        line, rotation = self.prepared(line, here)
        self.course = Course(line, self.task.area)
        self.course.plane = self.course.upright()
        self._carried, self.rotation = self.rotation, rotation
        self._way = way_to(line, here, rotation, self.task, self.touched, self._feeling(rotation))

    def step(self, observation: Observation) -> Motion:
        """One observation, one motion; see `states.TRANSITIONS`."""
        if self._last_time is not None:
            self._period = min(max(observation.time - self._last_time, 1e-4), 0.1)
        self._last_time = observation.time
        if self.state is State.CONTOUR:
            self._edge.watch(observation, self.follower, self.course.across())
        if self.state in (State.LINE, State.REAPPROACH):
            line = self.course.line
            self.touched.passed(observation.pose[:3, 3], line.place if line.axis == Y else np.nan)
        event = self._handlers[self.state](observation)
        if event is None and self._jammed(observation):
            event = Event.BLOCKED
        if event is not None:
            self._enter(event, observation)
        return self._motion(observation)

    def progress(self) -> Progress:
        """State and share of the lines done."""
        driven, known = self.itinerary.count()
        kind = "grid line" if self.course.line.axis == Y else "line across"
        doing = f"{kind}, {min(driven + 1, known)} of {known}: {self.state}"
        return Progress(doing, min(driven / max(known, 1), 1.0), self.state)

    # Which lines

    def _next_line(self, seen: Observation) -> None:
        """Go on with the next line, or with nothing."""
        self._aborts = 0
        self._leaving = seen.contact is not None
        here = seen.pose[:3, 3]
        if self.state is State.LINE and not self._leaving:
            first = back(seen, self.course.line)
        else:
            normal = surface_normal(seen) if self._leaving else self.follower.normal
            first = off(seen, normal, self.options.retreat, self.touched)
        line = self.itinerary.after(here)
        self._finished = line is None
        self._way = []
        if line is not None:
            self._take(line, here if first is None else first.place)
        if first is not None:
            self._way.insert(0, first)

    def prepared(self, line: Line, here: np.ndarray) -> tuple[Line, np.ndarray]:
        """The line as it is to be driven, and how the tip is held at its beginning, (3, 3)."""
        return line, self.upright

    def leaves_descents(self, line: Line) -> bool:
        """Whether a wall down which the line leads may be climbed from its other end instead."""
        return line.free_end

    def turn_wanted(self, seen: Observation) -> np.ndarray | None:
        """(3, 3) to turn to in the middle of a contour, None = go on as it is."""
        return None

    # What happened

    def _event_transfer(self, seen: Observation) -> Event | None:
        if self._overloaded(seen) and not self._yields(seen):
            return Event.OVERLOAD
        if self._met(seen):
            return Event.CONTACT
        if seen.blocked:
            return Event.BLOCKED
        if self._way and self._way[0].reached(seen.pose):
            self._way.pop(0)
            self._goal = None
        if not self._way:
            return Event.COVERED if self._finished else Event.ARRIVED
        return None

    def _event_line(self, seen: Observation) -> Event | None:
        self._doubts = self._doubts + 1 if maybe_stick(seen) and not self._leaving else 0
        if self._doubts:
            return Event.STICK if self._doubts >= DOUBTED else None
        if self._overloaded(seen):
            return Event.OVERLOAD
        if self._met(seen):
            return Event.CONTACT
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        return Event.LINE_END if self.course.past_end(seen.pose[:3, 3]) else None

    def _event_contour(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        if self.course.past_end(seen.pose[:3, 3]):
            return Event.LINE_END
        turn = self.turn_wanted(seen)
        if turn is not None:
            self.rotation = turn
            return Event.TURN
        if self.course.line.rim:
            if self._end_found(seen):
                return Event.END_FOUND
        elif self.course.plane is Plane.X_Y:
            if self._at_next_line(seen):
                return Event.NEXT_LINE
            if self._turned_back():
                return Event.LINE_END
        elif self._at_table(seen):
            return Event.TABLE
        elif self._climb_instead(seen):
            return Event.DESCENT
        return Event.LOST if seen.contact is None else None

    def _climb_instead(self, seen: Observation) -> bool:
        """Whether the wall that is descended is left here, to be climbed from the line's other end."""
        if not self.options.climb or seen.contact is None or not self.leaves_descents(self.course.line):
            return False
        up = self.climbing.instead(seen, self.course, self.upright)
        if up is None or self.itinerary.hopeless(up):
            return False
        self.itinerary.interpose(up)
        return True

    def _event_reapproach(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.contact is not None:
            return Event.CONTACT
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        if self.course.past_end(seen.pose[:3, 3]):
            return Event.LINE_END
        if self._at_table(seen):
            return Event.TABLE
        self._sought += float(np.sqrt(seen.velocity @ seen.velocity)) * self._period
        return Event.GAVE_UP if self._sought > self.options.reapproach else None

    def _event_release(self, seen: Observation) -> Event | None:
        if self.course.past_end(seen.pose[:3, 3]):
            return Event.LINE_END
        force = np.sqrt(seen.force @ seen.force)
        return Event.RELEASED if force <= 1.25 * self.task.force_target else None

    def _event_retreat(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.blocked:
            return Event.BLOCKED
        if self.course.past_end(seen.pose[:3, 3]):
            return Event.LINE_END
        self._retreat_left -= float(seen.velocity @ self._retreat_along) * self._period
        return Event.ARRIVED if self._retreat_left <= 0.0 else None

    def _event_tilt(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.blocked:
            return Event.BLOCKED
        if not held(seen.pose, self.rotation):
            return None
        return Event.ARRIVED if self._touching_tilt else Event.LOST

    def _jammed(self, seen: Observation) -> bool:
        """Following a surface, and yet in the same place after `JAM_TIME`: between two walls, or in a corner."""
        if self.state not in (State.CONTOUR, State.REAPPROACH):
            self._mark = None
            return False
        here = seen.pose[:3, 3]
        if self._mark is None:
            self._mark = (seen.time, here)
            return False
        since, place = self._mark
        if seen.time - since < JAM_TIME:
            return False
        self._mark = (seen.time, here)
        return bool(np.abs(here - place).max() < JAM_DISTANCE)

    def _overloaded(self, seen: Observation) -> bool:
        level = self.task.force_target + 0.6 * (self.task.force_limit - self.task.force_target)
        return hypot(*seen.force.tolist()) > level

    def _yields(self, seen: Observation) -> bool:
        """Leaving what is touched, along the force: there is no better answer to it."""
        if not (self._leaving and self._way):
            return False
        way = self._way[0].place - seen.pose[:3, 3]
        return float(way @ seen.force) > YIELDING * hypot(*way.tolist()) * hypot(*seen.force.tolist())

    def _met(self, seen: Observation) -> bool:
        """A touch, and not the one that is being left."""
        self._leaving = self._leaving and seen.contact is not None
        if self._leaving:
            return self.state is State.LINE and bool(surface_normal(seen) @ self.course.ahead() < -0.3)
        return seen.contact is not None

    def _threatened(self, seen: Observation) -> bool:
        """A link is nearer than it may come, and nearer than it already was when the last threat was answered."""
        near = seen.clearance
        if near is None or not near.threatens:
            self._borne = np.inf
            return False
        if near.distance > self._borne - BEARABLE:
            return False
        self._borne = near.distance
        return True

    def _at_table(self, seen: Observation) -> bool:
        if seen.pose[Z, 3] > self.task.area.lower[Z] + 1e-5:
            return False
        return bool(self.follower.tangent(self.course.across())[Z] < 0.0)

    def _end_found(self, seen: Observation) -> bool:
        """On a rim: past the place where the normal points along the line, or too far around for an end."""
        line, normal = self.course.line, self.follower.normal
        gone = (seen.pose[line.aside, 3] - line.place) * line.rim
        return bool(normal[line.aside] * line.rim > PAST or gone > 1.5 * self.options.step)

    def _at_next_line(self, seen: Observation) -> bool:
        neighbours = self.itinerary.neighbours()
        if neighbours is None:
            return False
        here, there = neighbours
        return bool((seen.pose[0, 3] - there) * (there - here) >= 0.0)

    def _turned_back(self) -> bool:
        """In X_Y: around the object's end, and now away from the next line again."""
        return bool(self.follower.tangent(self.course.across())[0] * self.itinerary.towards_next() < -0.5)

    # What follows from it

    def _enter(self, event: Event, seen: Observation) -> None:
        before = self.state
        if event is Event.THREAT:
            after = self._over_it(seen) if self._beneath() else self.avoid(seen)
        else:
            after = TRANSITIONS[before, event]
        missed = event is Event.LINE_END and before is State.LINE
        if (missed or event is Event.BLOCKED) and after is State.TRANSFER:
            self.itinerary.give_up(self.course.line)
        if event is Event.STICK:
            self._raise_line(seen)
        if event in LEAVES and after is State.TRANSFER:
            self._next_line(seen)
        if event is Event.TABLE:
            self._leaving = seen.contact is not None
        if event is Event.NEXT_LINE:
            self._take_next_in_passing(seen)
        if after in (State.LINE, State.TRANSFER):
            self.course.plane = self.course.upright()
        if after is State.CONTOUR and before in (State.LINE, State.TRANSFER, State.REAPPROACH):
            self._begin_contour(seen)
        if after is not State.RELEASE and before is not State.RELEASE:
            self._edge.forget()
            self.climbing.forget()
        if after is State.TILT:
            self._touching_tilt = before is State.CONTOUR
        if after is State.REAPPROACH:
            self._sought = 0.0
        self.state = after
        self._goal = None
        self.trace.append((seen.time, before.value, event.value, after.value))

    def _raise_line(self, seen: Observation) -> None:
        """Under what the stick meets nothing can be felt: the line goes on from here, above that by and by."""
        line, here = self.course.line, seen.pose[:3, 3]
        self._stick.meets(line, here)
        height = float(here[Z]) + RAISE
        if height > self.task.area.upper[Z]:
            self.itinerary.give_up(line)
            return
        begin = float(here[line.axis]) - line.sign * self.options.retreat
        self.itinerary.raise_line(replace(line, begin=begin, height=height, on_surface=False))

    def _beneath(self) -> bool:
        """Whether a line has come in under what stands ahead, so that the stick comes near that."""
        if self.state is State.LINE:
            return True
        met = self.course.plane is self.course.upright() and self.follower.normal @ self.course.ahead() < 0.0
        return self.state is State.CONTOUR and bool(met and self.follower.normal[Z] < UNDER)

    def _over_it(self, seen: Observation) -> State:
        self._raise_line(seen)
        self._next_line(seen)
        return State.TRANSFER

    def _take_next_in_passing(self, seen: Observation) -> None:
        """A contour in X_Y has come to the next grid line: along that, from the side it is on."""
        self._aborts = 0
        line = self.itinerary.in_passing(seen.pose[:3, 3])
        inward = -1.0 if self.follower.normal[Y] > 0.0 else 1.0
        self.course = Course(line if line.sign == inward else line.turned(), self.task.area)

    def _begin_contour(self, seen: Observation) -> None:
        if seen.contact is not None and self.first_contact is None:
            self.first_contact = seen.contact.point.copy()
        self.follower.restart(surface_normal(seen))
        line, course = self.course.line, self.course
        if line.rim:
            course.plane, course.level = Plane.X_Y, line.height
            course.round = -line.rim * (1.0 if self.follower.normal[line.axis] > 0.0 else -1.0)

    @abstractmethod
    def avoid(self, seen: Observation) -> State:
        """What to do about a collision threat; the strategies differ in this alone."""

    def follow_in(self, plane: Plane) -> State:
        """Go on contouring along other axes; in X_Y towards the next grid line."""
        self.course.plane, self.course.level = plane, None
        self.course.round = self.itinerary.towards_next() * (1.0 if self.follower.normal[Y] >= 0.0 else -1.0)
        return State.CONTOUR

    def give_up_line(self, seen: Observation) -> State:
        """Leave the line where it is and go on with what is to be driven instead, or with the next."""
        self.itinerary.give_up(self.course.line)
        self._next_line(seen)
        return State.TRANSFER

    def retreat(self, seen: Observation, along: np.ndarray) -> State:
        """Leave a threat along a direction; the grid goes on from there."""
        size = float(np.sqrt(along @ along))
        self._retreat_along = along / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
        self._retreat_left = self.options.retreat
        return State.RETREAT

    # How it moves

    def _motion(self, seen: Observation) -> Motion:
        if self.state is State.FINISHED:
            return Done("area covered")
        if self.state is State.TRANSFER:
            return self._transfer(seen)
        if self.state is State.LINE:
            return self._along_line(seen)
        if self.state is State.RELEASE:
            return self._release(seen)
        if self.state is State.RETREAT:
            return VelocityCommand(self._retreat_along * self.task.approach_speed, reason=self.state)
        if self.state is State.TILT:
            return self._tilt(seen)
        if self.state is State.REAPPROACH:
            return self._reapproach(seen)
        return self._contour(seen)

    def _transfer(self, seen: Observation) -> Motion:
        if not self._way:
            return Goal(seen.pose, self.task.free_speed, self.state)
        if self._goal is None:
            self._goal = self._goal_of(self._way[0], seen)
        return self._goal

    def _goal_of(self, target: Waypoint, seen: Observation) -> Goal:
        if target.rotation is not None:
            self._carried = target.rotation
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._carried, target.place
        speed = self.task.free_speed
        if target.pace is Pace.FEELING:
            way = target.place - seen.pose[:3, 3]
            size = float(np.sqrt(way @ way))
            along = way / size if size > 1e-9 else DOWN
            speed = min(self._feeling(turn)(along) for turn in (seen.pose[:3, :3], self._carried))
        return Goal(pose, speed, self.state)

    def _feeling(self, rotation: np.ndarray) -> Feeling:
        return lambda along: self.follower.approach_speed(along, rotation)

    def _along_line(self, seen: Observation) -> Motion:
        if self._doubts:
            return VelocityCommand(np.zeros(3), reason=self.state)  # until it is known what touches
        if self._goal is None or seen.goal_reached:
            line, here, held = self.course.line, seen.pose[:3, 3], seen.pose[:3, :3]
            end, careful = self._stick.piece(line, here)
            target = line.at(end)
            target[Z] = here[Z]
            speed = self._feeling(held)(held[:, Z] if careful else self.course.ahead())
            self._goal = Goal(self._pose(target), speed, self.state)
        return self._goal

    def _contour(self, seen: Observation) -> Motion:
        here, normal = seen.pose[:3, 3], self._followed_normal(seen)
        self._remember(seen, normal)
        force = max(float(seen.force @ normal), 0.0)
        feed = self.task.contour_speed
        if not believed(seen):
            # Maybe it is the stick that touches, and the sphere has something unknown above it.
            feed = min(feed, self.follower.approach_speed(DOWN, seen.pose[:3, :3]))
        velocity = self.follower.velocity(normal, force, self.course.across(), feed, seen.pose[:3, :3], self._period)
        velocity += self.course.back(here, self.follower.normal)
        return VelocityCommand(self.course.bounded(here, velocity), reason=self.state, pose=self._held(seen))

    def _followed_normal(self, seen: Observation) -> np.ndarray:
        """That of the surface; in an inner edge, where two are felt at once, that of the one met last."""
        edge = self._edge.normal(seen)
        return surface_normal(seen) if edge is None else edge

    def _remember(self, seen: Observation, normal: np.ndarray) -> None:
        here, line, contact = seen.pose[:3, 3], self.course.line, seen.contact
        self._touched_at = here - self.task.probe.radius * normal
        if contact is not None and contact.trust > 0.0:
            on_grid = line.axis == Y and self.course.plane is not Plane.X_Y
            self.touched.add(here, contact.point, contact.normal, line.place if on_grid else np.nan)

    def _tilt(self, seen: Observation) -> Motion:
        """Hold the contact, if there is one, by its force alone while the probe turns about the sphere's centre."""
        if not self._touching_tilt:
            return VelocityCommand(np.zeros(3), reason=self.state, pose=self._held(seen))
        normal = surface_normal(seen) if seen.contact is not None else self.follower.normal
        force = max(float(seen.force @ normal), 0.0)
        velocity = self.follower.velocity(normal, force, self.course.across(), 0.0, seen.pose[:3, :3], self._period)
        return VelocityCommand(velocity, reason=self.state, pose=self._held(seen))

    def _held(self, seen: Observation) -> np.ndarray | None:
        """The orientation to turn to, None while it is held anyway."""
        if np.vdot(self.rotation, seen.pose[:3, :3]) > 3.0 - 1e-6:
            return None
        return self._pose(seen.pose[:3, 3])

    def _reapproach(self, seen: Observation) -> Motion:
        around = rolling(seen.pose[:3, 3], self._touched_at, self.follower.normal)
        self.follower.normal = around
        way = 0.7 * np.array(self.follower.tangent(self.course.across())) - 0.5 * around
        way /= np.sqrt(way @ way)
        velocity = min(self.follower.approach_speed(way, seen.pose[:3, :3]), self.task.contour_speed) * way
        return VelocityCommand(self.course.bounded(seen.pose[:3, 3], velocity), reason=self.state)

    def _release(self, seen: Observation) -> Motion:
        size = float(np.sqrt(seen.force @ seen.force))
        along = seen.force / size if size > 1e-9 else self.follower.normal
        return VelocityCommand(
            self.course.bounded(seen.pose[:3, 3], along * self.follower.yielding(size, seen.pose[:3, :3])),
            reason=self.state,
        )

    def _pose(self, place: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3] = self.rotation
        pose[:3, 3] = place
        return pose
