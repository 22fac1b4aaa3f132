"""A height for each square of the plan view, and the largest and least of them in a window."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import hypot

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.mapping import plan_view_kernels as kernels

Window = tuple[int, int, int, int]
"""Squares: the first and the one after the last along x, the same along y; it may reach beyond the last square."""


class PlanView:
    """Heights in the plan view.

    Parameters
    ----------
    shape : number of squares along x and along y
    height : m, of each square at first

    Attributes
    ----------
    heights : (n, m) m; may be written to in place
    """

    __slots__ = ("_bridge", "_lower", "_lowest_facing", "_tallest", "heights")

    def __init__(self, shape: tuple[int, int], height: float) -> None:
        self.heights = np.full(shape, height)
        self._tallest, self._lowest_facing, self._bridge, self._lower = _entries()

    def lower(self, i: int, j: int, around: int, height: float) -> None:
        """Lower a square and so many to all sides of it to a height [m] where they are higher."""
        self._lower(self.heights, i, j, around, height)

    def tallest(self, window: Window) -> float:
        """m, largest height in a window; -inf where that is empty."""
        return float(self._tallest(self.heights, *window))

    def lowest_facing(self, normals: np.ndarray, window: Window, along: tuple[float, float], share: float) -> float:
        """m, least height in a window, of surfaces that face a motion; inf where none does.

        Parameters
        ----------
        normals : (n, m, 2), x and y of each square's unit normal
        along : x and y of the motion's direction
        share : of a normal against the motion's horizontal direction, from which on its surface faces the motion
        """
        normals = np.ascontiguousarray(normals, dtype=np.float64)
        return float(self._lowest_facing(self.heights, normals, *window, *along, -share * hypot(*along)))

    def bridged(self, known: np.ndarray, touched: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """(n, m) m, the heights where they are `known` (n, m), and what is assumed between; elsewhere inf.

        Between two known squares in a row along x or along y that is the tallest height of either and of those beside
        it, across the row, half as far as both are apart. Where one of both is `touched` (n, m) it is taller by what
        may be `hidden` (k,) m between squares that are 0 to k - 1 squares apart; nothing is assumed between others.
        Known squares in between do not matter unless they are touched: the sphere may have passed higher there.
        What is left between known squares and such places, along x or along y, is bridged likewise: the end of a line
        that was given up leaves a hole between its neighbours.
        """
        known, touched = (np.ascontiguousarray(mask, dtype=np.bool_) for mask in (known, touched))
        found = np.where(known, self.heights, np.inf)
        for along_x in (True, False):
            self._bridge(self.heights, known, touched, hidden, along_x, False, found)
        around, known = found.copy(), found < np.inf
        for along_x in (True, False):
            self._bridge(around, known, touched, hidden, along_x, True, found)
        return found


@cache
def _entries() -> tuple[Callable, ...]:
    """Machine code of the kernels, made before the arm moves."""
    plane, normals, window = np.zeros((1, 1)), np.zeros((1, 1, 2)), (0, 0, 0, 0)
    return (
        entry(kernels.tallest, plane, *window),
        entry(kernels.lowest_facing, plane, normals, *window, 0.0, 0.0, 0.0),
        entry(kernels.bridge, plane, plane > 0.0, plane > 0.0, np.zeros(1), True, False, plane),
        entry(kernels.lower, plane, 0, 0, 0, 0.0),
    )
