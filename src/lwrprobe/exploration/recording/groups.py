"""Places that lie together."""

from __future__ import annotations

import numpy as np


def groups(places: np.ndarray, apart: float) -> list[np.ndarray]:
    """Indices of the places (n, 3) m that hang together by steps of at most `apart` m, group by group."""
    if not len(places):
        return []
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(places).query_pairs(apart, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    count, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group == k) for k in range(count)]
