"""Mesh files: what is written is read back, in every format, and a broken file gets one typed error."""

import struct

import numpy as np
import pytest
import trimesh

from lwrprobe.contracts import FormatError, InputError, TriangleMesh, UnknownNameError
from lwrprobe.reconstruction.meshes import WRITERS, read_mesh, write_mesh

ALL = [(ending, encoding) for ending, encodings in WRITERS.items() for encoding in encodings]


@pytest.fixture(scope="module")
def ball():
    body = trimesh.creation.icosphere(subdivisions=2, radius=0.024)
    return TriangleMesh(np.array(body.vertices), np.array(body.faces), np.linspace(0, 1e-3, len(body.vertices)))


@pytest.mark.parametrize(("ending", "encoding"), ALL)
def test_round_trip(tmp_path, ball, ending, encoding):
    path = write_mesh(tmp_path / f"ball{ending}", ball, encoding)
    back = read_mesh(path)
    assert len(back.faces) == len(ball.faces)
    assert trimesh.Trimesh(back.vertices, back.faces, process=False).is_watertight
    corners = np.sort(back.vertices[back.faces].reshape(-1, 9), axis=0)
    assert np.abs(corners - np.sort(ball.vertices[ball.faces].reshape(-1, 9), axis=0)).max() < 1e-7
    if ending == ".ply":
        assert np.allclose(back.vertex_error, ball.vertex_error, atol=1e-9)
    assert [f.name for f in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(("ending", "encoding"), [pair for pair in ALL if pair[0] != ".obj"])
def test_an_empty_mesh_stays_empty(tmp_path, ending, encoding):
    empty = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    back = read_mesh(write_mesh(tmp_path / f"none{ending}", empty, encoding))
    assert back.vertices.shape == (0, 3)
    assert back.faces.shape == (0, 3)


def test_a_format_without_that_encoding_says_what_it_has(tmp_path, ball):
    with pytest.raises(InputError, match=r"binary for \.glb"):
        write_mesh(tmp_path / "ball.glb", ball, "ascii")
    with pytest.raises(InputError, match="at least one face"):
        write_mesh(tmp_path / "none.obj", TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)))
    with pytest.raises(UnknownNameError, match=r"did you mean '\.stl'"):
        write_mesh(tmp_path / "ball.slt", ball)


def test_a_binary_stl_that_begins_with_solid(tmp_path, ball):
    path = write_mesh(tmp_path / "ball.stl", ball)
    path.write_bytes(b"solid by another program".ljust(80) + path.read_bytes()[80:])
    assert len(read_mesh(path).faces) == len(ball.faces)


def test_an_ascii_stl_may_be_in_capitals(tmp_path, ball):
    path = write_mesh(tmp_path / "ball.stl", ball, "ascii")
    path.write_text(path.read_text().upper())
    assert len(read_mesh(path).faces) == len(ball.faces)


PLY = b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
FACES = b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"
BROKEN = {
    "empty.stl": b"",
    "short.stl": b"\0" * 60,
    "lying_count.stl": b"\0" * 80 + struct.pack("<I", 1000) + b"\0" * 50,
    "huge_count.stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1),
    "cut.stl": b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n",
    "words.stl": b"solid x\nfacet normal a b c\nouter loop\nvertex p q r\nendloop\nendfacet\nendsolid x\n",
    "not_finite.stl": b"\0" * 80 + struct.pack("<I12fH", 1, *[0.0] * 3, *[float("nan")] * 9, 0),
    "empty.ply": b"",
    "other.ply": b"solid x\nendsolid x\n",
    "cloud.ply": PLY % 1 + b"end_header\n0 0 0\n",
    "cut.ply": PLY % 3 + FACES % 1 + b"0 0 0\n1 0 0\n",
    "beyond.ply": PLY % 3 + FACES % 1 + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
    "negative.ply": PLY % 3 + FACES % 1 + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n",
    "no_end.ply": PLY % 3,
    "empty.obj": b"",
    "cloud.obj": b"v 0 0 0\nv 1 0 0\n",
    "beyond.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "words.obj": b"v a b c\nf x y z\n",
    "empty.glb": b"",
    "cut.glb": b"glTF" + struct.pack("<II", 2, 4000) + b"{}",
    "other.glb": b"ply\n",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_gets_one_typed_error_that_names_it(tmp_path, name):
    (tmp_path / name).write_bytes(BROKEN[name])
    with pytest.raises(FormatError, match=name):
        read_mesh(tmp_path / name)


def test_a_missing_file(tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        read_mesh(tmp_path / "nowhere.stl")


@pytest.mark.parametrize(("ending", "encoding"), ALL)
def test_damage_never_gets_past_the_typed_error(tmp_path, ball, ending, encoding):
    path = write_mesh(tmp_path / f"ball{ending}", ball, encoding)
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(40):
        damaged = bytearray(whole[: rng.integers(1, len(whole) + 1)])
        for place in rng.integers(0, len(damaged), 6):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged))
        try:
            mesh = read_mesh(path)
        except FormatError:
            continue
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.size == 0 or mesh.faces.max() < len(mesh.vertices)
