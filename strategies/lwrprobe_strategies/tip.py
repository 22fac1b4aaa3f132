"""What skills share: the task, the latest observation, the controller, the memory of contacts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import hypot, inf

import numpy as np

from lwrprobe.contracts import Confidence, Doubt, Observation, Task
from lwrprobe.control import ContourControl
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.free_space import COLUMN, SIDE, FreeSpace
from lwrprobe_strategies.planning.lines import UP
from lwrprobe_strategies.planning.overhangs import Overhangs
from lwrprobe_strategies.planning.paths import THERE, Speeds, tip_pose
from lwrprobe_strategies.planning.shaft import UNEXPECTED
from lwrprobe_strategies.planning.upright_body import body, tallest_possible
from lwrprobe_strategies.trace import Trace

MIN_PERIOD, MAX_PERIOD = 1e-4, 0.1
"""s between two samples; what lies outside is a gap in the stream and not a time to integrate over."""
FIRST_PERIOD = 0.008
"""s, assumed before the second sample: 125 Hz."""
HELD = 3.0 - 1e-6
"""Trace of the turn between two orientations, from which on they are the same for a command."""
BESIDE = 0.015
"""m beside what was touched, within which more of it may be; a program with lines sets it by their distance."""
STICK = "stick"
"""Name of the stick among the probe's links."""
SIDEWAYS = 0.1
"""Share of a motion across the stick, up to which the stick goes where it has been."""
UPWARDS = 0.6
"""Share of a motion along z, from which on it leads up a wall, and under what stands out from it."""
NEAR, NEAR_IN_FREE_SPACE = 0.0015, 0.003
"""m between the stick and what was touched, from which on a motion towards that is slow: braking, and the sphere, which
reaches 3 mm further out, would have met a plain wall before. Where it touches nothing it has not met one: what is near
then stands out, and where it was not touched it may do so by a little more."""
CLEAR = 1.25
"""Times the wanted force, from which on one contact of the stick is certain."""
LEAST_SHARE = 0.1
"""Of a speed, to which a stiff arm may slow it in the choice of a path."""
TOWARDS = 0.3
"""Share of the sideways motion towards what is near; a motion along a wall has less."""


