"""A regular grid of nodes in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.reconstruction.distance_kernels import scatter

MAX_NODES = 3_000_000


def affordable(lower: np.ndarray, upper: np.ndarray, step: float) -> float:
    """m: `step`, or more where a grid from `lower` to `upper` (3,) m would have more than `MAX_NODES` nodes."""
    return max(step, float(np.cbrt(np.prod(upper - lower + 8.0 * step) / MAX_NODES)))


@dataclass(slots=True, frozen=True)
class Grid:
    """Node (i, j, k) lies at `origin` + `step` * (i, j, k); `shape` counts the nodes of each axis."""

    origin: np.ndarray
    step: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, lower: np.ndarray, upper: np.ndarray, step: float) -> Grid:
        """The smallest grid whose nodes reach from `lower` to `upper` (3,) m."""
        nx, ny, nz = (np.ceil((np.asarray(upper) - lower) / step).astype(int) + 1).tolist()
        return cls(np.array(lower, dtype=np.float64), step, (nx, ny, nz))

    def nodes(self) -> np.ndarray:
        """All nodes, (nx, ny, nz, 3) m."""
        axes = [self.origin[m] + self.step * np.arange(self.shape[m]) for m in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def nearest(self, points: np.ndarray, radius: float) -> np.ndarray:
        """(nx, ny, nz) number of the nearest of points (n, 3) to each node, -1 where none is within `radius` m."""
        found = np.full(self.shape, -1, dtype=np.int64)
        scatter(points, self.origin, self.step, radius, np.full(self.shape, radius * radius), found)
        return found
