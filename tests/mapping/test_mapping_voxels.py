"""The voxel map holds exactly what was put in, and answers as a plain set of keys would."""

from __future__ import annotations

from itertools import pairwise

import naive_mapping as naive
import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import InputError, UnknownNameError
from lwrprobe.mapping import VoxelMap, VoxelState, kernels
from lwrprobe.mapping.voxel_set import MAX_WORDS

EDGE = 0.002
REACH = 32768 * EDGE


def cells_of(voxels):
    return {tuple(key) for key in naive.keys(voxels.centres(), voxels.resolution)}


def block(shape, low=(0, 0, 0)):
    cells = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    return (cells + low + 0.5) * EDGE


@pytest.mark.parametrize("spread", [0.004, 0.05, 1.0, 65.0])
def test_holds_what_a_set_of_keys_holds(spread):
    rng = np.random.default_rng(0)
    voxels, truth = VoxelMap(EDGE), set()
    for _ in range(5):
        points = rng.uniform(-spread, spread, (400, 3))
        fresh = {tuple(key) for key in naive.keys(points, EDGE)} - truth
        assert voxels.insert(points) == len(fresh)
        truth |= fresh
    assert len(voxels) == len(truth)
    assert cells_of(voxels) == truth
    asked = rng.uniform(-spread, spread, (500, 3))
    expected = [tuple(key) in truth for key in naive.keys(asked, EDGE)]
    assert [voxels.occupied(point) for point in asked] == expected
    assert (voxels.states(asked) == np.where(expected, VoxelState.OCCUPIED, VoxelState.UNKNOWN)).all()


def test_one_by_one_and_in_a_batch_are_the_same():
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (3000, 3))
    single, batch = VoxelMap(EDGE), VoxelMap(EDGE)
    fresh = [single.insert_point(point) for point in points]
    assert sum(fresh) == batch.insert(points) == len(single)
    assert not single.insert_point(points[0])
    np.testing.assert_array_equal(single.centres(), batch.centres())


def test_nodes_that_share_an_entry_of_the_index_are_told_apart():
    rng = np.random.default_rng(10)
    cells = 256 * rng.integers(-127, 128, (300, 3)) + rng.integers(0, 6, (300, 3))
    places, keys = zip(*(kernels.entry_of(*key) for key in (cells + 32768).tolist()))
    assert len(set(places)) == 1 < len(set(keys))
    voxels, truth = VoxelMap(EDGE), set()
    for cell in cells.tolist():
        assert voxels.insert_point((np.array(cell) + 0.5) * EDGE) == (tuple(cell) not in truth)
        truth.add(tuple(cell))
    others = np.concatenate([cells, cells + np.array([0, 0, 1]), cells + np.array([16, 0, 0]), -cells])
    expected = [tuple(cell) in truth for cell in others.tolist()]
    assert [voxels.occupied(point) for point in (others + 0.5) * EDGE] == expected
    assert (voxels.states((others + 0.5) * EDGE) == np.where(expected, VoxelState.OCCUPIED, VoxelState.UNKNOWN)).all()


def test_the_index_leads_right_where_nodes_have_filled_up():
    points = block((32, 16, 16))
    voxels = VoxelMap(EDGE)
    voxels.insert(points[np.random.default_rng(11).permutation(len(points))])
    assert len(voxels.leaves().sizes) == 2
    assert voxels.insert(points) == 0
    assert not voxels.insert_point(points[-1])
    assert voxels.insert_point(points[-1] + [EDGE, 0.0, 0.0])
    assert (voxels.states(points) == VoxelState.OCCUPIED).all()
    assert len(voxels) == len(points) + 1


def test_a_place_outside_is_named_when_asked_in_a_batch():
    points = np.zeros((4, 3))
    points[2, 1] = REACH
    with pytest.raises(InputError, match=r"points\[2\]"):
        VoxelMap(EDGE).states(points)


def test_keys_are_octomaps_at_every_border():
    reference = octomap.OcTree(EDGE)
    rng = np.random.default_rng(2)
    steps = rng.integers(-32768, 32768, 2000)
    xs = np.concatenate([steps * EDGE, steps * EDGE * (1 + 1e-7), steps * EDGE * (1 - 1e-7), [-REACH]])
    xs = xs.astype(np.float32).astype(float)  # the reference's points have single precision
    for x in xs[(xs >= -REACH) & (xs < REACH)]:
        assert kernels.key_of(x, 1.0 / EDGE) == reference.coordToKey(np.array([x, 0.0, 0.0]))[0]


