"""How far contacts are from the truth: points against points, points against the surface, normals against normals."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.scene.solid import Solid


@dataclass(slots=True, frozen=True)
class PointError:
    """Distances of n points from the truth, m; all zero for no points.

    Attributes
    ----------
    count : number of points
    median, mean, rms, p95, max : m
    """

    count: int
    median: float
    mean: float
    rms: float
    p95: float
    max: float

    def as_dict(self) -> dict[str, float]:
        """Millimetres."""
        return {name: round(1e3 * getattr(self, name), 5) for name in ("median", "mean", "rms", "p95", "max")}


@dataclass(slots=True, frozen=True)
class NormalError:
    """Angles between n normals and the true ones, rad; all zero for no normals."""

    count: int
    median: float
    mean: float
    p95: float
    max: float

    def as_dict(self) -> dict[str, float]:
        """Degrees."""
        return {name: round(float(np.degrees(getattr(self, name))), 4) for name in ("median", "mean", "p95", "max")}


def point_error(estimated: np.ndarray, true: np.ndarray) -> PointError:
    """Distances between estimated and true points, both (n, 3) m, row by row."""
    estimated, true = rows("estimated", estimated), rows("true", true)
    if len(estimated) != len(true):
        raise InputError("true", true.shape, f"as many points as were estimated, {len(estimated)}")
    return _spread(np.linalg.norm(estimated - true, axis=1))


def aligned_points(estimated: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(n, 3) m, estimated points after the rigid motion that brings them nearest to the true ones in least squares.

    Kabsch's method; fewer than three points are brought onto the true ones. What then remains between the two is the
    error of the shape, without that of its place.
    """
    estimated, true = rows("estimated", estimated), rows("true", true)
    if len(estimated) != len(true):
        raise InputError("true", true.shape, f"as many points as were estimated, {len(estimated)}")
    if len(estimated) < 3:
        return true.copy()
    from scipy.spatial.transform import Rotation

    middle, aim = estimated.mean(axis=0), true.mean(axis=0)
    spread = estimated - middle
    with warnings.catch_warnings():  # points on one line leave the turn about it open, which changes no distance
        warnings.simplefilter("ignore", UserWarning)
        turn, _ = Rotation.align_vectors(true - aim, spread)
    return np.asarray(turn.apply(spread) + aim, dtype=np.float64)


def surface_error(points: np.ndarray, solid: Solid) -> PointError:
    """Distances of points (n, 3) m from the nearest point of the true surface, on either side of it."""
    points = rows("points", points)
    return _spread(np.abs(solid.signed_distance(points)))


def normal_error(estimated: np.ndarray, true: np.ndarray) -> NormalError:
    """Angles between estimated and true normals, both (n, 3), of any length but zero, row by row."""
    estimated, true = rows("estimated", estimated), rows("true", true)
    if len(estimated) != len(true):
        raise InputError("true", true.shape, f"as many normals as were estimated, {len(estimated)}")
    angle = angles(estimated, true)
    if not len(angle):
        return NormalError(0, 0.0, 0.0, 0.0, 0.0)
    return NormalError(
        len(angle), *map(float, (np.median(angle), angle.mean(), np.percentile(angle, 95.0), angle.max()))
    )


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) rad between rows of a and b, as exact near zero as near pi."""
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    return np.arctan2(cross, np.einsum("ij,ij->i", a, b))


def rows(name: str, values: np.ndarray) -> np.ndarray:
    """(n, 3) finite float64; raises InputError naming the field."""
    values = np.asarray(values, dtype=np.float64)
    if values.size == 0:
        return values.reshape(-1, 3)
    if values.ndim != 2 or values.shape[1] != 3:
        raise InputError(name, values.shape, "an (n, 3) array")
    if not np.isfinite(values).all():
        raise InputError(name, "NaN or infinite values", "finite numbers only")
    return values


def _spread(distance: np.ndarray) -> PointError:
    if not len(distance):
        return PointError(0, 0.0, 0.0, 0.0, 0.0, 0.0)
    figures = (
        np.median(distance),
        distance.mean(),
        np.sqrt(np.mean(distance**2)),
        np.percentile(distance, 95.0),
        distance.max(),
    )
    return PointError(len(distance), *map(float, figures))
