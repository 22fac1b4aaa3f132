"""The certificate: its kernels, that motion never makes it larger, and that nothing larger hides."""

from __future__ import annotations

import naive_mapping as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import Area, InputError, LinkShape
from lwrprobe.mapping import certificate_kernels as kernels
from lwrprobe.mapping.certificate import Certificate

RADIUS, OPENING = 0.005, 0.015
ORIGIN, EDGE, SHAPE = np.array([-0.01, -0.02, 0.003]), 0.0023, (11, 13, 9)


def points_of_grid():
    return ORIGIN + EDGE * np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1).reshape(-1, 3)


def small_area(height=0.03):
    return Area(np.array([-0.03, -0.03, 0.006]), np.array([0.03, 0.03, height]))


@pytest.mark.parametrize("seed", range(4))
def test_distances_from_a_path_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    centres = ORIGIN + rng.uniform(-0.01, 0.04, (12, 3))
    centres[5] = centres[4]  # a segment of no length
    joined = rng.random(12) < 0.6
    values, owners = np.full(SHAPE, 0.012), np.full(SHAPE, -1, np.int32)
    begins = np.array([centres[k - 1] if k and joined[k] else centres[k] for k in range(12)])
    kernels.lower_to_path(values, owners, 100, 3, ORIGIN, EDGE, begins, centres, 0.004, 0.012)
    wanted = naive.lowered_to_path(points_of_grid(), 0.012, centres, joined, 0.004)
    np.testing.assert_allclose(values.ravel(), wanted, atol=1e-12)
    for at, number in zip(points_of_grid(), owners.ravel().tolist()):
        if number >= 0:
            row = number // 3 - 100
            own = naive.distance_to_segment(at[None], begins[row], centres[row])[0] - 0.004
            assert own == pytest.approx(naive.lowered_to_path(at[None], 0.012, centres, joined, 0.004)[0], abs=1e-12)


def test_squares_of_the_distances_from_points_are_those_of_the_naive_twin():
    points = ORIGIN + np.random.default_rng(5).uniform(-0.01, 0.04, (20, 3))
    points[0] = ORIGIN - 1.0  # too far away to matter
    reach = 0.009
    squares = np.full(SHAPE, 0.012**2)
    kernels.lower_to_points(squares, ORIGIN, EDGE, points, reach)
    wanted = naive.lowered_to_path(points_of_grid(), 0.012, points, np.zeros(20, bool), 0.0)
    near, found = wanted < reach, np.sqrt(squares.ravel())
    assert near.any()
    assert not near.all()
    np.testing.assert_allclose(found[near], wanted[near], atol=1e-12)
    assert (found[~near] >= wanted[~near] - 1e-12).all()  # beyond the reach too large at most


@pytest.mark.parametrize("kind", ["cylinder", "box", "capsule"])
def test_distances_from_a_link_are_those_of_the_naive_twin(kind):
    rng = np.random.default_rng(7)
    size = np.array([0.006, 0.011, 0.017]) if kind == "box" else np.array([0.004, 0.02, 0.0])
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3] = Rotation.random(5, rng).as_matrix()
    poses[:, :3, 3] = ORIGIN + rng.uniform(0.0, 0.025, (5, 3))
    code = {"cylinder": kernels.CYLINDER, "box": kernels.BOX, "capsule": kernels.CAPSULE}[kind]
    values, owners = np.full(SHAPE, 0.012), np.full(SHAPE, -1, np.int32)
    kernels.lower_to_link(values, owners, 7, 4, 2, ORIGIN, EDGE, poses, code, size, 0.0002, 0.004)
    assert set(owners.ravel().tolist()) <= {-1, *range(7 * 4 + 2, 12 * 4 + 2, 4)}
    exact = naive.distance_to_links(points_of_grid(), poses, kind, size) + 0.0002
    near, found = exact < 0.0042, values.ravel()
    assert near.any()
    np.testing.assert_allclose(found[near], exact[near], atol=1e-12)
    assert (
        found[~near] >= np.minimum(exact[~near], 0.012) - 1e-12
    ).all()  # beyond the band a value may be too large, never too small


def test_nothing_swept_leaves_the_whole_height_of_the_area():
    found = Certificate(small_area(), RADIUS, opening=OPENING).hiding()
    assert found.diameter == pytest.approx(0.034, abs=0.004)  # 24 mm and a radius at each end
    assert found.out_of_reach == 0.0


