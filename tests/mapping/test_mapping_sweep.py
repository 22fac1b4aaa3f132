"""The sphere's path, given place after place, frees what carving frees."""

from __future__ import annotations

from itertools import pairwise

import naive_mapping as naive
import numpy as np
import pytest
from scipy.spatial import cKDTree

from lwrprobe.contracts import InputError
from lwrprobe.mapping import SweptSphere, VoxelMap

EDGE, RADIUS = 0.002, 0.005
PLAY = 0.005 * EDGE


def keys(voxels):
    return {tuple(key) for key in naive.keys(voxels.free_centres(), EDGE)}


def carved(centres, radius):
    voxels = VoxelMap(EDGE)
    voxels.carve_path(centres, radius)
    return keys(voxels)


class CountingMap(VoxelMap):
    __slots__ = ("pieces",)

    def carve_path(self, path, radius):
        self.pieces = getattr(self, "pieces", 0) + 1
        super().carve_path(path, radius)


def swept(centres):
    voxels = CountingMap(EDGE)
    sphere = SweptSphere(voxels, RADIUS)
    for place in centres:
        sphere.move_to(place)
    sphere.leave()
    return voxels


def sampled(corners, rng):
    """Places on a path with corners, at steps as uneven as a run's, some of them none at all."""
    places = [corners[:1]]
    for begin, end in pairwise(corners):
        steps = int(np.linalg.norm(end - begin) / 2e-4) + 1
        shares = np.sort(rng.uniform(0.0, 1.0, steps)).repeat(rng.integers(1, 3, steps))
        places += [begin + np.outer(shares, end - begin), end[None]]
    return np.concatenate(places)


def test_a_way_with_corners_frees_what_its_straight_legs_free():
    rng = np.random.default_rng(1)
    for _ in range(4):
        corners = np.cumsum(rng.normal(0.0, 0.012, (6, 3)), axis=0)
        centres = sampled(corners, rng)
        voxels = swept(centres)
        found = keys(voxels)
        assert carved(centres, RADIUS - PLAY) <= found <= carved(corners, RADIUS + PLAY)
        assert voxels.pieces < len(centres) / 12


@pytest.mark.parametrize("bend", [0.002, 0.01, 0.1, 5.0])
def test_a_bent_way_is_kept_to(bend):
    angle = np.linspace(0.0, min(6.0, 0.1 / bend), 400)
    centres = bend * np.column_stack([np.cos(angle), np.sin(angle), 0.2 * angle])
    voxels = swept(centres)
    assert carved(centres, RADIUS - PLAY) <= keys(voxels)
    inside = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 5) * EDGE] * 3), -1).reshape(-1, 3)
    places = np.concatenate([np.linspace(a, b, 8) for a, b in pairwise(centres)])
    off, _ = cKDTree(places).query((voxels.free_centres()[:, None] + inside).reshape(-1, 3))
    assert off.max() <= RADIUS + PLAY + 1e-6  # every part of every voxel


def test_what_is_pending_is_marked_when_the_sphere_leaves_and_the_next_way_begins_anew():
    voxels = VoxelMap(EDGE)
    sphere = SweptSphere(voxels, RADIUS)
    for x in np.arange(0.0, 0.004, 0.001):
        sphere.move_to(np.array([x, 0.0, 0.0]))
    assert voxels.free_count() == 0
    sphere.leave()
    assert keys(voxels) == naive.swept(np.zeros(3), np.array([0.003, 0.0, 0.0]), RADIUS, EDGE)
    before = keys(voxels)
    sphere.move_to(np.array([0.2, 0.0, 0.0]))
    sphere.leave()
    assert keys(voxels) == before  # one place alone, between two touches, is no way
    sphere.move_to(np.array([0.2, 0.0, 0.0]))
    sphere.move_to(np.array([0.2, 0.0, 0.0]))
    sphere.leave()
    assert keys(voxels) == before | naive.swept(*[np.array([0.2, 0.0, 0.0])] * 2, RADIUS, EDGE)


def test_resting_for_long_and_going_back_and_forth():
    rest = np.zeros((500, 3))
    there = np.column_stack([np.linspace(0.0, 0.01, 40), np.zeros(40), np.zeros(40)])
    centres = np.concatenate([rest, there, there[::-1], there, rest])
    voxels = swept(centres)
    assert keys(voxels) == naive.swept(there[0], there[-1], RADIUS, EDGE)
    assert voxels.pieces < 12


def test_a_way_that_is_not_finite_or_leaves_the_map_is_refused():
    for bad in (np.nan, np.inf, 1e6):
        sphere = SweptSphere(VoxelMap(EDGE), RADIUS)
        sphere.move_to(np.zeros(3))
        sphere.move_to(np.array([bad, 0.0, 0.0]))
        with pytest.raises(InputError, match="path"):
            sphere.leave()
