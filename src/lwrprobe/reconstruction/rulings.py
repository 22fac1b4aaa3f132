"""Rulings: straight lines that are taken to lie on the surface between two contacts that face the same way.

On a plane, a cylinder, a cone, or along the edge of a prism, the normal is the same all along each straight line on
the surface, a ruling (do Carmo, Differential Geometry of Curves and Surfaces, 1976, section 3-5). So two contacts with
one normal, each in the tangent plane of the other, are taken to be the ends of a ruling, as long as nothing that was
touched or passed speaks against it. A surface that bends both ways has few such pairs, and they are close together.

A wall that was touched low down, with a flat top right behind it, is taken to go straight up to the edge of that top:
between both there is no room for anything as wide as the sphere.

All of it is about the surface on which the sphere's centre moves in contact. There an edge is an arc of the sphere's
radius, so that the edges of a prism have rulings as well.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters, cluster
from lwrprobe.reconstruction.hermite_field import HermiteData
from lwrprobe.reconstruction.ruling_kernels import best_rulings, refuted
from lwrprobe.reconstruction.touches import Touches

_FINE = 0.4
"""Radii: size of the clusters whose normals are compared; the sphere rolls over an edge on an arc of one radius."""
_ALIKE = 0.07
"""rad between two normals at most."""
_SHORTEST, _LONGEST = 2.8, 14.0
"""Radii, of a ruling: a shorter one has no place that is far from contacts."""
_CELL = 1.2
"""Radii: edge of the cells that hold one ruling each."""
_STEP, _BEND = 2e-4, 0.02
"""m, and share of the length, between the mean tangent planes of the two contacts at most."""
_FAR = 1.4
"""Radii from contacts, from which on a ruling says more than they do."""
_SAG = 0.004
"""Of the distance to the nearer end: how sure the place is."""
_UPRIGHT, _TOP, _FLAT = 0.06, 0.5, 0.15
"""Share of the normal along z of a wall at most and of a top at least; cosine between both normals at most."""
_BEHIND, _ASIDE = 3.0, 2.0
"""Radii behind the wall and along it, within which the top is touched that it reaches up to."""
_LEAN = 0.02
"""Of the distance to the nearer end, by which such a wall may be elsewhere."""
_BESIDE = 2.0
"""Radii beside a ruling, within which what was touched or passed may speak against it."""
_OFF = 1e-3
"""m off the surface, from which on it does."""
_LEVEL = 0.7
"""Share of the normal along z, from which on a surface faces up: nothing passes under it with an upright stick."""
_DEEP, _DEEP_LEVEL = 2.0, 12.0
"""Radii below a ruling, down to which a passing sphere speaks against it: farther on it may be behind the object; and
on a surface that faces up."""
_HOLLOW = 2.0
"""Times that depth, down to which what was touched speaks against it: farther on it may be the far wall of a hollow."""


def fine_clusters(touches: Touches) -> Clusters:
    """The contacts in clusters so small that the normals in one are the same, of which rulings and prisms are found."""
    return cluster(touches.centres, touches.normals, touches.confidence, _FINE * touches.radius)


def find_rulings(touches: Touches, fine: Clusters) -> HermiteData:
    """Places of the sphere's centre on rulings between `fine_clusters`, far from contacts."""
    from scipy.spatial import cKDTree

    radius = touches.radius
    one, other, share = _through_cells(fine.points, fine.normals, radius)
    begin, finish = fine.points[one], fine.points[other]
    normals = (1.0 - share)[:, None] * fine.normals[one] + share[:, None] * fine.normals[other]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sag = np.full(len(one), _SAG)
    wall, edge, part = _up_to_tops(fine.points, fine.normals, radius)
    begin, finish, share = np.vstack([begin, fine.points[wall]]), np.vstack([finish, edge]), np.append(share, part)
    normals, sag = np.vstack([normals, fine.normals[wall]]), np.append(sag, np.full(len(wall), _LEAN))
    places = begin + share[:, None] * (finish - begin)
    apart = np.minimum(share, 1.0 - share) * np.linalg.norm(finish - begin, axis=1)
    far = cKDTree(fine.points).query(places)[0] > _FAR * radius
    begin, finish, places, normals, error = (rows[far] for rows in (begin, finish, places, normals, sag * apart))
    deep = radius * np.where(normals[:, 2] > _LEVEL, _DEEP_LEVEL, _DEEP)
    wrong = np.zeros(len(places), dtype=bool)
    touched, passed = (fine.points, fine.normals, _HOLLOW * deep), (touches.visited, np.empty((0, 3)), deep)
    for points, facing, down_to in (touched, passed):
        refuted(begin, finish, normals, points, facing, _BESIDE * radius, _OFF, radius, down_to, wrong)
    kept = ~wrong
    deviation = np.hypot(touches.noise, error[kept])
    return HermiteData(places[kept], normals[kept], deviation, np.full(len(deviation), touches.normal_noise))


