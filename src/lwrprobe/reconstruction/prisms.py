"""Prisms: objects with one cross-section along an axis, as far as all that was touched and passed agrees with that.

On a prism each contact between both ends tells where the surface is all along the line through it that is parallel to
the axis. The axis is a direction across which nearly all normals lie. Near both ends the sphere also touches the end
faces and rolls over their edges; other normals anywhere else show that the object is no prism. So do places on the
lines where something else was touched, or below which the sphere has passed. A prism rests on an end or on a side: its
axis is upright or level. A box is a prism along each of its three axes.

All of it is about the surface on which the sphere's centre moves in contact. Like a ruling, a line says something only
far from contacts.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters
from lwrprobe.reconstruction.hermite_field import HermiteData
from lwrprobe.reconstruction.ruling_kernels import refuted
from lwrprobe.reconstruction.touches import Touches

_ACROSS = 0.05
"""Share of a normal along the axis, up to which it lies across it (3 degrees)."""
_MOST = 0.3
"""Share of the normals that lie across an axis at least."""
_PAIRED, _APART = 60, 0.35
"""Normals that are paired, and the sine between two of them at least: their cross product may be the axis."""
_AXES, _TURNED = 3, 0.3
"""Axes at most, and the sine between two of them at least."""
_RESTS = 0.05
"""Share of an axis along z at most where it is level; the same beside z where it is upright."""
_SPREAD = 0.05
"""Mean square, at least, of the shares of the normals across the axis along their second direction: the normals of
one face alone have no axis."""
_END = 1.3
"""Radii from the first and the last contact along the axis, within which the sphere touches ends and their edges."""
_OTHER, _REFUTED = 0.03, 0.05
"""Share of the normals elsewhere that are not across the axis, and share of the places that are refuted, at most."""
_ROUND = 0.7
"""Radii from the last contact that faces across the axis to the last place: soon the sphere rolls over an edge."""
_STEP = 1.2
"""Radii between two places on a line, and edge of the cells that hold one place each."""
_FAR = 1.4
"""Radii from contacts, from which on a line says more than they do."""
_LEAN = 0.02
"""Of the distance to the contact, by which the surface may be elsewhere."""
_DOWN = -0.1
"""Share of the normal along z, from which on a line counts: what faces down may end anywhere."""
_BESIDE, _OFF, _DEEP = 0.5, 1e-3, 2.0
"""Radii beside a line, m off it, and radii below it: where something must lie to refute a place."""


def find_prisms(touches: Touches, fine: Clusters) -> HermiteData:
    """Places of the sphere's centre far from contacts, as they follow from `fine_clusters` on a prism; else none."""
    none = np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    found = [_along(axis, fine.points, fine.normals, touches) or none for axis in _axes(fine.normals)]
    places, normals, error = (np.concatenate(rows) for rows in zip(none, *found))
    return HermiteData(places, normals, np.hypot(touches.noise, error), np.full(len(error), touches.normal_noise))


def _axes(normals: np.ndarray) -> list[np.ndarray]:
    """Unit directions (3,), level or upright, across which most of the normals (n, 3) lie, the best one first."""
    some = normals[:: max(1, len(normals) // _PAIRED)]
    one, other = np.triu_indices(len(some), 1)
    tried = np.cross(some[one], some[other])
    sine = np.linalg.norm(tried, axis=1)
    tried = tried[sine > _APART] / sine[sine > _APART, None]
    beside, along = np.hypot(tried[:, 0], tried[:, 1]), np.abs(tried[:, 2])
    tried = tried[np.minimum(beside, along) < _RESTS]
    share = (np.abs(normals @ tried.T) < _ACROSS).mean(axis=0)
    found: list[np.ndarray] = []
    for number in np.argsort(-share, kind="stable"):
        if len(found) == _AXES or share[number] < _MOST:
            break
        if all(np.linalg.norm(np.cross(tried[number], axis)) > _TURNED for axis in found):
            across = normals[np.abs(normals @ tried[number]) < _ACROSS]
            found.append(np.linalg.eigh(across.T @ across)[1][:, 0])
    return found


def _along(
    axis: np.ndarray, centres: np.ndarray, normals: np.ndarray, touches: Touches
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Places (n, 3) m along an axis, their normals, and by how much (n,) m they may be off; None for no prism."""
    from scipy.spatial import cKDTree

    radius, along = touches.radius, centres @ axis
    across = np.abs(normals @ axis) < _ACROSS
    between = (along > along.min() + _END * radius) & (along < along.max() - _END * radius)
    if np.mean(between & ~across) > _OTHER:
        return None
    sides = np.flatnonzero(across)
    if np.linalg.eigvalsh(normals[sides].T @ normals[sides] / max(len(sides), 1))[1] < _SPREAD:
        return None
    levels = np.arange(along[sides].min() + _ROUND * radius, along[sides].max() - _ROUND * radius, _STEP * radius)
    source = np.repeat(sides[normals[sides, 2] > _DOWN], len(levels))
    shift = np.resize(levels, len(source)) - along[source]
    places = centres[source] + shift[:, None] * axis
    # Of all lines through a cell, that of the nearest contact.
    order = np.argsort(np.abs(shift), kind="stable")
    cells = np.floor(places[order] / (_STEP * radius)).astype(np.int64)
    kept = order[np.unique(cells, axis=0, return_index=True)[1]]
    kept = kept[cKDTree(centres).query(places[kept])[0] > _FAR * radius]
    places, facing, error = places[kept], normals[source[kept]], _LEAN * np.abs(shift[kept])
    begin, finish = places - radius * axis, places + radius * axis
    deep, wrong = np.full(len(places), _DEEP * radius), np.zeros(len(places), dtype=bool)
    for points, towards in ((centres, normals), (touches.visited, np.empty((0, 3)))):
        refuted(begin, finish, facing, points, towards, _BESIDE * radius, _OFF, radius, deep, wrong)
    if not len(places) or wrong.mean() > _REFUTED:
        return None
    return places[~wrong], facing[~wrong], error[~wrong]
