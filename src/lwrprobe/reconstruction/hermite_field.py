"""A signed distance field from points with normals: local Gaussian processes, blended.

Macedo, Gois, Velho, Hermite radial basis functions implicits (2011), in the reading of Gaussian processes, so that
noise has its place: one process for each cube of space near data, over the points of the cube and its surroundings,
joined by a partition of unity (Ohtake et al. 2003). The cost grows linearly with the number of points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.hermite_kernels import add_block, deviations, fit

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
    _cubes: dict[tuple[int, int, int], np.ndarray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._cubes = _groups(np.floor(self.data.points / self.edge).astype(np.int64))

    @property
    def edge(self) -> float:
        """m, of the cubes."""
        return self.reach * 2.0 / 3.0

    @property
    def variance(self) -> float:
        """m^2, of the field before it has seen any data."""
        return self.reach**2 / 9.0

    def values(self, grid: Grid, wanted: np.ndarray) -> np.ndarray:
        """Field at the grid's nodes marked in `wanted` (nx, ny, nz), NaN elsewhere and where no data is near."""
        total, share = np.zeros(grid.shape), np.zeros(grid.shape)
        scales = np.array([self.reach, self.variance, self.edge / 2.0, self.edge / 5.0])
        for cube, members in self._blocks():
            points, _, weights = self._fit(members)
            centre = (np.array(cube) + 0.5) * self.edge
            add_block(points, weights, scales, centre, grid.origin, grid.step, wanted, total, share)
        with np.errstate(invalid="ignore", divide="ignore"):
            return total / share

    def deviations(self, places: np.ndarray) -> np.ndarray:
        """Standard deviation [m] of the field at places (m, 3)."""
        out = np.full(len(places), np.sqrt(self.variance))
        groups = _groups(np.floor(places / self.edge).astype(np.int64))
        for cube, members in self._blocks():
            here = groups.get(cube)
            if here is not None:
                points, factor, _ = self._fit(members)
                some = np.empty(len(here))
                deviations(points, factor, self.reach, self.variance, places[here], some)
                out[here] = some
        return out

    def _blocks(self) -> Iterator[tuple[tuple[int, int, int], np.ndarray]]:
        """Cubes that hold data or touch one that does, each with the points in it and around it."""
        active = np.unique((np.array(list(self._cubes))[:, None] + _AROUND).reshape(-1, 3), axis=0)
        for cube in active:
            near = [self._cubes[key] for key in map(tuple, (cube + _AROUND).tolist()) if key in self._cubes]
            members = np.sort(np.concatenate(near))
            apart = np.abs(self.data.points[members] - (cube + 0.5) * self.edge).max(axis=1)
            members = members[apart <= 1.2 * self.edge]
            if len(members):
                yield tuple(cube.tolist()), members

    def _fit(self, members: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        data, size = self.data, 4 * len(members)
        points, factor, weights = data.points[members], np.empty((size, size)), np.empty(size)
        variances = data.value_sd[members] ** 2, data.normal_sd[members] ** 2
        # With noise on the diagonal the covariance is positive definite; rounding cannot break it at these sizes.
        if not fit(points, data.normals[members], *variances, self.reach, self.variance, factor, weights):
            raise ArithmeticError("covariance is not positive definite")
        return points, factor, weights


def _groups(keys: np.ndarray) -> dict[tuple[int, int, int], np.ndarray]:
    """Row numbers of equal rows of (n, 3) integer keys."""
    if len(keys) == 0:
        return {}
    order = np.lexsort(keys.T)
    ordered = keys[order]
    cuts = np.flatnonzero(np.any(np.diff(ordered, axis=0) != 0, axis=1)) + 1
    return {tuple(ordered[rows[0]].tolist()): order[rows] for rows in np.split(np.arange(len(keys)), cuts)}
