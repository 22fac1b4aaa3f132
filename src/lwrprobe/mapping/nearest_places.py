"""Of each point of a grid the nearest of places that become more."""

from __future__ import annotations

import numpy as np

from lwrprobe.mapping.estimate_kernels import lower_to_nearest


class NearestPlaces:
    """The nearest place of each grid point, by distances that may be weighted.

    Parameters
    ----------
    origin, edge : (3,) m of the first grid point, and m between two neighbouring ones
    shape : (nx, ny, nz), grid points along each axis

    Attributes
    ----------
    square : (nx, ny, nz) m^2, squared distance to the nearest place; infinite without places
    owner : (nx, ny, nz) number of that place, in the order in which they were added; -1 without places
    """

    def __init__(self, origin: np.ndarray, edge: float, shape: tuple[int, ...]) -> None:
        self._origin, self._edge = origin, edge
        self.square, self.owner = np.full(shape, np.inf), np.full(shape, -1, np.int64)
        self._count = 0

    def add(self, places: np.ndarray, weights: np.ndarray | None = None) -> None:
        """Add places (n, 3) m.

        `weights` (n, 3) are those of a squared difference in x or y, of one upwards, and of one downwards from each
        place; 1 where they are not given.
        """
        weights = np.ones((len(places), 3)) if weights is None else weights
        lower_to_nearest(self.square, self.owner, self._origin, self._edge, places, weights, self._count)
        self._count += len(places)
