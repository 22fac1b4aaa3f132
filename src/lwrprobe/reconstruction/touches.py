"""A touch record made ready: checked, cleaned, with the sphere's centres and the pitch of its lines."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.reconstruction.normals import estimate_normals
from lwrprobe.reconstruction.record import finite_points, solid_points

_RAW_NOISE = 1e-4  # m, of a contact point, one standard deviation along the normal
_NORMAL_NOISE = np.radians(2.0)
_GUESSED_NORMAL_NOISE = np.radians(10.0)  # where normals had to be estimated
_IN_LINES = 0.35  # of the points, or there are no lines
_AS_STATED = 0.2  # share by which lines may be closer or farther apart than stated
_UNDERSIDE = -0.7  # normals pointing down more than this are contacts from below


@dataclass(slots=True)
class Touches:
    """What the normal-aware methods work on.

    Attributes
    ----------
    points, normals : (n, 3) m and unit
    confidence : (n,) 0..1
    radius : m, of the sphere, or of the virtual one where the record has none
    visited : (k, 3) m, where the sphere's centre has been without touching, dense along its path
    leaning : (l, 3) m, where it has been while the stick leaned, likewise
    table : m, or None when the object is seen from below as well
    lowest : m, lowest centre
    noise, normal_noise : m and rad, standard deviations of a point along its normal, and of the normal
    without : what the record lacks
    """

    points: np.ndarray
    normals: np.ndarray
    confidence: np.ndarray
    radius: float
    visited: np.ndarray
    leaning: np.ndarray
    table: float | None
    lowest: float
    noise: float
    normal_noise: float
    without: list[str] = field(default_factory=list)

    @property
    def centres(self) -> np.ndarray:
        """(n, 3) m, of the sphere at each contact."""
        return self.points + self.radius * self.normals


def prepare(record: TouchRecord, spacing: float) -> Touches:
    """Check a record and fill in what it lacks; `spacing` [m] is the step along the free path.

    Raises InputError for points that span no solid, or fewer than 4 of them with a normal and confidence.
    """
    without = [name for name in ("confidence", "normals") if getattr(record, name) is None]
    points, normals, confidence = _usable(record)
    radius = _radius(record, points, without)
    centres = points + radius * normals
    seen_below = float(np.mean(normals[:, 2] < _UNDERSIDE)) > 0.02
    table = _table(record, points, seen_below, without)
    lowest = float(centres[:, 2].min()) if record.lowest is None else min(record.lowest, float(centres[:, 2].min()))
    visited = np.empty((0, 3)) if record.free_path is None else dense(record.free_path, record.free_gap, spacing)
    leaning = np.empty((0, 3)) if record.leaning is None else dense(record.leaning, record.free_gap, spacing)
    if record.free_path is None:
        without.append("free path")
    noise = float(np.hypot(_RAW_NOISE, record.resolution / np.sqrt(12.0)))
    normal_noise = _NORMAL_NOISE if record.normals is not None else _GUESSED_NORMAL_NOISE
    return Touches(points, normals, confidence, radius, visited, leaning, table, lowest, noise, normal_noise, without)


def _usable(record: TouchRecord) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points with normal and confidence, their unit normals and confidence; estimated normals where there are none."""
    points = finite_points(record.points)
    solid_points(points)
    confidence = np.ones(len(points)) if record.confidence is None else np.nan_to_num(record.confidence, nan=0.0)
    normals = record.normals
    if normals is None:
        pitch = line_pitch(points, record.resolution)
        points, confidence = _thinned(points, confidence, 0.2 * pitch)
        normals = estimate_normals(points, pitch)
    length = np.linalg.norm(normals, axis=1)
    kept = np.isfinite(length) & (length > 1e-9) & (confidence > 0.0)
    if np.count_nonzero(kept) < 4:
        raise InputError("normals", f"{np.count_nonzero(kept)} contacts with a normal and confidence", "at least 4")
    solid_points(points[kept])
    return points[kept], normals[kept] / length[kept, None], np.clip(confidence[kept], 0.0, 1.0)


