"""ReferenceSphere: finds a sphere of known radius, presses on it from many sides, then on the table.

The strategy of `lwrprobe calibrate`. It uses the contact estimator to find the sphere; the calibration itself
is made from the raw readings of arm and sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import Done, InputError, Progress
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.lines import UP
from lwrprobe_strategies.planning.paths import Waypoint, tip_pose
from lwrprobe_strategies.planning.sphere_estimate import ROUGH, SphereEstimate
from lwrprobe_strategies.planning.sphere_touches import (
    WORTH,
    SphereTouch,
    path_around,
    sphere_touches,
)
from lwrprobe_strategies.skills import Procedure, approach, load, rest, transit, unload
from lwrprobe_strategies.supervisor import Program, SkillStrategy

STANDOFF = 0.010
"""m off the surface, between two touches."""
LISTEN, ZEROING = 0.25, 0.7
"""s at rest before a touch, to read the sensor's zero, and in which the run moves its own zero there."""
ZERO_EVERY = 4
"""Touches after which the zero is moved: an uncalibrated sensor drifts by 0.1 N a minute."""
FAR, NEAR = 0.005, 0.0006
"""m before the surface where a slow approach begins, while the place of sphere or table is rough, and at least."""
BEYOND = 0.003
"""m behind the surface where an approach ends that met nothing."""
LOAD_TIME = 0.4
"""s, in which the force rises."""
UNLOAD_TIMES = (0.25, 0.07)
"""s in which it falls: two speeds tell the clocks' offset from the play of joints and sensor. They change after every
second touch, so that both are used along the stick and across it (`sphere_touches`)."""
SEARCH = 0.7
"""Sums of the radii between two places at which the sphere is sought."""
HEIGHT = 0.003
"""m, of the table beside what is stated: how far beside the middle the first touch from above may lie follows from it.
"""
SIDES, ELEVATION = (0.0, 0.5, 1.0, 1.5), 0.12
"""Directions, in half turns, from which a sphere is touched that was found from above, until three touches have met it;
and rad above the horizontal: across the stick the probe is soft, and an approach fast."""
ENOUGH = 3
ON_TABLE = 0.4
"""Share of the sum of the radii by which the tip must be above the table to have met the sphere."""
BESIDE = 0.02
"""m between the sphere and the touches of the table."""
SLOPE = 0.02
"""rad, of the table between two of its touches, for the place from which on the second one is sought."""
LET_GO = 0.001
"""m, by which a touch is left."""
READABLE = 0.9
"""Share of the torque at which the run's guard lets go, up to which a press leads: a data sheet's gain and crosstalk
make a reading wrong by 3 %."""
PRESSING = 100.0
"""s for the presses, however long a sphere was sought."""


@dataclass(slots=True, frozen=True)
class _Options:
    """Options.

    Attributes
    ----------
    radius : m, of the reference sphere
    places : x, y, z of its centre in m, one place after another, as far as known
    spread : m, within which the sphere is sought around that place
    force : share of the force limit that a press reaches
    leans : orientations of the probe against that of the start: tilt, direction of the tilt and turn about the stick,
        in rad, one after another
    speed_shares : that of the approach speed which the arm allows in each of them, along the stick; none = all of it
    touches : presses in each orientation
    table : m, height of the table as far as known; nan = there is none
    torque : N m about each axis of the sensor at which the run's guard lets go
    time : s at one place of the sphere, which a slow loop keeps to with fewer presses
    """

    radius: float = 0.015
    places: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.015),)
    spread: float = 0.02
    force: float = 0.65
    leans: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.4, 1.6, 0.0))
    speed_shares: tuple[float, ...] = ()
    touches: int = 4
    table: float = 0.0
    torque: float = float("inf")
    time: float = 265.0

    def __post_init__(self) -> None:
        for name, low, high in (("radius", 0.002, 0.1), ("spread", 0.0, 0.1), ("force", 0.2, 0.7), ("time", 1.0, 1e4)):
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise InputError(name, value, f"{low:g} to {high:g}")
        if not 1 <= self.touches <= 50:
            raise InputError("touches", self.touches, "1 to 50")
        for name in ("places", "leans"):
            rows = getattr(self, name)
            if not rows or not all(len(row) == 3 and np.isfinite(row).all() for row in rows):
                raise InputError(name, rows, "rows of three finite numbers")
        if self.speed_shares and not (
            len(self.speed_shares) == len(self.leans) and all(0.0 < share <= 1.0 for share in self.speed_shares)
        ):
            raise InputError("speed_shares", self.speed_shares, "one number above 0 and up to 1 for each of `leans`")


