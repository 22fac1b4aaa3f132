"""Rulings between contacts: where they are taken to be, and what speaks against them."""

from pathlib import Path

import naive_reconstruction as naive
import numpy as np
import pytest

from lwrprobe.contracts import TouchRecord
from lwrprobe.evaluation import mesh_error
from lwrprobe.reconstruction import contact_surface
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.hermite_field import HermiteData
from lwrprobe.reconstruction.ruling_kernels import best_rulings, refuted
from lwrprobe.reconstruction.rulings import find_rulings, fine_clusters
from lwrprobe.reconstruction.touches import prepare
from lwrprobe.scene import load_scene

RADIUS = 0.005
UP = np.array([0.0, 0.0, 1.0])


def touched(points, normals, path=((0.2, 0.2, 0.2), (0.2, 0.2, 0.21))):
    """Touches of a sphere that has passed along a path."""
    return prepare(
        TouchRecord(
            np.asarray(points, dtype=float),
            normals=np.asarray(normals, dtype=float),
            free_path=np.asarray(path, dtype=float),
            probe_radius=RADIUS,
            table=0.0,
        ),
        0.002,
    )


def rulings(touches):
    return find_rulings(touches, fine_clusters(touches))


def level_lines(height, ys, xs):
    """Contacts every millimetre along x on a level surface, and one far below: they have to span a solid."""
    points = np.array([*((x, y, height) for y in ys for x in np.arange(*xs, 0.001)), (0.1, 0.1, 0.0)])
    return points, np.vstack([np.tile(UP, (len(points) - 1, 1)), [1.0, 0.0, 0.0]])


def circles(radius, heights):
    angles = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
    return (
        np.vstack([radius * normals + [0.0, 0.0, height] for height in heights]),
        np.vstack([normals for _ in heights]),
    )


def test_a_plane_between_two_lines():
    found = rulings(touched(*level_lines(0.05, (-0.02, 0.02), (-0.04, 0.04))))
    assert len(found.points) > 50
    assert np.allclose(found.points[:, 2], 0.05 + RADIUS, atol=1e-9)
    assert np.allclose(found.normals, UP)
    assert np.abs(found.points[:, 1]).max() < 0.02


def test_the_wall_of_a_cylinder_between_two_circles():
    found = rulings(touched(*circles(0.024, (0.006, 0.046))))
    assert len(found.points) > 50
    assert np.allclose(np.linalg.norm(found.points[:, :2], axis=1), 0.024 + RADIUS, atol=1e-4)


def test_circles_of_different_size_are_joined_along_a_cone_alone():
    points, normals = circles(0.024, (0.006,))
    small, alike = circles(0.014, (0.046,))
    assert not len(rulings(touched(np.vstack([points, small]), np.vstack([normals, alike]))).points)
    lean = np.array([0.0, 0.0, 0.25])  # the normals of the cone through both circles
    normals, alike = ((n + lean) / np.hypot(1.0, 0.25) for n in (normals, alike))
    found = rulings(touched(np.vstack([points, small]), np.vstack([normals, alike])))
    feet = found.points - RADIUS * found.normals
    assert len(feet) > 50
    assert np.allclose(np.linalg.norm(feet[:, :2], axis=1), 0.024 - 0.25 * (feet[:, 2] - 0.006), atol=2e-4)


def test_a_ball_has_none():
    angles = np.linspace(0.1, np.pi / 2, 60)
    normals = np.array(
        [(np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)) for a in angles for b in np.arange(0, 6.28, 0.7)]
    )
    assert not len(rulings(touched(0.04 * normals + [0.0, 0.0, 0.05], normals)).points)


def test_a_gap_that_the_sphere_went_into_ends_the_plane():
    points, normals = level_lines(0.05, (-0.02, 0.02), (-0.04, 0.04))
    slot = [(0.0, 0.0, 0.08), (0.0, 0.0, 0.03)]
    near = np.linalg.norm(rulings(touched(points, normals, slot)).points[:, :2], axis=1)
    everywhere = np.linalg.norm(rulings(touched(points, normals)).points[:, :2], axis=1)
    assert near.min() > 0.008 > everywhere.min()


def test_what_stands_on_a_plane_and_what_is_sunk_into_it_end_it():
    points, normals = level_lines(0.05, (-0.02, 0.02), (-0.04, 0.04))
    for height in (0.06, 0.04):
        line, up = level_lines(height, (0.0,), (-0.04, 0.04))
        found = rulings(touched(np.vstack([points, line]), np.vstack([normals, up])))
        assert not (np.abs(found.points[:, 2] - 0.05 - RADIUS) < 1e-6).any()


def block(half, top, x, heights=(0.006,)):
    """Contacts on a wall at `half` m at these heights, and on a line along x over the top up to `x` m."""
    ys, xs = np.arange(-0.02, 0.0201, 0.001), np.arange(-x, x, 0.001)
    points = [(half, y, height) for height in heights for y in ys] + [(a, 0.0, top) for a in xs]
    count = len(heights) * len(ys)
    return np.array(points), np.vstack([np.tile([1.0, 0.0, 0.0], (count, 1)), np.tile(UP, (len(xs), 1))])


def upright(points, normals):
    """Places on upright walls that face along x."""
    found = rulings(touched(points, normals))
    return found.points[found.normals[:, 0] > 0.9]


