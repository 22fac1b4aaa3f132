"""Contacts as an ideal exploration along lines would give them: for benches and tests of reconstructors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.scene.solid import Solid

RADIUS = 0.005
STICK_RADIUS = 0.002
LOWEST = 0.006
STEP = 0.002
NOISE = 1e-4
NORMAL_NOISE = np.radians(2.0)
VOXEL = 0.002
_MARGIN = 0.03  # m, from the object's box to the ends of the lines
_CELL = 0.0008  # m, of the grid whose contour is the sphere's path
_GRAZE = 1e-6  # m, a sphere that passes this deep still touches nothing


def sample_lines(solid: Solid, pitch: float, phase: float = 0.5, seed: int = 1) -> TouchRecord:
    """Contacts of a sphere on a vertical stick on lines along y, `pitch` m apart, every 2 mm of the centre's path.

    Contact points carry 0.1 mm of noise per axis, normals 2 degrees. `phase` (0..1) shifts the lines by that share of
    the pitch. The lowest centre is 6 mm above the table; where the stick would touch, the sphere does not get.
    """
    rng = np.random.default_rng(seed)
    lower, upper = solid.bounds()
    count = int(np.ceil((upper[0] - lower[0] + 2.0 * _MARGIN) / pitch))
    places = 0.5 * (lower[0] + upper[0]) + pitch * (np.arange(-(count // 2), count // 2 + 1) + phase)
    lines: list[np.ndarray] = []
    free: list[np.ndarray] = []
    for i, x in enumerate(places):
        paths, path = _line(solid, x, lower, upper)
        lines += [_every_step(line_path, rng) for line_path in paths]
        free.append(path if i % 2 == 0 else path[::-1])
    centres = np.concatenate(lines)
    normals = centres - solid.nearest(centres).points
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = centres - RADIUS * normals + NOISE * rng.normal(size=centres.shape)
    return TouchRecord(
        points,
        normals=_tilted(normals, rng),
        free_path=np.concatenate(free),
        probe_radius=RADIUS,
        table=0.0,
        lowest=LOWEST,
    )


def voxelised(record: TouchRecord) -> TouchRecord:
    """The same contacts as 2 mm voxel centres, each with the mean of its normals: what a map keeps."""
    if record.normals is None:
        raise InputError("record", "contacts without normals", "contacts with normals")
    columns = record.normals.T
    cells, inverse = np.unique(np.floor(record.points / VOXEL).astype(np.int64), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    sums = np.stack([np.bincount(inverse, column) for column in columns], axis=1)
    normals = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
    return TouchRecord(
        (cells + 0.5) * VOXEL,
        normals=normals,
        free_path=record.free_path,
        probe_radius=record.probe_radius,
        table=record.table,
        lowest=record.lowest,
        resolution=VOXEL,
        pitch=record.pitch,
    )


def _line(solid: Solid, x: float, lower: np.ndarray, upper: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """The paths (k, 3) of the centre in contact in the plane at x, and its free path (k, 3) at the lowest height."""
    from contourpy import contour_generator

    y = np.arange(lower[1] - 0.008, upper[1] + 0.008, _CELL)
    z = np.arange(LOWEST - 2 * _CELL, upper[2] + 0.008, _CELL)
    nodes = np.stack(np.broadcast_arrays(x, y[None, :], z[:, None]), axis=-1)
    distance = solid.signed_distance(nodes.reshape(-1, 3)).reshape(len(z), len(y))
    paths = []
    for line in contour_generator(y, z, distance).lines(RADIUS - _GRAZE):
        line_path = np.column_stack([np.full(len(line), x), np.asarray(line)])
        paths += list(_runs(line_path, (line_path[:, 2] >= LOWEST) & _stick_is_free(solid, line_path, upper[2])))
    line_path = np.column_stack(
        [np.full(400, x), np.linspace(lower[1] - _MARGIN, upper[1] + _MARGIN, 400), np.full(400, LOWEST)]
    )
    passed = (solid.signed_distance(line_path) > RADIUS - _GRAZE) & _stick_is_free(solid, line_path, upper[2])
    blocked = np.flatnonzero(~passed)
    if len(blocked):  # from each side up to the first contact
        passed[blocked[0] : blocked[-1]] = False
    return paths, line_path[passed]


def _stick_is_free(solid: Solid, centres: np.ndarray, top: float) -> np.ndarray:
    free = np.ones(len(centres), dtype=bool)
    for height in np.arange(RADIUS, top + STICK_RADIUS, STICK_RADIUS):
        beside = np.flatnonzero(free & (centres[:, 2] + height < top + STICK_RADIUS))
        free[beside] = solid.signed_distance(centres[beside] + np.array([0.0, 0.0, height])) > STICK_RADIUS
    return free


def _runs(line_path: np.ndarray, kept: np.ndarray) -> Iterator[np.ndarray]:
    change = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(np.int8)))
    for begin, end in zip(change[::2], change[1::2]):
        if end - begin > 1:
            yield line_path[begin:end]


def _every_step(line_path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_path, axis=0), axis=1))])
    at = np.arange(rng.uniform(0.0, min(STEP, length[-1])), length[-1], STEP)
    return np.column_stack([np.interp(at, length, line_path[:, m]) for m in range(3)])


def _tilted(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    aside = np.cross(normals, rng.normal(size=normals.shape))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    angle = NORMAL_NOISE * rng.normal(size=(len(normals), 1))
    return np.cos(angle) * normals + np.sin(angle) * aside
