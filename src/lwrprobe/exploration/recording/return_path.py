"""The path on which the probe returns to where a run was cut off: down from above, then as it came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe.contracts.contact import RELIABLE_FROM
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
DIVE = 0.3
"""Share of a step along the stick, from which on a touch there is one along the stick."""

AXIS = [5, 8, 11]
"""Columns of a path's row, place and rotation, that hold the tip's z axis, along the stick."""


@dataclass(slots=True, frozen=True)
class ReturnSpeeds:
    """m/s: where nothing can be touched, where something may be touched, and where that would be along the stick."""

    free: float
    approach: float
    touch: float


@dataclass(slots=True, frozen=True)
class Leg:
    """A straight piece of the return: the pose (4, 4) where it ends and the speed [m/s] on the path there."""

    pose: np.ndarray
    speed: float


def return_path(past: Past, area: Area, radius: float, speeds: ReturnSpeeds) -> list[Leg]:
    """Over the area, down to a place of the path that was driven, and along that path; loops are cut.

    The probe comes down where the return takes the shortest time. There the stick stood already, and no contact was
    found within `radius` [m, of the sphere] and `LIFT` above the place; at the area's border nothing stands. The last
    leg ends where the run was cut off; where a surface was touched there, the one before it ends off that surface.
    """
    seen = np.flatnonzero(past.rows[:, 0] == SEEN)
    rows = past.rows[seen[seen <= past.last]]
    poses = rows[:, 2:14].reshape(-1, 3, 4)
    normals = np.where((rows[:, [22]] > 0.0) & (rows[:, [24]] >= RELIABLE_FROM), rows[:, 28:31], 0.0)
    rotations, places = poses[:, :, :3].reshape(-1, 9), poses[:, :, 3] + LIFT * normals
    driven = _without_loops(np.hstack([places, rotations]))
    height = np.maximum(area.upper[2] - driven[:, 2], 0.0)
    gap = np.minimum(driven[:, :2] - area.lower[:2], area.upper[:2] - driven[:, :2]).min(axis=1)
    is_open = (height < OPEN) | (gap < OPEN)
    down = np.where(is_open, speeds.approach, speeds.touch)
    times = np.linalg.norm(np.diff(driven[:, :3], axis=0), axis=1) / _allowed(driven, speeds)
    remaining = np.append(np.cumsum(times[::-1])[::-1], 0.0)
    touched = rows[rows[:, 22] > 0.0, 25:28]
    soonest = np.argsort(height / down + remaining, kind="stable")
    first = next((int(k) for k in soonest if is_open[k] or not _stands_above(driven[k], touched, radius + LIFT)), 0)
    driven = driven[first:]
    corners = driven[path_corners(driven[:, :3], driven[:, 3:], CHORD, TURN)]
    if normals[-1].any():
        corners = np.vstack([corners, np.hstack([poses[-1, :, 3], rotations[-1]])])
    above, axis = _pose(corners[0]), corners[0][AXIS]
    if height[first] > 0.0 and axis[2] < 0.0:
        above[:3, 3] += height[first] / axis[2] * axis
    legs = [Leg(above, speeds.free), Leg(_pose(corners[0]), float(down[first]))]
    along = zip(corners[1:], _allowed(corners, speeds).tolist(), strict=True)
    return legs + [Leg(_pose(row), speed) for row, speed in along]


def _allowed(rows: np.ndarray, speeds: ReturnSpeeds) -> np.ndarray:
    """m/s on the steps between the rows (n, 12): slower where the probe moves towards its tip, where it is stiff."""
    steps = np.diff(rows[:, :3], axis=0)
    dives = (steps * rows[:-1, AXIS]).sum(axis=1) > DIVE * np.linalg.norm(steps, axis=1)
    return np.where(dives, speeds.touch, speeds.approach)


def _stands_above(row: np.ndarray, touched: np.ndarray, radius: float) -> bool:
    """Whether one of the contacts (n, 3) lies within `radius` of the stick's axis, above the sphere's centre."""
    off = touched - row[:3]
    along = off @ row[AXIS]
    aside = np.linalg.norm(off - along[:, None] * row[AXIS], axis=1)
    return bool(((along < 0.0) & (aside < radius)).any())


def _without_loops(rows: np.ndarray) -> np.ndarray:
    """Rows (n, 12: place and rotation) from the first to the last; where they come back to a place, the shorter one."""
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
