"""What a sphere has swept, as heights in the plan view: from where on up nothing is, as far as it shows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.mapping import plan_view_kernels as kernels


class SweptColumns:
    """Spans of height in the plan view that a sphere has swept; of each square the upper two.

    Parameters
    ----------
    shape : number of squares along x and along y
    half : (2 k + 1, 2 k + 1) m, half of the height of the sphere in the squares around its centre; none where <= 0
    """

    __slots__ = ("_half", "_spans", "_sweep")

    def __init__(self, shape: tuple[int, int], half: np.ndarray) -> None:
        self._half = np.ascontiguousarray(half, dtype=np.float64)
        self._spans = np.empty((*shape, 2, 2))
        self._spans[..., 0], self._spans[..., 1] = np.inf, -np.inf
        self._sweep = _entry()

    def note(self, i: int, j: int, height: float) -> None:
        """The sphere's centre is at a height [m] in a square, which may lie outside."""
        self._sweep(self._spans, i, j, self._half, height)

    def free_from(self, above: np.ndarray) -> np.ndarray:
        """(n, m) m, from where on nothing is, if from heights `above` (n, m) m on nothing is."""
        found = above
        for span in (0, 1):
            low, high = self._spans[..., span, 0], self._spans[..., span, 1]
            found = np.where(high >= found, np.minimum(low, found), found)
        return found


@cache
def _entry() -> Callable:
    """Machine code of the kernel, made before the arm moves."""
    return entry(kernels.sweep, np.zeros((1, 1, 2, 2)), 0, 0, np.zeros((1, 1)), 0.0)
