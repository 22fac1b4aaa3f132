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

CELL = 0.0015
"""m, touches that lie so close and face the same way are averaged into one."""
GATE = 0.010
"""m, partners are not sought farther away; lines are often that far apart."""
SAME_WAY = np.cos(np.radians(25.0))
NEIGHBOURS = 12
STARTS = np.array([(0.0, 0.0), (5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0)]) * 1e-3
ROUNDS, ROUNDS_A_START = 40, 15
DONE = 1e-8
OPEN = 0.05
"""Share of the best determined direction below which a direction counts as open: it keeps its value."""
GAP = 2e-3
"""m, a touch without partner counts as so far off when starts are compared."""
DIRECTIONS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


@dataclass(slots=True, frozen=True)
class Registration:
    """The motion p -> rotation @ p + translation that lays one run's touches over another's, and how well.

    Attributes
    ----------
    rotation, translation : (3, 3) and (3,) m
    shift : m, by which the middle of the touches moves
    angle : rad
    before, after : m, median distance of the pairs along their normals, unmoved and moved
    misfit : share of the pairs that are more than 1.5 mm apart when moved
    overlap : share of the moved run's (thinned) touches that have a partner
    pairs : their number
    open : directions that the touches tell nothing about
    """

    rotation: np.ndarray
    translation: np.ndarray
    shift: float
    angle: float
    before: float
    after: float
    misfit: float
    overlap: float
    pairs: int
    open: tuple[str, ...]

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) m moved."""
        return points @ self.rotation.T + self.translation

    def directions(self, directions: np.ndarray) -> np.ndarray:
        """Directions (n, 3) turned."""
        return directions @ self.rotation.T


def register(moving: TouchRecord, fixed: TouchRecord, on_table: bool) -> Registration:
    """The small motion that lays `moving` over `fixed`; with `on_table` a shift on the table and a turn about z.

    Shifts up to about 10 mm and turns of a few degrees are found. Raises InputError naming a record without normals or
    touches.
    """
    for name, record in (("moving", moving), ("fixed", fixed)):
        if record.normals is None or len(record.points) == 0:
            raise InputError(name, f"{len(record.points)} touches", "touches with normals")
    other = _Side(*thinned(fixed.points, fixed.normals))
    points, normals = thinned(moving.points, moving.normals)
    middle = points.mean(axis=0)
    free = np.array([0, 1, 5] if on_table else range(6))
    unmoved = other.pair(points, normals)

    def descend(rotation: np.ndarray, translation: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
        for _ in range(rounds):
            turn, shift, *_ = _step(other, points, normals, middle, rotation, translation, free)
            rotation, translation = turn @ rotation, turn @ translation + shift
            if np.abs(shift).max() < DONE and np.abs(turn - np.eye(3)).max() < DONE:
                break
        return rotation, translation

    # motions are about the middle of the moving touches: middle + rotation (p - middle) + translation
    ends = [descend(np.eye(3), np.array([*start, 0.0]), ROUNDS_A_START) for start in STARTS]
    scores = [_score(other, points, normals, middle, *end) for end in ends]
    rotation, translation = descend(*ends[int(np.argmin(scores))], ROUNDS)
    *_, unknown, size = _step(other, points, normals, middle, rotation, translation, free)
    rotation, translation = _without(rotation, translation, unknown, size)
    found = other.pair(middle + (points - middle) @ rotation.T + translation, normals @ rotation.T)
    return Registration(
        rotation=rotation,
        translation=middle + translation - rotation @ middle,
        shift=float(np.linalg.norm(translation)),
        angle=float(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0))),
        before=unmoved.median,
        after=found.median,
        misfit=float((np.abs(found.apart) > 1.5e-3).mean()) if len(found.apart) else 1.0,
        overlap=len(found.apart) / len(points),
        pairs=len(found.apart),
        open=tuple(dict.fromkeys(DIRECTIONS[int(np.argmax(np.abs(way)))] for way in unknown)),
    )


def intruding(points: np.ndarray, record: TouchRecord, tolerance: float = 1e-3) -> np.ndarray:
    """(n,) bool: points that lie where the other run's sphere was, deeper than `tolerance` [m].

    The sphere was where it touched and, along `free_path`, where it did not: no surface can be inside it.
    """
    radius = record.probe_radius
    if radius is None or len(points) == 0:
        return np.zeros(len(points), dtype=bool)
    centres = [_dense(record.free_path, record.free_gap)]
    if record.normals is not None:
        centres.append(record.points + radius * record.normals)
    centres = np.concatenate(centres)
    if len(centres) == 0:
        return np.zeros(len(points), dtype=bool)
    distance, _ = KDTree(centres).query(points, distance_upper_bound=radius)
    return distance < radius - tolerance


def thinned(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of the touches (n, 3) in each cell that face the same of six ways, and of their normals."""
    axis = np.argmax(np.abs(normals), axis=1)
    way = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0)
    cells = np.column_stack([np.floor(points / CELL).astype(np.int64), way])
    _, which, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    mean = np.stack([np.bincount(which, points[:, k]) for k in range(3)], axis=1) / count[:, None]
    facing = np.stack([np.bincount(which, normals[:, k]) for k in range(3)], axis=1)
    return mean, facing / np.linalg.norm(facing, axis=1, keepdims=True)


