"""Finds contacts with a table that is not where the scene puts it, and leaves them out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lwrprobe.contracts import Area

LEAN = np.cos(np.radians(12.0))
"""Share of the normal along that of the stated table, from which on a contact may be a table's."""
AWAY = 0.010
"""m, by which a table may be off the place that was stated."""
HIGHER = 0.004
"""m in the middle of the area, by which a table may be higher or lower than stated: four standard deviations of one
that nobody has measured. What is farther off is a plate that goes on beyond the area."""
FLAT = 0.0004
"""m off the plane, up to which a contact lies in it."""
ALIKE = np.cos(np.radians(5.0))
"""Of the angle between a contact's normal and the plane's, from which on it counts for the plane."""
STEEPEST = np.cos(np.radians(25.0))
"""The same, from which on a contact in the plane is the table's: a sphere of 4 mm or more, which is above the table,
touches nothing as low as `FLAT` where that is steeper. When a touch begins normals are off by 5 degrees and more."""
AT_BORDER = 0.001
"""m from the border of the area, within which the sphere's centre stands at it."""
FEWEST = 10
TRIED = 200
"""Contacts that are tried as the plane's."""


@dataclass(slots=True, frozen=True)
class TablePlane:
    """`normal` (3,) unit, upwards, and `offset` m: all places p with normal @ p = offset."""

    normal: np.ndarray
    offset: float

    def touched(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(n,) bool: which contacts (n, 3), with unit normals (n, 3), are this table's."""
        return self._in_plane(points) & (normals @ self.normal > STEEPEST)

    def shown_by(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(n,) bool: which of them have its normal as well."""
        return self._in_plane(points) & (normals @ self.normal > ALIKE)

    def _in_plane(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(points @ self.normal - self.offset) < FLAT)

    def height_at(self, place: np.ndarray) -> float:
        """m, of the plane over a place (2,) m."""
        return float((self.offset - self.normal[:2] @ place) / self.normal[2])

    def as_dict(self, contacts: int) -> dict[str, Any]:
        """For the summary, with the number of contacts that are left out for it."""
        tilt = float(np.degrees(np.arccos(min(self.normal[2], 1.0))))
        plane = {"normal": [float(v) for v in self.normal], "offset_m": float(self.offset)}
        return plane | {"tilt_deg": round(tilt, 3), "contacts": contacts}

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> TablePlane:
        """From a summary."""
        return cls(np.array(stored["normal"], dtype=np.float64), float(stored["offset_m"]))


def find_table(
    points: np.ndarray, normals: np.ndarray, area: Area, radius: float, stated: TablePlane
) -> TablePlane | None:
    """The plane near the stated one in which contacts (n, 3) go on to the border of the area; None without one.

    What ends inside the area is an object, however low and flat.
    """
    low = (normals @ stated.normal > LEAN) & (np.abs(points @ stated.normal - stated.offset) < AWAY)
    points, normals = points[low], normals[low]
    if len(points) < FEWEST:
        return None
    tried = np.unique(np.linspace(0, len(points) - 1, TRIED).astype(int))
    planes = [TablePlane(normals[k], float(normals[k] @ points[k])) for k in tried]
    best = max(planes, key=lambda plane: int(plane.shown_by(points, normals).sum()))
    for _ in range(3):
        own = best.shown_by(points, normals)
        if own.sum() < FEWEST:
            return None
        best = _fitted(points[own], normals[own])
    own = best.shown_by(points, normals)
    centres = points[own, :2] + radius * normals[own, :2]
    at_border = (centres < area.lower[:2] + AT_BORDER) | (centres > area.upper[:2] - AT_BORDER)
    middle = 0.5 * (area.lower[:2] + area.upper[:2])
    height, expected = (plane.height_at(middle) for plane in (best, stated))
    return best if own.sum() >= FEWEST and at_border.any() and abs(height - expected) < HIGHER else None


def _fitted(points: np.ndarray, normals: np.ndarray) -> TablePlane:
    """Least squares in z; where the contacts lie on one line only, across it their normals decide."""
    middle, mean = points.mean(axis=0), normals.mean(axis=0)
    slope = -mean[:2] / mean[2]
    flat = points[:, :2] - middle[:2]
    axes, spread, rows = np.linalg.svd(flat, full_matrices=False)
    left = points[:, 2] - middle[2] - flat @ slope
    for k in np.flatnonzero(spread > 0.005 * np.sqrt(len(points))):  # 5 mm RMS: far enough to tell a slope
        slope = slope + (axes[:, k] @ left / spread[k]) * rows[k]
    normal = np.array([-slope[0], -slope[1], 1.0])
    normal /= np.linalg.norm(normal)
    return TablePlane(normal, float(normal @ middle))