def test_a_wall_goes_straight_up_to_the_top_right_behind_it():
    found = upright(*block(0.04, 0.05, 0.04))
    assert len(found) > 20
    assert np.allclose(found[:, 0], 0.04 + RADIUS)
    assert np.abs(found[:, 1]).max() <= 2.0 * RADIUS, "beside the line over the top, as far as that says something"
    assert 0.005 + RADIUS < found[:, 2].min() < 0.02 < 0.04 < found[:, 2].max() < 0.05 + RADIUS


def test_a_top_far_behind_a_wall_may_stand_on_a_step():
    assert not len(upright(*block(0.04, 0.05, 0.028)))


def test_a_top_that_falls_off_towards_the_wall_is_rounded():
    points, normals = block(0.04, 0.05, 0.04)
    tops = normals[:, 2] > 0.5
    normals[tops] = np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0)
    assert not len(upright(points, normals))


def test_a_wall_that_was_touched_farther_in_higher_up_does_not_go_straight_up():
    points, normals = block(0.04, 0.05, 0.04)
    inner = np.array([(0.036, y, 0.03) for y in np.arange(-0.02, 0.0201, 0.001)])
    facing = np.tile([1.0, 0.0, 0.0], (len(inner), 1))
    found = upright(np.vstack([points, inner]), np.vstack([normals, facing]))
    assert np.allclose(found[:, 0], 0.036 + RADIUS), "the upper part of the wall does"


def test_the_inner_wall_of_a_hollow_does_not_speak_against_a_wall():
    points, normals = block(0.04, 0.05, 0.04)
    inner = np.array([(-0.03, y, 0.03) for y in np.arange(-0.02, 0.0201, 0.001)])
    facing = np.tile([1.0, 0.0, 0.0], (len(inner), 1))
    both = upright(np.vstack([points, inner]), np.vstack([normals, facing]))
    assert (both[:, 0] > 0.0).sum() == len(upright(points, normals))


def test_what_stands_beyond_a_slot_does_not_speak_against_a_wall():
    points, normals = block(0.04, 0.05, 0.04)
    alone = upright(points, normals)
    ys = np.arange(-0.02, 0.0201, 0.001)
    far_side = np.column_stack([np.full(len(ys), 0.057), ys, np.full(len(ys), 0.03)])  # of a fin before the wall
    points, normals = np.vstack([points, far_side]), np.vstack([normals, np.tile([1.0, 0.0, 0.0], (len(ys), 1))])
    assert len(upright(points, normals)) < len(alone), "it may be that of a boss on the wall"
    near_side = far_side - [0.004, 0.0, 0.0]
    points, normals = np.vstack([points, near_side]), np.vstack([normals, np.tile([-1.0, 0.0, 0.0], (len(ys), 1))])
    far = np.abs(alone[:, 2] - 0.03) > 0.007  # from the contacts on the fin: beside them none is needed
    assert np.array_equal(upright(points, normals), alone[far])


def test_few_strokes_over_flat_faces_make_a_better_mesh(monkeypatch):
    file = np.load(Path(__file__).parent / "recorded" / "bridge.npz")
    contacts, free = file["contacts"].astype(float), file["free_path"].astype(float)
    record = TouchRecord(
        contacts[:, :3], normals=contacts[:, 3:], free_path=free, probe_radius=RADIUS, table=0.0, lowest=0.006,
        pitch=0.025,
    )  # fmt: skip
    solid = load_scene("bridge").solid()
    found = mesh_error(ContactSurface().reconstruct(record).mesh, solid, 0.007, samples=4000)
    none = HermiteData(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0))
    monkeypatch.setattr(contact_surface, "find_rulings", lambda touches, fine: none)
    without = mesh_error(ContactSurface().reconstruct(record).mesh, solid, 0.007, samples=4000)
    assert found.mean < 0.9 * without.mean


def test_best_rulings_are_those_of_all_pairs():
    random = np.random.default_rng(3)
    centres = random.uniform(0.0, 0.05, (40, 3))
    normals = UP + random.normal(0.0, 0.02, (40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    limits = 0.01, 0.04, np.cos(0.07), 0.002, 0.02
    lower, cell, shape = np.zeros(3), 0.006, (9, 9, 9)
    worth, ends, share = np.full(shape, np.inf), np.zeros((*shape, 2), np.int64), np.zeros(shape)
    best_rulings(centres, normals, *limits, lower, cell, worth, ends, share)
    wanted = naive.best_rulings(centres, normals, *limits, lower, cell)
    assert 10 < len(wanted) == np.isfinite(worth).sum()
    for key, score in wanted.items():
        assert worth[key] == pytest.approx(score)
        place = centres[ends[key][0]] + share[key] * (centres[ends[key][1]] - centres[ends[key][0]])
        assert tuple((place / cell).astype(int)) == key


@pytest.mark.parametrize("touching", [True, False])
def test_what_refutes_a_ruling(touching):
    random = np.random.default_rng(4)
    begin = random.uniform(0.0, 0.05, (60, 3))
    finish = begin + random.uniform(-0.03, 0.03, (60, 3)) * [1.0, 1.0, 0.0]
    normals = np.tile(UP, (60, 1))
    points = random.uniform(0.0, 0.05, (12, 3))
    facing = random.normal(size=(12, 3)) if touching else np.empty((0, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    deep, found = random.uniform(0.005, 0.05, 60), np.zeros(60, dtype=bool)
    refuted(begin, finish, normals, points, facing, 0.01, 0.001, RADIUS, deep, found)
    wanted = naive.refuted(begin, finish, normals, points, facing, 0.01, 0.001, RADIUS, deep)
    assert np.array_equal(found, wanted)
    assert 5 < wanted.sum() < 55
