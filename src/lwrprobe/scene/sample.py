"""Points spread evenly over the exact surface of a solid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.scene import program
from lwrprobe.scene.csg import Group, Surface
from lwrprobe.scene.mesh_body import MeshBody
from lwrprobe.scene.sample_kernels import keep_faces
from lwrprobe.scene.surface_kernels import surface_nearest_batch, surface_values

_SHELL = 5e-4  # m, half thickness of the shell in which a blend's points are drawn
_STEPS = np.array([0.7548776662466927, 0.5698402909980532])  # of the plane's most even additive sequence (Roberts 2018)

Scattered = tuple[np.ndarray, np.ndarray]
"""Points (n, 3) m and their outward normals (n, 3)."""


def scatter(
    surfaces: list[Surface], groups: list[Group], bodies: Sequence[MeshBody],
    numbers: np.ndarray, indices: np.ndarray, density: float, rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Points (n, 3) and outward normals (n, 3), `density` to the square metre, on what bounds the union."""
    row = indices[program.BOUNDS + 1]
    lower, upper = numbers[row : row + 3], numbers[row + 3 : row + 6]
    found = [(np.empty((0, 3)), np.empty((0, 3)))]
    for group in groups:
        box = np.array([np.maximum(group.lower, lower), np.minimum(group.upper, upper)])
        for k in range(group.first, group.last):
            points, normals = _on_surface(surfaces[k], k, box, numbers, density, rng)
            keep = np.empty(len(points), dtype=np.int64)
            keep_faces(numbers, indices, k, points, normals, keep)
            points = points[keep != 0]
            found.append((points, normals[keep != 0] * keep[keep != 0, None]))
    for body in bodies:
        points, normals = _on_triangles(body, density, rng)
        keep = np.empty(len(points), dtype=np.int64)
        keep_faces(numbers, indices, -1, points, normals, keep)
        found.append((points[keep != 0], normals[keep != 0]))
    return np.concatenate([p for p, _ in found]), np.concatenate([n for _, n in found])


def _on_surface(
    surface: Surface, k: int, box: np.ndarray, numbers: np.ndarray, density: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Even points on the part of one surface inside a box, with the surface's gradient."""
    axis = surface.u if surface.u.any() else np.array([0.0, 0.0, 1.0])
    e1 = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    corner = np.array([[box[x, 0], box[y, 1], box[z, 2]] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    local = (corner - surface.a) @ np.array([e1, e2, axis]).T
    low, high = local.min(axis=0), local.max(axis=0)
    if surface.kind == program.PLANE:
        u, v = _even((high[0] - low[0]) * (high[1] - low[1]), density, rng)
        across = (low[0] + u * (high[0] - low[0]))[:, None] * e1 + (low[1] + v * (high[1] - low[1]))[:, None] * e2
        return surface.a + across, np.broadcast_to(surface.u, across.shape).copy()
    if surface.kind == program.CYLINDER:
        return _on_barrel(surface, low[2], high[2], (e1, e2, axis), density, rng)
    if surface.kind == program.SPHERE:
        return _on_ball(surface.a, surface.r, density, rng)
    if surface.kind == program.CAPSULE:
        points, normals = _on_ball(surface.a, surface.r, density, rng)
        points = points + np.where(normals @ axis > 0.0, surface.l, 0.0)[:, None] * axis
        barrel = _on_barrel(surface, 0.0, surface.l, (e1, e2, axis), density, rng)
        return np.concatenate([points, barrel[0]]), np.concatenate([normals, barrel[1]])
    return _on_blend(k, box, numbers, density, rng)


def _on_barrel(
    surface: Surface, low: float, high: float, frame: tuple, density: float, rng: np.random.Generator
) -> Scattered:
    u, v = _even(2.0 * np.pi * surface.r * (high - low), density, rng)
    turn = 2.0 * np.pi * u
    normals = np.cos(turn)[:, None] * frame[0] + np.sin(turn)[:, None] * frame[1]
    return surface.a + surface.r * normals + (low + v * (high - low))[:, None] * frame[2], normals


def _on_ball(centre: np.ndarray, radius: float, density: float, rng: np.random.Generator) -> Scattered:
    u, v = _even(4.0 * np.pi * radius**2, density, rng)
    turn, z = 2.0 * np.pi * u, 2.0 * v - 1.0
    ring = np.sqrt(1.0 - z**2)
    normals = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    return centre + radius * normals, normals


def _on_blend(k: int, box: np.ndarray, numbers: np.ndarray, density: float, rng: np.random.Generator) -> Scattered:
    """Feet of points drawn evenly in a thin shell around the surface: even on it to second order in its thickness."""
    count = rng.poisson(density * np.prod(box[1] - box[0] + 2.0 * _SHELL) / (2.0 * _SHELL))
    points = rng.uniform(box[0] - _SHELL, box[1] + _SHELL, (count, 3))
    values = np.empty(count)
    surface_values(numbers, k, points, values)
    points = points[np.abs(values) < _SHELL]  # the value never exceeds the distance
    feet, normals = np.empty_like(points), np.empty_like(points)
    surface_nearest_batch(numbers, k, points, feet, normals)
    near = np.linalg.norm(points - feet, axis=1) < _SHELL
    return feet[near], normals[near]


def _on_triangles(body: MeshBody, density: float, rng: np.random.Generator) -> Scattered:
    a, b, c = (body.vertices[body.faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    count = rng.poisson(density * area)
    face = np.repeat(np.arange(len(area)), count)
    u, v = np.sqrt(rng.random(len(face))), rng.random(len(face))
    points = (1 - u)[:, None] * a[face] + (u * (1 - v))[:, None] * b[face] + (u * v)[:, None] * c[face]
    return points, body.face_normals[face]


def _even(area: float, density: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two coordinates in 0..1 of as many evenly spread points as the area takes."""
    count = int(area * density + rng.random())
    u, v = np.mod(rng.random(2)[:, None] + np.arange(count) * _STEPS[:, None], 1.0)
    return u, v
