"""Fewer, better points: contacts close together that face the same way become one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lwrprobe.reconstruction.cluster_kernels import Cells, Seeds, assign, merge, support

_AGREEMENT = 0.8
"""Cosine between normals above which two contacts may be of one surface: 37 degrees."""

_WITH = 0.3
"""Cosine above which a neighbour speaks for a contact, and below minus which against it."""

_OUTVOTED = 3.0
"""Weight against a contact over the weight for it from which on it is left out."""

_WALL = 8
"""Pairs that make a wall: fewer are chance."""

_MIN_SUPPORT, _MIN_SHARE = 1.5, 0.25
"""Weight, and share of the weight around it, below which what a contact and its like say is chance."""

_FACING = -0.2
"""Cosine between normals below which two surfaces face each other: they leave less than 78 degrees between them."""

_ON_PLANE = 1e-3
"""m beside a tangent plane, up to which the sphere touches that surface as well, or nearly: noise, a little curvature,
and a gap so narrow that a normal on its one side says nothing of what is on the other."""

_PORTION = 50_000
"""Points between two looks at the progress callback."""


@dataclass(slots=True)
class Clusters:
    """Points and unit normals (k, 3), weight (k,) the members' summed confidence, label (n,) of each input point."""

    points: np.ndarray
    normals: np.ndarray
    weight: np.ndarray
    label: np.ndarray


def cluster(
    points: np.ndarray,
    normals: np.ndarray,
    confidence: np.ndarray,
    size: float,
    progress: Callable[[float], None] | None = None,
) -> Clusters:
    """Gather (n, 3) points within `size` m of a seed whose normals agree; the order of the input decides the seeds."""
    n = len(points)
    slots = 1 << max(4, int(np.ceil(np.log2(2 * n + 1))))
    cells, heads = np.zeros((slots, 3), dtype=np.int64), np.full(slots, -1, dtype=np.int64)
    seeds = Seeds(np.empty((n, 3)), np.empty((n, 3)), cells, heads, np.full(n, -1, dtype=np.int64))
    label, count = np.empty(n, dtype=np.int64), 0
    for begin in range(0, n, _PORTION):
        end = min(begin + _PORTION, n)
        portion = slice(begin, end)
        count = assign(points[portion], normals[portion], size, _AGREEMENT, seeds, count, label[portion])
        if progress is not None:
            progress(end / n)
    centre, facing, total = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
    merge(points, normals, confidence, label, centre, facing, total)
    return Clusters(centre, facing, total, label)


def outvoted(clusters: Clusters, feet: np.ndarray, reach: float) -> np.ndarray:
    """(k,) bool: clusters that face against nearly everything touched around them.

    `feet` (k, 3) are their places on the object. The two sides of a thin plate have about equal weight and stay; a
    contact whose normal was turned over stands alone.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(feet).query_pairs(reach, output_type="ndarray")
    facing = np.einsum("ij,ij->i", clusters.normals[pairs[:, 0]], clusters.normals[pairs[:, 1]])
    own, against = clusters.weight.copy(), np.zeros(len(feet))
    for here, there in ((0, 1), (1, 0)):
        weight = clusters.weight[pairs[:, there]]
        own += np.bincount(pairs[:, here], weight * (facing > _WITH), minlength=len(feet))
        against += np.bincount(pairs[:, here], weight * (facing < -_WITH), minlength=len(feet))
    return against > _OUTVOTED * own


def wedged(clusters: Clusters, reach: float) -> np.ndarray:
    """(k,) bool: places of the sphere's centre, the clusters' points, at which it touches two surfaces.

    They lie on the tangent plane of a place within `reach` m whose surface faces theirs. Two surfaces of the centres
    meet there. The normal is that of one of them, or of the sum of two forces, and beyond the place it holds for
    neither: in front of one surface is the body of the other.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(clusters.points).query_pairs(reach, output_type="ndarray")
    one, other = clusters.normals[pairs[:, 0]], clusters.normals[pairs[:, 1]]
    pairs = pairs[np.einsum("ij,ij->i", one, other) < _FACING]
    found = np.zeros(len(clusters.points), dtype=bool)
    for here, there in ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0])):
        apart = clusters.points[here] - clusters.points[there]
        off = np.abs(np.einsum("ij,ij->i", apart, clusters.normals[there]))
        found[here[off < _ON_PLANE]] = True
    return found


def supported(
    claims: np.ndarray, alike: np.ndarray, points: np.ndarray, normals: np.ndarray, weight: np.ndarray, reach: float
) -> np.ndarray:
    """(n,) bool: the claims (n,) bool that contacts around them share, which are those in `alike` (n,) bool.

    They must hold a quarter of the weight of all that was touched within `reach` m and faces about the same way, and
    be more than one contact: a single noisy normal proves nothing.
    """
    lowest = points.min(axis=0, initial=np.inf)
    cells = 1 + np.floor((points - lowest) / reach).astype(np.int64)  # from 1 on: each has neighbours on all sides
    size = 2 + cells.max(axis=0, initial=0)
    keys = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    places = Cells(points[order], normals[order], keys[order], size)
    agreeing, all_weight = np.zeros(len(points)), np.zeros(len(points))
    support(places, claims[order], alike[order], weight[order], reach, _AGREEMENT, agreeing, all_weight)
    kept = np.zeros(len(points), dtype=bool)
    kept[order] = claims[order] & (agreeing >= np.maximum(_MIN_SUPPORT, _MIN_SHARE * all_weight))
    return kept


def thinnest_wall(clusters: Clusters, feet: np.ndarray, reach: float) -> float:
    """m between contacts that face apart within `reach` m, a quarter of the pairs being nearer; inf without such walls.

    `feet` (k, 3) are the clusters' places on the object.
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(feet).query_pairs(reach, output_type="ndarray")
    one, other = clusters.normals[pairs[:, 0]], clusters.normals[pairs[:, 1]]
    apart = np.einsum("ij,ij->i", feet[pairs[:, 0]] - feet[pairs[:, 1]], 0.5 * (one - other))
    walls = apart[(np.einsum("ij,ij->i", one, other) < -_AGREEMENT) & (apart > 0.0)]
    return float(np.percentile(walls, 25.0)) if len(walls) >= _WALL else np.inf
