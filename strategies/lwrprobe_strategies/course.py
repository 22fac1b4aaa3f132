"""Where a line leads: the plane of its contour, its end, the way back to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.states import Plane

Z = 2
PULL = 2.0
"""1/s, how fast a probe that was pushed off its line comes back."""
FASTEST_PULL = 0.005
"""m/s"""


@dataclass(slots=True)
class Course:
    """The present line and the plane in which a contact on it is followed.

    Attributes
    ----------
    line : the present line
    plane : vertical through the line, or horizontal
    round : +1 or -1, the sense in which a horizontal contour runs around the object
    level : m, the height of a horizontal contour, None where it may drift
    """

    line: Line
    area: Area
    plane: Plane = Plane.Z_Y
    round: float = 1.0
    level: float | None = None

    def ahead(self) -> np.ndarray:
        """(3,) unit, along the line."""
        ahead = np.zeros(3)
        ahead[self.line.axis] = self.line.sign
        return ahead

    def across(self) -> tuple[float, float, float]:
        """The axis that the contour does not use, signed so that the tangent (normal x across) leads onward."""
        if self.plane is Plane.X_Y:
            return 0.0, 0.0, self.round
        if self.line.axis == 1:
            return self.line.sign, 0.0, 0.0
        return 0.0, -self.line.sign, 0.0

    def upright(self) -> Plane:
        """The vertical plane through the line."""
        return Plane.Z_Y if self.line.axis == 1 else Plane.Z_X

    def past_end(self, place: np.ndarray) -> bool:
        """Whether the line's end has been reached; a horizontal contour may also leave the area on the side."""
        line = self.line
        if self.plane is Plane.X_Y:
            low, high = self.area.lower[line.axis], self.area.upper[line.axis]
            return bool(place[line.axis] >= high - 1e-5 or place[line.axis] <= low + 1e-5)
        return bool((place[line.axis] - line.end) * line.sign >= -1e-5)

    def back(self, place: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(3,) m/s, small pull towards the line within the surface, for a probe that was pushed off it sideways."""
        nx, ny, nz = normal.tolist()
        pull = [0.0, 0.0, 0.0]
        if self.plane is not Plane.X_Y:
            pull[self.line.aside] = _pull(self.line.place - float(place[self.line.aside]))
        elif self.level is not None:
            pull[Z] = _pull(self.level - float(place[Z]))
        out = pull[0] * nx + pull[1] * ny + pull[2] * nz
        return np.array((pull[0] - out * nx, pull[1] - out * ny, pull[2] - out * nz))

    def bounded(self, place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """`velocity` without what leads out of the area in height or across the line."""
        for axis in (self.line.aside, Z):
            here, onward = place.item(axis), velocity.item(axis)
            outward = onward > 0.0 and here >= self.area.upper.item(axis)
            inward = onward < 0.0 and here <= self.area.lower.item(axis)
            if outward or inward:
                velocity[axis] = 0.0
        return velocity


def _pull(off: float) -> float:
    return min(max(PULL * off, -FASTEST_PULL), FASTEST_PULL)
