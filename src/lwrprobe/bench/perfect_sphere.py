"""A sphere on its stick that follows surfaces without any error, in no time: for what depends on geometry alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe.scene.solid import Solid

STEP = 0.0005
"""m between the places of the sphere that are kept: what it sweeps between them is not counted."""
CLOSE = 2e-7
"""m, at which the sphere touches."""
UNDERSIDE = -0.05
"""Share of the normal along z, below which a line ends: an upright stick would be in the way."""
APART = 3.0
"""Radii of the stick between the places along it that are looked at."""
MAX_STEPS = 2000
X, Y, Z = 0, 1, 2


@dataclass(slots=True)
class Trail:
    """Where the sphere was and what it touched: centres (n, 3) m, contacts (k, 3) m."""

    centres: np.ndarray
    contacts: np.ndarray


class PerfectSphere:
    """Drives lines and pokes over a solid.

    Parameters
    ----------
    solid : what is touched
    area : of the sphere's centre; nothing is as high as its top
    radius, stick_radius, stick_length : m
    """

    def __init__(self, solid: Solid, area: Area, radius: float, stick_radius: float, stick_length: float) -> None:
        self._solid, self._area, self._radius = solid, area, radius
        # Balls along the stick that hold it, and do not reach beyond the sphere's flank.
        self._along = np.arange(radius, stick_length + APART * stick_radius, APART * stick_radius)
        self._beside = stick_radius * float(np.hypot(1.0, 0.5 * APART))

    def lines(self, axis: int, places: np.ndarray) -> list[Trail]:
        """Lines along an axis (0 or 1) at places (n,) m across it: down in the middle of each, then both ways.

        A line ends at the border of the area, at an underside, and where the stick would touch.
        """
        starts = np.empty((len(places), 2))
        starts[:, 1 - axis], starts[:, axis] = places, 0.5 * (self._area.lower + self._area.upper)[axis]
        begun, here, hit = self._down(starts)
        return [begun, *(self._along_line(here.copy(), hit, axis, sign) for sign in (1.0, -1.0))]

    def pokes(self, places: np.ndarray) -> Trail:
        """Straight down at places (n, 2) m, from the top of the area to what is met or to the floor."""
        return self._down(places)[0]

    def _along_line(self, here: np.ndarray, hit: np.ndarray, axis: int, sign: float) -> Trail:
        """From centres (n, 3), of which those `hit` touch, along an axis in a direction."""
        low, high, count = self._area.lower, self._area.upper, len(here)
        onward = np.zeros(3)
        onward[axis] = sign
        centres, contacts = [], []
        free = ~hit  # in free space, else in contact
        open_ = np.ones(count, bool)
        for _ in range(MAX_STEPS):
            if not open_.any():
                break
            moved = here.copy()
            normals = self._solid.nearest(here[open_]).normals
            tangents = np.tile(onward, (len(normals), 1))
            flat = normals[:, [axis, Z]]
            length = np.hypot(*flat.T)
            contact = ~free[open_]
            flat = flat[contact] / np.maximum(length[contact], 1e-9)[:, None]
            tangents[contact, axis], tangents[contact, Z] = sign * flat[:, 1], -sign * flat[:, 0]
            moved[open_] += STEP * tangents
            touched, good = self._resting(moved, open_, free, axis)
            inside = (moved[:, Z] >= low[Z] - CLOSE) & (moved[:, Z] <= high[Z])
            inside &= (moved[:, axis] >= low[axis] - CLOSE) & (moved[:, axis] <= high[axis] + CLOSE)
            down = ~free & (moved[:, Z] < low[Z])  # at the foot of the far wall: on through free space
            moved[down, Z] = low[Z]
            open_ &= good & (inside | down) & self._upright(moved)
            free = np.where(open_, ~touched | down, free)
            here[open_] = moved[open_]
            centres.append(here[open_])
            hit = open_ & touched & ~down
            contacts.append(self._solid.nearest(here[hit]).points if hit.any() else np.empty((0, 3)))
        swept = np.vstack(centres) if centres else np.empty((0, 3))
        outside = self._solid.signed_distance(swept) >= self._radius - 2.0 * CLOSE
        return Trail(swept[outside], np.vstack(contacts) if contacts else np.empty((0, 3)))

    def _resting(
        self, moved: np.ndarray, open_: np.ndarray, free: np.ndarray, axis: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Moves spheres within their planes onto what they meet, or have left; whether they touch, and rightly."""
        touched, good = np.zeros(len(moved), bool), np.ones(len(moved), bool)
        active = open_.copy()
        for _ in range(12):
            if not active.any():
                return touched, good
            near = self._solid.nearest(moved[active])
            gap, flat = near.distance - self._radius, near.normals[:, [axis, Z]]
            length = np.hypot(*flat.T)
            index = np.flatnonzero(active)
            settled = np.abs(gap) <= CLOSE
            clear = free[index] & (gap > CLOSE) & ~touched[index]
            bad = ~settled & ~clear & ((length < 0.2) | (near.normals[:, Z] < UNDERSIDE))
            touched[index[settled]] = True
            good[index[bad]] = False
            moving = ~(settled | clear | bad)
            shift = np.clip(-gap[moving] / length[moving], -STEP, STEP)[:, None] * (flat[moving].T / length[moving]).T
            moved[np.ix_(index[moving], [axis, Z])] += shift
            touched[index[moving]] |= gap[moving] < 0.0
            active[index[~moving]] = False
        good[active] = False
        return touched, good

    def _down(self, places: np.ndarray) -> tuple[Trail, np.ndarray, np.ndarray]:
        """What pokes sweep and touch, where they end (n, 3) and which of them touch."""
        low, high = self._area.lower, self._area.upper
        here = np.column_stack([places, np.full(len(places), high[Z])])
        centres, falling, hit = [here.copy()], np.ones(len(here), bool), np.zeros(len(here), bool)
        while falling.any():
            index = np.flatnonzero(falling)
            gap = self._solid.signed_distance(here[index]) - self._radius
            here[index, Z] = np.maximum(here[index, Z] - np.clip(gap, 0.0, STEP), low[Z])
            hit[index] = gap <= CLOSE
            falling[index] = ~hit[index] & (here[index, Z] > low[Z])
            centres.append(here[index])
        met = self._solid.nearest(here[hit]).points if hit.any() else np.empty((0, 3))
        return Trail(np.vstack(centres), met), here, hit

    def _upright(self, here: np.ndarray) -> np.ndarray:
        """(n,) bool: an upright stick above the centres (n, 3) touches nothing."""
        points = here[:, None] + self._along[:, None] * np.array([0.0, 0.0, 1.0])
        gap = self._solid.signed_distance(points.reshape(-1, 3)).reshape(points.shape[:2])
        return np.asarray((gap >= self._beside).all(axis=1))
