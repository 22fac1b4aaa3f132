"""The part of a true surface that the probe's sphere can reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    radius : m, of the sphere
    each : m^2 that one sample stands for
    whole_area : m^2 of the whole surface, within reach or not
    """

    points: np.ndarray
    normals: np.ndarray
    radius: float
    each: float
    whole_area: float

    @property
    def area(self) -> float:
        """m^2 that the sphere can reach."""
        return self.each * len(self.points)

    @property
    def footprint(self) -> float:
        """m^2 of it seen from above."""
        return self.each * float(np.maximum(self.normals[:, 2], 0.0).sum())

    @property
    def centres(self) -> np.ndarray:
        """(n, 3) m, where the sphere's centre is while it touches the samples."""
        return self.points + self.radius * self.normals

    def within(self, area: Area) -> Reach:
        """What of it the sphere reaches with its centre in a box."""
        inside = ((self.centres >= area.lower - _TOUCH) & (self.centres <= area.upper + _TOUCH)).all(axis=1)
        return replace(self, points=self.points[inside], normals=self.normals[inside])


def upright(
    found: Reach, solid: Solid, links: Sequence[LinkShape], rotation: np.ndarray, keep: Sequence[float]
) -> Reach:
    """What of it is reached without turning the tip: each link keeps `keep` m from the object while the sphere touches.

    `links` [tip frame], with one distance each, `rotation` (3, 3) of the tip. The links are looked at in some points of
    their surface: the answer is for judging a strategy, not for avoiding a collision.
    """
    centres = found.centres
    free = np.ones(len(centres), dtype=bool)
    for link, distance in zip(links, keep, strict=True):
        for offset in _surface(link) @ rotation.T:
            left = np.flatnonzero(free)
            free[left] = solid.signed_distance(centres[left] + offset) >= distance
    return replace(found, points=found.points[free], normals=found.normals[free])


def _surface(link: LinkShape) -> np.ndarray:
    """(k, 3) points on a link's surface, tip frame; rings of a cylinder are no farther apart than it is wide."""
    if link.kind == "box":
        steps = [np.linspace(-0.5, 0.5, 3) * edge for edge in link.size]
        grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        points = grid[(np.abs(grid) >= 0.5 * np.array(link.size) - 1e-12).any(axis=1)]
    else:
        radius, length = link.size
        angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
        ring = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(12)])
        heights = np.linspace(-0.5, 0.5, max(int(np.ceil(0.5 * length / radius)), 2) + 1) * length
        points = np.concatenate([ring + np.array([0.0, 0.0, z]) for z in heights])
    return points @ link.pose[:3, :3].T + link.pose[:3, 3]


def reach(
    solid: Solid, radius: float, lowest: float, area: Area | None = None, samples: int = SAMPLES, seed: int = 0
) -> Reach:
    """Sample what a sphere of `radius` m can reach with its centre at or above the height `lowest` m.

    A surface point p with outward normal n counts when the sphere fits at p + r n; with `area`, when its centre is
    inside that box as well. Inner edges, slots narrower than the sphere and what is too low are left out.
    """
    if solid.empty:
        return Reach(np.empty((0, 3)), np.empty((0, 3)), radius, 0.0, 0.0)
    points, normals = solid.sample_surface(samples, seed)
    whole = solid.area(seed)
    high = points[:, 2] + radius * normals[:, 2] >= lowest
    found = Reach(points[high], normals[high], radius, whole / samples, whole)
    if area is not None:
        found = found.within(area)
    free = solid.signed_distance(found.centres) >= radius - _TOUCH
    return replace(found, points=found.points[free], normals=found.normals[free])
