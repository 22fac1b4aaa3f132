"""The flat form of a solid: two arrays that kernels take instead of objects.

`numbers` (float64) and `indices` (int64) hold all sections of a solid one behind the other; the first
`HEADER` entries of `indices` say where each section begins and how many rows it has. Two arrays instead of twenty
keep a call from Python cheap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# Kinds of surfaces. Row of numbers: a (3), u (3), r, l, kind, object, where a blend's balls begin and end, and the
# first and last surface of the primitive that it belongs to. The surfaces come first in `numbers`, so that surface k
# begins at SURFACE_NUMBERS * k without a look into the header.
PLANE = 0  # point a, outward normal u
CYLINDER = 1  # point a on the axis, direction u, radius r, without ends
SPHERE = 2  # centre a, radius r
CAPSULE = 3  # end a of the axis, direction u, radius r, length l of the axis
BLEND = 4  # centre a, smoothing r, balls of the section BALLS
SURFACE_NUMBERS = 14
SURFACE_KIND = 8
SURFACE_PART = 9
SURFACE_BALLS = 10
SURFACE_GROUP = 12

# Sections. Header entries: rows, offset into numbers, offset into indices.
SURFACES = 0  # numbers: as above, then all balls: centre (3), radius, +1 for a ball or -1 for a hollow
TREE = 3  # indices: operation, first, last; the solid in reverse Polish notation
STEPS = 6  # indices, right after the header: surface, next step when inside it, next step when outside it
CHAINS = 9  # numbers: bounding sphere (4); indices: first edge, last edge, surfaces (2), signs (2), convex, kind
EDGES = 12  # numbers: see below
VERTICES = 15  # numbers: point (3); indices: first and last row of INCIDENCE
INCIDENCE = 18  # indices: surface
BOUNDS = 21  # numbers: lower (3), upper (3)
MESHES = 24  # indices: where the parts of each mesh begin, see below
HEADER = 27

BALL_NUMBERS = 5
TREE_INDICES = 3
STEP_INDICES = 3
CHAIN_NUMBERS = 4
CHAIN_INDICES = 8
EDGE_NUMBERS = 12
VERTEX_NUMBERS = 3
VERTEX_INDICES = 2

# Row of a mesh: its object, then offsets into numbers or indices.
MESH_PART = 0
MESH_CORNERS = 1  # numbers: vertex (3)
MESH_FACES = 2  # indices: vertices (3)
MESH_FACE_NORMALS = 3  # numbers: (3) a face
MESH_EDGE_NORMALS = 4  # numbers: (3, 3) a face
MESH_VERTEX_NORMALS = 5  # numbers: (3) a vertex
MESH_NEIGHBOURS = 6  # indices: faces across the three edges
MESH_RING_STARTS = 7  # indices: where each vertex's faces begin in the rings
MESH_RINGS = 8  # indices: faces around each vertex
MESH_NODE_BOXES = 9  # numbers: lower (3), upper (3) a node
MESH_NODES = 10  # indices: first face and count of a leaf, or left child and 0 (the right one follows it)
MESH_INDICES = 11

# Operations of the tree: a group is the intersection of consecutive surfaces.
GROUP = 0
UNION = 1
INTERSECTION = 2
DIFFERENCE = 3

# Ends of the steps.
INSIDE = -1
OUTSIDE = -2

# Kinds of edges and their numbers.
LINE = 0  # start (3), direction (3), length
ARC = 1  # centre (3), direction of the start (3), direction a quarter turn on (3), radius, span
CURVE = 2  # start (3), end (3), unit tangents at both (3, 3); one short piece of an intersection curve


Sections = dict[int, tuple[int, ArrayLike, ArrayLike]]
"""Rows, numbers and indices by section."""


def pack(sections: Sections) -> tuple[np.ndarray, np.ndarray]:
    """`numbers` and `indices` from sections given as (rows, numbers, indices)."""
    header = np.zeros(HEADER, dtype=np.int64)
    numbers, indices = [np.empty(0)], [header]
    first = [section for section in (SURFACES, STEPS) if section in sections]
    for section in (*first, *(s for s in sections if s not in first)):
        rows, section_numbers, section_indices = sections[section]
        header[section : section + 3] = rows, sum(map(len, numbers)), sum(map(len, indices))
        numbers.append(np.asarray(section_numbers, dtype=np.float64).ravel())
        indices.append(np.asarray(section_indices, dtype=np.int64).ravel())
    return np.concatenate(numbers), np.concatenate(indices)


def pack_tree(
    vertices: np.ndarray, faces: np.ndarray, boxes: np.ndarray, nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`numbers` and `indices` of one mesh with its tree of boxes alone: enough for distances without sign."""
    row = np.zeros(MESH_INDICES, dtype=np.int64)
    row[MESH_NODE_BOXES] = vertices.size
    row[MESH_FACES] = HEADER + MESH_INDICES
    row[MESH_NODES] = row[MESH_FACES] + faces.size
    header = np.zeros(HEADER, dtype=np.int64)
    header[MESHES], header[MESHES + 2] = 1, HEADER
    numbers = np.concatenate([vertices.ravel(), boxes.ravel()])
    return numbers, np.concatenate([header, row, faces.ravel(), nodes.ravel()])
