"""Obviously right twins of the clearance kernels, in numpy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def at(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)):
    """(4, 4) pose at a place, turned by a rotation vector."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def project(link, frame, points):
    """Nearest points of a solid link, standing in `frame` (4, 4), to (n, 3) points."""
    pose = frame @ link.pose
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    if link.kind == "box":
        half = 0.5 * np.array(link.size)
        near = np.clip(local, -half, half)
    else:
        radius, half = link.size[0], 0.5 * link.size[1]
        axis = np.zeros_like(local)
        axis[:, 2] = np.clip(local[:, 2], -half, half)
        off = local - axis if link.kind == "capsule" else local * (1.0, 1.0, 0.0)
        near = axis + off * np.minimum(1.0, radius / np.maximum(np.linalg.norm(off, axis=1), 1e-300))[:, None]
    return near @ pose[:3, :3].T + pose[:3, 3]


def reach(link, frame, direction):
    """Largest inner product of a unit direction with a point of the link."""
    pose = frame @ link.pose
    local = direction @ pose[:3, :3]
    if link.kind == "box":
        return direction @ pose[:3, 3] + 0.5 * np.abs(local) @ link.size
    radius, half = link.size[0], 0.5 * link.size[1]
    side = radius if link.kind == "capsule" else radius * np.hypot(local[0], local[1])
    return direction @ pose[:3, 3] + side + half * abs(local[2])


def link_to_cubes(link, frame, centres, edge, steps=600):
    """Distances (n,) between a link and cubes: accelerated projected gradient on half the squared distance.

    Its error in that function is below 2 |x0 - x*|^2 / steps^2 (Beck, Teboulle 2009).
    """
    low, high = centres - 0.5 * edge, centres + 0.5 * edge
    x, ahead, t = centres.copy(), centres.copy(), 1.0
    for _ in range(steps):
        new = np.clip(project(link, frame, ahead), low, high)
        faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
        ahead = new + (t - 1.0) / faster * (new - x)
        x, t = new, faster
    return np.linalg.norm(x - project(link, frame, x), axis=1)


def clearance(links, frames, centres, edge, steps=600):
    """Smallest distance over all pairs; `frames` by carrier name."""
    return min(link_to_cubes(link, frames[link.carrier], centres, edge, steps).min() for link in links)


def inside(link, frame, point, slack=0.0):
    """Whether a point lies in a link grown by `slack`."""
    return np.linalg.norm(point - project(link, frame, point[None])[0]) <= slack


def gap_between(link, frame, centre, edge, direction):
    """Distance between two parallel planes, across `direction` from the link to the cube, with a body behind each."""
    return centre @ direction - 0.5 * edge * np.abs(direction).sum() - reach(link, frame, direction)
