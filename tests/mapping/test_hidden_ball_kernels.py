"""Branch and bound for the largest hidden ball: its kernels against naive twins, and how tight it is."""

from __future__ import annotations

import naive_mapping as naive
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import Area
from lwrprobe.mapping import certificate_kernels
from lwrprobe.mapping import hidden_ball_kernels as kernels
from lwrprobe.mapping.certificate import Certificate

COVER, EDGE = 0.009, 0.0015


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_those_of_the_naive_twins(seed):
    rng = np.random.default_rng(seed)
    point, begin, end = rng.uniform(-0.01, 0.01, (3, 3))
    wanted = naive.distance_to_segment(point[None], begin, end)[0]
    assert kernels.segment_distance(*point, begin, end) == pytest.approx(wanted, abs=1e-15)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.01, 0.01, 3)
    size = np.array([0.002, 0.008, 0.0])
    wanted = naive.distance_to_links(point[None], pose[None], "cylinder", size)[0]
    found = kernels.placed_distance(*point, pose, certificate_kernels.CYLINDER, size)
    assert found == pytest.approx(wanted, abs=1e-15)
    area = Area(np.full(3, -0.004), np.full(3, 0.003))
    nearest = np.clip(point, area.lower, area.upper)
    off = np.linalg.norm(point - nearest)
    if off == 0.0:
        off = -min((point - area.lower).min(), (area.upper - point).min())
    assert kernels.outside(*point, area.lower, area.upper) == pytest.approx(off, abs=1e-15)


def reaches(point, t, contacts, closed, gap, origin):
    """The kernel with no border near."""
    contacts = contacts[np.argsort(contacts[:, 0])]
    far, work = np.full(3, 1.0), len(contacts) + 6
    about = (np.empty((work, 4)), np.empty(work, np.int64), gap, origin, EDGE, np.empty((kernels.DEPTH, 5)))
    fine = 1e-4
    return kernels.within_reach(*point, t, fine, contacts, 0, len(contacts), closed, -far, far, *about)


@pytest.mark.parametrize("seed", range(12))
def test_a_covering_ball_reaches_what_the_naive_twin_finds_it_to_reach(seed):
    rng = np.random.default_rng(seed)
    point = rng.uniform(-0.001, 0.001, 3)
    contacts = rng.uniform(-0.012, 0.012, (int(rng.integers(1, 60)), 3)) * (1.0, 1.0, 0.2) - (0.0, 0.0, 0.003)
    gap, origin = np.zeros((21, 21, 21)), np.full(3, -10 * EDGE)  # a middle may lie anywhere
    nearest = naive.nearest_middle(point, contacts, COVER)
    assert reaches(point, nearest + 2e-6, contacts, COVER, gap, origin)
    assert nearest < 1e-4 or not reaches(point, nearest - 2.5e-4, contacts, COVER, gap, origin)


def test_no_covering_ball_comes_from_where_the_grid_allows_none():
    gap, origin = np.full((21, 21, 21), 0.02), np.full(3, -10 * EDGE)
    contacts = np.array([[0.0, 0.0, -0.001]])
    assert not reaches(np.zeros(3), 0.0085, contacts, COVER, gap, origin)
    assert reaches(np.zeros(3), 0.0085, contacts, COVER, np.zeros((21, 21, 21)), origin)


@pytest.mark.parametrize("axis", range(3))
def test_no_middle_lies_beyond_the_border(axis):
    caps, low, high = np.empty((6, 4)), np.full(3, -1.0), np.full(3, 1.0)
    low[axis] = 0.002
    assert kernels.borders(0.0, 0.0, 0.0, 0.001, 0.0, low, high, caps, 0) == -1
    assert kernels.borders(0.0, 0.0, 0.0, 0.004, 0.0, low, high, caps, 0) == 1
    assert caps[0, :3] @ np.eye(3)[axis] == -1.0
    assert caps[0, 3] == pytest.approx(-0.5)  # less than half of the way leads along the axis
    low[axis] = -0.002  # inside: only what lies beyond it at the least distance
    assert kernels.borders(0.0, 0.0, 0.0, 0.004, 0.001, low, high, caps, 0) == 0
    assert kernels.borders(0.0, 0.0, 0.0, 0.004, 0.0025, low, high, caps, 0) == 1
    assert caps[0, 3] == pytest.approx(0.8)


def test_blocks_of_rows_hold_the_owners_about_a_grid_point():
    rng = np.random.default_rng(3)
    owners, found = rng.integers(-1, 400, (5, 5, 5)).astype(np.int32), np.empty((54, 2), np.int64)
    count = kernels.blocks_about(2, 0, 4, owners, 3, found)
    blocks = set(map(tuple, found[:count].tolist()))
    assert len(blocks) == count
    for owner in owners[1:4, 0:2, 3:5].ravel().tolist():
        if owner >= 0:
            row, kind = divmod(owner, 3)
            assert {(row // kernels.BLOCK, kind)} <= blocks


def test_lines_4_mm_apart_certify_less_than_a_millimetre():
    """On a grid of more than 1 mm: what is certified does not depend on how fine that is."""
    area, certified = Area(np.array([-0.02, -0.02, 0.006]), np.array([0.02, 0.02, 0.01])), []
    for voxels in (4000, 40_000):
        certificate = Certificate(area, 0.005, opening=0.018, max_voxels=voxels)
        for x in np.arange(-0.036, 0.0361, 0.004):
            y = np.linspace(-0.04, 0.04, 161)
            for height in (0.007, 0.01):
                certificate.sweep(np.column_stack([np.full(161, x), y, np.full(161, height)]))
            certificate.touch(np.column_stack([np.full(161, x), y, np.full(161, 0.002)]))
        certified.append(certificate.hiding().diameter)
        assert certificate.edge > 0.0006
    sink = 0.009 - np.sqrt(0.009**2 - 0.002**2)
    # Beside two sweeps and on the covering ball: 0.002² + (0.005 + sink - b)² = (0.005 + b)².
    largest = (0.002**2 + (0.005 + sink) ** 2 - 0.005**2) / (2.0 * (0.005 + sink) + 0.01)
    assert all(2.0 * largest <= diameter < 2.0 * largest + 0.00015 for diameter in certified)
