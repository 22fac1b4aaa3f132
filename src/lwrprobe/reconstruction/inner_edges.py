"""Inner edges that the sphere does not fit into: the faces on both sides go on until they meet.

Shrinking the surface of the centres leaves an arc of the sphere's radius there, the largest solid that the contacts
allow. Edges of made objects are sharper than a sphere: what both faces show is taken to hold up to where they meet.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters

CROWDED = 0.7  # feet this close together, as a share: a concave arc of less than about three radii
_AROUND = 1.0  # of the pitch: how far from the edge its faces are looked at, to the next line
_BESIDE = 0.5  # radii: nearer to the edge the sphere touches both faces, and its normals lie between theirs
_THROUGH = 0.2  # radii: so near to the sphere's centre in the edge a face's plane has to pass
_ANGLE = 0.8  # cosine between two faces that make an edge
_TOWARDS = 0.35  # cosine between the way of a vertex and a face that it goes to
_FARTHEST = 1.7  # radii from the centre of the sphere to where the faces meet, at 72 degrees
_FACING = 0.2  # radii: so far before the one face the other one has to be


def meet(vertices: np.ndarray, centres: np.ndarray, clusters: Clusters, radius: float, pitch: float) -> np.ndarray:
    """Vertices (n, 3) on the arcs of inner edges, moved away from the sphere's `centres` (n, 3) there onto its faces.

    A vertex is moved where the planes of contacts around make an inner edge, until the first of them.
    """
    from scipy.spatial import cKDTree

    moved = vertices.copy()
    for i, near in enumerate(cKDTree(clusters.points).query_ball_point(centres, _AROUND * pitch)):
        offset = centres[i] - clusters.points[near]
        normals = clusters.normals[near]
        height = np.einsum("ij,ij->i", offset, normals)
        kept = (np.abs(height) < _THROUGH * radius) & (np.linalg.norm(offset, axis=1) > _BESIDE * radius)
        offset, normals, height = offset[kept], normals[kept], height[kept]
        before = np.einsum("ik,ijk->ij", normals, offset[:, None] - offset[None])
        if not ((normals @ normals.T < _ANGLE) & (np.minimum(before, before.T) > _FACING * radius)).any():
            continue
        arm = vertices[i] - centres[i]
        length = np.linalg.norm(arm)
        sinking = -(normals @ arm) / length
        towards = sinking > _TOWARDS
        reach = ((height[towards] + radius) / sinking[towards]).min(initial=np.inf)
        if length < reach < _FARTHEST * radius:
            moved[i] = centres[i] + reach / length * arm
    return moved
