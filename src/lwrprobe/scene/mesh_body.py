"""Triangle meshes as bodies of a solid."""

from __future__ import annotations

from dataclasses import dataclass
from os.path import isfile
from typing import Any

import numpy as np

from lwrprobe.contracts import SceneError
from lwrprobe.scene import program
from lwrprobe.scene.box_tree_kernels import halve
from lwrprobe.scene.mesh_kernels import column_crossings
from lwrprobe.scene.shape import Mesh, RandomObject
from lwrprobe.scene.table import LARGEST

_LEAF = 4  # faces
SMALLEST = 0.001
"""m, of the longest side of a mesh."""


@dataclass(slots=True)
class MeshBody:
    """A closed mesh in the world frame with all that the kernels look up; faces are in the order of the tree."""

    part: int
    vertices: np.ndarray
    faces: np.ndarray
    face_normals: np.ndarray
    edge_normals: np.ndarray
    vertex_normals: np.ndarray
    neighbours: np.ndarray
    ring_starts: np.ndarray
    rings: np.ndarray
    boxes: np.ndarray
    nodes: np.ndarray

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


def load_body(shape: Mesh | RandomObject, part: int, frame: np.ndarray) -> MeshBody:
    """A mesh file or random object as a body; raises SceneError when a file has no closed, consistently wound mesh."""
    if isinstance(shape, Mesh):
        vertices, faces = _read(shape, part)
    else:
        from lwrprobe.scene.random_object import random_mesh

        vertices, faces = random_mesh(shape.kind, shape.seed, shape.length)
    return build_body(vertices @ frame[:3, :3].T + frame[:3, 3], faces, part)