@dataclass(slots=True, frozen=True)
class _Pairs:
    """Which of the moving touches have a partner (m,), the pairs' distances along the mean normal, and that (m, 3)."""

    who: np.ndarray
    apart: np.ndarray
    normal: np.ndarray

    @property
    def median(self) -> float:
        return float(np.median(np.abs(self.apart))) if len(self.apart) else np.inf


class _Side:
    """The touches that stay, ready to be asked for partners."""

    def __init__(self, points: np.ndarray, normals: np.ndarray) -> None:
        self.points, self.normals = points, normals
        self._tree = KDTree(points)

    def pair(self, points: np.ndarray, normals: np.ndarray) -> _Pairs:
        count = min(NEIGHBOURS, len(self.points))
        distance, index = self._tree.query(points, k=range(1, count + 1), distance_upper_bound=GATE)
        near = np.isfinite(distance)
        index = np.where(near, index, 0)
        fits = near & (np.einsum("ik,ijk->ij", normals, self.normals[index]) > SAME_WAY)
        who = np.flatnonzero(fits.any(axis=1))
        partner = index[who, np.argmax(fits[who], axis=1)]
        normal = normals[who] + self.normals[partner]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return _Pairs(who, np.einsum("ik,ik->i", points[who] - self.points[partner], normal), normal)


def _step(
    other: _Side,
    points: np.ndarray,
    normals: np.ndarray,
    middle: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    free: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """One Gauss-Newton step: turn (3, 3) and shift (3,) about the middle; then the directions (k, 6) that stay open, of
    shift and turn times size, and that size [m]."""
    lever = (points - middle) @ rotation.T
    pairs = other.pair(middle + lever + translation, normals @ rotation.T)
    if len(pairs.who) < 6:
        return np.eye(3), np.zeros(3), np.eye(6)[free], 1.0
    lever = lever[pairs.who] + translation
    size = float(np.sqrt((lever**2).sum(axis=1).mean()))
    rows = np.hstack([pairs.normal, np.cross(lever, pairs.normal) / size])[:, free]
    scale = max(4.685 * 1.4826 * pairs.median, 2e-4)
    weight = np.clip(1.0 - (pairs.apart / scale) ** 2, 0.0, None)
    _, singular, ways = np.linalg.svd(weight[:, None] * rows, full_matrices=False)
    known = singular > OPEN * singular[0]
    answer = ways[known].T @ (
        (ways[known] @ (rows.T @ (-(weight**2) * pairs.apart))) / np.maximum(singular[known], 1e-300) ** 2
    )
    step = np.zeros(6)
    step[free] = answer
    unknown = np.zeros(((~known).sum(), 6))
    unknown[:, free] = ways[~known]
    return _turn(step[3:] / size), step[:3], unknown, size


def _without(
    rotation: np.ndarray, translation: np.ndarray, unknown: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """A small motion without what it has of the open directions: there is no reason to move along them."""
    from scipy.spatial.transform import Rotation

    if len(unknown) == 0:
        return rotation, translation
    motion = np.concatenate([translation, size * Rotation.from_matrix(rotation).as_rotvec()])
    motion -= unknown.T @ (unknown @ motion)
    return _turn(motion[3:] / size), motion[:3]


def _score(
    other: _Side,
    points: np.ndarray,
    normals: np.ndarray,
    middle: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
) -> float:
    pairs = other.pair(middle + (points - middle) @ rotation.T + translation, normals @ rotation.T)
    apart = np.minimum(np.abs(pairs.apart), GAP).sum()
    return float(apart + GAP * (len(points) - len(pairs.who))) / len(points)


def _turn(vector: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def _dense(path: np.ndarray | None, gap: float) -> np.ndarray:
    """The path's points with more between them, 1 mm apart, where a step is no gap."""
    if path is None or len(path) == 0:
        return np.empty((0, 3))
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1)
    pieces = np.where(length <= gap, np.maximum(np.ceil(length / 1e-3), 1.0), 1.0).astype(np.int64)
    which = np.repeat(np.arange(len(step)), pieces)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[which]
    return np.concatenate([path[which] + share[:, None] * step[which], path[-1:]])
