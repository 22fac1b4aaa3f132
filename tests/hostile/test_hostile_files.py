"""Files of others are read or refused with one sentence: never another error, never without bound in memory or time."""

import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readers import BROKEN, READERS, damaged, outcome, well_formed

from lwrprobe.contracts import LwrprobeError
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.reconstruction.meshes import read_mesh
from lwrprobe.scene import load_scene


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return well_formed(tmp_path_factory.mktemp("files"))


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(files, tmp_path, name):
    @settings(max_examples=40)
    @given(choose=st.randoms(use_true_random=False))
    def each(choose):
        assert outcome(name, damaged(choose.choice(files[name]), choose), tmp_path) in ("read", "refused")

    each()


@pytest.mark.parametrize("file", sorted(BROKEN.glob("*")), ids=lambda file: file.name)
def test_files_that_once_failed_are_refused(file, tmp_path):
    assert outcome(file.name.partition("_")[2], file.read_bytes(), tmp_path) in ("read", "refused")


CLAIMS = {
    "cloud.pcd": b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 100000000\nHEIGHT 1\n"
    b"POINTS 100000000\nDATA binary\n" + b"\0" * 500,
    "packed.pcd": b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 100000000\nHEIGHT 1\n"
    b"POINTS 100000000\nDATA binary_compressed\n"
    + (500).to_bytes(4, "little")
    + (1_200_000_000).to_bytes(4, "little")
    + b"\0" * 500,
    "cloud.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 100000000\nproperty float x\nproperty float y\n"
    b"property float z\nend_header\n" + b"\0" * 500,
    "mesh.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 100000000\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n" + b"\0" * 500,
    "mesh.stl": b"\0" * 80 + (20_000_000).to_bytes(4, "little") + b"\0" * 500,
    "map.bt": b"# Octomap OcTree binary file\nid OcTree\nsize 1000000000\nres 0.001\ndata\n" + b"\xff" * 500,
    "map.ot": b"# Octomap OcTree file\nid OcTree\nsize 1000000000\nres 0.001\ndata\n" + b"\xff" * 500,
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_claim_of_a_gigabyte_in_a_kilobyte_is_refused(tmp_path, name):
    """Resident memory, which numpy's and numba's own allocations count in too, grows by less than 200 MB."""
    import resource

    path = tmp_path / name
    path.write_bytes(CLAIMS[name])
    reader = {"pcd": read_cloud, "stl": read_mesh, "bt": VoxelMap.read, "ot": VoxelMap.read}.get(path.suffix[1:])
    reader = reader or (read_mesh if name == "mesh.ply" else read_cloud)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LwrprobeError):
        reader(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


class Bomb:
    def __reduce__(self):
        import os

        return os.mkdir, ("/tmp/lwrprobe_was_here",)


@pytest.mark.parametrize("name", READERS)
def test_no_reader_unpickles(tmp_path, name):
    from pathlib import Path

    outcome(name, pickle.dumps(Bomb()), tmp_path)
    assert not Path("/tmp/lwrprobe_was_here").exists()


def test_a_mesh_of_a_scene_is_read_as_a_mesh_alone(tmp_path):
    """A scene may name any file; what is no mesh is refused, and its content is not repeated."""
    secret = tmp_path / "secret.stl"
    secret.write_text("the secret word is abracadabra")
    (tmp_path / "scene.toml").write_text('[[object]]\nshape = "mesh"\nfile = "secret.stl"\n')
    with pytest.raises(LwrprobeError) as refused:
        load_scene(tmp_path / "scene.toml").solid()
    assert "abracadabra" not in str(refused.value)
