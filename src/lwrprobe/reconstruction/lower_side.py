"""How a side of the object goes on below the lowest contacts on it: straight down, inwards, or along an even bend."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lwrprobe.reconstruction.touches import Touches

LOOKED_UP = 2.0, 1.5  # of the pitch: so far above its end a side is looked at; the less where it does not bend evenly
SHOWN = 2.0  # radii: over so much of that at least it has been touched
_FEWEST = 4  # contacts that show how a side bends
_EVENLY = 0.1  # rad, root mean square: so far normals lie off an even bend
_STRAY = 0.05  # share of the normals that may be wrong
_SURE = 2.5  # standard deviations from which on a side bends or leans
_CLOSEST = 2.0  # radii of the sphere: what the centres' surface bends around more closely is an edge
LEVEL = 0.9  # -z of the normal that an underside has beside its edge: rows lead down as well
_GROWTH = 0.03  # m of standard deviation a metre below the last contact, of an upright wall as a whole
_APIECE = 0.005  # the same of the wall's places beside each other: what was wrong of it is so everywhere
_GROWTH_BENT = 0.15  # the same of a side that leans or bends, seen on random solids
FINE = 1e-3  # m, steps in which a bend is followed


@dataclass(slots=True, frozen=True)
class LowerSide:
    """The lower end of what was touched of a side, on the centres' surface.

    Attributes
    ----------
    end, normal : (3,) m and unit
    bend : 1/m, how fast the normal turns down, downwards
    seen : m, length over which it was seen
    foot : whether it leads to a foot of which no contact tells
    """

    end: np.ndarray
    normal: np.ndarray
    bend: float
    seen: float
    foot: bool = False

    @property
    def inward(self) -> np.ndarray:
        """(2,) unit, level."""
        return -self.normal[:2] / np.linalg.norm(self.normal[:2])

    @property
    def straight(self) -> bool:
        """Whether it is an upright wall."""
        return self.bend == 0.0 and self.normal[2] == 0.0

    @property
    def growth(self) -> tuple[float, float]:
        """m of standard deviation a metre below the end: of each place, and what all places have in common."""
        if self.foot:
            return _APIECE, _GROWTH_BENT
        return (_APIECE, _GROWTH) if self.straight else (_GROWTH_BENT, 0.0)

    def underside(self, radius: float) -> LowerSide:
        """What leads inwards where the side has an edge at its end, around which the sphere has this radius [m]."""
        normal = np.array([*(-np.sqrt(1.0 - LEVEL**2) * self.inward), -LEVEL])
        return replace(self, end=self.end + radius * (normal - self.normal), normal=normal, bend=0.0)

    def plan_view(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) m each, how far points (n, 3) lie inwards of the end, and aside of that direction."""
        offset = points[:, :2] - self.end[:2]
        return offset @ self.inward, np.abs(offset[:, 0] * self.inward[1] - offset[:, 1] * self.inward[0])

    def below(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, 3) on the side at distances (n,) m below its end, and the normals there.

        A hollow goes on until it stands upright: below that it would have been touched.
        """
        fine = np.arange(0.0, along[-1] + 2.0 * FINE, FINE)
        turn = self.bend * self.seen * (1.0 - np.exp(-fine / self.seen))
        if self.bend < 0.0:
            turn = np.maximum(turn, min(np.arcsin(self.normal[2]), 0.0))
        down = steepest_down(self.normal)
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        course = cosine * down - sine * self.normal
        steps = 0.5 * FINE * (course[1:] + course[:-1])
        places = self.end + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        normals = cosine * self.normal + sine * down
        at = [np.column_stack([np.interp(along, fine, column) for column in rows.T]) for rows in (places, normals)]
        return at[0], at[1] / np.linalg.norm(at[1], axis=1, keepdims=True)


def steepest_down(normal: np.ndarray) -> np.ndarray:
    """(3,) unit, steepest way down on a surface with a normal (3,) that is not upright."""
    down = normal * normal[2] - [0.0, 0.0, 1.0]
    return down / np.linalg.norm(down)


def fitted_side(
    end: np.ndarray, normal: np.ndarray, above: np.ndarray, turn: np.ndarray, touches: Touches, pitch: float
) -> LowerSide | None:
    """The side whose normals `turn` (n,) rad up from `normal` at places (n,) m `above` its end.

    None where too little of it was touched, where it does not bend evenly, or where it is an edge.
    """
    for share in LOOKED_UP:
        rows = above < share * pitch
        if np.count_nonzero(rows) < _FEWEST or above[rows].max() < min(SHOWN * touches.radius, 0.9 * share * pitch):
            continue
        x, y = above[rows], turn[rows]
        bend, start, off = _line(x, y)
        if off < _EVENLY:
            break
    else:
        return None
    noise = max(off, touches.normal_noise) / np.sqrt(len(x))
    if abs(bend) * x.std() < _SURE * noise:
        bend, start = 0.0, float(np.median(y))
    if bend * _CLOSEST * touches.radius > 1.0:
        return None
    facing = np.cos(start) * normal - np.sin(start) * steepest_down(normal)
    if bend <= 0.0 and facing[2] > -_SURE * noise:
        level = facing * [1.0, 1.0, 0.0]
        return LowerSide(end, level / np.linalg.norm(level), 0.0, x.max())
    if bend > 0.0:  # what stands on a table reaches down to it
        bend = min(bend, (1.0 + min(facing[2], 0.0)) / (end[2] - touches.table + touches.radius))
    return LowerSide(end, facing, bend, x.max())


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, value at 0 and root mean square residual of the line through (n,) values that single ones do not sway.

    Theil and Sen: the median of the slopes between all pairs. The residual is that without the share of stray values.
    """
    one, other = np.triu_indices(len(x), 1)
    apart = x[other] - x[one]
    kept = np.abs(apart) > 1e-9
    slope = float(np.median((y[other] - y[one])[kept] / apart[kept])) if kept.any() else 0.0
    start = float(np.median(y - slope * x))
    squares = np.sort((y - start - slope * x) ** 2)
    return slope, start, float(np.sqrt(np.mean(squares[: len(x) - int(_STRAY * len(x))])))
