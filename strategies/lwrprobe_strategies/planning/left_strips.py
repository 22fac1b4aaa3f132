"""Lines up what was left between two touched strips of one steep face.

Lines a spacing apart meet a face that stands aslant farther apart than that: by 1.4 times at 45 degrees. Lines along
the other axis come in between only where the object lets them. What is left then is found from the contacts alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.lines import Line, Z

STEEP = 0.5
"""Share of the normal along z, up to which a touch is one of a steep face."""
GRAIN = 0.002
"""m, edge of the cubes of which one touch is looked at."""
MARGIN = 0.001
"""m beyond half a pitch from a touch, up to which a face counts as touched."""
ALIKE = 0.95
"""Cosine between two normals of one face: it may be curved, and normals are known to a few degrees."""
OUT_OF_PLANE = 0.0025
"""m by which two touches of one face may lie before or behind each other."""
LEVEL = 0.0015
"""m in height, between two touches with the same height."""
TALL = 0.75
"""Pitches in height that are worth a line."""
BEFORE, BEHIND = 0.012, 0.003
"""m before and behind where the sphere is expected to touch, between which a line leads."""
OVERLAP = 0.001
"""m, by which both contours overlap."""


def left_strips(contacts: np.ndarray, area: Area, pitch: float, lowest: Callable[[Line], float]) -> list[Line]:
    """A line up each strip that lies between two touched ones of the same face, too far from both to count as touched.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    pitch : m, between two lines
    lowest : m, height at which a line may be driven
    """
    wall = contacts[np.abs(contacts[:, 8]) < STEEP]
    if not len(wall):
        return []
    wall = _thinned(wall, wall[:, 3:6])
    near = 0.5 * pitch + MARGIN
    middles = _between(wall[np.argsort(wall[:, 5])], near, 2.0 * pitch)
    middles = _thinned(middles, middles[:, :3])
    middles = middles[~_touched(middles, wall, near)]
    lines: list[Line] = []
    while len(middles):
        around = _beside(middles, middles[0], 0.5 * pitch)
        own = _beside(middles, np.median(middles[around], axis=0), 0.5 * pitch) | (np.arange(len(middles)) == 0)
        strip, middles = middles[own], middles[~own]
        if np.ptp(strip[:, Z]) < TALL * pitch:
            continue
        place, normal = np.median(strip[:, 6:9], axis=0), np.median(strip[:, 3:6], axis=0)
        axis = int(np.argmax(np.abs(normal[:2])))
        sign = -float(np.sign(normal[axis]))
        low, high = float(area.lower[axis]), float(area.upper[axis])
        begin = min(max(float(place[axis]) - sign * BEFORE, low), high)
        line = Line(axis, float(place[1 - axis]), begin, float(place[axis]) + sign * BEHIND, float(area.lower[Z]))
        height, ceiling = lowest(line), float(strip[:, 8].max()) + OVERLAP
        if ceiling - height > 0.5 * pitch:
            lines.append(replace(line, height=height, ceiling=ceiling, low=True))
    return lines


def _thinned(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The first of the rows (m, k) in each cube around their points (m, 3)."""
    return rows[np.unique(np.round(points / GRAIN).astype(int), axis=0, return_index=True)[1]]


def _between(wall: np.ndarray, near: float, farthest: float) -> np.ndarray:
    """(k, 9) point, normal and sphere's centre half way between each two touches (m, 10) of one face at one height.

    The touches go upwards. Two are more than twice `near` m apart, and up to `farthest` m.
    """
    points, normals, found = wall[:, 3:6], wall[:, 6:9], []
    ends = np.searchsorted(points[:, Z], points[:, Z] + LEVEL)
    for k, end in enumerate(ends):
        step = points[k + 1 : end] - points[k]
        apart = (step * step).sum(axis=1)
        pair = (apart > 4.0 * near * near) & (apart < farthest * farthest)
        pair &= (normals[k + 1 : end] @ normals[k] > ALIKE) & (np.abs(step @ normals[k]) < OUT_OF_PLANE)
        other = np.flatnonzero(pair) + k + 1
        if len(other):
            found.append(0.5 * (wall[other] + wall[k]))
    middles = np.concatenate(found) if found else np.empty((0, wall.shape[1]))
    return middles[:, [3, 4, 5, 6, 7, 8, 0, 1, 2]]


def _beside(middles: np.ndarray, middle: np.ndarray, reach: float) -> np.ndarray:
    """(k,) bool, which middles (k, 9) lie within a reach [m] of one (9,) in the plan view and face as it does."""
    apart = np.hypot(middles[:, 0] - middle[0], middles[:, 1] - middle[1])
    near: np.ndarray = (apart < reach) & (middles[:, 3:6] @ middle[3:6] > ALIKE)
    return near


def _touched(middles: np.ndarray, wall: np.ndarray, near: float) -> np.ndarray:
    """(k,) bool, where a touch (m, 10) that faces alike is within `near` m of the middles (k, 9)."""
    from scipy.spatial import cKDTree

    close = cKDTree(wall[:, 3:6]).query_ball_point(middles[:, :3], near)
    alike = [bool((wall[rows, 6:9] @ middle[3:6] > STEEP).any()) for rows, middle in zip(close, middles)]
    return np.array(alike, dtype=bool)
