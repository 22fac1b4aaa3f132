"""Walls below the lowest contacts on them, where the probe's body or a line that ended early let nothing be touched.

A wall is taken to go straight down from where it was touched last. Without this, the surface ran half way between
the object and the nearest place that was passed freely, which below the probe's reach is far beside the object.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.hermite_field import HermiteData
from lwrprobe.reconstruction.touches import Touches

_UPRIGHT = -0.15, 0.35  # z of a wall's normals: lower it overhangs, higher its foot is elsewhere
_ALIKE = 0.98  # cosine between the normals of one wall
_STEP = 0.5  # of the pitch, between places
_STRAIGHT = 2.0  # radii: so much higher up a wall faces the same way
_BESIDE = 0.6  # of the pitch: contacts of the same line, or of another that shows the wall there
_DEEP = 1.0  # of the pitch: so far the contacts themselves show how a wall goes on
_FLOOR = 1.5  # of the pitch: how far away a contact on a floor tells of it
_FACES_UP = 0.2  # z of such a contact's normal
_SUNK = 0.25  # radii: so far below a floor a sphere is in the solid
_PASSED = 0.8  # radii: so near to a place that was passed freely nothing is
_GROWTH = 0.03  # m of standard deviation a metre below the last contact
_NORMAL_SD = 0.1  # rad


def find_lower_walls(touches: Touches, clusters: Clusters, pitch: float) -> HermiteData:
    """Where the sphere's centre would be if it touched the walls lower down, and the surface's normals there.

    `clusters` are those of the touches' centres, `pitch` [m] lies between their lines. Each row goes down from the
    lowest contacts of a wall to `touches.lowest`, to a floor, or to where the sphere passed freely.
    """
    from scipy.spatial import cKDTree

    if touches.table is None:
        return _data(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    lowest = _lowest(clusters, pitch, touches.radius)
    lowest = lowest[clusters.points[lowest, 2] > touches.lowest + _DEEP * pitch]
    start, facing = clusters.points[lowest], clusters.normals[lowest] * [1.0, 1.0, 0.0]
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    floors = clusters.normals[:, 2] > _FACES_UP
    floor, up = clusters.points[floors], clusters.normals[floors]
    beneath, passed = cKDTree(floor), cKDTree(touches.visited)
    places, normals, depths = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for top, normal in zip(start, facing):
        down = np.arange(_STEP * pitch, top[2] - touches.lowest + 0.5 * _STEP * pitch, _STEP * pitch)
        row = np.column_stack([np.broadcast_to(top[:2], (len(down), 2)), top[2] - down])
        ended = np.zeros(len(row), dtype=bool)
        for i, near in enumerate(passed.query_ball_point(row, _PASSED * touches.radius)):
            ended[i] = bool((touches.visited[near, 2] < top[2] - touches.radius).any())
        for i, near in enumerate(beneath.query_ball_point(row, _FLOOR * pitch)):
            offset = floor[near] - row[i]
            sunk = np.einsum("ij,ij->i", offset, up[near]) > _SUNK * touches.radius
            ended[i] |= bool((sunk & (offset @ normal > -touches.radius)).any())
        kept = ~np.logical_or.accumulate(ended)
        places.append(row[kept])
        normals.append(np.broadcast_to(normal, places[-1].shape))
        depths.append(down[kept])
    depth = np.concatenate(depths)
    return _data(np.concatenate(places), np.concatenate(normals), np.hypot(touches.noise, _GROWTH * depth))


def _data(centres: np.ndarray, normals: np.ndarray, deviation: np.ndarray) -> HermiteData:
    return HermiteData(centres, normals, deviation, np.full(len(centres), _NORMAL_SD))


def _lowest(clusters: Clusters, pitch: float, radius: float) -> np.ndarray:
    """(k,) numbers of the clusters that lie lowest on their line on a wall, and higher up face as they do here."""
    from scipy.spatial import cKDTree

    height, normals, places = clusters.points[:, 2], clusters.normals, clusters.points[:, :2]
    upright = np.flatnonzero((normals[:, 2] > _UPRIGHT[0]) & (normals[:, 2] < _UPRIGHT[1]))
    beside = max(_BESIDE * pitch, radius)
    found = []
    for i, near in zip(upright, cKDTree(places).query_ball_point(places[upright], max(pitch, beside))):
        rise, facing = height[near] - height[i], normals[near] @ normals[i]
        same_line = np.linalg.norm(places[near] - places[i], axis=1) <= beside
        lower = same_line & (rise < -1e-9) & (facing > 0.0)
        higher = (rise > _STRAIGHT * radius) & (facing > _ALIKE)
        if higher.any() and not lower.any():
            found.append(i)
    return np.array(found, dtype=np.int64)
