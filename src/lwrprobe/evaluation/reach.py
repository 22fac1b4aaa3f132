"""The part of a true surface that the probe's sphere can reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area, LinkShape
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


def upright(found: Reach, solid: Solid, radius: float, links: Sequence[LinkShape], rotation: np.ndarray, keep: float):
    """(n,) bool: where the links keep `keep` m from the true object while the sphere touches and the tip is not turned.

    `rotation` (3, 3) is the tip's. The links are looked at in some points of their surface: the answer is for judging a
    strategy, not for avoiding a collision.
    """
    centres = found.points + radius * found.normals
    free = np.ones(len(centres), dtype=bool)
    for offset in np.concatenate([_surface(link) for link in links] or [np.empty((0, 3))]) @ rotation.T:
        left = np.flatnonzero(free)
        free[left] = solid.signed_distance(centres[left] + offset) >= keep
    return free


def _surface(link: LinkShape) -> np.ndarray:
    """(k, 3) points on a link's surface, tip frame."""
    if link.kind == "box":
        steps = [np.linspace(-0.5, 0.5, 3) * edge for edge in link.size]
        grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        points = grid[(np.abs(grid) >= 0.5 * np.array(link.size) - 1e-12).any(axis=1)]
    else:
        angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
        ring = link.size[0] * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(12)])
        points = np.concatenate([ring + np.array([0.0, 0.0, z]) for z in np.linspace(-0.5, 0.5, 3) * link.size[1]])
    return points @ link.pose[:3, :3].T + link.pose[:3, 3]


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
