"""OrientationChange: the probe is turned so that it points at the object (Rau 2017, section 5.3.3, figure 5.12)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError, LinkShape, Observation, Task
from lwrprobe_strategies.contouring import Contouring, ContouringConfig, Y
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.itinerary import ALMOST
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.states import Plane, State

UP = np.array([0.0, 0.0, 1.0])
ABOVE = 0.003
"""m above what makes a probe lean, where it is set upright again."""

SPARE = 0.02
"""m further out, where a leaning probe has to be in reach as well: no contour ends at a stretched elbow."""
STEP = float(np.radians(2.5))
"""rad, between two angles that are tried."""
MORE = float(np.radians(10.0))
"""rad, by which it leans further where leaning has not helped."""
SHELTERED = 0.0015
"""m, beyond the clearance, that the body is kept behind the sphere where it leans."""
MOST_TURNS = 4
"""On one line; what still comes near after as many is given up."""


@dataclass(slots=True, frozen=True)
class OrientationChangeConfig(ContouringConfig):
    """The shared options, and how far the probe is turned.

    Attributes
    ----------
    tilt_deg : degrees out of the vertical by which the stick leans away from the surface at most
    """

    step: float = 0.015
    tilt_deg: float = 40.0

    def __post_init__(self) -> None:
        # dataclass(slots=True) makes a new class, which the bare super() does not know.
        ContouringConfig.__post_init__(self)
        if not 5.0 <= self.tilt_deg <= 80.0:
            raise InputError("strategy.tilt_deg", self.tilt_deg, "5 to 80 degrees")


class OrientationChange(Contouring):
    """A threat in Z_Y turns the probe so that it points at the object, and the contour goes on; in X_Y it goes to Z_Y.

    Departures: the direction of the turn follows from the surface's normal at the contact, where the source chooses
    between two fixed orientations. And where the object may be taller than the stick is long, lines begin at the lowest
    height with the probe leaning back, so that the near side is touched from its foot upwards as well; the source
    drives them above the height at which an upright probe is safe.
    """

    Config: ClassVar[type] = OrientationChangeConfig

    def start(self, task: Task) -> None:
        """Take over in free space."""
        self._leaning_since = -np.inf  # m, the height at which the last threat made it lean
        super().start(task)

    def prepared(self, line: Line, here: np.ndarray) -> tuple[Line, np.ndarray]:
        """From the lowest height and leaning back, away from what may stand ahead, where the arm can do that."""
        self._leaning_since = -np.inf
        if line.on_surface or line.rim or line.raised or line.height <= self.lowest + ALMOST:
            return line, self.upright
        low = replace(line, height=self.lowest)
        back = np.zeros(3)
        back[line.axis] = -line.sign
        if line.axis == Y:
            back = _horizontal(back + self._outward(line.place))
        # On the border it turns where it stands; elsewhere it comes over the top, where nothing is.
        beside = line.axis == Y and abs(here[Y] - line.begin) < 1e-3
        over = np.array([low.start[0], low.start[1], self.task.area.upper[Z]])
        way = [low.start, low.at(0.5 * (low.begin + low.end))]
        rotation = self._leaning(back, [here] if beside else [], way if beside else [over, *way])
        return (line, self.upright) if rotation is None else (low, rotation)

    def _outward(self, x: float) -> np.ndarray:
        """Off the object's end in x, on lines beyond what has been touched: how far it goes on is not known yet."""
        touched = self.touched.table()[:, 0]
        if len(touched) and x > touched.max():
            return np.array([1.0, 0.0, 0.0])
        if len(touched) and x < touched.min():
            return np.array([-1.0, 0.0, 0.0])
        return np.zeros(3)

    def turn_wanted(self, seen: Observation) -> np.ndarray | None:
        """Upright again as soon as that is safe: above where the body is clear, and above what it leaned away from."""
        if self.rotation is self.upright:
            return None
        safe = max(self.itinerary.height, self._leaning_since) + ABOVE
        return self.upright if seen.pose[Z, 3] > safe else None

    def avoid(self, seen: Observation) -> State:
        """In X_Y: change the motion state. In Z_Y: lean away; give the line up where that has not helped."""
        self._aborts += 1
        if self.course.line.rim or self._aborts > MOST_TURNS:
            return self.give_up_line(seen)
        if self.course.plane is Plane.X_Y:
            return self.follow_in(Plane.Z_Y)
        here = seen.pose[:3, 3]
        foot = np.array([here[0], here[1], self.lowest])
        least = self._lean() + MORE if self._aborts > 1 else 0.0
        rotation = self._leaning(self._away(seen), [here], [foot], least)
        if rotation is None or np.abs(rotation - self.rotation).max() < 0.05:
            return self.give_up_line(seen)
        self.rotation, self._leaning_since = rotation, float(here[Z])
        return State.TILT

    def _away(self, seen: Observation) -> np.ndarray:
        """Horizontal: off the surface that is followed and off what comes near."""
        near = seen.clearance
        assert near is not None
        away = _horizontal(near.on_robot - near.on_map)
        if self.state is State.CONTOUR:
            away = away + 2.0 * _horizontal(self.follower.normal)
        else:  # what stands ahead is unknown: keep leaning back from it
            away = away + _horizontal(-self.rotation[:, Z])
        return _horizontal(away)

    def _leaning(
        self, towards: np.ndarray, turn: list[np.ndarray], reach: list[np.ndarray], least: float = 0.0
    ) -> np.ndarray | None:
        """Leaning towards a horizontal direction, no further than is needed: the stick is stiff along its axis.

        So far that the body behind the stick stays behind the sphere, and `least` rad; that it can turn to it at the
        places `turn` without coming near anything, and that the arm reaches there and at the places `reach`. None
        where that cannot be.
        """
        if not towards.any():
            return None
        most = np.radians(self.options.tilt_deg)
        for angle in np.append(np.arange(max(least, STEP), most, STEP), most):
            rotation = turned(UP, towards, angle) @ self.upright
            if angle < most and self._foremost(rotation, -towards) > -SHELTERED:
                continue
            way = [self._at(place, rotation) for place in turn]
            further = [self._at(place + SPARE * towards, rotation) for place in reach]
            if self.task.clear(way) and self.task.reachable([*way, *further]):
                return rotation
        return None

    def _foremost(self, rotation: np.ndarray, direction: np.ndarray) -> float:
        """m, how far the body behind the stick is ahead of the sphere along a direction, a negative number behind."""
        body = [extent(link, rotation, direction) for link in self.task.probe.links if link.name != "stick"]
        return max(body, default=-np.inf) - self.task.probe.radius + self.task.clearance_threshold

    def _lean(self) -> float:
        """rad, between the stick and the upright one."""
        return float(np.arccos(np.clip(self.rotation[:, Z] @ self.upright[:, Z], -1.0, 1.0)))

    @property
    def lowest(self) -> float:
        """m"""
        return float(self.task.area.lower[Z])

    def _at(self, place: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, place
        return pose


def extent(link: LinkShape, rotation: np.ndarray, direction: np.ndarray) -> float:
    """m, how far a link of the probe, held by `rotation` (3, 3), reaches along a unit direction (3,) from the tip."""
    along = direction @ rotation @ link.pose[:3, :3]
    centre = float(direction @ rotation @ link.pose[:3, 3])
    if link.kind == "box":
        return centre + 0.5 * float(np.abs(along) @ np.array(link.size))
    across = float(np.hypot(along[0], along[1]))
    return centre + link.size[0] * across + 0.5 * link.size[1] * abs(float(along[Z]))


def _horizontal(vector: np.ndarray) -> np.ndarray:
    """Unit, zero where the vector is all but vertical."""
    flat = vector - vector[Z] * UP
    size = float(np.sqrt(flat @ flat))
    return flat / size if size > 0.2 * float(np.sqrt(vector @ vector)) and size > 0.0 else np.zeros(3)


def turned(from_axis: np.ndarray, to_axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] that takes `from_axis` towards `to_axis`, both unit and perpendicular."""
    turn = np.outer(to_axis, from_axis) - np.outer(from_axis, to_axis)
    return np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * (turn @ turn)
