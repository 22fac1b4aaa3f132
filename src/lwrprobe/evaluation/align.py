"""A rigid motion that lays one shape over the true one, for meshes and clouds from another frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.scene.solid import Solid

_SAMPLE = 1500
_ROUNDS = 60
_DONE = 1e-9  # m and rad, a smaller step is none
_NEAR = 5e-3  # m; shapes that lie so close already are not turned about


@dataclass(slots=True, frozen=True)
class Alignment:
    """p -> rotation @ p + translation; `rms` m of the points against the true surface, before and after."""

    rotation: np.ndarray
    translation: np.ndarray
    before: float
    after: float

    def move(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) m moved."""
        return points @ self.rotation.T + self.translation

    @property
    def angle(self) -> float:
        """rad, of the whole rotation."""
        return float(np.arccos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0)))


def align(points: np.ndarray, solid: Solid) -> Alignment:
    """The motion that brings points (n, 3) m of a surface onto the true one, in least squares with outliers damped.

    Point to plane (Chen, Medioni 1991) with Huber weights. Points that lie near already are moved from where they are;
    others start with their middle on the solid's, at four turns about z, and the best end wins. Raises InputError for
    fewer than 6 points or an empty solid.
    """
    if len(points) < 6 or solid.empty:
        raise InputError("align", f"{len(points)} points", "at least 6 points and a true shape")
    sample = points[:: max(1, len(points) // _SAMPLE)]
    before = float(np.sqrt(np.mean(solid.signed_distance(sample) ** 2)))
    starts = [(np.eye(3), np.zeros(3))]
    if before > _NEAR:
        middle, low_high = 0.5 * (sample.min(axis=0) + sample.max(axis=0)), solid.bounds()
        aim = 0.5 * (low_high[0] + low_high[1])
        for quarter in range(4):
            c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarter]
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            starts.append((turn, aim - turn @ middle))
    ends = [_descend(sample, solid, *start) for start in starts]
    rotation, translation, after = min(ends, key=lambda end: end[2])
    return Alignment(rotation, translation, before, after)


def _descend(
    points: np.ndarray, solid: Solid, rotation: np.ndarray, translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    for _ in range(_ROUNDS):
        moved = points @ rotation.T + translation
        near = solid.nearest(moved)
        middle = moved.mean(axis=0)
        rows = np.hstack([np.cross(moved - middle, near.normals), near.normals])
        scale = max(1.5 * float(np.median(np.abs(near.distance))), 1e-6)
        weight = np.minimum(1.0, scale / np.maximum(np.abs(near.distance), 1e-12))
        # A direction that the shape leaves open (a cylinder about its axis) keeps its value.
        step = np.linalg.lstsq((weight[:, None] * rows), -weight * near.distance, rcond=1e-6)[0]
        turn = _rotation(step[:3])
        rotation, translation = turn @ rotation, turn @ (translation - middle) + middle + step[3:]
        if np.abs(step).max() < _DONE:
            break
    distance = solid.signed_distance(points @ rotation.T + translation)
    return rotation, translation, float(np.sqrt(np.mean(distance**2)))


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula for a rotation vector (3,) rad."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