def test_the_range_ends_where_it_says():
    voxels = VoxelMap(EDGE)
    assert voxels.reach == REACH
    low, high = np.full(3, -REACH), np.full(3, np.nextafter(REACH, 0.0))
    assert voxels.insert(np.array([low, high])) == 2
    assert voxels.occupied(low)
    np.testing.assert_allclose(voxels.bounds(), [[-REACH] * 3, [REACH] * 3])
    for outside in (REACH, -REACH - EDGE, np.inf, -np.inf, np.nan, 1e300):
        for axis in range(3):
            point = np.zeros(3)
            point[axis] = outside
            for ask in (voxels.insert_point, voxels.occupied, voxels.state, voxels.nearest):
                with pytest.raises(InputError, match="point"):
                    ask(point)
            with pytest.raises(InputError, match=r"points\[1\]"):
                voxels.insert(np.array([np.zeros(3), point]))
    assert len(voxels) == 2, "a refused batch must leave nothing behind"


@pytest.mark.parametrize("bad", [None, "abc", 1.0, [1.0, 2.0], np.zeros(4), np.zeros((3, 1)), [[0.0, 0.0, 0.0]]])
def test_refuses_what_is_no_point(bad):
    voxels = VoxelMap()
    for ask in (voxels.insert_point, voxels.occupied, voxels.state, voxels.nearest):
        with pytest.raises(InputError, match="point"):
            ask(bad)
    if np.shape(bad) != (1, 3):
        with pytest.raises(InputError, match="points"):
            voxels.insert(bad)


def test_takes_points_in_any_dress():
    voxels = VoxelMap(EDGE)
    pose = np.eye(4)
    pose[:3, 3] = 0.1, 0.2, 0.3
    assert voxels.insert_point(pose[:3, 3])
    for same in ([0.1, 0.2, 0.3], (0.1, 0.2, 0.3), np.array([0.1, 0.2, 0.3], np.float32)):
        assert voxels.occupied(same)
    assert voxels.insert(np.asfortranarray(np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]))) == 1
    assert voxels.insert(np.empty((0, 3))) == 0


@pytest.mark.parametrize("resolution", [0.0, -0.002, np.nan, np.inf, 1e-7, 2e3, None, "fine", [0.002]])
def test_refuses_a_senseless_resolution(resolution):
    with pytest.raises(InputError, match="resolution"):
        VoxelMap(resolution)


def test_nearest_is_the_nearest_of_all():
    rng = np.random.default_rng(3)
    for spread, count in ((0.01, 3), (0.05, 200), (30.0, 500)):
        voxels = VoxelMap(EDGE)
        voxels.insert(rng.uniform(-spread, spread, (count, 3)))
        cells = naive.keys(voxels.centres(), EDGE)
        for point in rng.uniform(-1.5 * spread, 1.5 * spread, (100, 3)):
            distance, centre = voxels.nearest(point)
            assert distance == pytest.approx(naive.nearest(cells, EDGE, point), rel=1e-12)
            assert np.linalg.norm(centre - point) == pytest.approx(distance, rel=1e-12)
            assert voxels.occupied(centre)


def test_nearest_in_filled_cubes_and_on_an_empty_map():
    voxels = VoxelMap(EDGE)
    distance, centre = voxels.nearest(np.zeros(3))
    assert distance == np.inf
    assert np.isnan(centre).all()
    voxels.insert(block((16, 16, 16)))
    cells = naive.keys(voxels.centres(), EDGE)
    for point in np.random.default_rng(4).uniform(-0.03, 0.06, (200, 3)):
        assert voxels.nearest(point)[0] == pytest.approx(naive.nearest(cells, EDGE, point), rel=1e-12)


@pytest.mark.slow
def test_full_cubes_are_pruned_and_still_all_there():
    points = block((64, 64, 64))
    voxels = VoxelMap(EDGE)
    voxels.insert(points[np.random.default_rng(5).permutation(len(points))])
    leaves = voxels.leaves()
    assert len(leaves.sizes) == 1
    assert leaves.sizes[0] == pytest.approx(64 * EDGE)
    np.testing.assert_allclose(leaves.centres[0], 32 * EDGE)
    assert len(voxels) == 64**3
    assert cells_of(voxels) == {tuple(key) for key in naive.keys(points, EDGE)}
    assert voxels.insert(points[:100]) == 0


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-6, 6)] * 3), min_size=1, max_size=400))
def test_leaves_cover_the_voxels_once(cells):
    voxels = VoxelMap(EDGE)
    voxels.insert((np.array(cells) + 0.5) * EDGE)
    leaves = voxels.leaves()
    assert (leaves.states == VoxelState.OCCUPIED).all()
    assert round(((leaves.sizes / EDGE) ** 3).sum()) == len(voxels) == len(set(cells))


def test_bounds_and_length():
    voxels = VoxelMap(EDGE)
    assert voxels.bounds() is None
    assert len(voxels) == 0
    voxels.insert(np.array([[0.001, 0.011, -0.001], [0.021, -0.003, 0.005]]))
    low, high = voxels.bounds()
    np.testing.assert_allclose(low, [0.0, -0.004, -0.002])
    np.testing.assert_allclose(high, [0.022, 0.012, 0.006])


