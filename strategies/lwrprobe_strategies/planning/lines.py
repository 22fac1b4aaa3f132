"""Lines over an exploration area (Rau 2017, sections 4.2.3 and 4.2.4, figure 4.6)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from lwrprobe.contracts import Area, InputError

X, Y, Z = range(3)
"""Indices of the world axes."""
UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
AT_END = 1e-4
"""m, within which a line's end is reached: play and waves of the gears keep the tip from it by half as much."""
NEIGHBOUR = 1.5
"""Line spacings across a line, within which another line is its neighbour."""
ON_LINE = 0.0015
"""m across a line, within which a place is one of it."""
OVERLAP = 0.001
"""m, by which the contours of two lines up one wall overlap."""
ON_FLOOR = 0.003
"""m above the area's floor, up to which a line that begins there counts as one on the floor."""


@dataclass(slots=True, frozen=True)
class Line:
    """One line along a horizontal world axis.

    Attributes
    ----------
    axis : 0 along x, 1 along y
    place : m, on the other horizontal axis
    begin, end : m along `axis`
    height : m, of the sphere's centre at the beginning
    on_surface : the beginning is known to touch; it is approached from above
    free_to : m, height down to which the path to such a beginning is known to be free
    outline : 0, or the sign on the other horizontal axis towards which a contact is followed in the horizontal plane
    fallback : the line to drive where this one has to be given up
    raised : begins above something that the stick has touched
    foot_followed : the wall that it meets has been followed down to its foot already
    low : what is above it was passed before, so it is not raised
    ceiling : m, height above which the surface was touched already
    rotation : (3, 3) in which it is driven, None = upright
    expected : m, height below which its side is expected to recede too far to be touched; None = nothing is known
    survey : driven for what it shows to be free; nothing comes in its place
    free_end : the end lies in free space, from where the line may be driven as well
    """

    axis: int
    place: float
    begin: float
    end: float
    height: float
    _: KW_ONLY
    on_surface: bool = False
    free_to: float = np.inf
    outline: int = 0
    fallback: Line | None = None
    low: bool = False
    survey: bool = False
    free_end: bool = False
    raised: bool = False
    foot_followed: bool = False
    ceiling: float = np.inf
    expected: float | None = None
    rotation: np.ndarray | None = field(default=None, compare=False)

    @property
    def sign(self) -> float:
        """Of the travel along `axis`."""
        return 1.0 if self.end >= self.begin else -1.0

    @property
    def aside(self) -> int:
        """The other horizontal axis."""
        return 1 - self.axis

    @property
    def grid_x(self) -> float:
        """m, x of the line where it is one of the grid, along y; else NaN."""
        return self.place if self.axis == Y else np.nan

    @property
    def ahead(self) -> np.ndarray:
        """(3,) unit, along the line."""
        ahead = np.zeros(3)
        ahead[self.axis] = self.sign
        return ahead

    @property
    def start(self) -> np.ndarray:
        """(3,) m, the sphere's centre at the beginning."""
        return self.at(self.begin)

    def at(self, along: float) -> np.ndarray:
        """(3,) m, at a place along the axis."""
        place = np.array([0.0, 0.0, self.height])
        place[self.axis], place[self.aside] = along, self.place
        return place

    def turned(self) -> Line:
        """The same the other way round."""
        return replace(self, begin=self.end, end=self.begin)


@dataclass(slots=True, frozen=True)
class Grid:
    """Lines along y, in the order in which they are driven.

    Attributes
    ----------
    x : (n,) m, of each line: from the first line to the end of the area in +x, then from the first line's
        neighbour to the end in -x; or in passes, as of `coarse_to_fine`
    second_side : index of the first line of the second side, n where there is none
    """

    x: np.ndarray
    second_side: int

    @classmethod
    def over(cls, area: Area, step: float, first: float | None = None, radius: float = 0.0) -> Grid:
        """Lines that cover `area`; `first` is the x [m] of the first line, the area's lower end when None.

        An end of the area gets a line of its own where the sphere, of `radius` m, does not sweep it from the last one.
        """
        low, high = float(area.lower[0]), float(area.upper[0])
        if not (np.isfinite(step) and step > 0.0):
            raise InputError("strategy.step", step, "a positive length in metres")
        first = low if first is None else min(max(first, low), high)
        up = cls._towards(first, high, step, radius)
        down = cls._towards(first, low, step, radius)[1:]
        return cls(np.array(up + down), len(up))

    @staticmethod
    def _towards(first: float, end: float, step: float, radius: float) -> list[float]:
        sign = 1.0 if end >= first else -1.0
        count = int(abs(end - first) / step + 1e-9)
        lines = [first + sign * i * step for i in range(count + 1)]
        if abs(end - lines[-1]) > radius + 1e-9:
            lines.append(end)
        return lines

    def coarse_to_fine(self) -> Grid:
        """The same lines in three passes: every fourth, from the middle outwards; those half way between; the rest."""
        x, numbers = np.sort(self.x), np.arange(len(self))
        off = np.abs(numbers - len(self) // 2)
        first = numbers[off % 4 == 0]
        order = [first[np.argsort(off[first], kind="stable")], numbers[off % 4 == 2], numbers[off % 2 == 1]]
        return Grid(x[np.concatenate(order)], len(self))

    def __len__(self) -> int:
        return len(self.x)
