"""The path on which the probe returns to where a run was cut off: from a place above which nothing is, as it came."""

from __future__ import annotations

import numpy as np

from lwrprobe.contact import RELIABLE_FROM
from lwrprobe.contracts import Area
from lwrprobe.exploration.recording.logbook import SEEN, Past
from lwrprobe.mapping import path_corners

OPEN = 0.001
"""m from the area's border or below its top, within which nothing stands above the probe."""
LIFT = 0.001
"""m off the surface, along the contact's normal, on which a contour is passed again."""
CUT = 0.001
"""m between two places of the path, within which what the probe did in between is left out."""
CHORD, TURN = 0.0003, 0.05
"""m, and change of a rotation's element, by which straight pieces may differ from the path that was driven."""


def return_path(past: Past, area: Area) -> list[np.ndarray]:
    """Poses (4, 4): above a place that is open towards the top, then along what was driven from there; loops are cut.

    The last pose is where the run was cut off; before it, where a surface was touched there, comes one that is off that
    surface. A run that never was at an open place returns over its first one.
    """
    seen = np.flatnonzero(past.rows[:, 0] == SEEN)
    rows = past.rows[seen[seen <= past.last]]
    poses = rows[:, 2:14].reshape(-1, 3, 4)
    normals = np.where((rows[:, [22]] > 0.0) & (rows[:, [24]] >= RELIABLE_FROM), rows[:, 28:31], 0.0)
    rotations, places = poses[:, :, :3].reshape(-1, 9), poses[:, :, 3] + LIFT * normals
    gap = np.minimum(places - area.lower, area.upper - places)
    is_open = (places[:, 2] > area.upper[2] - OPEN) | (gap[:, :2].min(axis=1) < OPEN)
    first = int(np.flatnonzero(is_open)[-1]) if is_open.any() else 0
    driven = _without_loops(np.hstack([places, rotations])[first:])
    path = [_pose(row) for row in driven[path_corners(driven[:, :3], driven[:, 3:], CHORD, TURN)]]
    above, axis = path[0].copy(), path[0][:3, 2]
    height = float(area.upper[2]) - above[2, 3]
    if height > 0.0 and axis[2] < 0.0:
        above[:3, 3] += height / axis[2] * axis
    if normals[-1].any():
        path.append(_pose(np.hstack([poses[-1, :, 3], rotations[-1]])))
    return [above, *path]


def _without_loops(rows: np.ndarray) -> np.ndarray:
    """Rows (n, 12: place and rotation) from the first to the last; where they come back to a place, the shorter way."""
    kept, k = [0], 0
    while k < len(rows) - 1:
        near = np.abs(rows[k + 1 :, :3] - rows[k, :3]).max(axis=1) < CUT
        alike = np.abs(rows[k + 1 :, 3:] - rows[k, 3:]).max(axis=1) < TURN
        back = np.flatnonzero(near & alike)
        k += 1 + (int(back[-1]) if len(back) else 0)
        kept.append(k)
    return rows[kept]


def _pose(row: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = row[3:].reshape(3, 3), row[:3]
    return pose