def test_all_swept_leaves_no_more_than_the_grid():
    certificate = Certificate(small_area(), RADIUS, opening=OPENING, max_voxels=60_000)
    for x in np.linspace(-0.03, 0.03, 61):
        for z in np.linspace(0.006, 0.03, 13):
            certificate.sweep(np.array([[x, -0.03, z], [x, 0.03, z]]))
    assert certificate.hiding().diameter < 0.0004  # in the corners between sweeps


def test_between_lines_on_a_plate_what_fits_under_two_sweeps_hides():
    """Lines 10 mm apart and a sphere of 5 mm: a ball of 2.5 mm touches plate and both sweeps.

    As far as anybody knows, the covering ball of 7.5 mm sinks in between the lines by s = 1.91 mm. A ball of radius b
    touches both sweeps and the bottom of that where 5² + (5 + s - b)² = (5 + b)².
    """
    area = Area(np.array([-0.03, -0.02, 0.006]), np.array([0.03, 0.02, 0.02]))
    certificate = Certificate(area, RADIUS, opening=OPENING, max_voxels=2_000_000)
    top = 0.007
    for x in np.arange(-0.04, 0.0401, 0.01):
        y = np.linspace(-0.03, 0.03, 121)
        certificate.sweep(np.column_stack([np.full(121, x), y, np.full(121, top + RADIUS)]))
        certificate.touch(np.column_stack([np.full(121, x), y, np.full(121, top)]))
    for z in (0.016, 0.02):
        for x in np.arange(-0.04, 0.0401, 0.005):
            certificate.sweep(np.array([[x, -0.03, z], [x, 0.03, z]]))
    found = certificate.hiding()
    sink = 0.0075 - np.sqrt(0.0075**2 - 0.005**2)
    largest = (RADIUS + sink) ** 2 / (4.0 * RADIUS + 2.0 * sink)
    assert 2.0 * largest <= found.diameter < 2.0 * largest + 0.00015
    assert found.out_of_reach > 1e-6


def test_the_links_sweep_too():
    links = (LinkShape("body", "box", (0.08, 0.08, 0.02), np.eye(4)),)
    pose = np.eye(4)
    pose[2, 3] = 0.02
    with_links = Certificate(small_area(), RADIUS, links, opening=OPENING)
    without = Certificate(small_area(), RADIUS, opening=OPENING)
    for certificate in (with_links, without):
        certificate.sweep(pose[None, :3, 3], poses=pose[None])
    assert with_links.hiding().unknown < 0.6 * without.hiding().unknown


@given(st.integers(0, 2**31), st.integers(1, 8))
@settings(max_examples=40, deadline=None)
def test_more_motion_and_more_contacts_never_make_it_larger(seed, parts):
    rng = np.random.default_rng(seed)
    links = (LinkShape("stick", "cylinder", (0.002, 0.02), np.eye(4)),)
    certificate = Certificate(small_area(), RADIUS, links, opening=OPENING, tolerance=1e-4, max_voxels=8000)
    last = certificate.hiding().diameter
    for _ in range(parts):
        count = int(rng.integers(1, 30))
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, :3, :3] = Rotation.random(count, rng).as_matrix()
        poses[:, :3, 3] = rng.uniform([-0.04, -0.04, 0.0], [0.04, 0.04, 0.04], (count, 3))
        certificate.sweep(poses[:, :3, 3], rng.random(count) < 0.5, poses)
        certificate.touch(rng.uniform([-0.03, -0.03, 0.0], [0.03, 0.03, 0.035], (int(rng.integers(0, 60)), 3)))
        now = certificate.hiding().diameter
        assert now <= last
        last = now


@pytest.mark.parametrize("seed", [*range(8), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(8, 25))])
def test_no_ball_hides_that_is_larger_than_certified(seed):
    """The largest 40 of 40 000 bumps at each of 25 objects, each bump as large as what was swept leaves room for."""
    rng = np.random.default_rng(seed)
    area, world = small_area(0.036), naive.ConvexObject.random(rng)
    pitch = float(rng.choice([0.002, 0.004, 0.007, 0.01]))
    skip = bool(rng.random() < 0.5)
    centres, touched = world.raster(area, RADIUS, pitch, skip=skip, rng=rng)
    certificate = Certificate(area, RADIUS, opening=OPENING, max_voxels=int(rng.choice([20_000, 60_000])))
    certificate.sweep(centres, np.zeros(len(centres), bool))
    certificate.touch(touched)
    claimed, swept = certificate.hiding().diameter, cKDTree(centres)
    places = rng.uniform(area.lower - RADIUS, area.upper + RADIUS, (40_000, 3))
    beyond = np.maximum(area.lower - places, places - area.upper)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    room = np.minimum(swept.query(places)[0] - RADIUS, world.distance(places))
    room = np.minimum(room, RADIUS - outside)  # the sphere comes no farther
    # Straight away from the object a covering ball holds each, and has its middle in the area.
    held = places + np.maximum(0.5 * OPENING - room, 0.0)[:, None] * world.gradient(places)
    room[(held < area.lower - (0.0025, 0.0025, 0.0)).any(axis=1) | (held > area.upper + 0.0025).any(axis=1)] = 0.0
    bumps = np.sort(2.0 * room)[-40:]
    assert bumps[-1] > 0.0
    assert (bumps <= claimed).all()
    if not skip:  # without some lines the object may be hollow, as far as anybody knows
        assert claimed <= bumps[-1] + 6.0 * certificate.edge
    if not skip and pitch <= 0.004:
        assert claimed <= bumps[-1] + 0.0013  # as the covering ball sinks in, and as bumps are drawn at random