def _thinned(points: np.ndarray, confidence: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean point and confidence of each cell. Where the sphere rolls over an edge, hundreds of contacts coincide."""
    _, cell = np.unique(np.floor(points / size).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    mean = np.stack([np.bincount(cell, points[:, m]) for m in range(3)], axis=1) / count[:, None]
    return mean, np.bincount(cell, confidence) / count


def _radius(record: TouchRecord, points: np.ndarray, without: list[str]) -> float:
    if record.probe_radius is not None:
        if not (np.isfinite(record.probe_radius) and record.probe_radius > 0.0):
            raise InputError("probe_radius", record.probe_radius, "a positive length in metres, or None")
        return float(record.probe_radius)
    without.append("probe radius")
    return 0.5 * line_pitch(points)


def _table(record: TouchRecord, points: np.ndarray, seen_below: bool, without: list[str]) -> float | None:
    if record.table is not None:
        return float(record.table)
    without.append("table")
    return None if seen_below else float(points[:, 2].min())


def dense(path: np.ndarray, gap: float, spacing: float) -> np.ndarray:
    """The path (k, 3) m with points at most `spacing` m apart where it is swept, in steps of up to `gap` m.

    Rows that are not finite are left out.
    """
    path = np.asarray(path, dtype=np.float64).reshape(-1, 3)
    path = path[np.isfinite(path).all(axis=1)]
    if len(path) < 2:
        return path
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    pieces = np.where(length <= gap, np.maximum(1, np.ceil(length / spacing)), 1).astype(np.int64)
    piece = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(len(piece)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[piece]
    return np.vstack([path[piece] + share[:, None] * (path[piece + 1] - path[piece]), path[-1:]])


def line_pitch(centres: np.ndarray, resolution: float = 0.0) -> float:
    """Distance [m] between the scan's lines, or what plays its part in a cloud without lines.

    Lines show as heaps in the histogram of x or y; without heaps it is the usual distance to the nearest points that
    do not continue a point's own line. `resolution` [m] is the edge of the voxels that the points may have been
    rounded to.
    """
    found = [pitch for axis in (0, 1) if (pitch := _heap_distance(centres[:, axis], resolution)) is not None]
    return max(found) if found else _beside_distance(centres, resolution)


def regular_lines(centres: np.ndarray, pitch: float) -> bool:
    """Whether most of the centres (n, 3) lie on parallel lines that are `pitch` [m] apart along x or y."""
    found = (_heap_distance(centres[:, axis], 0.0) for axis in (0, 1))
    return any(apart is not None and abs(apart - pitch) < _AS_STATED * pitch for apart in found)


def _heap_distance(values: np.ndarray, resolution: float) -> float | None:
    """Usual distance between heaps of values, None where they do not stand apart."""
    from scipy.ndimage import median_filter

    extent = np.ptp(values)
    if extent <= 2.0 * resolution or len(values) < 20:
        return None
    bins = int(np.clip(len(values) // 4, 8, 400))
    if resolution > 0.0:
        bins = max(8, min(bins, int(2.0 * extent / resolution)))
    counts, edges = np.histogram(values, bins=bins)
    width = edges[1] - edges[0]
    half = max(1, round(1.5 * resolution / width))
    window = 1.0 + half - np.abs(np.arange(-half, half + 1))
    counts = np.convolve(counts, window / window.sum(), mode="same")
    # Lines that cross these lie under the heaps as an even ground.
    excess = counts - 3.0 * median_filter(counts, size=bins // 8 | 1, mode="nearest")
    if not excess.max() > 0.0:
        return None
    busy = excess > 0.2 * np.median(excess[excess > 0.3 * excess.max()])
    change = np.flatnonzero(np.diff(np.concatenate([[False], busy, [False]]).astype(np.int8)))
    heaps = list(zip(change[::2], change[1::2]))
    # A few points at the same height of a shape make heaps as well; lines hold a good part of all points.
    if len(heaps) < 3 or busy.mean() > 0.55 or counts[busy].sum() < _IN_LINES * counts.sum():
        return None
    middle = edges[:-1] + 0.5 * width
    apart = np.diff([np.average(middle[a:b], weights=counts[a:b]) for a, b in heaps])
    # By length, so that lines which close in on an end do not count for the pitch.
    apart = np.sort(apart)
    usual = float(apart[np.searchsorted(np.cumsum(apart), 0.5 * apart.sum())])
    alike = apart[np.abs(apart - usual) < 0.15 * usual]
    return usual if len(alike) > 1 and alike.sum() > 0.6 * apart.sum() else None


def _beside_distance(points: np.ndarray, resolution: float) -> float:
    """Median distance to the nearest point beside the line through a point and its near neighbours."""
    from scipy.spatial import cKDTree

    distinct = np.unique(points, axis=0)
    sample = distinct[:: max(1, len(distinct) // 400)]
    step = max(2.0 * float(np.median(cKDTree(distinct).query(sample, k=2)[0][:, 1])), resolution)
    thinned = _thinned(points, np.ones(len(points)), step)[0]
    sample = thinned[:: max(1, len(thinned) // 400)]
    distance, near = cKDTree(thinned).query(sample, k=min(96, len(thinned)))
    offset = thinned[near] - sample[:, None]
    along = np.linalg.eigh(np.einsum("ijk,ijl->ikl", offset[:, :5], offset[:, :5]))[1][:, :, 2]
    width = np.linalg.norm(offset - np.einsum("ijk,ik->ij", offset, along)[..., None] * along[:, None], axis=2)
    width[width < np.maximum(2.0 * step, 0.7 * distance)] = np.inf
    nearest = width.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.median(nearest)) if len(nearest) else 2.0 * step