def _read(shape: Mesh, part: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) m and outward faces (m, 3) of a mesh file."""
    import trimesh

    name = f"object[{part}].file"
    if not isfile(shape.file):
        raise SceneError(name, shape.file, "an existing mesh file")
    try:
        mesh: Any = trimesh.load(shape.file, force="mesh")
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:
        raise SceneError(name, shape.file, f"a readable triangle mesh ({type(error).__name__}: {error})") from error
    if len(faces) == 0:
        raise SceneError(name, shape.file, "a mesh with at least four triangles")
    size = shape.scale * float(np.ptp(vertices, axis=0).max())
    if not SMALLEST <= size <= LARGEST:
        allowed = f"a scale by which the mesh, now {size:g} m long, becomes {SMALLEST:g} to {LARGEST:g} m"
        raise SceneError(f"object[{part}].scale", shape.scale, f"{allowed}: files in millimetres need 0.001")
    if not mesh.is_watertight:
        raise SceneError(name, shape.file, "a closed (watertight) mesh")
    if not mesh.is_winding_consistent:
        raise SceneError(name, shape.file, "a mesh whose triangles are all wound the same way")
    if mesh.volume < 0.0:
        faces = faces[:, ::-1]
    bodies = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(faces))
    if _inside_out(vertices, faces, bodies):
        raise SceneError(name, shape.file, "a mesh whose bodies all face outwards; one of them is inside out")
    return shape.scale * vertices, faces


def _inside_out(vertices: np.ndarray, faces: np.ndarray, bodies: np.ndarray) -> bool:
    """Whether a body faces inwards and is no cavity of another: just behind its surface the winding number is negative.

    `bodies` (m,) numbers the bodies of the faces (m, 3).
    """
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    volumes = np.bincount(bodies, weights=np.einsum("ij,ij->i", a, np.cross(b, c)))
    inward = np.flatnonzero(volumes < 0.0)
    if not len(inward):
        return False
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    largest = np.array([np.argmax(np.where(bodies == body, areas, -1.0)) for body in inward])
    # No upright line through such a place of a face is likely to meet an edge.
    places = np.einsum("k,ikj->ij", [0.37, 0.34, 0.29], vertices[faces[largest]])
    places += 1e-5 * normals[largest] / np.sqrt(areas[largest])[:, None]
    winding = np.empty((len(places), 1))
    column_crossings(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces), places[:, :2].copy(), places[:, 2:].copy(), winding
    )
    return bool((winding < -0.5).any())


def build_body(vertices: np.ndarray, faces: np.ndarray, part: int = 0) -> MeshBody:
    """A body from vertices (n, 3) and faces (m, 3) of a closed mesh, counter-clockwise seen from outside."""
    faces, boxes, nodes = box_tree(vertices, faces)
    normals = _unit(
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    )
    neighbours = _neighbours(faces)
    order = np.argsort(faces.ravel(), kind="stable")
    starts = np.searchsorted(faces.ravel()[order], np.arange(len(vertices) + 1))
    return MeshBody(
        part=part,
        vertices=np.ascontiguousarray(vertices, dtype=np.float64),
        faces=faces,
        face_normals=normals,
        edge_normals=normals[:, None, :] + normals[neighbours],
        vertex_normals=_vertex_normals(vertices, faces, normals),
        neighbours=neighbours,
        ring_starts=starts,
        rings=order // 3,
        boxes=boxes,
        nodes=nodes,
    )


def pack_bodies(numbers: np.ndarray, indices: np.ndarray, bodies: list[MeshBody]) -> tuple[np.ndarray, np.ndarray]:
    """Append meshes to a packed solid."""
    all_numbers, all_indices = [numbers], [indices.copy()]
    places = {"numbers": len(numbers), "indices": len(indices)}

    def put(array: np.ndarray, where: str) -> int:
        begin = places[where]
        (all_numbers if where == "numbers" else all_indices).append(array.ravel())
        places[where] += array.size
        return begin

    rows = []
    for body in bodies:
        row = np.zeros(program.MESH_INDICES, dtype=np.int64)
        row[program.MESH_PART] = body.part
        row[program.MESH_CORNERS] = put(body.vertices, "numbers")
        row[program.MESH_FACES] = put(body.faces, "indices")
        row[program.MESH_FACE_NORMALS] = put(body.face_normals, "numbers")
        row[program.MESH_EDGE_NORMALS] = put(body.edge_normals, "numbers")
        row[program.MESH_VERTEX_NORMALS] = put(body.vertex_normals, "numbers")
        row[program.MESH_NEIGHBOURS] = put(body.neighbours, "indices")
        row[program.MESH_RING_STARTS] = put(body.ring_starts, "indices")
        row[program.MESH_RINGS] = put(body.rings, "indices")
        row[program.MESH_NODE_BOXES] = put(body.boxes, "numbers")
        row[program.MESH_NODES] = put(body.nodes, "indices")
        rows.append(row)
    header = all_indices[0]
    header[program.MESHES] = len(bodies)
    header[program.MESHES + 2] = put(np.array(rows, dtype=np.int64), "indices")
    return np.concatenate(all_numbers), np.concatenate(all_indices).astype(np.int64)


def box_tree(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes halved at the median of the longest side; returns the faces in leaf order, node boxes and nodes."""
    corners = vertices[faces]
    order = np.arange(len(faces))
    boxes, nodes = np.empty((2 * len(faces) + 1, 6)), np.empty((2 * len(faces) + 1, 2), dtype=np.int64)
    count = halve(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1), _LEAF, order, boxes, nodes)
    return np.ascontiguousarray(faces[order]), boxes[:count].copy(), nodes[:count].copy()


def _neighbours(faces: np.ndarray) -> np.ndarray:
    """(m, 3) face across each edge ab, bc, ca."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    across = np.empty(len(edges), dtype=np.int64)
    across[order[0::2]], across[order[1::2]] = order[1::2] // 3, order[0::2] // 3
    return across.reshape(-1, 3)


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Sum of the faces' normals around each vertex, weighted by angle."""
    total = np.zeros_like(vertices, dtype=np.float64)
    for corner in range(3):
        here = vertices[faces[:, corner]]
        a = _unit(vertices[faces[:, (corner + 1) % 3]] - here)
        b = _unit(vertices[faces[:, (corner + 2) % 3]] - here)
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", a, b), -1.0, 1.0))
        np.add.at(total, faces[:, corner], angle[:, None] * normals)
    return total


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
