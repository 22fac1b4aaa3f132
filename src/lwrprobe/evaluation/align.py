"""Rigid alignment of a mesh or a cloud with the true shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.reconstruction.alignment import STILL, Alignment, Pairs, RigidMotion
from lwrprobe.scene.solid import Solid

_SAMPLE = 1500
_ROUNDS = 60
_NEAR = 5e-3  # m; shapes that lie so close already are not turned about
_OPEN = 1e-6  # a direction that the shape leaves open (a cylinder about its axis) keeps its value


@dataclass(slots=True, frozen=True)
class Placement(RigidMotion):
    """The motion, and `rms` m of the points against the true surface before and after it."""

    before: float
    after: float


def align(points: np.ndarray, solid: Solid) -> Placement:
    """The motion that brings points (n, 3) m of a surface onto the true one, in least squares with outliers damped.

    Huber weights. Points that lie near already are moved from where they are; others start with their middle on the
    solid's, at four turns about z, and the best end wins. Raises InputError for fewer than 6 points or an empty solid.
    """
    if len(points) < 6 or solid.empty:
        raise InputError("align", f"{len(points)} points", "at least 6 points and a true shape")
    sample = points[:: max(1, len(points) // _SAMPLE)]
    fit = Alignment(_Truth(solid), sample, np.zeros_like(sample), _huber, _OPEN, np.arange(6))
    starts, before = [STILL], _rms(sample, solid)
    if before > _NEAR:
        aim, middle = 0.5 * np.add(*solid.bounds()), 0.5 * (sample.min(axis=0) + sample.max(axis=0))
        for c, s in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            starts.append(RigidMotion(turn, aim - fit.middle + turn @ (fit.middle - middle)))
    ends = [fit.about_origin(fit.descend(start, _ROUNDS)) for start in starts]
    after = [_rms(end.points(sample), solid) for end in ends]
    best = int(np.argmin(after))
    return Placement(ends[best].rotation, ends[best].translation, before, after[best])


@dataclass(slots=True, frozen=True)
class _Truth:
    """Every point's partner is the nearest of the true surface."""

    solid: Solid

    def pair(self, points: np.ndarray, normals: np.ndarray) -> Pairs:
        near = self.solid.nearest(points)
        return Pairs(np.arange(len(points)), near.distance, near.normals)


def _huber(pairs: Pairs) -> np.ndarray:
    scale = max(1.5 * pairs.median, 1e-6)
    return np.minimum(1.0, scale / np.maximum(np.abs(pairs.apart), 1e-12))


def _rms(points: np.ndarray, solid: Solid) -> float:
    return float(np.sqrt(np.mean(solid.signed_distance(points) ** 2)))
