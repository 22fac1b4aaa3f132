"""Exact distances on a grid (kernels, private): Felzenszwalb, Huttenlocher 2012, lower envelopes of parabolas.

A squared distance along one axis after the other; `FAR` stands for a line on which nothing is near.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import kernel

FAR = np.inf


@kernel
def along_line(values, count, sites, bounds, out):
    """out[i] = min over j of values[j] + (i - j)^2, for `count` values; `sites` and `bounds` are work space."""
    last = -1
    for j in range(count):
        if values[j] == FAR:
            continue
        low = -FAR
        while last >= 0:
            i = sites[last]
            # Where the parabola of j comes below that of i.
            low = 0.5 * ((values[j] + j * j) - (values[i] + i * i)) / (j - i)
            if low > bounds[last]:
                break
            last -= 1
            low = -FAR
        last += 1
        sites[last], bounds[last] = j, low
    if last < 0:
        for i in range(count):
            out[i] = FAR
        return
    at = 0
    for i in range(count):
        while at < last and bounds[at + 1] < i:
            at += 1
        j = sites[at]
        out[i] = values[j] + (i - j) * (i - j)


@kernel
def distances(marked, edge, out):
    """Distances out (nx, ny, nz) from each grid point to the nearest one that is not marked, infinite without one."""
    nx, ny, nz = marked.shape
    longest = max(nx, ny, nz)
    line, found, bounds = np.empty(longest), np.empty(longest), np.empty(longest)
    sites = np.empty(longest, np.int64)
    for i in range(nx):
        for j in range(ny):
            last = FAR
            for k in range(nz):
                last = last + 1.0 if marked[i, j, k] else 0.0
                line[k] = last
            last = FAR
            for k in range(nz - 1, -1, -1):
                last = min(last + 1.0, line[k])
                out[i, j, k] = last * last
    for i in range(nx):
        for k in range(nz):
            for j in range(ny):
                line[j] = out[i, j, k]
            along_line(line, ny, sites, bounds, found)
            for j in range(ny):
                out[i, j, k] = found[j]
    for j in range(ny):
        for k in range(nz):
            for i in range(nx):
                line[i] = out[i, j, k]
            along_line(line, nx, sites, bounds, found)
            for i in range(nx):
                out[i, j, k] = edge * np.sqrt(found[i])
