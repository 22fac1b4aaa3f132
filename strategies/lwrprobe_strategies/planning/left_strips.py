"""Lines up what was left between two touched strips of one steep face.

Lines a spacing apart meet a face that stands aslant farther apart than that: by 1.4 times at 45 degrees. Lines along
the other axis come in between only where the object lets them. What is left then is found from the contacts alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.contact_memory import NORMAL, NORMAL_Z, POINT, POINT_X, POINT_Y, POINT_Z
from lwrprobe_strategies.planning.lines import OVERLAP, Line, Z

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


def left_strips(contacts: np.ndarray, area: Area, pitch: float, lowest: Callable[[Line], float]) -> list[Line]:
    """A line up each strip that lies between two touched ones of the same face, too far from both to count as touched.

    Parameters
    ----------
    contacts : (m, 10) as in `ContactMemory.contacts`
    pitch : m, between two lines
    lowest : m, height at which a line may be driven
    """
    wall = contacts[np.abs(contacts[:, NORMAL_Z]) < STEEP]
    if not len(wall):
        return []
    wall = _thinned(wall)
    near = 0.5 * pitch + MARGIN
    middles = _between(wall[np.argsort(wall[:, POINT_Z])], near, 2.0 * pitch)
    middles = _thinned(middles)
    middles = middles[~_touched(middles, wall, near)]
    lines: list[Line] = []
    while len(middles):
        around = _beside(middles, middles[0], 0.5 * pitch)
        own = _beside(middles, np.median(middles[around], axis=0), 0.5 * pitch) | (np.arange(len(middles)) == 0)
        strip, middles = middles[own], middles[~own]
        if np.ptp(strip[:, POINT_Z]) < TALL * pitch:
            continue
        place, normal = np.median(strip[:, :3], axis=0), np.median(strip[:, NORMAL], axis=0)
        axis = int(np.argmax(np.abs(normal[:2])))
        sign = -float(np.sign(normal[axis]))
        low, high = float(area.lower[axis]), float(area.upper[axis])
        begin = min(max(float(place[axis]) - sign * BEFORE, low), high)
        line = Line(axis, float(place[1 - axis]), begin, float(place[axis]) + sign * BEHIND, float(area.lower[Z]))
        height, ceiling = lowest(line), float(strip[:, Z].max()) + OVERLAP
        if ceiling - height > 0.5 * pitch:
            lines.append(replace(line, height=height, ceiling=ceiling, low=True))
    return lines


def _thinned(rows: np.ndarray) -> np.ndarray:
    """The first of the touches (m, 10) in each cube around their points."""
    return rows[np.unique(np.round(rows[:, POINT] / GRAIN).astype(int), axis=0, return_index=True)[1]]


def _between(wall: np.ndarray, near: float, farthest: float) -> np.ndarray:
    """(k, 10), columns as those of a contact, half way between each two touches (m, 10) of one face at one height.

    The touches go upwards. Two are more than twice `near` m apart, and up to `farthest` m.
    """
    points, normals, found = wall[:, POINT], wall[:, NORMAL], []
    ends = np.searchsorted(points[:, Z], points[:, Z] + LEVEL)
    for k, end in enumerate(ends):
        step = points[k + 1 : end] - points[k]
        apart = (step * step).sum(axis=1)
        pair = (apart > 4.0 * near * near) & (apart < farthest * farthest)
        pair &= (normals[k + 1 : end] @ normals[k] > ALIKE) & (np.abs(step @ normals[k]) < OUT_OF_PLANE)
        other = np.flatnonzero(pair) + k + 1
        if len(other):
            found.append(0.5 * (wall[other] + wall[k]))
    return np.concatenate(found) if found else np.empty((0, wall.shape[1]))


def _beside(middles: np.ndarray, middle: np.ndarray, reach: float) -> np.ndarray:
    """(k,) bool, which middles (k, 10) lie within a reach [m] of one (10,) in the plan view and face as it does."""
    apart = np.hypot(middles[:, POINT_X] - middle[POINT_X], middles[:, POINT_Y] - middle[POINT_Y])
    near: np.ndarray = (apart < reach) & (middles[:, NORMAL] @ middle[NORMAL] > ALIKE)
    return near


def _touched(middles: np.ndarray, wall: np.ndarray, near: float) -> np.ndarray:
    """(k,) bool, where a touch (m, 10) that faces alike is within `near` m of the middles (k, 10)."""
    from scipy.spatial import cKDTree

    close = cKDTree(wall[:, POINT]).query_ball_point(middles[:, POINT], near)
    alike = [bool((wall[rows, NORMAL] @ middle[NORMAL] > STEEP).any()) for rows, middle in zip(close, middles)]
    return np.array(alike, dtype=bool)
