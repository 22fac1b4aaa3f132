"""A signed distance field from points with normals: local Gaussian processes, blended.

Macedo, Gois, Velho, Hermite radial basis functions implicits (2011), in the reading of Gaussian processes, so that
noise has its place: one process for each cube of space near data, over the points of the cube and its surroundings,
joined by a partition of unity (Ohtake et al. 2003). The cost grows linearly with the number of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.hermite_kernels import add_block, deviations, fit, value_at

_NEAREST = 12
"""Data that a deviation is taken from."""

_AROUND_PLACE = 24
"""Data that a single value is taken from: those of both lines beside it."""

_AROUND = np.array(list(product((-1, 0, 1), repeat=3)))


@dataclass(slots=True)
class HermiteData:
    """Where the field is zero, and its gradient there.

    Attributes
    ----------
    points, normals : (n, 3) m and unit
    value_sd : (n,) m, standard deviation of the zero
    normal_sd : (n,) rad, standard deviation of the normal
    """

    points: np.ndarray
    normals: np.ndarray
    value_sd: np.ndarray
    normal_sd: np.ndarray

    def __add__(self, other: HermiteData) -> HermiteData:
        names = ("points", "normals", "value_sd", "normal_sd")
        return HermiteData(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


@dataclass(slots=True)
class HermiteField:
    """Blended local processes with correlation length `reach` [m]; cubes have an edge of two thirds of it."""

    data: HermiteData
    reach: float

    @property
    def edge(self) -> float:
        """m, of the cubes."""
        return self.reach * 2.0 / 3.0

    @property
    def variance(self) -> float:
        """m^2, of the field before it has seen any data."""
        return self.reach**2 / 9.0

    def values(
        self, grid: Grid, wanted: np.ndarray, progress: Callable[[float], None] = lambda share: None
    ) -> np.ndarray:
        """Field at the grid's nodes marked in `wanted` (nx, ny, nz), NaN elsewhere and where no data is near."""
        total, share = np.zeros(grid.shape), np.zeros(grid.shape)
        scales = np.array([self.reach, self.variance, self.edge / 2.0, self.edge / 5.0])
        centres, members = self._blocks(grid, wanted)
        for b, (centre, rows) in enumerate(zip(centres, members)):
            points, weights = self._fit(np.array(rows))
            add_block(points, weights, scales, centre, grid.origin, grid.step, wanted, total, share)
            if b % 64 == 0:
                progress(b / len(centres))
        with np.errstate(invalid="ignore", divide="ignore"):
            return total / share

    def values_near(self, middles: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(m, k) m: the field at places (m, k, 3), each row from the data nearest to its middle (m, 3)."""
        from scipy.spatial import cKDTree

        count = min(_AROUND_PLACE, len(self.data.points))
        near = cKDTree(self.data.points).query(middles, k=np.arange(1, count + 1))[1]
        out = np.empty(places.shape[:2])
        for m, members in enumerate(near):
            points, weights = self._fit(members)
            out[m] = [value_at(points, weights, self.reach, self.variance, *place) for place in places[m]]
        return out

    def deviations(self, places: np.ndarray) -> np.ndarray:
        """Standard deviation [m] of the field at places (m, 3), from the nearest data: farther ones add nothing."""
        from scipy.spatial import cKDTree

        tree = cKDTree(self.data.points)
        _, near = tree.query(places, k=_NEAREST, distance_upper_bound=self.reach)
        out = np.empty(len(places))
        variances = self.data.value_sd**2, self.data.normal_sd**2
        if not deviations(self.data.points, *variances, near, self.reach, self.variance, places, out):
            raise ArithmeticError("covariance is not positive definite")
        return out

    def _blocks(self, grid: Grid, wanted: np.ndarray) -> tuple[np.ndarray, Any]:
        """Centres of the cubes with a wanted node, and the data in and around each."""
        from scipy.spatial import cKDTree

        cubes = np.unique(np.floor(self.data.points / self.edge).astype(np.int64), axis=0)
        cubes = np.unique((cubes[:, None] + _AROUND).reshape(-1, 3), axis=0)
        centres = (cubes + 0.5) * self.edge
        reach = 0.7 * self.edge  # half a cube and its overlap
        first = np.maximum(np.ceil((centres - reach - grid.origin) / grid.step).astype(int), 0)
        last = np.floor((centres + reach - grid.origin) / grid.step).astype(int) + 1
        busy = [
            wanted[a[0] : max(b[0], 0), a[1] : max(b[1], 0), a[2] : max(b[2], 0)].any() for a, b in zip(first, last)
        ]
        centres = centres[busy]
        members = cKDTree(self.data.points).query_ball_point(centres, 1.2 * self.edge, p=np.inf, return_sorted=True)
        held = np.array([len(rows) > 0 for rows in members], dtype=bool)
        return centres[held], members[held]

    def _fit(self, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        data, size = self.data, 4 * len(members)
        points, factor, weights = data.points[members], np.empty((size, size)), np.empty(size)
        variances = data.value_sd[members] ** 2, data.normal_sd[members] ** 2
        # With noise on the diagonal the covariance is positive definite; rounding cannot break it at these sizes.
        if not fit(points, data.normals[members], *variances, self.reach, self.variance, factor, weights):
            raise ArithmeticError("covariance is not positive definite")
        return points, weights
