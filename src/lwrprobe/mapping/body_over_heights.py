"""A rigid body above heights in the plan view: how deep it is in them, and where it has been."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts.samples import Vector
from lwrprobe.kinematics import straight_line
from lwrprobe.mapping import plan_view_kernels as kernels

STEP, TURN = 0.001, 0.05
"""m and rad between two poses of a motion that are looked at."""


class BodyOverHeights:
    """Surface points of a rigid body that moves with the tip, over a height for each square of the plan view.

    Poses are (4, 4) of the tip in the world frame. Orientations whose matrices differ by less than 0.001 count as one.

    Parameters
    ----------
    points : (k, 3) m, on the body's surface, in the tip's frame
    low : (2,) m, the middle of the first square
    cell : m, edge of a square
    heights : (n, m) m, of what may be there, below `top`; also beyond the border as on it
    top : m, above which there is nothing

    Attributes
    ----------
    lowest : (n, m) m, the least height at which the body has been, below `top` and not on the border; else inf
    """

    def __init__(self, points: np.ndarray, low: np.ndarray, cell: float, heights: np.ndarray, top: float) -> None:
        self._points, self._turned = points, np.ascontiguousarray(points, dtype=np.float64)
        self._state = np.zeros(kernels.SIZE)
        self._state[[kernels.LOW_X, kernels.LOW_Y, kernels.CELL, kernels.TOP]] = *low, cell, top
        self.lowest = np.full(heights.shape, np.inf)
        self.heights = heights
        self._held, self._enter, self._depth, self._clears, self._lower = _entries()
        self._turn(np.eye(3))

    @property
    def heights(self) -> np.ndarray:
        """(n, m) m, of what may be there; replaced, never written to."""
        return self._heights

    @heights.setter
    def heights(self, heights: np.ndarray) -> None:
        self._heights = np.ascontiguousarray(heights, dtype=np.float64)
        self._state[kernels.BOX_TALLEST] = np.inf

    def raise_top(self, top: float) -> None:
        """There may be something up to `top` m from now on; the heights are to be replaced."""
        self._state[[kernels.TOP, kernels.BOX_TALLEST]] = top, np.inf

    def note(self, pose: np.ndarray) -> bool:
        """The body is there itself; whether that has lowered anything since it was last noted."""
        pose = _as_array(pose)
        found = self._enter(self._state, self._turned, self.lowest, pose)
        if found == kernels.OTHERWISE:
            self._turn(pose[:3, :3])
            found = self._enter(self._state, self._turned, self.lowest, pose)
        return bool(found == kernels.YES)

    def lower(self, heights: np.ndarray, around: int, above: float) -> None:
        """Lower heights (n, m) in place to `above` m over where the body has been, in so many squares around it."""
        self._lower(self.lowest, around, above, heights)

    def clears(self, begin: np.ndarray, turned: np.ndarray, shift: Vector) -> bool:
        """Whether it is plain that the body stays above all that may be there while the tip goes by `shift` (3,) m.

        The motion ends in the orientation of the pose `turned`. False decides nothing: `depth_on_path` does.
        """
        begin, turned, shift = _as_array(begin), _as_array(turned), _as_array(shift)
        found = self._clears(self._state, self._heights, begin, turned, shift)
        if found == kernels.OTHERWISE:
            self._turn(begin[:3, :3])
            found = self._clears(self._state, self._heights, begin, turned, shift)
        return bool(found == kernels.YES)

    def depth(self, poses: np.ndarray) -> np.ndarray:
        """(n,) m, how far the body below `top` is at poses (n, 4, 4) in what may be there; negative above it."""
        depths = np.empty(len(poses))
        for k, pose in enumerate(np.ascontiguousarray(poses, dtype=np.float64)):
            if not self._held(self._state, pose):
                self._turn(pose[:3, :3])
            depths[k] = self._depth(self._state, self._turned, self._heights, pose[0, 3], pose[1, 3], pose[2, 3])
        return depths

    def depth_on_path(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(n,) m, as `depth`, from one pose straight to another, both included."""
        return self.depth(straight_line(begin, end, STEP, TURN))

    def _turn(self, rotation: np.ndarray) -> None:
        state, self._turned = self._state, np.ascontiguousarray(self._points @ rotation.T)
        state[kernels.ROTATION : kernels.ROTATION + 9] = rotation.ravel()
        low, high = self._turned.min(axis=0, initial=np.inf), self._turned.max(axis=0, initial=-np.inf)
        state[kernels.LOWEST] = low[2]
        state[[kernels.LEFT, kernels.RIGHT, kernels.FRONT, kernels.BACK]] = low[0], high[0], low[1], high[1]
        state[kernels.BOX_TALLEST] = np.inf


def _as_array(given: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(given, dtype=np.float64)


@cache
def _entries() -> tuple[Callable, ...]:
    """Machine code of the kernels, made before the arm moves."""
    state, plane, pose, vector = np.zeros(kernels.SIZE), np.zeros((1, 1)), np.zeros((4, 4)), np.zeros(3)
    return (
        entry(kernels.held, state, pose),
        entry(kernels.enter, state, plane, plane, pose),
        entry(kernels.depth, state, plane, plane, 0.0, 0.0, 0.0),
        entry(kernels.clears, state, plane, pose, pose, vector),
        entry(kernels.lower_around, plane, 0, 0.0, plane),
    )
