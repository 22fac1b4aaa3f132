"""Whether a mesh is closed, and into how many pieces it falls."""

from __future__ import annotations

import numpy as np


def is_closed(faces: np.ndarray) -> bool:
    """Each directed edge of faces (m, 3) occurs once, and so does its opposite."""
    if len(faces) == 0:
        return False
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key = edges[:, 0] * (faces.max() + 1) + edges[:, 1]
    opposite = edges[:, 1] * (faces.max() + 1) + edges[:, 0]
    key.sort()
    opposite.sort()
    return bool((np.diff(key) > 0).all() and np.array_equal(key, opposite))


def count_pieces(faces: np.ndarray) -> int:
    """Number of connected parts of faces (m, 3)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if len(faces) == 0:
        return 0
    used, compact = np.unique(faces, return_inverse=True)
    compact = compact.reshape(faces.shape)
    rows, columns = compact[:, [0, 1]].ravel(), compact[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(used), len(used)))
    return int(connected_components(graph, directed=False)[0])
