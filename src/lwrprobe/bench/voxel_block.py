"""The object of the map benches: the voxels that cover a block."""

from __future__ import annotations

import numpy as np

EDGE = 0.002


def block_surface(count: int, seed: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`count` voxel centres (n, 3) m on the surface of a block, shuffled, and the block's centre and size (3,).

    The block is 2 : 1 : 1, the smallest whose surface has that many voxels, and stands half a metre ahead on z = 0.
    """
    side = 2
    while 10 * side * side - 16 * side + 8 < count:
        side += 1
    shape = np.array([2 * side, side, side])
    cells = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    shell = cells[((cells == 0) | (cells == shape - 1)).any(axis=1)]
    chosen = np.random.default_rng(seed).permutation(len(shell))[:count]
    corner = np.array([0.5 / EDGE, 0.0, 0.0]).round() - [side, side // 2, 0]
    return (shell[chosen] + corner + 0.5) * EDGE, (corner + 0.5 * shape) * EDGE, shape * EDGE