class ReferenceSphere(SkillStrategy):
    """Presses on a sphere of known radius from many sides.

    Attributes
    ----------
    centres : (3,) m of each place of the sphere that was found
    """

    Config: ClassVar[type] = _Options
    centres: list[np.ndarray]

    def program(self) -> Program:
        """Find the sphere, then press according to the plan."""
        options: _Options = self.task.options
        self.centres, self._count, self._planned = [], 0, 1
        self._reach = options.radius + self.task.probe.radius
        self._upright = self.tip.rotation.copy()
        self._force = options.force * self.task.force_limit
        plan = sphere_touches(self._upright, options.leans, options.touches, options.speed_shares)
        self._planned = len(plan) * len(options.places)
        for index, stated in enumerate(options.places):
            self._met: list[np.ndarray] = []
            self._begun = self.tip.seen.time
            found = yield from self._find(np.asarray(stated, dtype=float), options)
            if found is not Ended.CONTACT:
                return Done(f"the reference sphere was not found around {_coordinates(stated)} m", complete=False)
            yield from self._press_all(plan[index:] + plan[:index])
            self.centres.append(self._sphere.centre)
            try:
                if np.isfinite(options.table):
                    yield from self._press_table()
                yield from self._leave_upwards()
            except (Overload, Blocked):  # what was pressed counts, where no other place comes after it
                if index + 1 < len(options.places):
                    raise
        return Done("all touches made")

    def progress(self) -> Progress:
        """Share of the planned touches."""
        return Progress("calibrating", min(self._count / self._planned, 1.0), self.tip.trace.state)

    def _press_all(self, plan: list[SphereTouch]) -> Procedure:
        """One orientation after another; while the time does not suffice, presses are left out of each.

        The later the plan is, the more presses are left out of each orientation. Which kinds are left out follows from
        what they tell per second (`WORTH`). The table takes about as long as the search has, at the same speed.
        """
        options, begin, before = self.task.options, self.tip.seen.time, self._count
        left, made = max(options.time - 2.0 * (begin - self._begun), PRESSING), np.zeros(options.touches)
        worth = np.resize(WORTH, options.touches)
        for first in range(0, len(plan), options.touches):
            late = (self.tip.seen.time - begin) / left - first / len(plan)
            spared = int(np.clip(np.ceil(2.0 * late * len(plan) / options.touches), 0, options.touches - 1))
            kept = np.sort(np.argsort(made / worth, kind="stable")[: options.touches - spared])
            for k in kept[kept < len(plan) - first].tolist():
                self._count = before + first + k
                yield from self._press(plan[first + k])
                made[k] += 1.0
        self._count = before + len(plan)
        return Ended.RELEASED

    def _find(self, stated: np.ndarray, options: _Options) -> Procedure:
        """Go down at places around the stated one until the tip meets something above the table, then beside it.

        Places alone count, because an uncalibrated sensor says little of a contact's normal.
        """
        step, rings = SEARCH * self._reach, int(np.ceil(options.spread / (SEARCH * self._reach)))
        grid = np.arange(-rings, rings + 1) * step
        for x, y in sorted(((x, y) for x in grid for y in grid), key=lambda offset: np.hypot(*offset)):
            if (yield from self._descend(stated, stated[:2] + np.array((x, y)))) is Ended.CONTACT:
                break
        else:
            return Ended.NOTHING_FOUND
        below = stated[2] + self._reach - self._met[0][2]
        centre = self._met[0] - (self._reach - max(below, 0.0)) * UP
        self._sphere = SphereEstimate(centre, self._upright, self._reach)
        aside = np.sqrt(2.0 * self._reach * (abs(below) + HEIGHT))
        self._at, known = SphereTouch(self._upright, UP), False
        for half_turns in SIDES:
            outcome = yield from self._meet_side(np.pi * half_turns, 2.0 * ROUGH if known else aside)
            known = known or (outcome is Ended.CONTACT and half_turns >= 0.5)
            if len(self._met) > ENOUGH:
                break
        yield from transit(self.tip, [Waypoint(self._sphere.centre + self._off(STANDOFF) * UP)])
        return Ended.CONTACT if len(self._met) >= ENOUGH else Ended.NOTHING_FOUND

    def _descend(self, stated: np.ndarray, place: np.ndarray) -> Procedure:
        """Go down at a place (2,) to the table, and up again; what is met above the table is the sphere."""
        tip, options = self.tip, self.task.options
        top = stated[2] + self._reach
        floor = stated[2] if not np.isfinite(options.table) else options.table + self.task.probe.radius
        above = np.array([*place, top + STANDOFF])
        path = [Waypoint(_at(tip.here, max(above[2], tip.here[2]))), Waypoint(_at(above, max(above[2], tip.here[2])))]
        path += [Waypoint(above), Waypoint(_at(above, top + FAR))]
        if not self.task.reachable([tip.pose_at(point.place) for point in path]):
            return Ended.NO_CONTACT
        yield from transit(tip, path)
        yield from rest(tip, ZEROING)
        outcome = yield from approach(tip, UP, top + FAR - floor)
        here = tip.here.copy()
        yield from self._let_go(UP)
        yield from transit(tip, [Waypoint(above)])
        if outcome is Ended.NO_CONTACT or here[2] < floor + ON_TABLE * self._reach:
            return Ended.NO_CONTACT
        self._met.append(here)
        return Ended.CONTACT

    def _meet_side(self, side: float, unsure: float) -> Procedure:
        """Meet the sphere from a side [rad], which lies within `unsure` m of where it is thought to be."""
        tip = self.tip
        normal = np.array([np.cos(ELEVATION) * np.cos(side), np.cos(ELEVATION) * np.sin(side), np.sin(ELEVATION)])
        begin = self._sphere.centre + self._off(unsure + 2.0 * NEAR) * normal
        end = self._sphere.centre + (self._reach - unsure - BEYOND) * normal
        high = self._sphere.centre[2] + self._off(STANDOFF)
        path = [Waypoint(_at(tip.here, max(high, tip.here[2]))), Waypoint(_at(begin, high)), Waypoint(begin)]
        if not self.task.reachable([tip.pose_at(place) for place in (*(one.place for one in path), end)]):
            return Ended.NOTHING_FOUND
        outcome = yield from transit(tip, path)
        if outcome is Ended.ARRIVED:
            yield from rest(tip, ZEROING)
            outcome = yield from approach(tip, normal, float((begin - end) @ normal))
        if outcome is Ended.CONTACT:
            self._met.append(tip.here.copy())
            self._sphere.fit(np.array(self._met))
        yield from self._let_go(normal)
        out = tip.here + STANDOFF * normal
        yield from transit(tip, [Waypoint(out), Waypoint(_at(out, high))])
        return outcome

    def _press(self, touch: SphereTouch) -> Procedure:
        """Go round the sphere to where it is to be touched, and press; leave a touch out that is out of reach."""
        tip = self.tip
        self._sphere.turn_to(touch.rotation)
        centre = self._sphere.centre
        out = centre + self._off(STANDOFF) * touch.normal
        path = [
            Waypoint(centre + self._off(STANDOFF) * normal, rotation=rotation)
            for normal, rotation in path_around(self._at.normal, touch.normal, self._at.rotation, touch.rotation)
        ]
        pressed = tip_pose(centre + (self._reach - BEYOND) * touch.normal, touch.rotation)
        held = self._at.rotation
        poses = [tip_pose(point.place, held if point.rotation is None else point.rotation) for point in path]
        if not self.task.reachable([*poses, pressed]):
            return Ended.NOTHING_FOUND
        try:
            outcome = yield from transit(tip, path)
            if outcome is Ended.CONTACT:
                return (yield from self._retreat())
            tip.rotation = touch.rotation.copy()
            self._at = touch
            near = float(np.clip(self._sphere.uncertainty(touch.normal), NEAR, FAR))
            near_place = centre + self._off(near) * touch.normal
            yield from rest(tip, LISTEN if self._count % ZERO_EVERY else ZEROING)
            outcome = yield from transit(tip, [Waypoint(near_place)])
            if outcome is Ended.CONTACT:
                return (yield from self._retreat())
            outcome = yield from approach(tip, touch.normal, near + BEYOND, touch.speed_share)
            if outcome is Ended.CONTACT:
                yield from self._load(touch.normal, touch.speed_share)
                self._sphere.touched(self._contact, touch.normal)
            else:
                self._sphere.doubt()
        except (Overload, Blocked):
            tip.leave()
        yield from self._let_go(touch.normal)
        yield from transit(tip, [Waypoint(out)])
        return Ended.RELEASED

    def _load(self, normal: np.ndarray, speed_share: float = 1.0) -> Procedure:
        """Press along a normal and let go, in one of the two times."""
        tip = self.tip
        self._contact = tip.here.copy()
        outcome = yield from load(tip, normal, min(self._force, self._readable(normal)), LOAD_TIME, speed_share)
        pressed_in = float((self._contact - tip.here) @ normal)
        yield from unload(tip, normal, pressed_in, UNLOAD_TIMES[self._count // 2 % 2])
        return outcome

    def _readable(self, normal: np.ndarray) -> float:
        """N along a normal (3,), up to which the guard of the sensor's torque does not let go."""
        across = self.tip.rotation[:, :2].T @ normal
        lever = self.task.probe.sensor_distance * float(np.abs(across).max())
        return READABLE * self.task.options.torque / max(lever, 1e-9)

    def _let_go(self, normal: np.ndarray) -> Procedure:
        """Move out along a normal until nothing is touched."""
        self.tip.leave()
        outcome = yield from unload(self.tip, normal, LET_GO, UNLOAD_TIMES[0])
        return outcome

    def _retreat(self) -> Procedure:
        """Leave what was met where nothing was expected: along the force, then away from the sphere."""
        tip = self.tip
        force = tip.seen.force.copy()
        self._sphere.doubt()
        yield from self._let_go(force / max(float(np.linalg.norm(force)), 1e-9))
        away = tip.here - self._sphere.centre
        normal = away / np.linalg.norm(away)
        rotation = tip.seen.pose[:3, :3].copy()
        yield from transit(tip, [Waypoint(self._sphere.centre + self._off(STANDOFF) * normal, rotation=rotation)])
        self._at = SphereTouch(rotation, normal)
        tip.rotation = rotation
        return Ended.NO_CONTACT

    def _press_table(self) -> Procedure:
        """Press on the table at four places around the sphere, which stands on it."""
        tip, centre = self.tip, self._sphere.centre
        options: _Options = self.task.options
        yield from self._leave_upwards()
        high = float(tip.here[2])
        low = float(centre[2]) - options.radius + self.task.probe.radius
        radius, gap = self._reach + BESIDE, FAR
        for x, y in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
            above = np.array([centre[0] + radius * x, centre[1] + radius * y, high])
            down = _at(above, low + gap)
            if not self.task.reachable([tip.pose_at(above), tip.pose_at(_at(above, low))]):
                continue
            try:
                yield from transit(tip, [Waypoint(above), Waypoint(down)])
                yield from rest(tip, ZEROING)
                outcome = yield from approach(tip, UP, gap + BEYOND)
                if outcome is Ended.CONTACT:
                    low, gap = float(tip.here[2]), SLOPE * radius + NEAR
                    yield from self._load(UP)
            except (Overload, Blocked):
                tip.leave()
            yield from self._let_go(UP)
            yield from transit(tip, [Waypoint(above)])
        return Ended.RELEASED

    def _leave_upwards(self) -> Procedure:
        """Round to the top of the sphere, then up, held upright."""
        top = SphereTouch(self._upright, UP)
        centre = self._sphere.centre
        path = [
            Waypoint(centre + self._off(STANDOFF) * normal, rotation=rotation)
            for normal, rotation in path_around(self._at.normal, top.normal, self._at.rotation, top.rotation)
        ]
        outcome = yield from transit(self.tip, path)
        self.tip.rotation, self._at = self._upright.copy(), top
        return outcome

    def _off(self, gap: float) -> float:
        """m from the sphere's centre to the tip's, with so much between their surfaces."""
        return self._reach + gap


def _at(place: np.ndarray, height: float) -> np.ndarray:
    return np.array([place[0], place[1], height])


def _coordinates(place: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in place) + ")"
