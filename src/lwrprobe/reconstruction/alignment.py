"""Rigid alignment by least squares, point to plane (Chen, Medioni 1991), with outliers weighed down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

_CONVERGED = 1e-8  # m and rad, a smaller step is none
_MIN_PAIRS = 6


@dataclass(slots=True, frozen=True)
class RigidMotion:
    """p -> rotation (3, 3) @ p + translation (3,) m."""

    rotation: np.ndarray
    translation: np.ndarray

    @property
    def angle(self) -> float:
        """rad, of the whole rotation."""
        return float(np.arccos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0)))

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) m moved."""
        return points @ self.rotation.T + self.translation

    def directions(self, directions: np.ndarray) -> np.ndarray:
        """Directions (n, 3) turned."""
        return directions @ self.rotation.T


STILL = RigidMotion(np.eye(3), np.zeros(3))


@dataclass(slots=True, frozen=True)
class Pairs:
    """Which of the moving points have a partner (m,), how far they are apart along the partner's normal (m,) m, and
    that normal (m, 3)."""

    who: np.ndarray
    apart: np.ndarray
    normal: np.ndarray

    @property
    def median(self) -> float:
        """m, of the absolute distances."""
        return float(np.median(np.abs(self.apart))) if len(self.apart) else np.inf


class Target(Protocol):
    """What stays where it is."""

    def pair(self, points: np.ndarray, normals: np.ndarray) -> Pairs:
        """Partners of points (n, 3) m with normals (n, 3)."""
        ...


@dataclass(slots=True, frozen=True)
class Alignment:
    """Points (n, 3) m with normals (n, 3) to be laid over a target; motions here are about the points' middle.

    Attributes
    ----------
    weigh : weights (m,) of the pairs
    free : which of shift x, y, z and turn about x, y, z may change
    open_share : a direction determined less than this share of the best determined one keeps its value
    """

    target: Target
    points: np.ndarray
    normals: np.ndarray
    weigh: Callable[[Pairs], np.ndarray]
    open_share: float
    free: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """(3,) m."""
        return self.points.mean(axis=0)

    def pairs(self, motion: RigidMotion) -> Pairs:
        """Partners of the moved points."""
        lever = motion.directions(self.points - self.middle)
        return self.target.pair(self.middle + lever + motion.translation, motion.directions(self.normals))

    def about_origin(self, motion: RigidMotion) -> RigidMotion:
        """The same motion about the origin of the points' frame."""
        return RigidMotion(motion.rotation, self.middle + motion.translation - motion.rotation @ self.middle)

    def descend(self, motion: RigidMotion, rounds: int) -> RigidMotion:
        """Gauss-Newton steps until they are too small to count."""
        for _ in range(rounds):
            step, *_ = self._step(motion)
            motion = RigidMotion(step.rotation @ motion.rotation, step.points(motion.translation))
            if np.abs(step.translation).max() < _CONVERGED and np.abs(step.rotation - np.eye(3)).max() < _CONVERGED:
                break
        return motion

    def without_open(self, motion: RigidMotion) -> tuple[RigidMotion, np.ndarray]:
        """A small motion without its part along the open directions, and those (k, 6): there is no reason for it."""
        from scipy.spatial.transform import Rotation

        _, unknown, size = self._step(motion)
        if len(unknown) == 0:
            return motion, unknown
        parts = np.concatenate([motion.translation, size * Rotation.from_matrix(motion.rotation).as_rotvec()])
        parts -= unknown.T @ (unknown @ parts)
        return RigidMotion(_turn(parts[3:] / size), parts[:3]), unknown

    def _step(self, motion: RigidMotion) -> tuple[RigidMotion, np.ndarray, float]:
        """One step; the directions (k, 6) that stay open, of shift and turn times size; and that size [m]."""
        pairs = self.pairs(motion)
        if len(pairs.who) < _MIN_PAIRS:
            return STILL, np.eye(6)[self.free], 1.0
        lever = motion.directions(self.points - self.middle)[pairs.who] + motion.translation
        size = float(np.sqrt((lever**2).sum(axis=1).mean()))
        rows = np.hstack([pairs.normal, np.cross(lever, pairs.normal) / size])[:, self.free]
        weight = self.weigh(pairs)
        _, singular, directions = np.linalg.svd(weight[:, None] * rows, full_matrices=False)
        known = singular > self.open_share * singular[0]
        right = rows.T @ (-(weight**2) * pairs.apart)
        parts = np.zeros(6)
        parts[self.free] = directions[known].T @ (
            (directions[known] @ right) / np.maximum(singular[known], 1e-300) ** 2
        )
        unknown = np.zeros(((~known).sum(), 6))
        unknown[:, self.free] = directions[~known]
        return RigidMotion(_turn(parts[3:] / size), parts[:3]), unknown, size


def _turn(vector: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()
