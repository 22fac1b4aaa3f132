"""Mesh files by ending: STL (binary, ASCII), PLY with the vertices' errors, OBJ and GLB.

All but the writing of binary STL goes through trimesh; a run leaves nothing but that, and need not wait for the import.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from lwrprobe.contracts import FormatError, InputError, TriangleMesh, UnknownNameError
from lwrprobe.host.whole_file import write_whole

if TYPE_CHECKING:
    import trimesh

Encoding = Literal["binary", "ascii"]

WRITERS: dict[str, dict[Encoding, str]] = {
    ".stl": {"binary": "stl", "ascii": "stl_ascii"},
    ".ply": {"binary": "ply"},
    ".obj": {"ascii": "obj"},
    ".glb": {"binary": "glb"},
}
"""trimesh's name of the format, by ending and encoding; the first encoding is the default."""


class NoTriangles(FormatError):
    """A mesh file holds vertices alone: it may be a cloud."""


def write_mesh(path: str | Path, mesh: TriangleMesh, encoding: Encoding | None = None) -> Path:
    """Write a mesh in the format that the ending names; an interrupted write leaves no half file. Folders are made.

    PLY keeps `vertex_error` as the vertex property `vertex_error` [m]; the other formats have no place for it.
    Raises UnknownNameError for an unknown ending, InputError for an encoding that the format does not have or an
    empty mesh in a format that cannot hold one, StorageError where the file cannot be written.
    """
    path = Path(path)
    encodings = WRITERS[_ending(path)]
    if encoding is not None and encoding not in encodings:
        raise InputError("encoding", encoding, f"{' or '.join(encodings)} for {path.suffix}")
    default = next(iter(encodings))
    kind = encodings[default if encoding is None else encoding]
    if len(mesh.faces) == 0 and kind == "obj":
        raise InputError("mesh", "no faces", "at least one face for .obj; .stl, .ply and .glb can be empty")
    content = _binary_stl(mesh) if kind == "stl" else as_trimesh(mesh).export(file_type=kind)
    assert not isinstance(content, dict), "the formats of WRITERS are bytes or text"
    write_whole(path, content if isinstance(content, bytes) else content.encode("ascii"))
    return path


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a mesh; the corners that STL repeats are merged, a scene of several bodies becomes one mesh.

    Raises UnknownNameError for an unknown ending and FormatError, naming the file, for one that is missing,
    broken, or points at vertices that are not there; NoTriangles for one without triangles that is not empty.
    """
    path = Path(path)
    ending = _ending(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error
    _check_length(path, content, ending)
    mesh = _load(path, content, ending)
    _check(path, mesh, ending)
    return mesh


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in WRITERS:
        raise UnknownNameError("mesh file ending", ending, WRITERS)
    return ending


def _binary_stl(mesh: TriangleMesh) -> bytes:
    corners = mesh.vertices[mesh.faces].reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["normal"], facets["corners"] = normals, corners
    return bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes()


def as_trimesh(mesh: TriangleMesh) -> trimesh.Trimesh:
    """The same as a `trimesh.Trimesh`, with the vertices' errors [m] as the attribute `vertex_error`."""
    import trimesh

    attributes: dict[str, ArrayLike] = {}
    if mesh.vertex_error is not None:
        attributes["vertex_error"] = mesh.vertex_error.astype(np.float32)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_attributes=attributes, process=False)


def _load(path: Path, content: bytes, ending: str) -> TriangleMesh:
    import io

    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # its tracebacks are ours to turn into one sentence
    try:
        # trimesh's loaders answer a broken file with whatever their parsing ran into, so all of it is caught here.
        with np.errstate(invalid="ignore"):
            loaded: Any = trimesh.load(io.BytesIO(content), file_type=ending[1:], process=False)
            if isinstance(loaded, trimesh.Scene):
                loaded = loaded.to_mesh()
            if ending == ".stl":
                loaded.merge_vertices()
        return TriangleMesh(
            np.ascontiguousarray(loaded.vertices, dtype=np.float64),
            np.ascontiguousarray(getattr(loaded, "faces", np.zeros((0, 3))), dtype=np.int64),
            _vertex_error(loaded),
        )
    except Exception as error:
        raise FormatError(f"{path}: not a readable {ending[1:].upper()} mesh: {error}") from error


def _vertex_error(loaded: Any) -> np.ndarray | None:
    # trimesh hands scalar PLY properties on as the raw table that it read: structured array (binary) or dict (ASCII)
    table = loaded.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    names = table if isinstance(table, dict) else table.dtype.names
    if "vertex_error" not in names or len(table["vertex_error"]) != len(loaded.vertices):
        return None
    return np.asarray(table["vertex_error"], dtype=np.float64).reshape(-1)


def _check_length(path: Path, content: bytes, ending: str) -> None:
    """trimesh takes a truncated STL for a shorter one."""
    if ending != ".stl":
        return
    declared = 84 + 50 * int.from_bytes(content[80:84], "little")
    if len(content) >= 84 and len(content) == declared:  # many binary files begin with `solid` as well
        return
    if content.lstrip()[:5].lower() != b"solid":
        raise FormatError(f"{path}: {len(content)} bytes; its header needs {max(declared, 84)}")
    if b"endsolid" not in content[-256:].lower():
        raise FormatError(f"{path}: an ASCII STL without its last line, `endsolid`")


def _check(path: Path, mesh: TriangleMesh, ending: str) -> None:
    if len(mesh.faces) == 0 and (len(mesh.vertices) or ending == ".obj"):
        raise NoTriangles(f"{path}: holds {len(mesh.vertices)} vertices and no triangles")
    if not np.isfinite(mesh.vertices).all():
        raise FormatError(f"{path}: vertex {np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0]} is not finite")
    if len(mesh.faces) and (mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices)):
        raise FormatError(f"{path}: a face points at vertex {mesh.faces.max()} of {len(mesh.vertices)}")
