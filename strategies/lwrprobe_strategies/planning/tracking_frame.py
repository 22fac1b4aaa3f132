"""The frame in which a contour is followed: its plane, the direction onward, where it ends."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import nan, sqrt

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.lines import AT_END, Line, X, Y, Z

GAIN = 2.0
"""1/s, of the return of a probe that was pushed off its line."""
MAX_RETURN, BESIDE_SLIDING = 0.005, 0.5
"""m/s of that return, and its share of the sliding speed, at most. Else the return would press into the surface where
the force law slides slowly: a force may be near, or the normal is uncertain."""
AT_TABLE = 1e-5
"""m above the area's floor, within which the table height is reached."""

Vector = tuple[float, float, float]


@dataclass(slots=True, frozen=True)
class TrackingFrame:
    """A line, and the plane in which a contact on it is followed; at first the vertical plane through the line.

    Attributes
    ----------
    line : the line
    area : in which the tip has to stay
    level : the plane is horizontal
    backward : a contour in the upright plane leads against the line, down what stands ahead
    sense : +1 or -1, the sense in which a horizontal contour runs around the object
    height : m, of a horizontal contour, None where it may drift
    binormal : unit normal of the plane, signed so that the tangent (contact normal x binormal) leads onward
    grid_x : m, x of the grid line on which a contact lies; NaN off the grid
    """

    line: Line
    area: Area
    level: bool = False
    sense: float = 1.0
    height: float | None = None
    backward: bool = False
    binormal: Vector = field(init=False)
    grid_x: float = field(init=False)
    _low: list[float] = field(init=False, repr=False, compare=False)
    _high: list[float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        sign = -self.line.sign if self.backward else self.line.sign
        upright = (sign, 0.0, 0.0) if self.line.axis == Y else (0.0, -sign, 0.0)
        object.__setattr__(self, "binormal", (0.0, 0.0, self.sense) if self.level else upright)
        object.__setattr__(self, "grid_x", nan if self.level else self.line.grid_x)
        # Asked for with every sample.
        object.__setattr__(self, "_low", self.area.lower.tolist())
        object.__setattr__(self, "_high", self.area.upper.tolist())

    @classmethod
    def around(cls, area: Area, sense: float, height: float | None = None) -> TrackingFrame:
        """A horizontal plane around an object; ends where the area ends in y."""
        line = Line(Y, 0.0, float(area.lower[Y]), float(area.upper[Y]), float(area.lower[Z]))
        return cls(line, area, True, sense, height)

    @classmethod
    def through(cls, place: np.ndarray, axis: int, sign: float, area: Area) -> TrackingFrame:
        """The upright plane along a horizontal axis through a place (3,) m, towards the area's border."""
        end = float((area.upper if sign > 0.0 else area.lower)[axis])
        return cls(Line(axis, float(place[1 - axis]), float(place[axis]), end, float(place[Z])), area)

    def upright(self) -> TrackingFrame:
        """The vertical plane through the same line, and onward."""
        return replace(self, level=False, backward=False)

    def back_down(self) -> TrackingFrame:
        """The vertical plane through the same line, down what stands ahead."""
        return replace(self, level=False, backward=True)

    def horizontal(self, sense: float, height: float | None = None) -> TrackingFrame:
        """A horizontal plane."""
        return replace(self, level=True, sense=sense, height=height, backward=False)

    def past_end(self, place: np.ndarray) -> bool:
        """Whether the line's end is reached at a place (3,), backward its beginning.

        A horizontal contour ends at the area's border.
        """
        line, here = self.line, place.item(self.line.axis)
        if self.level:
            return here >= self._high[line.axis] - AT_END or here <= self._low[line.axis] + AT_END
        if self.backward:
            return (line.begin - here) * line.sign >= -AT_END
        return (here - line.end) * line.sign >= -AT_END

    def at_floor(self, place: np.ndarray) -> bool:
        """Whether a place (3,) is as low as the tip may be."""
        return place.item(Z) <= self._low[Z] + AT_TABLE

    def at_ceiling(self, place: np.ndarray) -> bool:
        """Whether a place (3,) is as high as the tip may be."""
        return place.item(Z) >= self._high[Z]

    def guided(self, place: np.ndarray, velocity: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """`velocity` (3,) m/s, with the return to the plane of a probe at `place` (3,) that was pushed off it; bounded.

        The return is along the surface with this `normal` (3,).
        """
        if self.level and self.height is None:
            return self.bounded(place, velocity)
        (vx, vy, vz), (nx, ny, nz), here = velocity.tolist(), normal.tolist(), place.tolist()
        axis, wanted = (Z, self.height) if self.level else (self.line.aside, self.line.place)
        assert wanted is not None
        press = vx * nx + vy * ny + vz * nz
        slide = sqrt(max(vx * vx + vy * vy + vz * vz - press * press, 0.0))
        most = min(MAX_RETURN, BESIDE_SLIDING * slide)
        pull = min(max(GAIN * (wanted - here[axis]), -most), most)
        out = pull * (nx, ny, nz)[axis]
        back = [-out * nx, -out * ny, -out * nz]
        back[axis] += pull
        return self.bounded(place, np.array((vx + back[X], vy + back[Y], vz + back[Z])))

    def bounded(self, place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """`velocity` (3,) without what leads out of the area; changed in place. Past the end of a line a skill ends."""
        (x, y, z), low, high = place.tolist(), self._low, self._high
        if low[X] < x < high[X] and low[Y] < y < high[Y] and low[Z] < z < high[Z]:
            return velocity  # as with nearly every sample
        for axis, here in enumerate((x, y, z)):
            onward = velocity.item(axis)
            if (onward > 0.0 and here >= high[axis]) or (onward < 0.0 and here <= low[axis]):
                velocity[axis] = 0.0
        return velocity
