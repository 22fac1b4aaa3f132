"""What the three strategies of the source share: grid lines, contouring, re-approach, release, table height.

Rau 2017, sections 4.2 and 5.3. Departures, each because the source's way loses surface or risks the arm:

- Lines are driven at the lowest height at which the wide part of the probe stays above everything the area may
  hold; the source leaves that height to the operator.
- A lost contact is sought on an arc around the point last touched, not on the straight line against the last
  force: past an edge that line leads over the top without a touch.
- The return to the first contact runs along the area's border, where nothing stands.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Done,
    Feed,
    Goal,
    InputError,
    Motion,
    Observation,
    Progress,
    Task,
)
from lwrprobe_strategies.following import Follower, rolling
from lwrprobe_strategies.grid import GridLines
from lwrprobe_strategies.states import TRANSITIONS, Event, Plane, State

Y = 1
Z = 2
DOWN = np.array([0.0, 0.0, -1.0])
JAM_TIME = 3.0
JAM_DISTANCE = 0.002
"""s and m: a contour that has not come further than this in that time is stuck."""
BEARABLE = 0.0005
"""m, by which a link may come nearer after a threat has been answered before that is a new threat."""


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
    """

    step: float = 0.010
    first_line: str = "middle"
    reapproach: float = 0.025
    retreat: float = 0.010

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
        first = None if self.options.first_line == "border" else float(task.start[0])
        self.lines = GridLines.over(task.area, self.options.step, first)
        self.line = 0
        self.height = line_height(task)
        self.direction = 1.0 if task.start[Y] <= 0.5 * (task.area.lower[Y] + task.area.upper[Y]) else -1.0
        self.plane = Plane.Z_Y
        self.upright = np.array(task.orientation, dtype=np.float64)
        self.rotation = self.upright
        self.follower = Follower(task)
        self.state = State.TRANSFER
        self.trace: list[tuple[float, str, str, str]] = []
        self._way: list[np.ndarray] = self._to_line(task.start)
        self._last_time: float | None = None
        self._period = 0.008
        self._sought = 0.0
        self._touched = np.array(task.start)
        self._retreat_left = 0.0
        self._retreat_along = np.zeros(3)
        self._aborts = 0
        self._borne = np.inf
        self._round = 1.0
        self._leaving = False
        self._mark: tuple[float, np.ndarray] | None = None
        self.first_contact: np.ndarray | None = None

    def step(self, observation: Observation) -> Motion:
        """One observation, one motion; see `states.TRANSITIONS`."""
        if self._last_time is not None:
            self._period = min(max(observation.time - self._last_time, 1e-4), 0.1)
        self._last_time = observation.time
        event = self._event(observation)
        if event is None and self._jammed(observation):
            event = Event.BLOCKED
        if event is not None:
            self._enter(event, observation)
        return self._motion(observation)

    def progress(self) -> Progress:
        """State and share of the lines done."""
        doing = f"line {min(self.line + 1, len(self.lines))} of {len(self.lines)}: {self.state}"
        return Progress(doing, min(self.line / len(self.lines), 1.0), self.state)

    # What happened

    def _event(self, seen: Observation) -> Event | None:
        handler = {
            State.TRANSFER: self._event_transfer,
            State.LINE: self._event_line,
            State.CONTOUR: self._event_contour,
            State.REAPPROACH: self._event_reapproach,
            State.RELEASE: self._event_release,
            State.RETREAT: self._event_retreat,
            State.TILT: self._event_tilt,
            State.FINISHED: lambda _: None,
        }[self.state]
        return handler(seen)

    def _event_transfer(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        self._leaving = self._leaving and seen.contact is not None
        if seen.contact is not None and not self._leaving:
            return Event.CONTACT
        if seen.blocked:
            return Event.BLOCKED
        if self._way and self._is_at(seen, self._way[0]):
            self._way.pop(0)
        if not self._way:
            return Event.COVERED if self.line >= len(self.lines) else Event.ARRIVED
        return None

    def _event_line(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.contact is not None:
            return Event.CONTACT
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        return Event.LINE_END if self._past_end(seen) else None

    def _event_contour(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        if self._past_end(seen):
            return Event.LINE_END
        if self.plane is Plane.X_Y:
            if self._at_next_line(seen):
                return Event.NEXT_LINE
            if self._turned_back():
                return Event.LINE_END
        elif self._at_table(seen):
            return Event.TABLE
        return Event.LOST if seen.contact is None else None

    def _event_reapproach(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.contact is not None:
            return Event.CONTACT
        if self._threatened(seen):
            return Event.THREAT
        if seen.blocked:
            return Event.BLOCKED
        if self._past_end(seen):
            return Event.LINE_END
        if self._at_table(seen):
            return Event.TABLE
        self._sought += float(np.sqrt(seen.velocity @ seen.velocity)) * self._period
        return Event.GAVE_UP if self._sought > self.options.reapproach else None

    def _event_release(self, seen: Observation) -> Event | None:
        if self._past_end(seen):
            return Event.LINE_END
        force = np.sqrt(seen.force @ seen.force)
        return Event.RELEASED if force <= 1.25 * self.task.force_target else None

    def _event_retreat(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.blocked:
            return Event.BLOCKED
        if self._past_end(seen):
            return Event.LINE_END
        self._retreat_left -= float(seen.velocity @ self._retreat_along) * self._period
        return Event.ARRIVED if self._retreat_left <= 0.0 else None

    def _event_tilt(self, seen: Observation) -> Event | None:
        if self._overloaded(seen):
            return Event.OVERLOAD
        if seen.blocked:
            return Event.BLOCKED
        turned = np.trace(self.rotation.T @ seen.pose[:3, :3])
        return Event.ARRIVED if turned > 1.0 + 2.0 * np.cos(0.02) else None

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
        return bool(seen.force @ seen.force > level * level)

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

    def _past_end(self, seen: Observation) -> bool:
        y = seen.pose[Y, 3]
        return y >= self.task.area.upper[Y] - 1e-5 if self.direction > 0 else y <= self.task.area.lower[Y] + 1e-5

    def _at_table(self, seen: Observation) -> bool:
        onward = self.follower.tangent(self._across())
        return bool(seen.pose[Z, 3] <= self.task.area.lower[Z] + 1e-5 and onward[Z] < 0.0)

    def _at_next_line(self, seen: Observation) -> bool:
        if self.line + 1 >= len(self.lines) or self.line + 1 == self.lines.second_side:
            return False
        here, there = self.lines.x[self.line], self.lines.x[self.line + 1]
        return bool((seen.pose[0, 3] - there) * (there - here) >= 0.0)

    def _turned_back(self) -> bool:
        """In X_Y: around the object's end, and now away from the next line again."""
        return bool(self.follower.tangent(self._across())[0] * self._towards_next_line() < -0.5)

    def _towards_next_line(self) -> float:
        last = min(self.line + 1, len(self.lines) - 1)
        return 1.0 if self.lines.x[last] >= self.lines.x[last - 1] else -1.0

    def _is_at(self, seen: Observation, place: np.ndarray) -> bool:
        return bool(np.abs(seen.pose[:3, 3] - place).max() < 2e-4)

    # What follows from it

    def _enter(self, event: Event, seen: Observation) -> None:
        before = self.state
        after = self.avoid(seen) if event is Event.THREAT else TRANSITIONS[before, event]
        if event in (Event.LINE_END, Event.BLOCKED) and after is State.TRANSFER:
            self._next_line(seen)
        if event is Event.NEXT_LINE:
            self.line += 1
            self._aborts = 0
            self.direction = -1.0 if self.follower.normal[Y] > 0.0 else 1.0
            self.plane = Plane.Z_Y
        if after in (State.LINE, State.TRANSFER):
            self.plane = Plane.Z_Y
        if after is State.CONTOUR and before in (State.LINE, State.TRANSFER, State.REAPPROACH):
            self._begin_contour(seen)
        if after is State.REAPPROACH:
            self._sought = 0.0
        self.state = after
        self.trace.append((seen.time, before.value, event.value, after.value))

    def _begin_contour(self, seen: Observation) -> None:
        if seen.contact is not None and self.first_contact is None:
            self.first_contact = seen.contact.point.copy()
        self.follower.restart(surface_normal(seen))

    @abstractmethod
    def avoid(self, seen: Observation) -> State:
        """What to do about a collision threat; the strategies differ in this alone."""

    def follow_in(self, plane: Plane) -> State:
        """Go on contouring along other axes; in X_Y towards the next grid line."""
        self.plane = plane
        self._round = self._towards_next_line() * (1.0 if self.follower.normal[Y] >= 0.0 else -1.0)
        return State.CONTOUR

    def retreat(self, seen: Observation, along: np.ndarray) -> State:
        """Leave a threat along a direction; the grid goes on from there."""
        size = float(np.sqrt(along @ along))
        self._retreat_along = along / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
        self._retreat_left = self.options.retreat
        return State.RETREAT

    def _next_line(self, seen: Observation) -> None:
        self.line += 1
        self._aborts = 0
        y = seen.pose[Y, 3]
        middle = 0.5 * (self.task.area.lower[Y] + self.task.area.upper[Y])
        self.direction = 1.0 if y < middle else -1.0
        if self.line < len(self.lines):
            self._way = self._to_line(seen.pose[:3, 3])
        else:
            self._way = []
        self._leaving = seen.contact is not None
        if self._leaving:
            self._way.insert(0, seen.pose[:3, 3] + self.options.retreat * surface_normal(seen))

    def _to_line(self, here: np.ndarray) -> list[np.ndarray]:
        """Way to the start of the present line: at the border in x, then in height; over the top from inside."""
        area = self.task.area
        x = float(self.lines.x[self.line])
        border = float(area.lower[Y] if self.direction > 0 else area.upper[Y])
        inside = abs(here[Y] - border) > 1e-3
        start = np.array([x, border, self.height])
        if not inside:
            return [np.array([x, border, here[Z]]), start]
        top = float(area.upper[Z])
        return [
            np.array([here[0], here[Y], top]),
            np.array([here[0], border, top]),
            np.array([x, border, top]),
            start,
        ]

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
            return Feed(self._retreat_along * self.task.approach_speed, reason=self.state)
        if self.state is State.TILT:
            return self._tilt(seen)
        if self.state is State.REAPPROACH:
            return self._reapproach(seen)
        return self._contour(seen)

    def _transfer(self, seen: Observation) -> Motion:
        if not self._way:
            return Goal(seen.pose, self.task.free_speed, self.state)
        target = self._way[0]
        # Above the lines nothing has been ruled out, so a move down is as slow as any search for a contact.
        down = target[Z] < seen.pose[Z, 3] - 1e-3 and seen.pose[Z, 3] > self.height + 1e-3
        speed = self.follower.approach_speed(DOWN, seen.pose[:3, :3]) if down else self.task.free_speed
        return Goal(self._pose(target), speed, self.state)

    def _along_line(self, seen: Observation) -> Motion:
        end = self.task.area.upper[Y] if self.direction > 0 else self.task.area.lower[Y]
        target = np.array([seen.pose[0, 3], end, seen.pose[Z, 3]])
        target[0] = self.lines.x[self.line]
        ahead = np.array([0.0, self.direction, 0.0])
        return Goal(self._pose(target), self.follower.approach_speed(ahead, seen.pose[:3, :3]), self.state)

    def _contour(self, seen: Observation) -> Motion:
        normal = surface_normal(seen)
        self._touched = seen.pose[:3, 3] - self.task.probe.radius * normal
        force = max(float(seen.force @ normal), 0.0)
        velocity = self.follower.velocity(
            normal, force, self._across(), self.task.contour_speed, seen.pose[:3, :3], self._period
        )
        return Feed(self._bounded(seen, velocity + self._back_to_line(seen)), reason=self.state, pose=self._held(seen))

    def _tilt(self, seen: Observation) -> Motion:
        """Hold the contact by its force alone while the probe turns about the sphere's centre."""
        normal = surface_normal(seen) if seen.contact is not None else self.follower.normal
        force = max(float(seen.force @ normal), 0.0)
        velocity = self.follower.velocity(normal, force, self._across(), 0.0, seen.pose[:3, :3], self._period)
        return Feed(velocity, reason=self.state, pose=self._held(seen))

    def _held(self, seen: Observation) -> np.ndarray | None:
        """The orientation to turn to, None while it is held anyway."""
        if np.trace(self.rotation.T @ seen.pose[:3, :3]) > 3.0 - 1e-6:
            return None
        return self._pose(seen.pose[:3, 3])

    def _reapproach(self, seen: Observation) -> Motion:
        around = rolling(seen.pose[:3, 3], self._touched, self.follower.normal)
        self.follower.normal = around
        speed = min(self.follower.approach_speed(around, seen.pose[:3, :3]), self.task.contour_speed)
        velocity = 0.7 * speed * self.follower.tangent(self._across()) - 0.5 * speed * around
        return Feed(self._bounded(seen, velocity), reason=self.state)

    def _release(self, seen: Observation) -> Motion:
        size = float(np.sqrt(seen.force @ seen.force))
        along = seen.force / size if size > 1e-9 else self.follower.normal
        return Feed(self._bounded(seen, along * self.follower.yielding(size, seen.pose[:3, :3])), reason=self.state)

    def _across(self) -> np.ndarray:
        """The axis that the contour does not use, signed so that the tangent leads onward."""
        if self.plane is Plane.X_Y:
            return np.array([0.0, 0.0, self._round])
        return np.array([self.direction, 0.0, 0.0])

    def _back_to_line(self, seen: Observation) -> np.ndarray:
        """Small pull towards the line's own x, within the surface, for a probe that was pushed off it sideways."""
        if self.plane is Plane.X_Y:
            return np.zeros(3)
        off = float(self.lines.x[self.line] - seen.pose[0, 3])
        pull = np.array([min(max(2.0 * off, -0.005), 0.005), 0.0, 0.0])
        normal = self.follower.normal
        return pull - (pull @ normal) * normal

    def _bounded(self, seen: Observation, velocity: np.ndarray) -> np.ndarray:
        """No component that leads out of the area in z or x."""
        here = seen.pose[:3, 3]
        for axis in (0, Z):
            outward = here[axis] >= self.task.area.upper[axis] and velocity[axis] > 0.0
            inward = here[axis] <= self.task.area.lower[axis] and velocity[axis] < 0.0
            if outward or inward:
                velocity[axis] = 0.0
        return velocity

    def _pose(self, place: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3] = self.rotation
        pose[:3, 3] = place
        return pose


def surface_normal(seen: Observation) -> np.ndarray:
    """(3,) unit: the estimated contact's, or the direction of the force where that estimate is not to be had."""
    contact = seen.contact
    if contact is not None and contact.trust > 0.0:
        return contact.normal
    size = float(np.sqrt(seen.force @ seen.force))
    return seen.force / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])


def line_height(task: Task) -> float:
    """m, lowest height of the sphere's centre at which the body above the stick clears whatever the area may hold.

    The area's top bounds the sphere's centre, so nothing that can be crossed is higher than that less the radius.
    """
    body = [-float(link.pose[2, 3]) - _half_length(link) for link in task.probe.links if link.name != "stick"]
    reach = min(body, default=0.0)
    tallest = float(task.area.upper[Z]) - task.probe.radius
    lowest = tallest + task.clearance_threshold - reach
    return float(min(max(lowest, task.area.lower[Z]), task.area.upper[Z]))


def _half_length(link) -> float:
    return link.size[2] / 2.0 if link.kind == "box" else link.size[1] / 2.0
