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
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.planning.sphere_touches import SphereTouch, path_around, sphere_touches
from lwrprobe_strategies.skills import Procedure, approach, load, rest, transit, unload
from lwrprobe_strategies.supervisor import Program, SkillStrategy

STANDOFF = 0.010
"""m off the surface, between two touches."""
LISTEN, ZEROING = 0.25, 0.7
"""s at rest before a touch, to read the sensor's zero, and in which the run moves its own zero there."""
ZERO_EVERY = 4
"""Touches after which the zero is moved: an uncalibrated sensor drifts by 0.1 N a minute."""
FAR, NEAR = 0.005, 0.001
"""m before the surface where a slow approach begins, while the place of sphere or table is rough, and when it is known.
"""
SURE = 3.0
"""Standard deviations of the contacts from the sphere by which an approach begins before the surface, at least: an arm
with another kinematic table has the sphere elsewhere in each orientation."""
BEYOND = 0.003
"""m behind the surface where an approach ends that met nothing."""
LOAD_TIME = 0.4
"""s, in which the force rises."""
UNLOAD_TIMES = (0.25, 0.07)
"""s in which it falls, in turn: two speeds tell the clocks' offset from the joints' play."""
SEARCH = 0.7
"""Sums of the radii between two places at which the sphere is sought."""
ROUNDS, ASIDE = 3, 0.45
"""Rounds of three touches from above around the sphere's middle at most, and sums of the radii that they lie beside it.
"""
ON_TABLE = 0.4
"""Share of the sum of the radii by which the tip must be above the table to have met the sphere."""
BESIDE = 0.02
"""m between the sphere and the touches of the table."""
LET_GO = 0.001
"""m, by which a touch is left."""
TWO_PI = 2.0 * np.pi
UP = np.array([0.0, 0.0, 1.0])
PRIOR = 0.02
"""m, by which the sphere may stand elsewhere than the first touch says: only steadies the fit."""


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
    touches : presses in each orientation
    table : m, height of the table as far as known; nan = there is none
    """

    radius: float = 0.015
    places: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.015),)
    spread: float = 0.02
    force: float = 0.5
    leans: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.4, 1.6, 0.0))
    touches: int = 4
    table: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (("radius", 0.002, 0.1), ("spread", 0.0, 0.1), ("force", 0.2, 0.7)):
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise InputError(name, value, f"{low:g} to {high:g}")
        if not 1 <= self.touches <= 50:
            raise InputError("touches", self.touches, "1 to 50")
        for name in ("places", "leans"):
            rows = getattr(self, name)
            if not rows or not all(len(row) == 3 and np.isfinite(row).all() for row in rows):
                raise InputError(name, rows, "rows of three finite numbers")


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
        plan = sphere_touches(self._upright, options.leans, options.touches)
        self._planned = len(plan) * len(options.places)
        for index, stated in enumerate(options.places):
            self._met: list[np.ndarray] = []
            found = yield from self._find(np.asarray(stated, dtype=float), options)
            if found is not Ended.CONTACT:
                return Done(f"the reference sphere was not found around {_coordinates(stated)} m", complete=False)
            self.centres.append(self._centre())
            for touch in plan[index:] + plan[:index]:
                yield from self._press(touch)
                self._count += 1
            self.centres[-1] = self._centre()
            if np.isfinite(options.table):
                yield from self._press_table()
            yield from self._leave_upwards()
        return Done("all touches made")

    def progress(self) -> Progress:
        """Share of the planned touches."""
        return Progress("calibrating", min(self._count / self._planned, 1.0), self.tip.trace.state)

    def _find(self, stated: np.ndarray, options: _Options) -> Procedure:
        """Go down at places around the stated one until the tip meets something above the table, then beside it.

        Heights alone count, because an uncalibrated sensor says little of a contact's normal.
        """
        step, rings = SEARCH * self._reach, int(np.ceil(options.spread / (SEARCH * self._reach)))
        grid = np.arange(-rings, rings + 1) * step
        for x, y in sorted(((x, y) for x in grid for y in grid), key=lambda offset: np.hypot(*offset)):
            if (yield from self._descend(stated, stated[:2] + np.array((x, y)))) is Ended.CONTACT:
                break
        else:
            return Ended.NOTHING_FOUND
        self._guess = self._met[0] - self._reach * UP
        for _ in range(ROUNDS):
            centre, before = self._centre(), len(self._met)
            for angle in (0.0, TWO_PI / 3.0, 2.0 * TWO_PI / 3.0):
                aside = ASIDE * self._reach * np.array([np.cos(angle), np.sin(angle)])
                yield from self._descend(stated, centre[:2] + aside)
            if len(self._met) - before == 3:
                break
        self._at = SphereTouch(self._upright, UP)
        yield from transit(self.tip, [Waypoint(self._centre() + self._off(STANDOFF) * UP)])
        return Ended.CONTACT if len(self._met) > 2 else Ended.NOTHING_FOUND

    def _descend(self, stated: np.ndarray, place: np.ndarray) -> Procedure:
        """Go down at a place (2,) to the table, and up again; what is met above the table is the sphere."""
        tip, options = self.tip, self.task.options
        top = stated[2] + self._reach
        floor = stated[2] if not np.isfinite(options.table) else options.table + self.task.probe.radius
        above = np.array([*place, top + STANDOFF])
        path = [Waypoint(_at(tip.here, max(above[2], tip.here[2]))), Waypoint(_at(above, max(above[2], tip.here[2])))]
        path += [Waypoint(above), Waypoint(_at(above, top + FAR))]
        if not self.task.reachable([tip.pose_at(way.place) for way in path]):
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

    def _near(self) -> float:
        """m before the surface where the approach of a touch begins: as sure as the contacts so far agree."""
        away = np.linalg.norm(np.array(self._met) - self._centre(), axis=1) - self._reach
        return float(np.clip(SURE * np.sqrt(np.mean(away**2)), NEAR, FAR))

    def _centre(self) -> np.ndarray:
        """(3,) m, from all contacts at this place: they lie as far from it as the sum of the radii."""
        centre, met = self._guess.copy(), np.array(self._met)
        for _ in range(10):
            away = met - centre
            distance = np.linalg.norm(away, axis=1)
            normal = away / distance[:, None]
            left = self._reach - distance
            square = normal.T @ normal + (1e-4 / PRIOR) ** 2 * np.eye(3)
            centre = centre - np.linalg.solve(square, normal.T @ left)
        return centre

    def _press(self, touch: SphereTouch) -> Procedure:
        """Go round the sphere to where it is to be touched, and press; leave a touch out that is out of reach."""
        tip = self.tip
        centre = self._centre()
        out = centre + self._off(STANDOFF) * touch.normal
        way = [
            Waypoint(centre + self._off(STANDOFF) * normal, rotation=rotation)
            for normal, rotation in path_around(self._at.normal, touch.normal, self._at.rotation, touch.rotation)
        ]
        pressed = _pose(touch.rotation, centre + (self._reach - BEYOND) * touch.normal)
        poses = [_pose(self._at.rotation if point.rotation is None else point.rotation, point.place) for point in way]
        if not self.task.reachable([*poses, pressed]):
            return Ended.NOTHING_FOUND
        try:
            outcome = yield from transit(tip, way)
            if outcome is Ended.CONTACT:
                return (yield from self._retreat())
            tip.rotation = touch.rotation.copy()
            self._at = touch
            near = self._near()
            near_place = centre + self._off(near) * touch.normal
            yield from rest(tip, LISTEN if self._count % ZERO_EVERY else ZEROING)
            outcome = yield from transit(tip, [Waypoint(near_place)])
            if outcome is Ended.CONTACT:
                return (yield from self._retreat())
            outcome = yield from approach(tip, touch.normal, near + BEYOND)
            if outcome is Ended.CONTACT:
                yield from self._load(touch.normal)
                self._met.append(self._contact)
        except (Overload, Blocked):
            tip.leave()
        yield from self._let_go(touch.normal)
        yield from transit(tip, [Waypoint(out)])
        return Ended.RELEASED

    def _load(self, normal: np.ndarray) -> Procedure:
        """Press along a normal and let go, in one of the two times."""
        tip = self.tip
        self._contact = tip.here.copy()
        outcome = yield from load(tip, normal, self._force, LOAD_TIME)
        way = float((self._contact - tip.here) @ normal)
        yield from unload(tip, normal, way, UNLOAD_TIMES[self._count % 2])
        return outcome

    def _let_go(self, normal: np.ndarray) -> Procedure:
        """Move out along a normal until nothing is touched."""
        self.tip.leave()
        outcome = yield from unload(self.tip, normal, LET_GO, UNLOAD_TIMES[0])
        return outcome

    def _retreat(self) -> Procedure:
        """Leave what was met where nothing was expected: along the force, then away from the sphere."""
        tip = self.tip
        force = tip.seen.force.copy()
        yield from self._let_go(force / max(float(np.linalg.norm(force)), 1e-9))
        away = tip.here - self._centre()
        normal = away / np.linalg.norm(away)
        rotation = tip.seen.pose[:3, :3].copy()
        yield from transit(tip, [Waypoint(self._centre() + self._off(STANDOFF) * normal, rotation=rotation)])
        self._at = SphereTouch(rotation, normal)
        tip.rotation = rotation
        return Ended.NO_CONTACT

    def _press_table(self) -> Procedure:
        """Press on the table at four places around the sphere."""
        tip, centre = self.tip, self._centre()
        options: _Options = self.task.options
        yield from self._leave_upwards()
        high = float(tip.here[2])
        low = options.table + self.task.probe.radius
        radius, gap = self._reach + BESIDE, FAR
        for x, y in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
            above = np.array([centre[0] + radius * x, centre[1] + radius * y, high])
            down = _at(above, low + gap)
            if not self.task.reachable([tip.pose_at(above), tip.pose_at(_at(above, low))]):
                continue
            yield from transit(tip, [Waypoint(above), Waypoint(down)])
            yield from rest(tip, LISTEN)
            outcome = yield from approach(tip, UP, gap + BEYOND)
            if outcome is Ended.CONTACT:
                low, gap = float(tip.here[2]), 2.0 * NEAR
                yield from self._load(UP)
            yield from self._let_go(UP)
            yield from transit(tip, [Waypoint(above)])
        return Ended.RELEASED

    def _leave_upwards(self) -> Procedure:
        """Round to the top of the sphere, then up, held upright."""
        top = SphereTouch(self._upright, UP)
        centre = self._centre()
        way = [
            Waypoint(centre + self._off(STANDOFF) * normal, rotation=rotation)
            for normal, rotation in path_around(self._at.normal, top.normal, self._at.rotation, top.rotation)
        ]
        outcome = yield from transit(self.tip, way)
        self.tip.rotation, self._at = self._upright.copy(), top
        return outcome

    def _off(self, gap: float) -> float:
        """m from the sphere's centre to the tip's, with so much between their surfaces."""
        return self._reach + gap


def _at(place: np.ndarray, height: float) -> np.ndarray:
    return np.array([place[0], place[1], height])


def _pose(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    return pose


def _coordinates(place: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in place) + ")"
