"""The kernels against their naive twins."""

from __future__ import annotations

import numpy as np
import pytest
from naive_collision import project, reach
from scipy.spatial.transform import Rotation

from lwrprobe.collision import clearance_kernels, shape_kernels, sweep_kernels
from lwrprobe.collision.link_rows import link_rows
from lwrprobe.contracts import LinkShape

KINDS = [("cylinder", (0.01, 0.05)), ("capsule", (0.01, 0.05)), ("box", (0.02, 0.03, 0.05))]


def random_pose(rng):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    return pose


def placed(link, frame):
    rows = link_rows([link])
    out = np.empty(rows.shape)
    shape_kernels.place(rows, frame, np.empty((0, 4, 4)), out)
    return out


@pytest.mark.parametrize(("kind", "size"), KINDS)
def test_signed_distance_and_its_tangent_plane(kind, size):
    rng = np.random.default_rng(0)
    link = LinkShape("link", kind, size, random_pose(rng))
    frame = random_pose(rng)
    shape = placed(link, frame)[0]
    middle = (frame @ link.pose)[:3, 3]
    points = middle + rng.normal(0.0, 0.03, (500, 3))
    points = np.vstack([points, middle, middle + (frame @ link.pose)[:3, 2] * 0.03])
    answers = np.array([shape_kernels.distance_to(shape, *point) for point in points])
    outside = np.linalg.norm(points - project(link, frame, points), axis=1)
    np.testing.assert_allclose(np.maximum(answers[:, 0], 0.0), outside, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(answers[:, 1:], axis=1), 1.0, atol=1e-12)
    for point, (distance, *gradient) in zip(points, answers):
        tangent = distance + (points - point) @ gradient
        assert (answers[:, 0] >= tangent - 1e-12).all()


@pytest.mark.parametrize(("kind", "size"), KINDS)
def test_support_reaches_as_far_as_the_body(kind, size):
    rng = np.random.default_rng(1)
    link = LinkShape("link", kind, size, random_pose(rng))
    frame = random_pose(rng)
    shape = placed(link, frame)[0]
    for direction in np.vstack([rng.normal(size=(50, 3)), np.eye(3), (frame @ link.pose)[:3, :3].T]):
        direction = direction / np.linalg.norm(direction)
        far = np.array(shape_kernels.support(shape, *direction)) @ direction + shape_kernels.margin(shape)
        assert far == pytest.approx(reach(link, frame, direction), abs=1e-12)


def test_bounding_box_of_a_mask():
    rng = np.random.default_rng(2)
    for bits in range(1, 65):
        for _ in range(20):
            children = rng.choice(64, bits, replace=False)
            mask = np.array([sum(1 << int(c) for c in children)], np.uint64).view(np.int64)[0]
            cells = np.stack([children & 3, (children >> 2) & 3, children >> 4], axis=1)
            wanted = tuple(zip(cells.min(0), cells.max(0) + 1))
            assert clearance_kernels.extents(mask) == wanted


def test_poses_between_two_poses():
    rng = np.random.default_rng(3)
    turn, pose = np.empty(3), np.eye(4)
    for angle in (0.0, 1e-12, 1e-6, 0.3, 3.0, np.pi - 1e-10, np.pi):
        a = random_pose(rng)
        axis = rng.normal(size=3)
        b = a.copy()
        b[:3, :3] = a[:3, :3] @ Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        b[:3, 3] += rng.normal(size=3)
        sweep_kernels.turn_between(a, b, turn)
        assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-7)
        sweep_kernels.pose_between(a, b, turn, 1.0, pose)
        np.testing.assert_allclose(pose, b, atol=1e-6)
        sweep_kernels.pose_between(a, b, turn, 0.5, pose)
        halfway = np.linalg.norm(Rotation.from_matrix(a[:3, :3].T @ pose[:3, :3]).as_rotvec())
        assert halfway == pytest.approx(0.5 * angle, abs=1e-6)


def test_rigid_motions_and_nothing_else():
    rng = np.random.default_rng(4)
    good = random_pose(rng)
    assert shape_kernels.is_rigid(good)
    for i in range(4):
        for j in range(4):
            for value in (np.nan, np.inf):
                bad = good.copy()
                bad[i, j] = value
                assert not shape_kernels.is_rigid(bad)
    for bad in (np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), np.diag([2.0, 0.5, 1.0, 1.0]), 2.0 * np.eye(4)):
        assert not shape_kernels.is_rigid(bad)
