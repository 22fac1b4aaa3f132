"""The nearest pair is the one that brute force finds, whatever the shapes, the pose and the map."""

from __future__ import annotations

import numpy as np
import pytest
from naive_collision import at, clearance, gap_between, inside

from lwrprobe.collision import NO_FRAMES, ClearanceQuery
from lwrprobe.contracts import InputError, LinkShape, UnknownNameError
from lwrprobe.mapping import VoxelMap

MICROMETRE = 1e-6


def probe_links():
    return [
        LinkShape("stick", "cylinder", (0.002, 0.040), at(z=-0.025)),
        LinkShape("sensor", "cylinder", (0.0085, 0.0145), at(z=-0.0525)),
        LinkShape("holder", "capsule", (0.0125, 0.04), at(z=-0.08)),
        LinkShape("finger_left", "box", (0.012, 0.02, 0.07), at(y=0.02, z=-0.12)),
        LinkShape("finger_right", "box", (0.012, 0.02, 0.07), at(y=-0.02, z=-0.12, turn=(0.1, 0.2, 0.3))),
    ]


def random_pose(rng, spread, turn=np.pi):
    return at(*rng.uniform(-spread, spread, 3), turn=rng.uniform(-1, 1, 3) * turn)


def assert_nearest_pair(found, link, pose, centre, edge):
    """Both witnesses lie in their bodies and no nearer pair exists: parallel planes that far apart part the bodies."""
    assert inside(link, pose, found.on_robot, slack=MICROMETRE)
    assert (np.abs(found.on_map - centre) <= 0.5 * edge + MICROMETRE).all()
    assert np.linalg.norm(found.on_robot - found.on_map) == pytest.approx(found.distance, abs=MICROMETRE)
    if found.distance == 0.0:
        return  # a point that is in both is proof enough
    displacement = found.on_map - found.on_robot
    assert (
        gap_between(link, pose, centre, edge, displacement / np.linalg.norm(displacement))
        >= found.distance - MICROMETRE
    )


def test_agrees_with_brute_force_to_a_micrometre():
    rng = np.random.default_rng(3)
    links = probe_links()
    for _ in range(10):
        voxels = VoxelMap(0.002)
        voxels.insert(rng.uniform(-0.05, 0.05, (rng.integers(1, 60), 3)))
        pose = random_pose(rng, 0.1)
        found = ClearanceQuery(links, voxels).nearest(pose)
        assert found.distance == pytest.approx(clearance(links, {"tip": pose}, voxels.centres(), 0.002), abs=MICROMETRE)