@pytest.mark.parametrize("radius", [0.0018, 0.005, 0.0123])
def test_carves_the_voxels_that_lie_wholly_in_the_swept_sphere(radius):
    rng = np.random.default_rng(6)
    for length in (0.0, 0.0003, 0.01, 0.12):
        begin = rng.uniform(-0.05, 0.05, 3)
        end = begin + length * rng.normal(size=3)
        voxels = VoxelMap(EDGE)
        voxels.carve_path(np.array([begin, end]), radius)
        found = {tuple(key) for key in naive.keys(voxels.free_centres(), EDGE)}
        assert found == naive.swept(begin, end, radius, EDGE)
        assert voxels.free_count() == len(found)


def test_a_path_carves_what_its_segments_carve():
    path = np.cumsum(np.random.default_rng(7).normal(0.0, 0.004, (60, 3)), axis=0)
    whole, parts = VoxelMap(EDGE), VoxelMap(EDGE)
    whole.carve_path(path, 0.005)
    for begin, end in pairwise(path):
        parts.carve_path(np.array([begin, end]), 0.005)
    np.testing.assert_array_equal(whole.free_centres(), parts.free_centres())
    whole.carve_path(np.empty((0, 3)), 0.005)
    single = VoxelMap(EDGE)
    single.carve_path(path[:1], 0.005)
    assert {tuple(k) for k in naive.keys(single.free_centres(), EDGE)} == naive.swept(path[0], path[0], 0.005, EDGE)


def test_what_was_touched_stays_occupied_and_what_was_swept_can_be_touched():
    voxels = VoxelMap(EDGE)
    touched = np.array([0.001, 0.001, 0.001])
    voxels.insert_point(touched)
    voxels.carve_path(np.array([touched]), 0.01)
    assert voxels.state(touched) is VoxelState.OCCUPIED
    beside = touched + np.array([0.004, 0.0, 0.0])
    assert voxels.state(beside) is VoxelState.FREE
    before = voxels.free_count()
    assert voxels.insert_point(beside)
    assert voxels.state(beside) is VoxelState.OCCUPIED
    assert voxels.free_count() == before - 1
    assert voxels.state(touched + 0.1) is VoxelState.UNKNOWN
    assert not {tuple(c) for c in voxels.free_centres()} & {tuple(c) for c in voxels.centres()}


def test_carving_at_the_end_of_the_range_and_refusals():
    voxels = VoxelMap(EDGE)
    corner = np.full(3, REACH - 0.001)
    voxels.carve_path(np.array([corner]), 0.005)
    assert voxels.free_count() > 0
    with pytest.raises(InputError, match="path"):
        voxels.carve_path(np.array([[0.0, 0.0, np.nan]]), 0.005)
    with pytest.raises(InputError, match="path"):
        voxels.carve_path([0.0], 0.005)
    for radius in (0.0, -1.0, np.nan, np.inf, 1.0, None, np.array(0.004), [0.004]):
        with pytest.raises(InputError, match="radius"):
            voxels.carve_path(np.zeros((1, 3)), radius)


def test_growth_has_an_end(monkeypatch):
    monkeypatch.setattr("lwrprobe.mapping.voxel_set.MAX_WORDS", 1 << 13)
    voxels = VoxelMap(EDGE)
    with pytest.raises(InputError, match="map"):
        voxels.insert(np.random.default_rng(8).uniform(-60.0, 60.0, (2000, 3)))
    assert MAX_WORDS <= 1 << kernels.PLACE_BITS


def test_a_list_too_long_for_memory_is_refused(monkeypatch):
    monkeypatch.setattr("lwrprobe.mapping.voxel_map.MAX_VOXELS_LISTED", 100)
    voxels = VoxelMap(EDGE)
    voxels.insert(block((5, 5, 5)))
    with pytest.raises(InputError, match="leaves"):
        voxels.centres()


def test_unknown_ending(tmp_path):
    with pytest.raises(UnknownNameError, match=r"\.bt"):
        VoxelMap().write(tmp_path / "map.xyz")
    with pytest.raises(UnknownNameError, match=r"\.ot"):
        VoxelMap.read(tmp_path / "map.btt")


def test_bits():
    rng = np.random.default_rng(9)
    words = [0, -1, 1, -(2**63), 2**63 - 1, *rng.integers(-(2**63), 2**63 - 1, 200).tolist()]
    for word in words:
        bits = f"{word & (2**64 - 1):064b}"
        assert kernels.bit_count(word) == bits.count("1")
        assert kernels.lowest_bit(word) == (64 if word == 0 else len(bits) - 1 - bits.rindex("1"))
