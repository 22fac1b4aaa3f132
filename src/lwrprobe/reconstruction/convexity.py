"""The tangent planes of an object of which all that was touched is convex: nothing of it lies beyond any of them.

A convex body lies on one side of each of its tangent planes, and so does the surface of the sphere's centres around it.
What nobody could touch, below a side that recedes or behind an edge, is bounded by the planes of what was touched.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.convexity_kernels import beyond, beyond_planes
from lwrprobe.reconstruction.grid import Grid
from lwrprobe.reconstruction.touches import Touches

_SD = 3.0  # standard deviations that a contact may lie beyond a plane, and by which each plane is moved out
_MAY_LIE = 0.01  # share of the contacts that may lie farther beyond a plane
_MAY_FAIL = 0.02  # share of the planes beyond which more may lie
_BESIDE = 1.0  # of the pitch: so near to contacts these say where the surface is
_ABOVE_FOOT = 2.0  # radii above the lowest height of the sphere's centre, to which the object has to reach down
_PLANES = 800  # planes that are looked at, of many
_HOLDS = 0.3  # of the normal's noise: so much of it the contacts of one plane share


def tangent_bound(
    touches: Touches, clusters: Clusters, pitch: float, grid: Grid, values: np.ndarray
) -> np.ndarray | None:
    """(nx, ny, nz) m, how far each node of the grid is beyond the tangent planes; None where something is not convex.

    `clusters` are those of the touches' centres, `pitch` [m] lies between their lines: nodes beside contacts are left
    to those. Nodes whose `values` (nx, ny, nz) are positive lie outside already.
    """
    share = 1.0 / np.sqrt(clusters.weight)
    angle = touches.normal_noise * np.hypot(share, _HOLDS)
    every = slice(None, None, len(clusters.points) // _PLANES + 1)
    planes = clusters.points[every], clusters.normals[every], angle[every]
    lying = beyond(clusters.points, *planes, _SD, _SD * touches.noise)
    holds = lying <= _MAY_LIE * len(clusters.points)  # a normal that is wrong by much would cut the object in two
    if holds.mean() < 1.0 - _MAY_FAIL:
        return None
    bound = np.full(grid.shape, -np.inf)
    points, normals, error = (part[holds] for part in planes)
    untouched = grid.nearest(clusters.points, _BESIDE * pitch) < 0
    outside = np.where(untouched, values, np.inf)
    beyond_planes(grid.origin, grid.step, outside, points, normals, _SD * error, _SD * touches.noise, bound)
    if touches.table is not None:
        height = touches.lowest + _ABOVE_FOOT * touches.radius - grid.origin[2]
        foot = min(max(int(np.ceil(height / grid.step)), 0), grid.shape[2] - 1)
        stands = values[:, :, foot] < 0.0
        if stands.any() and not (stands & (bound[:, :, foot] < 0.0)).any():
            return None  # it would end above the table
    return bound