@pytest.mark.parametrize("kind", ["cylinder", "capsule", "box"])
@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-9, 1e-6, 1e-4, 0.03, np.pi / 4, np.pi / 2])
def test_near_parallel_faces_and_edges(kind, turn):
    """Where projections back and forth crawl and simplices go flat."""
    rng = np.random.default_rng(5)
    link = LinkShape("link", kind, (0.01, 0.04) if kind != "box" else (0.02, 0.02, 0.04), np.eye(4))
    voxels = VoxelMap(0.002)
    centre = np.array([0.001, 0.001, 0.001])
    voxels.insert_point(centre)
    query = ClearanceQuery([link], voxels)
    for axis in np.vstack([np.eye(3), rng.normal(size=(3, 3))]):
        for distance in (1e-5, 1e-3, 0.1, 10.0):
            for displacement in ((1, 0, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (1, 1, 1)):
                pose = at(*(np.array(displacement) * (0.022 + distance)), turn=turn * axis / np.linalg.norm(axis))
                assert_nearest_pair(query.nearest(pose), link, pose, centre, 0.002)


def test_every_answer_is_certified():
    rng = np.random.default_rng(7)
    links = {link.name: link for link in probe_links()}
    voxels = VoxelMap(0.002)
    voxels.insert(rng.uniform(-0.05, 0.05, (500, 3)))
    query = ClearanceQuery(list(links.values()), voxels)
    free = 0
    for _ in range(2000):
        pose = random_pose(rng, 0.15)
        found = query.nearest(pose)
        free += found.distance > 0.0
        _, centre = voxels.nearest(found.on_map)
        assert_nearest_pair(found, links[found.link], pose, centre, 0.002)
    assert free > 1000


def test_zero_in_collision():
    voxels = VoxelMap(0.002)
    voxels.insert_point(np.array([0.3, 0.1, 0.05]))
    for link in probe_links():
        query = ClearanceQuery([link], voxels)
        for off in (0.0, 1e-4):
            inside_pose = np.eye(4)
            inside_pose[:3, 3] = np.array([0.301, 0.101 + off, 0.051]) - link.pose[:3, 3]
            found = query.nearest(inside_pose)
            assert found.distance == 0.0
            assert found.link == link.name
            np.testing.assert_array_equal(found.on_robot, found.on_map)


def test_just_touching_and_just_not():
    voxels = VoxelMap(0.002)
    voxels.insert_point(np.array([0.001, 0.001, 0.001]))
    link = LinkShape("stick", "cylinder", (0.002, 0.04), np.eye(4))
    query = ClearanceQuery([link], voxels)
    assert query.nearest(at(x=0.004 + 1e-5, y=0.001)).distance == pytest.approx(1e-5, abs=2e-7)
    assert query.nearest(at(x=0.004 - 1e-5, y=0.001)).distance == 0.0


def test_an_empty_map_is_infinitely_far():
    found = ClearanceQuery(probe_links(), VoxelMap()).nearest(np.eye(4))
    assert found.distance == np.inf
    assert found.link == ""
    assert ClearanceQuery([], VoxelMap()).nearest(np.eye(4)).distance == np.inf


def test_a_voxel_added_later_is_seen_without_a_rebuild():
    voxels = VoxelMap(0.002)
    voxels.insert_point(np.array([0.5, 0.0, 0.0]))
    query = ClearanceQuery(probe_links(), voxels)
    far = query.nearest(np.eye(4)).distance
    voxels.insert(np.random.default_rng(0).uniform(0.3, 0.6, (5000, 3)))  # outgrows the first array
    voxels.insert_point(np.array([0.02, 0.0, -0.02]))
    near = query.nearest(np.eye(4))
    assert near.distance < 0.02 < far
    assert near.distance == pytest.approx(
        clearance(probe_links(), {"tip": np.eye(4)}, np.array([[0.021, 0.001, -0.021]]), 0.002), abs=0.003
    )


@pytest.mark.slow
def test_filled_blocks_of_voxels_count_as_solid():
    grid = np.stack(np.meshgrid(*[np.arange(-16, 16)] * 3), -1).reshape(-1, 3) * 0.002 + 0.001
    voxels = VoxelMap(0.002)
    voxels.insert(grid)
    link = LinkShape("stick", "capsule", (0.002, 0.02), np.eye(4))
    query = ClearanceQuery([link], voxels)
    rng = np.random.default_rng(1)
    shell = grid[np.abs(grid).max(1) > 0.03]
    for _ in range(8):
        pose = random_pose(rng, 0.1)
        outside = np.maximum(np.abs(pose[:3, 3]) - 0.032, 0.0)
        if np.linalg.norm(outside) < 0.015:
            continue
        assert query.nearest(pose).distance == pytest.approx(
            clearance([link], {"tip": pose}, shell, 0.002, 300), abs=1e-5
        )
    assert query.nearest(np.eye(4)).distance == 0.0


def test_links_ride_on_arm_frames():
    voxels = VoxelMap(0.002)
    voxels.insert_point(np.array([0.001, 0.001, 0.301]))
    forearm = LinkShape("forearm", "capsule", (0.05, 0.2), np.eye(4), carrier="4")
    query = ClearanceQuery([*probe_links(), forearm], voxels)
    frames = np.tile(np.eye(4), (8, 1, 1))
    frames[4, :3, 3] = 0.2, 0.0, 0.3
    found = query.nearest(at(x=1.0), frames)
    assert found.link == "forearm"
    assert found.distance == pytest.approx(0.2 - 0.05 - 0.002, abs=MICROMETRE)
    with pytest.raises(InputError, match="link_frames"):
        query.nearest(at(x=1.0))


def test_batch_gives_what_single_calls_give():
    rng = np.random.default_rng(11)
    voxels = VoxelMap(0.002)
    voxels.insert(rng.uniform(-0.05, 0.05, (300, 3)))
    query = ClearanceQuery(probe_links(), voxels)
    poses = np.array([random_pose(rng, 0.1) for _ in range(50)])
    answers = query.nearest_batch(poses)
    single = np.empty(8)
    for pose, answer in zip(poses, answers):
        query.nearest_into(pose, NO_FRAMES, single)
        np.testing.assert_array_equal(answer, single)
    assert len(query.nearest_batch(np.empty((0, 4, 4)))) == 0


@pytest.mark.parametrize(
    ("break_it", "field"),
    [
        (lambda pose: pose * np.nan, "tip_pose"),
        (lambda pose: pose[:3], "tip_pose"),
        (lambda pose: np.diag([2.0, 2.0, 2.0, 1.0]), "tip_pose"),
        (lambda pose: np.diag([1.0, 1.0, -1.0, 1.0]), "tip_pose"),
        (lambda pose: pose + np.inf, "tip_pose"),
    ],
)
def test_refuses_what_is_no_pose(break_it, field):
    query = ClearanceQuery(probe_links(), VoxelMap())
    with pytest.raises(InputError, match=field):
        query.nearest(break_it(np.eye(4)))


def test_refuses_unknown_kinds_and_carriers():
    with pytest.raises(UnknownNameError, match="cylinder"):
        ClearanceQuery([LinkShape("a", "cone", (1.0, 1.0), np.eye(4))], VoxelMap())
    with pytest.raises(InputError, match="carrier"):
        ClearanceQuery([LinkShape("a", "box", (1.0, 1.0, 1.0), np.eye(4), carrier="-1")], VoxelMap())
