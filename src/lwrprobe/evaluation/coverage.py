"""How much of what can be touched has been touched, and whether the object's ends were found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.evaluation.point_error import rows
from lwrprobe.evaluation.reach import Reach

_CLOSE = 0.005  # m
_FACING = 0.7071  # share of the normal along the axis
SAME_SIDE = 0.5  # cosine of the angle, 60 degrees, within which a contact faces as the surface does


DEFAULT_SPACING = 0.010
"""m, line spacing that coverage is computed with where there are no lines."""


@dataclass(slots=True, frozen=True)
class Coverage:
    """Shares (0..1) of the reachable surface that have a contact nearby which faces the same way within 60 degrees.

    A contact on the other side of something thin does not count. None where nothing can be reached.

    Attributes
    ----------
    share : within half the line pitch plus 1 mm of a contact
    share_5mm : within 5 mm of a contact
    reachable_area, whole_area : m^2
    """

    share: float | None
    share_5mm: float | None
    reachable_area: float
    whole_area: float

    def as_dict(self) -> dict[str, float | None]:
        """Shares, and areas in cm^2."""
        return {
            "coverage": None if self.share is None else round(self.share, 4),
            "coverage_5mm": None if self.share_5mm is None else round(self.share_5mm, 4),
            "reachable_area_cm2": round(1e4 * self.reachable_area, 2),
            "whole_area_cm2": round(1e4 * self.whole_area, 2),
        }


def coverage(contacts: np.ndarray, normals: np.ndarray, found: Reach, pitch: float) -> Coverage:
    """Share of the reachable true surface near a contact that faces the same way.

    Parameters
    ----------
    contacts, normals : (n, 3) m, and (n, 3) unit, outwards
    found : what the sphere can reach
    pitch : m, between grid lines
    """
    made = _Contacts(contacts, normals)
    return Coverage(
        _share(made.touch(found.points, found.normals, _near(pitch))),
        _share(made.touch(found.points, found.normals, _CLOSE)),
        found.area,
        found.whole_area,
    )


def touched(
    points: np.ndarray, facing: np.ndarray, contacts: np.ndarray, normals: np.ndarray, pitch: float
) -> np.ndarray:
    """(m,) bool: points (m, 3) of a surface with unit normals `facing` (m, 3) near a contact that faces the same way.

    `contacts` (n, 3) m with `normals` (n, 3); near and the same way as in `Coverage`, for lines `pitch` m apart.
    """
    return _Contacts(contacts, normals).touch(points, facing, _near(pitch))


def coverage_over_time(
    contacts: np.ndarray, normals: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach, pitch: float
) -> np.ndarray:
    """(m,) share as in `coverage` at the rising times `at` (m,) s, for contacts (n, 3) with normals (n, 3) made at
    `times` (n,) s; NaN where nothing is reachable."""
    contacts, normals = rows("contacts", contacts), rows("normals", normals)
    times = np.asarray(times, dtype=np.float64)
    if times.shape != (len(contacts),):
        raise InputError("times", times.shape, f"one time a contact, {(len(contacts),)}")
    share, left = np.empty(len(at)), np.arange(len(found.points))
    for k, made in enumerate(_between(times, at)):
        now = _Contacts(contacts[made], normals[made])
        left = left[~now.touch(found.points[left], found.normals[left], _near(pitch))]
        share[k] = 1.0 - len(left) / len(found.points) if len(found.points) else np.nan
    return share


def gap_over_time(contacts: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach) -> np.ndarray:
    """(m,) m from the reachable surface to the nearest contact, whichever way that faces, mean over the surface;
    NaN where nothing is reachable.
    """
    return np.array([gap.mean() if len(gap) else np.nan for gap in _gaps_over_time(contacts, times, at, found)])


def gap_p95_over_time(contacts: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach) -> np.ndarray:
    """(m,) m, as `gap_over_time`: 95 % of the reachable surface is no farther from the nearest contact."""
    gaps = _gaps_over_time(contacts, times, at, found)
    return np.array([np.quantile(gap, 0.95, method="higher") if len(gap) else np.nan for gap in gaps])


def _gaps_over_time(contacts: np.ndarray, times: np.ndarray, at: np.ndarray, found: Reach) -> Iterator[np.ndarray]:
    """(n,) m from each sample of the reachable surface to the nearest contact, at each of the times."""
    gap = np.full(len(found.points), np.inf)
    for made in _between(times, at):
        gap = np.minimum(gap, _gaps(found.points, contacts[made]))
        yield gap


def end_errors(contacts: np.ndarray, normals: np.ndarray, found: Reach, axis: int = 0) -> tuple[float, float]:
    """m by which the contacts fall short of (positive) or pass (negative) the reachable surface's two ends on an axis.

    A contact (n, 3) counts for the end that its normal (n, 3) faces within 45 degrees: contacts on the sides alone
    do not determine an end. Infinite without such a contact.
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


class _Contacts:
    """Contacts (n, 3) m with normals (n, 3), ready to be asked what they touch."""

    def __init__(self, contacts: np.ndarray, normals: np.ndarray) -> None:
        from scipy.spatial import cKDTree

        self._points, self._normals = rows("contacts", contacts), rows("normals", normals)
        if len(self._points) != len(self._normals):
            raise InputError("normals", self._normals.shape, f"one normal a contact, {self._points.shape}")
        self._tree = cKDTree(self._points) if len(self._points) else None

    def touch(self, points: np.ndarray, normals: np.ndarray, near: float) -> np.ndarray:
        """(m,) bool: surface points (m, 3) with a contact within `near` m that faces as their normals (m, 3) do."""
        if self._tree is None or not len(points):
            return np.zeros(len(points), dtype=bool)
        gap, nearest = self._tree.query(points, distance_upper_bound=np.nextafter(near, np.inf))
        close = np.isfinite(gap)
        touched = np.zeros(len(points), dtype=bool)
        facing = np.einsum("ij,ij->i", self._normals[nearest[close]], normals[close])
        touched[close] = facing >= SAME_SIDE
        # Where the nearest faces another way, as at an edge, one behind it may do. There may be none at all: the two
        # queries round a distance that is just `near` differently.
        rest = np.flatnonzero(close & ~touched)
        for k, around in zip(rest, self._tree.query_ball_point(points[rest], near)):
            touched[k] = (self._normals[around] @ normals[k] >= SAME_SIDE).any()
        return touched


def _gaps(points: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """(n,) m from points (n, 3) to the nearest contact, inf where there is none."""
    if not len(contacts) or not len(points):
        return np.full(len(points), np.inf)
    from scipy.spatial import cKDTree

    return cKDTree(contacts).query(points)[0]


def _between(times: np.ndarray, at: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of the contacts made since the time before, for each of the rising times `at`."""
    order = np.argsort(times, kind="stable")
    ends = np.searchsorted(times[order], at, side="right")
    return (order[begin:end] for begin, end in pairwise([0, *ends]))


def _share(touched: np.ndarray) -> float | None:
    return float(np.mean(touched)) if len(touched) else None