def upright_walls(fine: Clusters, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Contacts (n, 3) m on walls that go straight up to a top right behind them, and their level normals (n, 3)."""
    feet = np.unique(_up_to_tops(fine.points, fine.normals, radius)[0])
    normals = fine.normals[feet] * [1.0, 1.0, 0.0]
    return fine.points[feet], normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _up_to_tops(centres: np.ndarray, normals: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    """Upright lines on walls, up to the edge of the top that was touched right behind them.

    Contacts (n,) at their feet, their upper ends (n, 3), and shares (n,) of their lengths, several for each line.
    """
    from scipy.spatial import cKDTree

    walls, tops = np.flatnonzero(np.abs(normals[:, 2]) < _UPRIGHT), np.flatnonzero(normals[:, 2] > _TOP)
    near = cKDTree(centres[tops, :2]).query_ball_point(centres[walls, :2], np.hypot(_BEHIND, _ASIDE) * radius)
    wall = np.repeat(walls, [len(rows) for rows in near])
    top = tops[np.array([row for rows in near for row in rows], dtype=np.int64)]
    away = centres[top, :2] - centres[wall, :2]
    behind = -np.einsum("ni,ni->n", away, normals[wall, :2])
    beside = np.sqrt(np.maximum((away**2).sum(axis=1) - behind**2, 0.0))
    # Where the top's tangent plane meets the wall's, the sphere begins to roll over the edge one radius lower.
    edge = centres[top, 2] + np.einsum("ni,ni->n", away, normals[top, :2]) / normals[top, 2] - radius
    good = (np.einsum("ni,ni->n", normals[wall], normals[top]) < _FLAT) & (behind > 0.0) & (behind < _BEHIND * radius)
    good &= (beside < _ASIDE * radius) & (edge - centres[wall, 2] > _SHORTEST * radius)
    order = np.flatnonzero(good)[np.argsort((behind + beside)[good], kind="stable")]
    feet, first = np.unique(wall[order], return_index=True)
    upper = np.column_stack([centres[feet, :2], edge[order[first]]])
    pieces = ((upper[:, 2] - centres[feet, 2]) / (_CELL * radius)).astype(np.int64)
    line = np.repeat(np.arange(len(feet)), pieces)
    share = (np.arange(len(line)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1.0) / pieces[line]
    return feet[line], upper[line], share


def _through_cells(centres: np.ndarray, normals: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    """Both ends (n,) and (n,) of the best ruling through each cell, and the share (n,) of it at which it is there."""
    cell = _CELL * radius
    lower, upper = centres.min(axis=0), centres.max(axis=0)
    shape = tuple(np.maximum(np.ceil((upper - lower) / cell), 1).astype(np.int64))
    worth, ends, share = np.full(shape, np.inf), np.zeros((*shape, 2), np.int64), np.zeros(shape)
    lengths = _SHORTEST * radius, _LONGEST * radius
    best_rulings(centres, normals, *lengths, np.cos(_ALIKE), _STEP, _BEND, lower, cell, worth, ends, share)
    there = np.isfinite(worth)
    one, other = ends[there].T
    return one, other, share[there]
