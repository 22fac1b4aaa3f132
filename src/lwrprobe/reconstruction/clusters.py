"""Fewer, better points: contacts close together that face the same way become one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lwrprobe.reconstruction.cluster_kernels import assign, merge

_AGREEMENT = 0.8
"""Cosine between normals above which two contacts may be of one surface: 37 degrees."""

_PORTION = 50_000
"""Points between two looks at the progress callback."""


@dataclass(slots=True)
class Clusters:
    """Points and unit normals (k, 3), weight (k,) as the sum of the members' trust, label (n,) of each input point."""

    points: np.ndarray
    normals: np.ndarray
    weight: np.ndarray
    label: np.ndarray


def cluster(
    points: np.ndarray,
    normals: np.ndarray,
    trust: np.ndarray,
    size: float,
    progress: Callable[[float], None] | None = None,
) -> Clusters:
    """Gather (n, 3) points within `size` m of a seed whose normals agree; the order of the input decides the seeds."""
    n = len(points)
    slots = 1 << max(4, int(np.ceil(np.log2(2 * n + 1))))
    cells, heads = np.zeros((slots, 3), dtype=np.int64), np.full(slots, -1, dtype=np.int64)
    chain, label = np.full(n, -1, dtype=np.int64), np.empty(n, dtype=np.int64)
    seeds, seed_normals = np.empty((n, 3)), np.empty((n, 3))
    count = 0
    for begin in range(0, n, _PORTION):
        end = min(begin + _PORTION, n)
        count = assign(
            points, normals, begin, end, size, _AGREEMENT, cells, heads, chain, seeds, seed_normals, count, label
        )  # fmt: skip
        if progress is not None:
            progress(end / n)
    centre, facing, total = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
    merge(points, normals, trust, label, centre, facing, total)
    return Clusters(centre, facing, total, label)
