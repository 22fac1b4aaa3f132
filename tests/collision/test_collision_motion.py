"""Threats along a motion step, the table, the robot against itself, and known meshes."""

from __future__ import annotations

import numpy as np
import pytest
from naive_collision import at
from scipy.spatial.transform import Rotation, Slerp

from lwrprobe.collision import ClearanceQuery
from lwrprobe.contracts import InputError, LinkShape, TriangleMesh, UnknownNameError
from lwrprobe.mapping import VoxelMap


def between(a, b, count):
    t = np.linspace(0.0, 1.0, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Slerp([0.0, 1.0], Rotation.from_matrix([a[:3, :3], b[:3, :3]]))(t).as_matrix()
    poses[:, :3, 3] = np.outer(1.0 - t, a[:3, 3]) + np.outer(t, b[:3, 3])
    return poses


def probe_links():
    return [
        LinkShape("stick", "cylinder", (0.002, 0.040), at(z=-0.025)),
        LinkShape("holder", "capsule", (0.0125, 0.04), at(z=-0.08)),
        LinkShape("finger", "box", (0.012, 0.02, 0.07), at(y=0.02, z=-0.12)),
    ]


def one_voxel(x, y, z):
    voxels = VoxelMap(0.002)
    voxels.insert_point(np.array([x, y, z]))
    return voxels


def test_a_threat_in_the_middle_of_a_step_is_seen():
    query = ClearanceQuery(probe_links(), one_voxel(0.001, 0.001, -0.025))
    begin, end = at(x=-0.1), at(x=0.1)
    assert query.nearest(begin).distance > 0.08
    assert query.nearest(end).distance > 0.08
    assert query.ahead(begin, end).distance == 0.0


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_ahead_is_never_too_large_and_hardly_too_small(tolerance):
    rng = np.random.default_rng(2)
    voxels = VoxelMap(0.002)
    voxels.insert(rng.uniform(-0.03, 0.03, (40, 3)))
    query = ClearanceQuery(probe_links(), voxels)
    for _ in range(10):
        begin = at(*rng.uniform(0.05, 0.1, 3), turn=rng.uniform(-2, 2, 3))
        end = begin @ at(*rng.uniform(-0.02, 0.02, 3), turn=rng.uniform(-0.5, 0.5, 3))
        sampled = query.nearest_batch(between(begin, end, 2001))[:, 0].min()
        ahead = query.ahead(begin, end, tolerance=tolerance)
        assert ahead.distance <= sampled + 1e-6
        assert ahead.distance >= sampled - tolerance - 1e-4 * (sampled > 0.0)


def test_half_a_turn_and_no_motion_at_all():
    query = ClearanceQuery(probe_links(), one_voxel(0.2, 0.0, 0.0))
    pose = at(z=0.1)
    assert query.ahead(pose, pose).distance == pytest.approx(query.nearest(pose).distance, abs=1e-6)
    for axis in np.eye(3):
        turned = pose @ at(turn=np.pi * axis)
        sampled = min(query.nearest(pose @ at(turn=t * axis)).distance for t in np.linspace(0.0, np.pi, 500))
        assert query.ahead(pose, turned, tolerance=1e-5).distance <= sampled + 1e-4


def test_enough_ends_the_search_but_stays_a_lower_bound():
    query = ClearanceQuery(probe_links(), one_voxel(0.001, 0.001, 0.051))
    begin, end = at(x=-0.02), at(x=0.02)
    exact = query.ahead(begin, end, tolerance=1e-5).distance
    rough = query.ahead(begin, end, tolerance=1e-5, enough=0.01).distance
    assert 0.01 <= rough <= exact + 1e-6


def test_ahead_on_an_empty_map_and_with_bad_input():
    query = ClearanceQuery(probe_links(), VoxelMap())
    assert query.ahead(np.eye(4), at(x=1.0)).distance == np.inf
    with pytest.raises(InputError, match="tolerance"):
        query.ahead(np.eye(4), np.eye(4), tolerance=0.0)
    with pytest.raises(InputError, match="enough"):
        query.ahead(np.eye(4), np.eye(4), enough=-1.0)
    with pytest.raises(InputError, match="pose_b"):
        query.ahead(np.eye(4), np.full((4, 4), np.nan))


def test_links_on_arm_frames_sweep_too():
    forearm = LinkShape("forearm", "capsule", (0.05, 0.2), np.eye(4), carrier="1")
    query = ClearanceQuery([forearm], one_voxel(0.001, 0.301, 0.001))
    begin, end = np.tile(np.eye(4), (2, 1, 1)), np.tile(np.eye(4), (2, 1, 1))
    end[1] = at(y=0.2)
    found = query.ahead(np.eye(4), np.eye(4), begin, end)
    assert found.distance == pytest.approx(0.1 - 0.05, abs=2e-4)


def above_table(query, pose, frames=None):
    """Distance of the lowest link from the table at rest, and the link."""
    return query.table_ahead(pose, pose, frames, frames)


def test_table_clearance_is_the_lowest_link():
    query = ClearanceQuery(probe_links(), VoxelMap(), table=np.array([0.0, 0.0, 1.0, -0.1]))
    distance, link = above_table(query, at(turn=(np.pi, 0.0, 0.0)))
    assert link == "stick"
    assert distance == pytest.approx(0.1 + 0.005)
    upright, link = above_table(query, np.eye(4))
    assert link == "finger"
    assert upright == 0.0  # its lower end is 55 mm below the table
    tilted, link = above_table(query, at(z=0.1, turn=(0.0, np.pi / 2, 0.0)))
    assert link == "holder"
    assert tilted == pytest.approx(0.2 - 0.0125)
    assert above_table(ClearanceQuery(probe_links(), VoxelMap()), np.eye(4)) == (np.inf, "")


def test_self_clearance_finds_the_nearest_pair():
    links = [*probe_links(), LinkShape("forearm", "capsule", (0.05, 0.2), np.eye(4), carrier="0")]
    query = ClearanceQuery(links, VoxelMap())
    frames = at(x=0.2, z=-0.08)[None]
    pairs = [("stick", "forearm"), ("holder", "forearm")]
    distance, pair = query.self_clearance(pairs, np.eye(4), frames)
    assert pair == ("holder", "forearm")
    assert distance == pytest.approx(0.2 - 0.05 - 0.0125, abs=1e-6)
    assert query.self_clearance(pairs, np.eye(4), at(x=0.01)[None])[0] == 0.0
    assert query.self_clearance([], np.eye(4), frames) == (np.inf, None)
    with pytest.raises(UnknownNameError, match="forearm"):
        query.self_clearance([("stick", "fore")], np.eye(4), frames)


def test_a_step_into_the_table_is_found_before_the_motion():
    """Both ends of the step are far from harm; what lies between is not."""
    links = [*probe_links(), LinkShape("forearm", "capsule", (0.02, 0.2), np.eye(4), carrier="0")]
    query = ClearanceQuery(links, VoxelMap(), table=np.array([0.0, 0.0, 1.0, 0.0]))
    frames = at(x=0.5, z=1.0)[None]
    up, down = at(z=0.17, turn=(0.0, 0.4, 0.0)), at(z=0.17, turn=(0.0, -0.4, 0.0))
    ends = [above_table(query, pose, frames)[0] for pose in (up, down)]
    swung, link = query.table_ahead(up, down, frames, frames)
    assert link == "finger"
    assert swung < min(ends) - 0.005
    sampled = min(above_table(query, pose, frames)[0] for pose in between(up, down, 400))
    assert sampled - 3e-4 <= swung <= sampled + 1e-6


def test_a_mesh_in_the_way_is_seen_ahead():
    query = ClearanceQuery(probe_links(), VoxelMap(), obstacles=[cube_mesh((0.0, 0.0, -0.08), 0.02)])
    assert query.ahead(at(x=-0.2), at(x=0.2)).distance == 0.0
    assert query.ahead(at(x=-0.2), at(x=-0.1)).distance == pytest.approx(0.1 - 0.01 - 0.0125, abs=2e-4)


def test_ten_thousand_voxels_of_a_tall_block_beside_the_holder():
    """The tip is free on the way down along the wall; the holder, wider than the stick, is what would strike."""
    side, height = np.arange(0.0, 0.1, 0.002), np.arange(0.0, 0.4, 0.002)
    wall = np.array([[0.0, y, z] for y in side for z in height]) + 0.001
    voxels = VoxelMap(0.002)
    assert voxels.insert(wall) == 10_000
    query = ClearanceQuery(probe_links(), voxels)
    above, below = at(-0.010, 0.05, 0.6, turn=(np.pi, 0.0, 0.0)), at(-0.010, 0.05, 0.05, turn=(np.pi, 0.0, 0.0))
    found = query.ahead(above, below)
    assert found.distance == 0.0
    assert found.link == "holder"
    beside = np.array([-0.02, 0.0, 0.0])
    above[:3, 3] += beside
    below[:3, 3] += beside
    assert query.ahead(above, below).distance == pytest.approx(0.03 - 0.0125, abs=3e-4)


def test_a_long_step_is_looked_at_more_coarsely_but_in_time():
    query = ClearanceQuery(probe_links(), one_voxel(0.0, 0.5, 0.0))
    found = query.ahead(at(x=-30.0), at(x=30.0), tolerance=1e-6)
    exact = query.nearest(at(x=0.0)).distance
    assert exact - 60.0 / 2000 - 1e-3 <= found.distance <= exact + 1e-6


def cube_mesh(centre, edge):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    return TriangleMesh((corners - 0.5) * edge + centre, np.array(faces))


def test_a_known_mesh_counts_beside_the_voxels():
    query = ClearanceQuery(probe_links(), one_voxel(-0.3, 0.0, -0.08), obstacles=[cube_mesh((0.1, 0.0, -0.08), 0.1)])
    found = query.nearest(np.eye(4))
    assert found.link == "holder"
    assert found.distance == pytest.approx(0.05 - 0.0125, abs=1e-4)
    assert found.on_map[0] == pytest.approx(0.05, abs=1e-4)
    assert query.nearest(at(x=0.06)).distance == 0.0
    nearer_voxel = query.nearest(at(x=-0.25))
    assert nearer_voxel.distance == pytest.approx(0.05 - 0.0125 - 0.002, abs=2e-3)


def test_refuses_broken_meshes():
    for mesh in (
        TriangleMesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]])),
        TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 3]])),
        TriangleMesh(np.zeros((3, 3)), np.empty((0, 3), int)),
    ):
        with pytest.raises(InputError, match=r"obstacles\[0\]"):
            ClearanceQuery(probe_links(), VoxelMap(), obstacles=[mesh])