class Tip:
    """The tip and what it has met.

    The supervisor updates it with every sample. A skill reads it, and keeps its own state in local variables.

    Attributes
    ----------
    task : what is to be explored
    seen : the latest observation
    here : (3,) m, the sphere's centre
    period : s between the last two
    reliable : what is touched is one surface, and the sphere touches it
    control : hybrid force and velocity control; holds the tracked normal
    memory : where the tip has been and what it touched there
    free : what the probe has shown to be free
    overhangs : where the stick may be met before the sphere
    body : where the body behind the stick may go, None where it is above all that may be there, or not asked for
    leaving : what is touched now is being left, and is no new contact
    pressed : presses have shown how stiff the arm is
    trace : which skill ran when, and how it ended
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.rotation = np.array(task.orientation, dtype=np.float64)
        self.seen = Observation(0.0, self.pose_at(np.asarray(task.start)), np.zeros(3), np.zeros(3))
        self.here = self.seen.pose[:3, 3]
        self.period = FIRST_PERIOD
        self.reliable = False
        self.control = ContourControl(task)
        self.memory = ContactMemory()
        self.free = FreeSpace(task.area, _side(task))
        self.expect_overhangs(BESIDE)
        self.body: BodySpace | None = None
        self.leaving = self.pressed = False
        self.trace = Trace()
        self._samples = 0

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3), the orientation in which the tip is to be held; set by the program, never by a skill."""
        return self._rotation

    @rotation.setter
    def rotation(self, rotation: np.ndarray) -> None:
        self._rotation, self._wanted = rotation, np.zeros(16)
        self._wanted.reshape(4, 4)[:3, :3] = rotation

    def confine(self, task: Task) -> None:
        """Go on with a task in a part of the area. What was touched and swept stays known; overhangs begin empty."""
        self.task = task
        wide = [bottom for half, bottom in body(task) if half.min() > task.probe.radius]
        self.free.confine(task.area, min(wide, default=inf))
        self.expect_overhangs(BESIDE)
        self.body = None

    def expect_overhangs(self, beside: float) -> None:
        """Begin to note overhangs anew; more of the object may be within `beside` m of what is touched."""
        task = self.task
        self.overhangs = Overhangs(task.area, task.probe, beside, task.force_target, tallest_possible(task))

    def raise_area(self, task: Task) -> None:
        """Go on with a task whose area reaches higher; what was touched and swept stays known."""
        self.task = task
        self.free.raise_top(float(task.area.upper[2]))
        self.overhangs.raise_top(float(task.area.upper[2]))
        if self.body is not None:
            self.body.raise_top(task)

    def observe(self, seen: Observation) -> None:
        """Take over a sample."""
        if self._samples:
            period = seen.time - self.seen.time
            inside = MIN_PERIOD <= period <= MAX_PERIOD
            self.period = period if inside else min(max(period, MIN_PERIOD), MAX_PERIOD)
        self._samples += 1
        self.seen, self.here = seen, seen.pose[:3, 3]
        self.trace.time = seen.time
        contact = seen.contact
        self.reliable = contact is not None and contact.confidence is Confidence.RELIABLE
        self.free.note(seen.pose, contact.normal if contact is not None else None, self.reliable)
        self.overhangs.note(seen.pose, contact)
        if self.body is not None:
            self.body.note(seen.pose, None if contact is None else contact.point)
        if contact is None:
            self.leaving = False

    @property
    def touches(self) -> bool:
        """Something is touched, and it is not being left."""
        return self.seen.contact is not None and not self.leaving

    def leave(self) -> None:
        """What is touched now counts as no contact until the tip is off it."""
        self.leaving = self.seen.contact is not None

    @property
    def column_is_free(self) -> bool:
        """Nothing is above the sphere, as far as is known: it came down here, or nothing near is taller."""
        x, y, z = self.here.tolist()
        return not self.overhangs.beside(self.here) or self.free.clear_down_to(x, y) <= z + THERE

    @property
    def stick_may_meet(self) -> bool:
        """The stick may meet something before the sphere does, in some direction; `stick_limit` says in which."""
        if self.seen.contact is None or self.leaving or self.overhangs.beside(self.here):
            return True
        return self._stick_is_near

    @property
    def _stick_is_near(self) -> bool:
        near = self.seen.clearance
        least = NEAR if self.touches else NEAR_IN_FREE_SPACE
        return near is not None and near.link == STICK and near.distance - near.required < least

    def stick_limit(self, along: np.ndarray) -> float:
        """m/s along a unit vector (3,) at which the stick may meet something before the sphere; inf where it cannot.

        It may where something is known near the stick, and where the object may overhang.
        """
        side = hypot(along.item(0), along.item(1))
        if side < SIDEWAYS:
            return inf
        return min(self._overhang_limit(along, side), self.near_limit(along))

    def _overhang_limit(self, along: np.ndarray, side: float) -> float:
        """m/s along a unit vector (3,) with a horizontal share `side`, where the object overhangs or may do so."""
        here = self.here
        if self.overhangs.cut_off(here, along):
            return inf
        if self.overhangs.ahead(here, along):
            # What overhangs slopes: going up meets it as well as going sideways.
            share = side if along[2] <= 0.0 else 1.0
            safe = self.control.stick_speed(self.overhangs.reach(here, along), along) / share
            return min(safe, self.control.wedge_speed(along, self.seen.pose[:3, :3])) if self.touches else safe
        if self.overhangs.possible(here, along):
            reach = self.overhangs.reach(here, along)
            # What the sphere presses with adds to what the stick meets.
            safe = self.control.stick_speed(reach, along, share=1.0)
            return (safe if self.touches else UNEXPECTED * self.control.stick_speed(reach, along)) / side
        if not self.touches and self.overhangs.anywhere(here, along):
            return UNEXPECTED * self.control.stick_speed(self.overhangs.reach(here, along), along) / side
        return inf

    def near_limit(self, along: np.ndarray) -> float:
        """m/s along a unit vector (3,) towards what is known to be near the stick; inf where that leads past it."""
        near, side = self.seen.clearance, hypot(along.item(0), along.item(1))
        if near is None or not self._stick_is_near or side < SIDEWAYS:
            return inf
        back = -self.seen.pose[:3, 2]
        there = near.on_map - self.here
        reach = float(there @ back)
        there = there - reach * back
        closing = float(there @ along) / max(hypot(*there.tolist()), 1e-9)
        if reach <= self.task.probe.radius or closing <= TOWARDS * side:
            return inf
        return self.control.stick_speed(reach, there) / closing

    def level_limit(self, along: np.ndarray) -> float:
        """m/s along a unit vector (3,) at which a level contour may lead in under what stands out above; inf where
        nothing may be.
        """
        reach = self.overhangs.beneath(self.here, along)
        return self.control.stick_speed(reach, along) if reach > 0.0 else inf

    @property
    def stick_touches(self) -> bool:
        """The stick is what is touched, and by a force that leaves no doubt."""
        contact = self.seen.contact
        if contact is None or contact.reason is not Doubt.AXIS_MISSES:
            return False
        above = float((contact.point - self.here) @ self.seen.pose[:3, 2]) < -self.task.probe.radius
        return above and float(self.seen.force @ self.seen.force) > (CLEAR * self.task.force_target) ** 2

    def climb_limit(self, along: np.ndarray) -> float:
        """m/s along a unit vector (3,) at which the sphere may come in under something on the way up a surface; inf
        where it does not go up or where what is above is known.
        """
        if along[2] < UPWARDS or not self.overhangs.above(self.here, self.control.normal):
            return inf
        safe = self.control.climb_speed if self.reliable else self.control.held_speed
        return safe / float(along[2])

    def speeds(self, rotation: np.ndarray) -> Speeds:
        """How fast a motion may be for a tip held by `rotation` (3, 3)."""
        control = self.control
        level = UNEXPECTED * control.stick_speed(self.task.probe.sensor_distance)
        guarded = partial(control.approach_speed, rotation=rotation)
        return Speeds(self.task.free_speed, control.column_speed, guarded, level, self.known_speed)

    def expected_speeds(self, rotation: np.ndarray) -> Speeds:
        """As `speeds`, for the choice of a path: what may touch along a stick that leans to where the arm is stiff is
        slowed (`ForceStage`).
        """
        speeds, axis = self.speeds(rotation), rotation[:, 2]
        share = min(max(1.0 + self.task.stiffness * float(axis @ self.task.softer @ axis), LEAST_SHARE), 1.0)
        return replace(speeds, guarded=lambda along: share * speeds.guarded(along))

    @property
    def known_speed(self) -> float:
        """m/s where all of the probe is known to fit: a slip of that knowledge is met softly, across the stick."""
        rotation = self.rotation
        return min(UNEXPECTED * self.control.approach_speed(rotation[:, 0], rotation), self.task.free_speed)

    def normal(self) -> np.ndarray:
        """(3,) unit: the contact's normal; the tracked one while the force is too small for a contact.

        Of a tip that has tracked nothing yet, the direction of the force.
        """
        contact, force, tracked = self.seen.contact, self.seen.force, self.control.normal
        if contact is not None:
            return contact.normal
        if tracked.any():
            return tracked
        size = float(np.sqrt(force @ force))
        return force / size if size > 1e-9 else UP.copy()

    def pose_at(self, place: np.ndarray) -> np.ndarray:
        """(4, 4) at a place (3,), in the wanted orientation."""
        return tip_pose(place, self.rotation)

    def turn(self, ahead: float = inf) -> np.ndarray | None:
        """(4, 4) pose whose orientation a velocity command turns to; None while the tip is held as wanted.

        It is `ahead` rad from the present one, until that is half of the rest.
        """
        alike = self._wanted.dot(self.seen.pose.ravel())
        if alike > HELD:
            return None
        return self.pose_at(self.here) if ahead == inf else self._turned(ahead)

    def _turned(self, ahead: float) -> np.ndarray:
        """(4, 4), the present pose turned towards the wanted orientation by `ahead` rad, or by all of the last two."""
        from scipy.spatial.transform import Rotation

        now = self.seen.pose[:3, :3]
        turn = Rotation.from_matrix(self._rotation @ now.T).as_rotvec()
        angle = float(np.linalg.norm(turn))
        share = ahead / angle if angle > 2.0 * ahead else 1.0
        return tip_pose(self.here, Rotation.from_rotvec(share * turn).as_matrix() @ now)


def _side(task: Task) -> float:
    """m beside where the sphere has been, within which nothing is struck as fast as the probe can."""
    return SIDE if task.arm_mass == 0.0 else COLUMN
