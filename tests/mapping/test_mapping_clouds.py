"""Cloud files of ours and of others; broken ones are one clear error."""

from __future__ import annotations

from contextlib import suppress

import naive_mapping as naive
import numpy as np
import pytest
import trimesh

from lwrprobe.contracts import FormatError, InputError, UnknownNameError
from lwrprobe.mapping.cloud_kernels import expand_lzf
from lwrprobe.mapping.clouds import ENDINGS, Cloud, read_cloud, write_cloud


def random_cloud(count=50, normals=True, scalars=("force", "confidence")):
    rng = np.random.default_rng(0)
    return Cloud(
        rng.uniform(-1.0, 1.0, (count, 3)),
        rng.normal(size=(count, 3)) if normals else None,
        {name: rng.normal(size=count) for name in scalars},
    )


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("count", [0, 1, 50])
def test_reads_back_what_was_written(ending, normals, count, tmp_path):
    cloud = random_cloud(count, normals)
    back = read_cloud(write_cloud(tmp_path / f"a{ending}", cloud))
    tolerance = 0.0 if ending == ".csv" else 1e-6
    np.testing.assert_allclose(back.points, cloud.points, atol=tolerance)
    assert (back.normals is None) == (cloud.normals is None)
    if normals:
        np.testing.assert_allclose(back.normals, cloud.normals, atol=tolerance)
    assert list(back.scalars) == ["force", "confidence"]
    for name, column in cloud.scalars.items():
        np.testing.assert_allclose(back.scalars[name], column, atol=tolerance)


def test_golden_pcd(tmp_path):
    path = write_cloud(tmp_path / "a.pcd", Cloud(np.array([[0.001, -0.003, 0.5]])))
    assert path.read_text().splitlines() == [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS x y z",
        "SIZE 4 4 4",
        "TYPE F F F",
        "COUNT 1 1 1",
        "WIDTH 1",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 0 0 0 1",
        "POINTS 1",
        "DATA ascii",
        "0.001 -0.003 0.5",
    ]


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_all_kinds(data, tmp_path):
    rng = np.random.default_rng(1)
    fields = [("x", "F", 4), ("y", "F", 8), ("z", "F", 4), ("_", "U", 4), ("label", "U", 2), ("step", "I", 1)]
    rows = [
        [*np.round(rng.uniform(-1, 1, 3), 3), 0, int(rng.integers(9)), int(rng.integers(-9, 9))] for _ in range(300)
    ]
    path = tmp_path / "a.pcd"
    path.write_bytes(naive.pcd(fields, data, rows))
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.points, np.array(rows)[:, :3], atol=1e-7)
    assert list(cloud.scalars) == ["label", "step"]
    np.testing.assert_array_equal(cloud.scalars["label"], np.array(rows)[:, 4])
    np.testing.assert_array_equal(cloud.scalars["step"], np.array(rows)[:, 5])


def test_points_that_pcl_marks_as_missing_are_left_out(tmp_path):
    path = tmp_path / "a.pcd"
    fields = [(name, "F", 4) for name in ("x", "y", "z", "normal_x", "normal_y", "normal_z")]
    path.write_bytes(naive.pcd(fields, "binary", [[1, 2, 3, 0, 0, 1], [np.nan] * 6, [4, 5, 6, np.nan, 0, 0]]))
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3]])
    np.testing.assert_array_equal(cloud.normals, [[0, 0, 1]])


def test_lzf_unpacks_what_was_packed():
    rng = np.random.default_rng(2)
    for plain in (b"", b"a", b"a" * 1000, bytes(rng.integers(0, 256, 500, np.uint8)), b"abcabc" * 50 + b"xyz" * 40):
        packed = np.frombuffer(naive.pack_lzf(plain), np.uint8)
        out = np.empty(len(plain), np.uint8)
        assert expand_lzf(packed, out) == len(plain)
        assert out.tobytes() == plain
    out = np.empty(100, np.uint8)
    for _ in range(2000):  # whatever the bytes: never beyond either array
        assert -1 <= expand_lzf(rng.integers(0, 256, rng.integers(1, 40), np.uint8), out) <= 100


