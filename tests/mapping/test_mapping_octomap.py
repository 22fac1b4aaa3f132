"""OctoMap's own library reads our files, we read its, and both write the same bytes."""

from __future__ import annotations

import struct

import naive_mapping as naive
import numpy as np
import octomap
import pytest

from lwrprobe.contracts import FormatError
from lwrprobe.mapping import VoxelMap, VoxelState, describe, to_cloud
from lwrprobe.mapping.clouds import read_cloud

EDGE = 0.002
HEAD = b"# Octomap OcTree binary file\nid OcTree\nsize 1\nres 0.002\ndata\n\0\0"


def judge_of(voxels):
    tree = octomap.OcTree(voxels.resolution)
    for centre in voxels.centres():
        tree.updateNode(centre, True)
    for centre in voxels.free_centres():
        tree.updateNode(centre, False)
    return tree


def judge_states(path):
    if path.suffix == ".ot":
        return octomap.OcTree.read(str(path))
    tree = octomap.OcTree(EDGE)
    assert tree.readBinary(str(path))
    return tree


def random_map(seed, spread=0.03, count=400):
    rng = np.random.default_rng(seed)
    voxels = VoxelMap(EDGE)
    voxels.insert(rng.uniform(-spread, spread, (count, 3)))
    voxels.carve_path(rng.uniform(-0.03, 0.03, (6, 3)), 0.008)
    return voxels


def test_golden_bytes(tmp_path):
    voxels = VoxelMap(EDGE)
    voxels.insert(np.array([[0.001, 0.001, 0.001], [0.003, 0.001, 0.001], [-0.001, 0.001, 0.001]]))
    head, data = voxels.write(tmp_path / "a.bt").read_bytes().split(b"\ndata\n")
    lines = head.decode().split("\n")
    assert lines[0].startswith("# Octomap OcTree binary file")
    assert lines[-3:] == ["id OcTree", "size 34", "res 0.002"]
    assert data.hex() == "00f0" + 14 * "0c00" + "0800" + 14 * "0300" + "0a00"
    assert len(data) == 62


@pytest.mark.parametrize("seed", range(4))
def test_the_same_bytes_as_octomap(seed, tmp_path):
    voxels = random_map(seed, spread=(0.01, 0.03, 0.1, 20.0)[seed])
    judge_of(voxels).writeBinary(str(tmp_path / "theirs.bt"))
    assert voxels.write(tmp_path / "ours.bt").read_bytes() == (tmp_path / "theirs.bt").read_bytes()


def test_pruned_cubes_have_the_same_bytes(tmp_path):
    grid = np.stack(np.meshgrid(*[np.arange(-9, 14)] * 3), -1).reshape(-1, 3)
    voxels = VoxelMap(EDGE)
    voxels.insert((grid + 0.5) * EDGE)
    judge_of(voxels).writeBinary(str(tmp_path / "theirs.bt"))
    assert voxels.write(tmp_path / "ours.bt").read_bytes() == (tmp_path / "theirs.bt").read_bytes()
    assert 1 < len(voxels.leaves().sizes) < len(voxels)


def test_log_odds_files_agree_with_octomap(tmp_path):
    voxels = random_map(5)
    tree = judge_states(voxels.write(tmp_path / "a.bt"))
    tree.write(str(tmp_path / "theirs.ot"))
    assert voxels.write(tmp_path / "ours.ot").read_bytes() == (tmp_path / "theirs.ot").read_bytes()
    assert judge_states(tmp_path / "ours.ot").size() == tree.size()


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_octomap_sees_every_voxel_of_ours(ending, tmp_path):
    voxels = random_map(6)
    tree = judge_states(voxels.write(tmp_path / f"a{ending}"))
    asked = np.random.default_rng(0).uniform(-0.04, 0.04, (3000, 3))
    labels = tree.getLabels(asked)  # 1 occupied, 0 free, -1 unknown
    states = voxels.states(asked)
    np.testing.assert_array_equal(
        states, np.choose(labels + 1, [VoxelState.UNKNOWN, VoxelState.FREE, VoxelState.OCCUPIED])
    )


