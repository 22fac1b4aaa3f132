"""What every reconstructor asks of its input."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import InputError

FLAT = 1e-7
"""Thickness over length below which points count as lying in one plane."""


def solid_points(points: np.ndarray) -> np.ndarray:
    """Distinct (n, 3) points that span a solid; raises InputError for NaN, too few, collinear or coplanar ones."""
    points = finite_points(points)
    points = np.unique(points, axis=0)
    if len(points) < 4:
        raise InputError("points", f"{len(points)} distinct", "at least 4 distinct points")
    centred = points - points.mean(axis=0)
    extent = np.abs(centred).max()
    scatter = np.linalg.svd((centred / extent).T @ (centred / extent), compute_uv=False)
    spread = np.sqrt(scatter / scatter[0])
    if spread[2] < FLAT:
        shape = "one line" if spread[1] < FLAT else "one plane"
        raise InputError("points", f"{len(points)} points in {shape}", "points that span a solid")
    return points


def finite_points(points: np.ndarray) -> np.ndarray:
    """(n, 3) float64; raises InputError when a coordinate is NaN or infinite."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"points[{bad[0]}]", points[bad[0]].tolist(), "finite coordinates")
    return points