def test_between_strokes_far_apart_on_a_wall_near_the_border_a_ball_hides():
    """A covering ball that may go no farther out than the sphere's radius had not come between them: 5.5 mm of 10.9."""
    wide, height, apart = 0.045, 0.06, 0.025
    area = Area(np.array([-0.055, -0.065, 0.006]), np.array([0.006, 0.065, height + 0.01]))
    heights, across = np.arange(0.001, height, 0.002), np.arange(-0.05, 0.0501, 0.002)

    def grid(*along):
        return np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)

    places = [np.unique(np.append(np.arange(a, b, 0.002), b)) for a, b in zip(area.lower, area.upper)]
    free = grid(*places)
    block = np.array([[-0.04, -0.05, -1.0], [0.0, 0.05, height]])
    off = np.linalg.norm(np.maximum(np.maximum(block[0] - free, free - block[1]), 0.0), axis=1)
    between = (free[:, 0] > -0.001) & (free[:, 2] < height + RADIUS) & (np.abs(free[:, 1]) < 0.055)
    strokes = grid([RADIUS], np.arange(-2.5, 2.6) * apart, np.arange(0.006, height + RADIUS, 0.0005))
    depths = np.arange(-0.04, 0.0001, 0.002)
    touched = [
        strokes[(np.abs(strokes[:, 1]) <= 0.05) & (strokes[:, 2] <= height)] - (RADIUS, 0.0, 0.0),
        grid(depths, across, [height]), grid(depths, [-0.05, 0.05], heights), grid([-0.04], across, heights),
    ]  # fmt: skip
    centres = np.vstack([strokes, free[(off >= RADIUS) & ~between]])
    certificate = Certificate(area, RADIUS, opening=wide)
    certificate.sweep(centres, np.zeros(len(centres), bool))
    certificate.touch(np.vstack(touched))
    middles = np.array([[size, 0.0, 0.5 * height] for size in np.arange(0.001, area.upper[0] + 0.5 * RADIUS, 1e-5)])
    room = np.minimum(cKDTree(centres).query(middles)[0] - RADIUS, RADIUS - (middles[:, 0] - area.upper[0]))
    hidden = 2.0 * middles[room >= middles[:, 0], 0].max()
    covering = middles[0] * (0.0, 1.0, 1.0) + (0.5 * wide, 0.0, 0.0)  # holds each of them, and comes from above
    assert np.linalg.norm((covering - np.vstack(touched))[:, :2], axis=1).min() >= 0.5 * wide - 1e-9
    assert covering[0] <= area.upper[0] + 0.5 * wide - RADIUS
    assert hidden > 0.0105
    assert certificate.hiding().diameter >= hidden


@pytest.mark.parametrize(
    ("field", "given"),
    [
        ("radius", {"radius": np.nan}),
        ("radius", {"radius": -1.0}),
        ("opening", {"opening": 0.009}),
        ("opening", {"opening": np.inf}),
        ("tolerance", {"tolerance": 0.006}),
        ("max_voxels", {"max_voxels": 3}),
    ],
)
def test_bad_numbers_are_refused(field, given):
    with pytest.raises(InputError) as caught:
        Certificate(**{"area": small_area(), "radius": RADIUS, "opening": OPENING, **given})
    assert caught.value.field == field


@pytest.mark.parametrize("rows", [np.zeros((2, 2)), [[0.0, np.nan, 0.0]], "places"])
def test_bad_places_are_refused(rows):
    certificate = Certificate(small_area(), RADIUS, opening=OPENING)
    with pytest.raises(InputError, match="centres"):
        certificate.sweep(rows)
    with pytest.raises(InputError, match="points"):
        certificate.touch(rows)