@pytest.mark.parametrize("ending", [".bt", ".ot"])
@pytest.mark.parametrize("seed", range(3))
def test_reads_back_what_was_written(ending, seed, tmp_path):
    voxels = random_map(seed, spread=(0.01, 0.05, 40.0)[seed])
    path = voxels.write(tmp_path / f"a{ending}")
    back = VoxelMap.read(path)
    assert back.resolution == voxels.resolution
    assert len(back) == len(voxels)
    assert back.free_count() == voxels.free_count()
    np.testing.assert_array_equal(back.centres(), voxels.centres())
    np.testing.assert_array_equal(back.free_centres(), voxels.free_centres())
    np.testing.assert_allclose(back.bounds(), voxels.bounds())
    assert back.write(tmp_path / f"b{ending}").read_bytes() == path.read_bytes()


def test_reads_a_map_that_octomap_made_from_rays(tmp_path):
    tree = octomap.OcTree(EDGE)
    points = np.random.default_rng(1).normal(0.0, 1.0, (300, 3))
    points *= 0.04 / np.linalg.norm(points, axis=1)[:, None]
    tree.insertPointCloud(points, np.zeros(3))
    tree.writeBinary(str(tmp_path / "rays.bt"))
    tree.write(str(tmp_path / "rays.ot"))
    asked = np.random.default_rng(2).uniform(-0.05, 0.05, (3000, 3))
    wanted = np.choose(tree.getLabels(asked) + 1, [VoxelState.UNKNOWN, VoxelState.FREE, VoxelState.OCCUPIED])
    for name in ("rays.bt", "rays.ot"):
        np.testing.assert_array_equal(VoxelMap.read(tmp_path / name).states(asked), wanted)


def test_a_read_map_can_grow_on(tmp_path):
    voxels = random_map(7)
    back = VoxelMap.read(voxels.write(tmp_path / "a.bt"))
    more = np.random.default_rng(3).uniform(-0.05, 0.05, (2000, 3))
    assert back.insert(more) == voxels.insert(more)
    assert back.write(tmp_path / "b.bt").read_bytes() == voxels.write(tmp_path / "c.bt").read_bytes()


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_an_empty_map(ending, tmp_path):
    path = VoxelMap(EDGE).write(tmp_path / f"empty{ending}")
    assert path.read_bytes().endswith(b"size 0\nres 0.002\ndata\n")
    assert len(VoxelMap.read(path)) == 0
    assert judge_states(path).size() == 0


def test_whole_space_in_one_node_of_a_log_odds_file(tmp_path):
    path = tmp_path / "all.ot"
    head = b"# Octomap OcTree file\nid OcTree\nsize 1\nres 0.5\ndata\n"
    path.write_bytes(head + struct.pack("<fB", 1.0, 0))
    voxels = VoxelMap.read(path)
    assert len(voxels) == 65536**3
    assert voxels.occupied(np.array([-1e4, 0.0, 1e4]))
    assert voxels.nearest(np.array([0.2, 0.2, 0.2]))[0] == pytest.approx(np.sqrt(3) * 0.05)
    assert VoxelMap.read(voxels.write(tmp_path / "all.bt")).state(np.zeros(3)) is VoxelState.OCCUPIED


def test_many_resolutions_survive(tmp_path):
    for resolution in (0.002, 0.005, 0.1, 1.0, 5.0, 1e-6, 0.0123456789012345):
        path = VoxelMap(resolution).write(tmp_path / "r.bt")
        assert VoxelMap.read(path).resolution == resolution


