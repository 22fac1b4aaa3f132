"""The inside of a sampled field made well-composed, so that its surface is a manifold.

Well-composed (Latecki, Eckhardt, Rosenfeld 1995): no two voxels of the inside touch in an edge or a corner alone.
"""

from __future__ import annotations

from lwrprobe.compiled import kernel


@kernel
def compose(values, tiny):
    """One pass that makes the inside (values < 0) well-composed by adding nodes to it; how many were added."""
    nx, ny, nz = values.shape
    added = 0
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                for axis in range(3):
                    added += _mend_face(values, i, j, k, axis, tiny)
                added += _mend_corner(values, i, j, k, tiny)
    return added


@kernel
def _mend_face(values, i, j, k, axis, tiny):
    ai, aj, ak = (0, 1, 0) if axis == 0 else (1, 0, 0)
    bi, bj, bk = (0, 1, 0) if axis == 2 else (0, 0, 1)
    near, far = values[i, j, k] < 0.0, values[i + ai + bi, j + aj + bj, k + ak + bk] < 0.0
    one, two = values[i + ai, j + aj, k + ak] < 0.0, values[i + bi, j + bj, k + bk] < 0.0
    if near != far or one != two or near == one:
        return 0
    if near:
        if values[i + ai, j + aj, k + ak] < values[i + bi, j + bj, k + bk]:
            values[i + ai, j + aj, k + ak] = -tiny
        else:
            values[i + bi, j + bj, k + bk] = -tiny
    elif values[i, j, k] < values[i + ai + bi, j + aj + bj, k + ak + bk]:
        values[i, j, k] = -tiny
    else:
        values[i + ai + bi, j + aj + bj, k + ak + bk] = -tiny
    return 1


@kernel
def _mend_corner(values, i, j, k, tiny):
    inside = 0
    for di in range(2):
        for dj in range(2):
            for dk in range(2):
                if values[i + di, j + dj, k + dk] < 0.0:
                    inside += 1
    if inside != 2 and inside != 6:
        return 0
    for dj in range(2):
        for dk in range(2):
            this, that = values[i, j + dj, k + dk] < 0.0, values[i + 1, j + 1 - dj, k + 1 - dk] < 0.0
            if this and that and inside == 2:
                values[i + 1, j + dj, k + dk] = -tiny
                return 1
            if not this and not that and inside == 6:
                values[i, j + dj, k + dk] = -tiny
                return 1
    return 0
