"""A path of the probe: its waypoints, and how fast each piece of it may be driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from math import cos, inf, sqrt

import numpy as np

from lwrprobe_strategies.planning.lines import DOWN

THERE = 2e-4
"""m, within which a place is reached."""
HELD = 1.0 + 2.0 * cos(0.02)
"""Trace of the turn between two orientations that are alike to a degree."""
OFF = 0.002
"""m off a surface, where it has been left."""
STOP = 0.15
"""s, that a stop between two pieces of a path costs: braking and accelerating at the limits."""


class SpeedLimit(Enum):
    """How fast a piece of a path may be driven."""

    FREE = auto()
    """Nothing is there: the part of the probe that moves there has been there, or it lies above all that may be."""
    COLUMN = auto()
    """The stick has been there, and the sphere may meet something with its flank."""
    KNOWN = auto()
    """Neighbouring lines have shown that all of the probe fits: nothing is expected."""
    GUARDED = auto()
    """Something may be there: as slow as the stiffness in that direction demands."""
    LEVEL = auto()
    """As GUARDED, and no faster than all of the stick may meet something unexpected."""


@dataclass(slots=True, frozen=True)
class Speeds:
    """How fast a motion may be.

    Attributes
    ----------
    free : m/s, where nothing is
    column : m/s along the stick, where the stick has been and the sphere has not
    guarded : m/s at which something may be met, from a unit direction (3,)
    level : m/s across the stick, at which all of it may meet something unexpected
    known : m/s, where all of the probe is known to fit
    """

    free: float
    column: float
    guarded: Callable[[np.ndarray], float]
    level: float = inf
    known: float = inf

    def at(self, speed_limit: SpeedLimit, along: np.ndarray) -> float:
        """m/s along a unit direction (3,)."""
        if speed_limit is SpeedLimit.FREE:
            return self.free
        if speed_limit is SpeedLimit.COLUMN:
            return self.column
        if speed_limit is SpeedLimit.KNOWN:
            return min(self.known, self.free)
        return min(self.guarded(along), self.level if speed_limit is SpeedLimit.LEVEL else inf)


@dataclass(slots=True)
class Waypoint:
    """Go there on a straight line.

    Attributes
    ----------
    place : (3,) m, of the sphere's centre
    speed_limit : how fast
    rotation : (3, 3) of the tip to turn to meanwhile, None = as it is
    """

    place: np.ndarray
    speed_limit: SpeedLimit = SpeedLimit.FREE
    rotation: np.ndarray | None = None

    def reached(self, pose: np.ndarray) -> bool:
        """Whether the tip's pose (4, 4) is there."""
        return self.is_at(pose[:3, 3]) and (self.rotation is None or held(pose, self.rotation))

    def is_at(self, here: np.ndarray) -> bool:
        """Whether it is at a place (3,): all that is left is to turn."""
        (x, y, z), (tx, ty, tz) = here.tolist(), self.place.tolist()
        return abs(x - tx) < THERE and abs(y - ty) < THERE and abs(z - tz) < THERE


def tip_pose(place: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """(4, 4), the tip's pose with the sphere's centre at a place (3,) m, held by `rotation` (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    return pose


def held(pose: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether the orientation of a pose (4, 4) is the wanted one (3, 3)."""
    return bool(np.vdot(rotation, pose[:3, :3]) > HELD)


def seconds(path: list[Waypoint], here: np.ndarray, speeds: Speeds) -> float:
    """How long a path from `here` (3,) takes."""
    time = 0.0
    for waypoint in path:
        step = waypoint.place - here
        length = float(np.sqrt(step @ step))
        if length > THERE:
            time += length / speeds.at(waypoint.speed_limit, step / length) + STOP
        here = waypoint.place
    return time


def direction(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(3,) unit, from one place (3,) to another; downwards where they are the same."""
    motion = there - here
    size = sqrt(motion.dot(motion))
    return motion / size if size > 1e-9 else DOWN