BROKEN = {
    "empty": b"",
    "noise": bytes(range(256)) * 10,
    "no data line": b"# Octomap OcTree binary file\nid OcTree\nsize 1\nres 0.002\n",
    "wrong first line": HEAD.replace(b"binary", b"ternary"),
    "no id": HEAD.replace(b"id OcTree\n", b""),
    "other tree": HEAD.replace(b"id OcTree", b"id ColorOcTree"),
    "no size": HEAD.replace(b"size 1\n", b""),
    "negative size": HEAD.replace(b"size 1", b"size -1"),
    "size in words": HEAD.replace(b"size 1", b"size one"),
    "size beyond all numbers": HEAD.replace(b"size 1", b"size " + b"9" * 4000),
    "no resolution": HEAD.replace(b"res 0.002\n", b""),
    "resolution zero": HEAD.replace(b"0.002", b"0"),
    "resolution negative": HEAD.replace(b"0.002", b"-0.002"),
    "resolution nan": HEAD.replace(b"0.002", b"nan"),
    "resolution inf": HEAD.replace(b"0.002", b"inf"),
    "unknown field": HEAD.replace(b"size 1", b"colour red\nsize 1"),
    "header not text": HEAD.replace(b"res 0.002", b"res 0.002\xff"),
    "size too large": HEAD.replace(b"size 1", b"size 2"),
    "size too small": HEAD.replace(b"\0\0", b"\x02\0"),
    "cut short": HEAD[:-1],
    "cut short below": HEAD.replace(b"size 1", b"size 2").replace(b"\0\0", b"\x03\0"),
    "bytes left over": HEAD + b"\0",
    "too deep": HEAD.replace(b"size 1", b"size 17").replace(b"\0\0", b"\x03\0" * 17),
    "header without end": b"# Octomap OcTree binary file\n" + b"# comment\n" * 10000,
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_one_clear_error(case, tmp_path):
    path = tmp_path / "broken.bt"
    path.write_bytes(BROKEN[case])
    with pytest.raises(FormatError, match=r"broken\.bt"):
        VoxelMap.read(path)


@pytest.mark.parametrize(
    "data",
    [
        b"\0\0\x80?\0\0",
        struct.pack("<fB", np.nan, 0),
        struct.pack("<fB", 1.0, 1),
        struct.pack("<fB", 1.0, 1) * 17,
        b"\0\0",
    ],
)
def test_a_broken_log_odds_file_is_one_clear_error(data, tmp_path):
    path = tmp_path / "broken.ot"
    path.write_bytes(b"# Octomap OcTree file\nid OcTree\nsize 1\nres 0.002\ndata\n" + data)
    with pytest.raises(FormatError, match=r"broken\.ot"):
        VoxelMap.read(path)


def test_mutated_files_are_read_or_refused(tmp_path):
    """Whatever the bytes: an answer or a FormatError that names the file."""
    rng = np.random.default_rng(4)
    for ending in (".bt", ".ot"):
        good = bytearray(random_map(8, count=30).write(tmp_path / f"good{ending}").read_bytes())
        path = tmp_path / f"bad{ending}"
        refused = 0
        for _ in range(300):
            bad = good.copy()
            for at in rng.integers(len(good), size=rng.integers(1, 4)):
                bad[at] = rng.integers(256)
            path.write_bytes(bad[: rng.integers(len(bad)) if rng.random() < 0.2 else len(bad)])
            try:
                VoxelMap.read(path).leaves()
            except FormatError as error:
                refused += str(path) in str(error)
        assert refused > 50


def test_a_file_made_to_exhaust_memory_is_refused(tmp_path, monkeypatch):
    """Each chain of 16 nodes costs 32 bytes in the file and seven nodes of ours."""
    monkeypatch.setattr("lwrprobe.mapping.voxel_set.MAX_WORDS", 1 << 14)
    voxels = VoxelMap(EDGE)
    monkeypatch.setattr("lwrprobe.mapping.voxel_set.MAX_WORDS", 1 << 28)
    voxels.insert(np.random.default_rng(5).uniform(-60.0, 60.0, (3000, 3)))
    path = voxels.write(tmp_path / "scattered.bt")
    monkeypatch.setattr("lwrprobe.mapping.voxel_set.MAX_WORDS", 1 << 14)
    with pytest.raises(FormatError, match=r"scattered\.bt.*MiB"):
        VoxelMap.read(path)


def test_a_missing_file(tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        VoxelMap.read(tmp_path / "none.bt")


def test_describe_and_cloud(tmp_path):
    voxels = random_map(9)
    path = voxels.write(tmp_path / "a.bt")
    facts = describe(path)
    assert facts["occupied_voxels"] == len(voxels)
    assert facts["free_voxels"] == voxels.free_count()
    assert facts["resolution_m"] == EDGE
    assert facts["occupied_leaves"] + facts["free_leaves"] == len(voxels.leaves().sizes)
    np.testing.assert_allclose(facts["lower_m"], voxels.bounds()[0])
    assert describe(VoxelMap(EDGE).write(tmp_path / "e.bt"))["lower_m"] == [None, None, None]
    for ending in (".pcd", ".ply", ".csv"):
        assert to_cloud(path, tmp_path / f"a{ending}") == len(voxels)
        points = read_cloud(tmp_path / f"a{ending}").points
        assert {tuple(k) for k in naive.keys(points, EDGE)} == {tuple(k) for k in naive.keys(voxels.centres(), EDGE)}