def test_other_peoples_ply(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    for encoding in ("ascii", "binary"):
        mesh.export(tmp_path / "a.ply", encoding=encoding)
        np.testing.assert_allclose(read_cloud(tmp_path / "a.ply").points, mesh.vertices, atol=1e-6)
    back = trimesh.load(write_cloud(tmp_path / "b.ply", random_cloud()))
    np.testing.assert_allclose(back.vertices, random_cloud().points, atol=1e-6)
    head = "ply\ncomment first\nformat binary_big_endian 1.0\nelement vertex 2\nproperty double x\nproperty float y\n"
    head += "property short z\nproperty uchar red\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.array([(1.5, 2.5, -3, 200), (4.5, 5.5, 6, 7)], [("x", ">f8"), ("y", ">f4"), ("z", ">i2"), ("r", "u1")])
    (tmp_path / "c.ply").write_bytes(head.encode() + rows.tobytes())
    cloud = read_cloud(tmp_path / "c.ply")
    np.testing.assert_array_equal(cloud.points, [[1.5, 2.5, -3], [4.5, 5.5, 6]])
    np.testing.assert_array_equal(cloud.scalars["red"], [200, 7])


def test_a_run_folders_contacts_are_a_cloud(tmp_path):
    path = tmp_path / "contacts.csv"
    path.write_text("time,x,y,z,nx,ny,nz,force,confidence\n0.1,1,2,3,0,0,1,0.5,1\n\n0.2,4,5,6,0,1,0,0.6,0.9\n")
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(cloud.normals, [[0, 0, 1], [0, 1, 0]])
    assert list(cloud.scalars) == ["time", "force", "confidence"]


PCD = naive.pcd([("x", "F", 4), ("y", "F", 4), ("z", "F", 4)], "ascii", [[1, 2, 3], [4, 5, 6]])
PACKED = naive.pcd([("x", "F", 4), ("y", "F", 4), ("z", "F", 4)], "binary_compressed", [[1, 2, 3]] * 9)
PACKED_DATA = PACKED.index(b"compressed\n") + len(b"compressed\n") + 8
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 1\n"
    + b"".join(b"property float %c\n" % c for c in b"xyz")
    + b"end_header\n1 2 3\n"
)
BROKEN = {
    "empty.pcd": b"",
    "noise.pcd": bytes(range(256)) * 300,
    "no-fields.pcd": PCD.replace(b"FIELDS x y z\n", b""),
    "two-fields.pcd": PCD.replace(b"FIELDS x y z", b"FIELDS x y"),
    "same-fields.pcd": PCD.replace(b"FIELDS x y z", b"FIELDS x y y"),
    "other-fields.pcd": PCD.replace(b"FIELDS x y z", b"FIELDS u v w"),
    "half-a-size.pcd": PCD.replace(b"SIZE 4 4 4", b"SIZE 4 4 3"),
    "complex.pcd": PCD.replace(b"TYPE F F F", b"TYPE F F C"),
    "count.pcd": PCD.replace(b"COUNT 1 1 1", b"COUNT 1 1 0"),
    "count-huge.pcd": PCD.replace(b"COUNT 1 1 1", b"COUNT 1 1 " + b"9" * 5000),
    "width.pcd": PCD.replace(b"WIDTH 2", b"WIDTH -2"),
    "points.pcd": PCD.replace(b"POINTS 2", b"POINTS 3"),
    "missing-line.pcd": PCD.replace(b"POINTS 2", b"POINTS 3").replace(b"WIDTH 2", b"WIDTH 3"),
    "points-huge.pcd": PCD.replace(b"POINTS 2", b"POINTS 999999999999").replace(b"WIDTH 2", b"WIDTH 999999999999"),
    "data.pcd": PCD.replace(b"DATA ascii", b"DATA morse"),
    "words.pcd": PCD.replace(b"4 5 6", b"4 five 6"),
    "short-line.pcd": PCD.replace(b"4 5 6", b"4 5"),
    "binary-short.pcd": PCD.replace(b"DATA ascii", b"DATA binary"),
    "header.pcd": PCD.replace(b"VERSION", b"\xff\xfe"),
    "packed-cut.pcd": PACKED[:-3],
    "packed-empty.pcd": PACKED[: PACKED.index(b"compressed\n") + 11],
    "packed-noise.pcd": PACKED[:PACKED_DATA] + b"\xff" * (len(PACKED) - PACKED_DATA),
    "packed-bomb.pcd": PACKED.replace(b"WIDTH 9", b"WIDTH 300000000").replace(b"POINTS 9", b"POINTS 300000000"),
    "empty.ply": b"",
    "noise.ply": b"ply" + bytes(range(256)),
    "no-end.ply": PLY.replace(b"end_header", b"end"),
    "format.ply": PLY.replace(b"ascii", b"morse"),
    "no-format.ply": PLY.replace(b"format ascii 1.0\n", b""),
    "no-vertex.ply": PLY.replace(b"element vertex", b"element corner"),
    "negative.ply": PLY.replace(b"vertex 1", b"vertex -1"),
    "huge.ply": PLY.replace(b"vertex 1", b"vertex 999999999999"),
    "binary-huge.ply": PLY.replace(b"vertex 1", b"vertex 999999999999").replace(b"ascii", b"binary_little_endian"),
    "type.ply": PLY.replace(b"float z", b"quad z"),
    "list.ply": PLY.replace(b"property float z", b"property list uchar int z"),
    "no-z.ply": PLY.replace(b"property float z\n", b"").replace(b"1 2 3", b"1 2"),
    "twice.ply": PLY.replace(b"float z", b"float y"),
    "words.ply": PLY.replace(b"1 2 3", b"1 two 3"),
    "short.ply": PLY.replace(b"1 2 3", b"1 2"),
    "few.ply": PLY.replace(b"vertex 1", b"vertex 2"),
    "text.ply": PLY.replace(b"ascii", b"\xe4scii"),
    "empty.csv": b"",
    "blank.csv": b"\n",
    "no-names.csv": b"1,2,3\n4,5,6\n",
    "twice.csv": b"x,x,z\n1,2,3\n",
    "no-z.csv": b"x,y\n1,2\n",
    "words.csv": b"x,y,z\n1,two,3\n",
    "short.csv": b"x,y,z\n1,2\n",
    "long.csv": b"x,y,z\n1,2,3,4\n",
    "binary.csv": b"x,y,z\n\xff\xfe\x00\n",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_clear_error(name, tmp_path):
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(FormatError, match=name.replace(".", r"\.")):
        read_cloud(tmp_path / name)


@pytest.mark.parametrize("good", [PCD, PACKED, PLY, b"x,y,z\n1,2,3\n4,5,6\n"])
def test_mutated_files_are_read_or_refused(good, tmp_path):
    rng = np.random.default_rng(3)
    ending = ".ply" if good == PLY else ".csv" if good.startswith(b"x,") else ".pcd"
    path = tmp_path / f"a{ending}"
    for _ in range(400):
        bad = bytearray(good)
        for at in rng.integers(len(good), size=rng.integers(1, 4)):
            bad[at] = rng.integers(256)
        path.write_bytes(bad[: rng.integers(len(bad)) if rng.random() < 0.2 else len(bad)])
        with suppress(FormatError):
            assert np.isfinite(read_cloud(path).points).all()


def test_refuses_what_is_no_cloud(tmp_path):
    for points in (np.zeros((2, 2)), np.zeros(3), np.array([[np.nan, 0, 0]]), "abc"):
        with pytest.raises(InputError, match="points"):
            Cloud(points)
    with pytest.raises(InputError, match="normals"):
        Cloud(np.zeros((2, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="force"):
        Cloud(np.zeros((2, 3)), None, {"force": np.zeros(3)})
    with pytest.raises(InputError, match="scalars"):
        Cloud(np.zeros((2, 3)), None, {"nx": np.zeros(2)})
    with pytest.raises(UnknownNameError, match=r"\.pcd"):
        write_cloud(tmp_path / "a.pcf", Cloud(np.zeros((1, 3))))
    with pytest.raises(UnknownNameError, match=r"\.ply"):
        read_cloud(tmp_path / "a.pyl")
    with pytest.raises(FormatError, match="cannot be read"):
        read_cloud(tmp_path / "none.ply")


def test_names_of_scalars_become_plain_words(tmp_path):
    cloud = Cloud(np.zeros((1, 3)), None, {"force, in N": np.ones(1)})
    for ending in ENDINGS:
        assert list(read_cloud(write_cloud(tmp_path / f"a{ending}", cloud)).scalars) == ["force_in_N"]
