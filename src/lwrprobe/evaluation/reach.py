"""The part of a true surface that the probe's sphere can reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe.scene.solid import Solid

SAMPLES = 20_000
_TOUCH = 1e-6  # m, how deep the sphere may sink in where it counts as touching


@dataclass(slots=True, frozen=True)
class Reach:
    """Even samples of the reachable surface.

    Attributes
    ----------
    points, normals : (n, 3)
    area : m^2 that the sphere can reach
    footprint : m^2 of it seen from above
    """

    points: np.ndarray
    normals: np.ndarray
    area: float
    footprint: float


def reach(
    solid: Solid, radius: float, lowest: float, area: Area | None = None, samples: int = SAMPLES, seed: int = 0
) -> Reach:
    """Sample what a sphere of `radius` m can reach with its centre at or above the height `lowest` m.

    A surface point p with outward normal n counts when the sphere fits at p + r n; with `area`, when its centre is
    inside that box as well. Inner edges, slots narrower than the sphere and what is too low are left out.
    """
    if solid.empty:
        return Reach(np.empty((0, 3)), np.empty((0, 3)), 0.0, 0.0)
    points, normals = solid.sample_surface(samples, seed)
    centres = points + radius * normals
    free = centres[:, 2] >= lowest
    if area is not None:
        free &= ((centres >= area.lower - _TOUCH) & (centres <= area.upper + _TOUCH)).all(axis=1)
    free[free] = solid.signed_distance(centres[free]) >= radius - _TOUCH
    each = solid.area(seed) / samples
    points, normals = points[free], normals[free]
    return Reach(points, normals, each * len(points), each * float(np.maximum(normals[:, 2], 0.0).sum()))
