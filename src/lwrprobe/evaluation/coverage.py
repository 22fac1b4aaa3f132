"""How much of what can be touched has been touched, and whether the object's ends were found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area, InputError, LinkShape
from lwrprobe.evaluation.point_error import rows
from lwrprobe.evaluation.reach import SAMPLES, Reach, reach, upright
from lwrprobe.scene.solid import Solid

_CLOSE = 0.005  # m
UPRIGHT_SAMPLES = 4000  # each is looked at some hundred times
_FACING = 0.7071  # share of the normal along the axis


@dataclass(slots=True, frozen=True)
class Coverage:
    """Shares (0..1) of the reachable surface that have a contact nearby; 1 where nothing can be reached.

    Attributes
    ----------
    share : within half the line pitch plus 1 mm of a contact
    share_5mm : within 5 mm of a contact
    reachable_area, whole_area : m^2
    """

    share: float
    share_5mm: float
    reachable_area: float
    whole_area: float

    def as_dict(self) -> dict[str, float]:
        """Shares, and areas in cm^2."""
        return {
            "coverage": round(self.share, 4),
            "coverage_5mm": round(self.share_5mm, 4),
            "reachable_area_cm2": round(1e4 * self.reachable_area, 2),
            "whole_area_cm2": round(1e4 * self.whole_area, 2),
        }


def coverage(
    contacts: np.ndarray,
    solid: Solid,
    radius: float,
    lowest: float,
    pitch: float,
    area: Area | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
) -> Coverage:
    """Share of the reachable true surface near a contact.

    Parameters
    ----------
    contacts : (n, 3) m
    radius : m, of the sphere
    lowest : m, lowest height of its centre
    pitch : m, between grid lines
    area : count only what the sphere can reach with its centre in this box, None = anywhere above `lowest`
    """
    if not pitch > 0.0:
        raise InputError("pitch", pitch, "a positive length in metres")
    found = reach(solid, radius, lowest, area, samples, seed)
    gap = _gaps(found, rows("contacts", contacts))
    whole = 0.0 if solid.empty else solid.area(seed)
    return Coverage(_share(gap, 0.5 * pitch + 0.001), _share(gap, _CLOSE), found.area, whole)


def upright_coverage(
    contacts: np.ndarray,
    solid: Solid,
    radius: float,
    lowest: float,
    pitch: float,
    area: Area,
    links: Sequence[LinkShape],
    rotation: np.ndarray,
    keep: float,
) -> float:
    """The share as in `coverage`, of what the probe reaches without being turned; 1 where that is nothing.

    `links` [tip frame] must keep `keep` m from the object, the tip held at `rotation` (3, 3).
    """
    found = reach(solid, radius, lowest, area, UPRIGHT_SAMPLES)
    free = upright(found, solid, radius, links, rotation, keep)
    return _share(_gaps(found, rows("contacts", contacts))[free], 0.5 * pitch + 0.001)


def coverage_over_time(
    contacts: np.ndarray,
    times: np.ndarray,
    at: np.ndarray,
    solid: Solid,
    radius: float,
    lowest: float,
    pitch: float,
    area: Area | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
) -> np.ndarray:
    """(m,) share as in `coverage` at the times `at` (m,) s, for contacts (n, 3) made at `times` (n,) s."""
    contacts, times = rows("contacts", contacts), np.asarray(times, dtype=np.float64)
    if times.shape != (len(contacts),):
        raise InputError("times", times.shape, f"one time a contact, {(len(contacts),)}")
    found = reach(solid, radius, lowest, area, samples, seed)
    first = _first_covered(found, contacts, times, 0.5 * pitch + 0.001)
    return np.searchsorted(np.sort(first), at, side="right") / max(len(first), 1)


def end_errors(
    contacts: np.ndarray,
    normals: np.ndarray,
    solid: Solid,
    radius: float,
    lowest: float,
    axis: int = 0,
    samples: int = SAMPLES,
) -> tuple[float, float]:
    """m by which the contacts fall short of (positive) or pass (negative) the reachable surface's two ends on an axis.

    A contact (n, 3) counts for the end that its normal (n, 3) faces within 45 degrees: what has been felt from its side
    alone has not been found. Infinite without such a contact.
    """
    contacts, normals = rows("contacts", contacts), rows("normals", normals)
    found = reach(solid, radius, lowest, samples=samples)
    if not len(contacts) or not len(found.points):
        return np.inf, np.inf
    true = found.points[:, axis]
    low, high = (contacts[sign * normals[:, axis] > _FACING, axis] for sign in (-1.0, 1.0))
    return (
        float(low.min() - true.min()) if len(low) else np.inf,
        float(true.max() - high.max()) if len(high) else np.inf,
    )


def _gaps(found: Reach, contacts: np.ndarray) -> np.ndarray:
    """(n,) m from each reachable sample to the nearest contact."""
    if not len(contacts) or not len(found.points):
        return np.full(len(found.points), np.inf)
    from scipy.spatial import cKDTree

    return cKDTree(contacts).query(found.points)[0]


def _first_covered(found: Reach, contacts: np.ndarray, times: np.ndarray, near: float) -> np.ndarray:
    """(n,) s at which each reachable sample got its first contact within `near`, inf for never."""
    first = np.full(len(found.points), np.inf)
    if not len(contacts) or not len(found.points):
        return first
    from scipy.spatial import cKDTree

    covered = cKDTree(found.points).query_ball_point(contacts, near)
    for time, samples in zip(times, covered):
        np.minimum.at(first, samples, time)
    return first


def _share(gap: np.ndarray, near: float) -> float:
    return float(np.mean(gap <= near)) if len(gap) else 1.0
