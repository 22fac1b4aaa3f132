"""OrientationChange: a collision threat turns the probe towards the object (Rau 2017, section 5.3.3, figure 5.12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError, Observation
from lwrprobe_strategies.contouring import Contouring, ContouringConfig
from lwrprobe_strategies.states import Plane, State

UP = np.array([0.0, 0.0, 1.0])


@dataclass(slots=True, frozen=True)
class OrientationChangeConfig(ContouringConfig):
    """The shared options, and how far the probe is turned.

    Attributes
    ----------
    tilt_deg : degrees out of the vertical by which the stick leans away from the surface
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

    Departure: the direction of the turn follows from the surface's normal at the contact; the source chooses between
    two fixed orientations.
    """

    Config: ClassVar[type] = OrientationChangeConfig

    def avoid(self, seen: Observation) -> State:
        """In X_Y: change the motion state. In Z_Y: tilt, or retreat when tilted already."""
        if self.course.line.rim:
            return self.give_up_line(seen)
        if self.course.plane is Plane.X_Y:
            return self.follow_in(Plane.Z_Y)
        away = self.follower.normal - self.follower.normal[2] * UP
        size = float(np.sqrt(away @ away))
        tilted = np.abs(self.rotation - self.upright).max() > 1e-6
        if size < 0.3 or tilted or self.state is State.LINE:
            return self.retreat(seen, self.follower.normal)
        self.rotation = turned(UP, away / size, np.radians(self.options.tilt_deg)) @ self.upright
        return State.TILT

    def _next_line(self, seen: Observation) -> None:
        super()._next_line(seen)
        self.rotation = self.upright


def turned(from_axis: np.ndarray, to_axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] that takes `from_axis` towards `to_axis`, both unit and perpendicular."""
    turn = np.outer(to_axis, from_axis) - np.outer(from_axis, to_axis)
    return np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * (turn @ turn)
