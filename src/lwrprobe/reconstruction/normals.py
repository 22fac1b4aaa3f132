"""Normals for clouds that have none, from points along lines."""

from __future__ import annotations

import numpy as np


def estimate_normals(points: np.ndarray, pitch: float) -> np.ndarray:
    """Unit normals (n, 3) of points (n, 3) m that lie densely along lines `pitch` m apart.

    One tangent is the principal direction of the near neighbours, which are of the point's own line; the other one
    leads to the nearest points beside that line. The object is taken to stand and to be touched from above: level
    parts face up, steep ones face to the side on which the cloud is lower.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    distance, near = tree.query(points, k=min(48, len(points)))
    offset = points[near] - points[:, None]
    along = _principal(offset, np.exp(-((distance / (0.3 * pitch)) ** 2)))
    aside = offset - np.einsum("ijk,ik->ij", offset, along)[..., None] * along[:, None]
    width = np.linalg.norm(aside, axis=2)
    # A line that bends leaves its tangent too, but far along it: what lies beside is mostly across.
    beside = np.where((width > 0.5 * pitch) & (width > 0.8 * distance), width, np.inf)
    closest = np.where(np.isfinite(beside).any(axis=1), beside.min(axis=1), pitch)
    weight = np.where(np.isfinite(beside), np.exp(-(((width - closest[:, None]) / (0.2 * pitch)) ** 2)), 0.0)
    alone = weight.sum(axis=1) < 1e-12
    weight[alone] = width[alone]
    normals = np.cross(along, _principal(aside, weight))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals * _signs(points, normals, pitch)[:, None]


def _principal(offset: np.ndarray, weight: np.ndarray) -> np.ndarray:
    scatter = np.einsum("ij,ijk,ijl->ikl", weight, offset, offset)
    return np.linalg.eigh(scatter)[1][:, :, 2]


def _signs(points: np.ndarray, normals: np.ndarray, pitch: float) -> np.ndarray:
    from scipy.spatial import cKDTree

    level = np.abs(normals[:, 2]) > 0.5
    sideways = normals[:, :2] / np.maximum(np.linalg.norm(normals[:, :2], axis=1, keepdims=True), 1e-12)
    plan = cKDTree(points[:, :2])
    tops = []
    for side in (1.0, -1.0):
        found = plan.query_ball_point(points[:, :2] + side * 0.9 * pitch * sideways, 0.6 * pitch)
        tops.append(np.array([points[rows, 2].max() if rows else -np.inf for rows in found]))
    ahead, behind = tops
    return np.where(np.where(level, normals[:, 2] >= 0.0, ahead < behind), 1.0, -1.0)
