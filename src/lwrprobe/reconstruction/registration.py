"""Laying the touches of one run over those of another, between which the object was moved a little.

Each touch is paired with the nearest of the other run whose normal points the same way; what the pair is apart along
the mean of both normals is brought to nothing in least squares (symmetric point to plane: Rusinkiewicz, ACM TOG 38,
2019), which is exact for curved surfaces even where the lines of the runs lie between each other. Outliers lose their
weight (Tukey).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.reconstruction.alignment import STILL, Alignment, Pairs, RigidMotion
from lwrprobe.reconstruction.touches import dense

CELL = 0.0015
"""m, touches that lie so close and face the same way are averaged into one."""
GATE = 0.010
"""m, partners are not sought farther away; lines are often that far apart."""
SAME_SIDE = np.cos(np.radians(25.0))
NEIGHBOURS = 12
STARTS = np.array([(0.0, 0.0), (5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0)]) * 1e-3
ROUNDS, ROUNDS_A_START = 40, 15
OPEN = 0.05
"""Share of the best determined direction below which a direction counts as open: it keeps its value."""
GAP = 2e-3
"""m, a touch without partner counts as so far off when starts are compared."""
SWEPT = 1e-3
"""m between two places of a path at which the sphere was."""
DIRECTIONS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


@dataclass(slots=True, frozen=True)
class Registration(RigidMotion):
    """The rigid motion that aligns the contacts of one run with those of another, and its residual.

    Attributes
    ----------
    shift : m, by which the middle of the touches moves
    before, after : m, median distance of the pairs along their normals, unmoved and moved
    misfit : share of the pairs that are more than 1.5 mm apart when moved
    overlap : share of the moved run's (thinned) touches that have a partner
    pairs : their number
    open : directions that the touches do not determine
    """

    shift: float
    before: float
    after: float
    misfit: float
    overlap: float
    pairs: int
    open: tuple[str, ...]


def register(moving: TouchRecord, fixed: TouchRecord, on_table: bool) -> Registration:
    """A small rigid motion that aligns `moving` with `fixed`; with `on_table` a shift on the table and a turn about z.

    Shifts up to about 10 mm and turns of a few degrees are found. Raises InputError naming a record without normals or
    touches.
    """
    free = np.array([0, 1, 5] if on_table else range(6))
    points, normals = _thinned_record("moving", moving)
    other = _Side(*_thinned_record("fixed", fixed))
    fit = Alignment(other, points, normals, _tukey, OPEN, free)
    starts = [RigidMotion(np.eye(3), np.array([*start, 0.0])) for start in STARTS]
    ends = [fit.descend(start, ROUNDS_A_START) for start in starts]
    best = min(ends, key=lambda end: _score(fit, end))
    motion, unknown = fit.without_open(fit.descend(best, ROUNDS))
    found, whole = fit.pairs(motion), fit.about_origin(motion)
    return Registration(
        whole.rotation,
        whole.translation,
        shift=float(np.linalg.norm(motion.translation)),
        before=fit.pairs(STILL).median,
        after=found.median,
        misfit=float((np.abs(found.apart) > 1.5e-3).mean()) if len(found.apart) else 1.0,
        overlap=len(found.apart) / len(fit.points),
        pairs=len(found.apart),
        open=tuple(dict.fromkeys(DIRECTIONS[int(np.argmax(np.abs(direction)))] for direction in unknown)),
    )


def intruding(points: np.ndarray, record: TouchRecord, tolerance: float = 1e-3) -> np.ndarray:
    """(n,) bool: points that lie where the other run's sphere was, deeper than `tolerance` [m].

    The sphere was where it touched and, along `free_path`, where it did not: no surface can be inside it.
    """
    radius = record.probe_radius
    if radius is None or len(points) == 0:
        return np.zeros(len(points), dtype=bool)
    path = np.empty((0, 3)) if record.free_path is None else record.free_path
    centres = [dense(path, record.free_gap, SWEPT)]
    if record.normals is not None:
        centres.append(record.points + radius * record.normals)
    visited = np.concatenate(centres)
    if len(visited) == 0:
        return np.zeros(len(points), dtype=bool)
    distance, _ = KDTree(visited).query(points, distance_upper_bound=radius)
    return distance < radius - tolerance


def _thinned_record(name: str, record: TouchRecord) -> tuple[np.ndarray, np.ndarray]:
    if record.normals is None or len(record.points) == 0:
        raise InputError(name, f"{len(record.points)} touches", "touches with normals")
    return thinned(record.points, record.normals)


def thinned(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the touches (n, 3) in each cell that face the same of six ways, and of their normals."""
    axis = np.argmax(np.abs(normals), axis=1)
    direction = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0)
    cells = np.column_stack([np.floor(points / CELL).astype(np.int64), direction])
    _, which, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    mean = np.stack([np.bincount(which, points[:, k]) for k in range(3)], axis=1) / count[:, None]
    facing = np.stack([np.bincount(which, normals[:, k]) for k in range(3)], axis=1)
    return mean, facing / np.linalg.norm(facing, axis=1, keepdims=True)


class _Side:
    """The touches that stay, ready to be asked for partners."""

    def __init__(self, points: np.ndarray, normals: np.ndarray) -> None:
        self.points, self.normals = points, normals
        self._tree = KDTree(points)

    def pair(self, points: np.ndarray, normals: np.ndarray) -> Pairs:
        count = min(NEIGHBOURS, len(self.points))
        distance, index = self._tree.query(points, k=range(1, count + 1), distance_upper_bound=GATE)
        near = np.isfinite(distance)
        index = np.where(near, index, 0)
        fits = near & (np.einsum("ik,ijk->ij", normals, self.normals[index]) > SAME_SIDE)
        who = np.flatnonzero(fits.any(axis=1))
        partner = index[who, np.argmax(fits[who], axis=1)]
        normal = normals[who] + self.normals[partner]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return Pairs(who, np.einsum("ik,ik->i", points[who] - self.points[partner], normal), normal)


def _tukey(pairs: Pairs) -> np.ndarray:
    scale = max(4.685 * 1.4826 * pairs.median, 2e-4)
    return np.clip(1.0 - (pairs.apart / scale) ** 2, 0.0, None)


def _score(fit: Alignment, motion: RigidMotion) -> float:
    pairs, count = fit.pairs(motion), len(fit.points)
    return float(np.minimum(np.abs(pairs.apart), GAP).sum() + GAP * (count - len(pairs.who))) / count
