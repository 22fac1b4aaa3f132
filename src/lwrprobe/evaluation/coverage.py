"""How much of what can be touched has been touched, and whether the object's ends were found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lwrprobe.contracts import InputError, LinkShape
from lwrprobe.evaluation.point_error import rows
from lwrprobe.evaluation.reach import Reach, upright
from lwrprobe.scene.solid import Solid

_CLOSE = 0.005  # m
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


def coverage(contacts: np.ndarray, found: Reach, pitch: float) -> Coverage:
    """Share of the reachable true surface near a contact.

    Parameters
    ----------
    contacts : (n, 3) m
    found : what the sphere can reach
    pitch : m, between grid lines
    """
    gap = _gaps(found.points, rows("contacts", contacts))
    return Coverage(_share(gap, _near(pitch)), _share(gap, _CLOSE), found.area, found.whole_area)


def upright_coverage(
    contacts: np.ndarray,
    found: Reach,
    pitch: float,
    solid: Solid,
    links: Sequence[LinkShape],
    rotation: np.ndarray,
    keep: float,
) -> float:
    """The share as in `coverage`, of what the probe reaches without being turned; 1 where that is nothing.

    `links` [tip frame] must keep `keep` m from the object `solid`, the tip held at `rotation` (3, 3).
    """
    free = upright(found, solid, links, rotation, keep)
    return _share(_gaps(found.points[free], rows("contacts", contacts)), _near(pitch))


def coverage_over_time(
    contacts: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach, pitch: float
) -> np.ndarray:
    """(m,) share as in `coverage` at the rising times `at` (m,) s, for contacts (n, 3) made at `times` (n,) s."""
    contacts, times = rows("contacts", contacts), np.asarray(times, dtype=np.float64)
    if times.shape != (len(contacts),):
        raise InputError("times", times.shape, f"one time a contact, {(len(contacts),)}")
    share, left, all_samples = np.empty(len(at)), found.points, max(len(found.points), 1)
    for k, made in enumerate(_between(contacts, times, at)):
        left = left[_gaps(left, made, _near(pitch)) > _near(pitch)]
        share[k] = 1.0 - len(left) / all_samples
    return share


def gap_over_time(contacts: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach) -> np.ndarray:
    """(m,) m from the reachable surface to the nearest contact, mean over the surface; arguments as above."""
    mean, gap = np.empty(len(at)), np.full(len(found.points), np.inf)
    for k, made in enumerate(_between(contacts, times, at)):
        gap = np.minimum(gap, _gaps(found.points, made))
        mean[k] = gap.mean() if len(gap) else 0.0
    return mean


def end_errors(contacts: np.ndarray, normals: np.ndarray, found: Reach, axis: int = 0) -> tuple[float, float]:
    """m by which the contacts fall short of (positive) or pass (negative) the reachable surface's two ends on an axis.

    A contact (n, 3) counts for the end that its normal (n, 3) faces within 45 degrees: what has been felt from its side
    alone has not been found. Infinite without such a contact.
    """
    contacts, normals = rows("contacts", contacts), rows("normals", normals)
    if not len(contacts) or not len(found.points):
        return np.inf, np.inf
    true = found.points[:, axis]
    low, high = (contacts[sign * normals[:, axis] > _FACING, axis] for sign in (-1.0, 1.0))
    return (
        float(low.min() - true.min()) if len(low) else np.inf,
        float(true.max() - high.max()) if len(high) else np.inf,
    )


def _near(pitch: float) -> float:
    """m, how far from a contact the surface counts as touched."""
    if not pitch > 0.0:
        raise InputError("pitch", pitch, "a positive length in metres")
    return 0.5 * pitch + 0.001


def _gaps(points: np.ndarray, contacts: np.ndarray, most: float = np.inf) -> np.ndarray:
    """(n,) m from points (n, 3) to the nearest contact, inf where that is farther than `most`."""
    if not len(contacts) or not len(points):
        return np.full(len(points), np.inf)
    from scipy.spatial import cKDTree

    return cKDTree(contacts).query(points, distance_upper_bound=np.nextafter(most, np.inf))[0]


def _between(contacts: np.ndarray, times: np.ndarray, at: np.ndarray) -> Iterator[np.ndarray]:
    """The contacts made since the time before, for each of the rising times `at`."""
    order = np.argsort(times, kind="stable")
    ends = np.searchsorted(times[order], at, side="right")
    return (contacts[order[begin:end]] for begin, end in pairwise([0, *ends]))


def _share(gap: np.ndarray, near: float) -> float:
    return float(np.mean(gap <= near)) if len(gap) else 1.0
