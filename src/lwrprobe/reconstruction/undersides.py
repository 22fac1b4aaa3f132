"""Undersides that no sphere on an upright stick gets to, from the two ends at which they were touched.

Where the sphere rolls over the lower edges of two faces that look apart, what lies between the edges is taken to
overhang as they do: a lying cylinder is touched at the rims of its two end faces and nowhere else below its axis.
Without this, the walls above go straight down. A surface that bends away smoothly says nothing about what it bends to.

What lies so between two edges is ruled: its chords are parallel, and lie beside each other. Where they lead in many
directions, or all lie in one place, the ends match by chance, and nothing is said.

Between two edges of a convex solid all lies within it. A chord is left out where the surface that goes on from the
contacts nearest to it leaves it inside.

Where nothing was touched lower than the edges, the object would stand on a foot that nobody has touched. Its side may
as well go on inwards as it does: there an underside begins at sharp edges alone.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.reconstruction.clusters import Clusters, cluster, supported
from lwrprobe.reconstruction.hermite_field import HermiteData, HermiteField
from lwrprobe.reconstruction.touches import Touches

_DOWN = -0.2  # of the normal across the chord: less is noise
_APART = 0.15  # how far both ends must face outwards
_TURN = 0.2  # rad that the normal must turn over an edge
_SURE = 2.5  # times the scatter of normals, which a turn over an edge exceeds
_SHARP = 2.0  # radii of the sphere: an edge is rounded less than that
_SHARP_LOWEST = 0.5  # the same, where nothing was touched lower
_LOWER = 1.0  # radii below the edges, from which on something was
_ALIKE = 0.97  # cosine between the two ends' normals across the chord: 14 degrees
_LEVEL = 0.05  # of the chord's length: how much the two ends' surfaces may miss each other
_PARALLEL = 0.985  # cosine between two chords that are: 10 degrees
_SHARED = 0.75  # of the chords that are parallel: ends that match by chance give chords in many directions
_BROAD = 1.0  # radii across the chords, over which they lie at least
_GROWTH = 0.03  # m of standard deviation a metre from the nearer end
_NORMAL_SD = 0.1  # rad
_BESIDE = 1.0  # of the pitch, across a chord, within which a wall that was touched goes on below it: to the next line
_FACING = 0.5  # of a wall's normal, against the chord
_MAX_SAMPLES = 600  # contacts that face down, of many
_WITHIN = 2.5
"""Standard deviations by which a chord lies inside the surface that goes on from the contacts."""


def find_undersides(touches: Touches, clusters: Clusters, known: HermiteField, pitch: float) -> HermiteData:
    """Where the sphere's centre would be if it touched the underside, and the surface's normals there.

    `clusters` are those of the touches' centres, `known` is their field, `pitch` [m] lies between their lines.
    """
    down = touches.normals[:, 2] < 0.7 * _DOWN
    low = np.flatnonzero(supported(down, down, touches.points, touches.normals, touches.confidence, touches.radius))
    low = low[:: len(low) // _MAX_SAMPLES + 1]
    if len(low) < 2:
        return _data(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    feet = clusters.points - touches.radius * clusters.normals
    ends, normals = touches.points[low], touches.normals[low]
    none_lower = ends[:, 2].max() < touches.points[:, 2].min() + _LOWER * touches.radius
    rounding = (_SHARP_LOWEST if none_lower else _SHARP) * touches.radius
    sharp = _over_edge(ends, normals, feet, clusters.normals, rounding, _SURE * _scatter(touches, clusters))
    walls = feet, clusters.normals
    places, facing, deviation, chord = _chords(ends, normals, sharp, walls, pitch, touches.radius, touches.noise)
    kept = _inside(places, feet, touches.visited, touches.radius, pitch)
    places, facing, deviation, chord = places[kept], facing[kept], deviation[kept], chord[kept]
    if not len(places):
        return _data(places, facing, deviation)
    found, sd = _gathered(places, facing, deviation, touches.radius, pitch)
    within = known.values_near(found.points, found.points[:, None])[:, 0]
    within = within < -_WITHIN * np.hypot(known.deviations(found.points), sd)
    kept = ~np.isin(chord, chord[within[found.label]])
    if not kept.any():
        return _data(places[kept], facing[kept], deviation[kept])
    found, sd = _gathered(places[kept], facing[kept], deviation[kept], touches.radius, pitch)
    return _data(found.points, found.normals, sd)


def _gathered(
    places: np.ndarray, facing: np.ndarray, deviation: np.ndarray, radius: float, pitch: float
) -> tuple[Clusters, np.ndarray]:
    """The sphere's centres over places (n, 3) of the surface, clustered, and the mean deviation of each cluster."""
    found = cluster(places + radius * facing, facing, np.ones(len(places)), 0.5 * pitch)
    return found, np.bincount(found.label, deviation) / found.weight


def _data(centres: np.ndarray, normals: np.ndarray, deviation: np.ndarray) -> HermiteData:
    return HermiteData(centres, normals, deviation, np.full(len(centres), _NORMAL_SD))


def _scatter(touches: Touches, clusters: Clusters) -> float:
    """rad: median angle between a contact's normal and that of its cluster."""
    cosine = np.einsum("ij,ij->i", touches.normals, clusters.normals[clusters.label])
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _towards(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Level distance (m, m) and direction (m, m, 3) from each end to each other."""
    run = ends[None, :, :2] - ends[:, None, :2]
    length = np.linalg.norm(run, axis=2)
    unit = np.zeros((*length.shape, 3))
    unit[..., :2] = run / np.maximum(length, 1e-12)[..., None]
    return length, unit


def _over_edge(
    ends: np.ndarray, normals: np.ndarray, feet: np.ndarray, facing: np.ndarray, radius: float, noise: float
) -> np.ndarray:
    """(m, m) bool: the first of the ends (m, 3) is on an edge of a face that looks away from the second.

    The face shows in feet (k, 3) that are `facing` (k, 3) that way; the edge is rounded by less than `radius` m.
    A turn of `noise` rad may be chance.
    """
    from scipy.spatial import cKDTree

    _, unit = _towards(ends)
    sharp = np.zeros(unit.shape[:2], dtype=bool)
    for i, rows in enumerate(cKDTree(feet).query_ball_point(ends, 0.7 * radius)):
        away = np.arccos(np.clip(-unit[i] @ facing[rows].T, -1.0, 1.0))
        own = np.arccos(np.clip(-unit[i] @ normals[i], -1.0, 1.0))
        turn = own[:, None] - away - noise
        sharp[i] = ((turn > _TURN) & (turn * radius > np.linalg.norm(feet[rows] - ends[i], axis=1))).any(axis=1)
    return sharp


def _chords(
    ends: np.ndarray,
    normals: np.ndarray,
    sharp: np.ndarray,
    walls: tuple[np.ndarray, np.ndarray],
    pitch: float,
    radius: float,
    noise: float,
) -> tuple[np.ndarray, ...]:
    """Places along the chords between ends that match, the normals there, the deviation to expect, the chord's number.

    A chord ends where it comes to one of the `walls`, feet and normals (k, 3), that stand below it.
    """
    length, unit = _towards(ends)
    across = [_without(normals[:, None], unit), _without(normals[None], unit)]
    apart = (np.einsum("ik,ijk->ij", normals, unit) < -_APART) & (np.einsum("jk,ijk->ij", normals, unit) > _APART)
    alike = np.einsum("ijk,ijk->ij", *across)
    miss = np.abs(np.einsum("ijk,ijk->ij", ends[None] - ends[:, None], across[0] + across[1])) * 0.5
    fits = apart & sharp & sharp.T & (alike > _ALIKE) & (length > pitch) & (miss < _LEVEL * length)
    fits &= (across[0][..., 2] < _DOWN) & (across[1][..., 2] < _DOWN)
    # On an edge normals fan out: the chord straight across it leaves the one that points down most.
    slant = 0.5 * (across[0] + across[1])[..., 2] - alike
    cost = np.where(fits, miss / np.maximum(length, 1e-12) + slant, np.inf)
    partner = cost.argmin(axis=1)
    matched = np.flatnonzero(np.isfinite(cost.min(axis=1, initial=np.inf)))
    matched = matched[_parallel(unit[matched, partner[matched]])]
    if not _broad(ends[matched], ends[partner[matched]], _BROAD * radius):
        matched = matched[:0]
    places, facing, deviation = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for i in matched:
        j = partner[i]
        steps = int(np.ceil(length[i, j] / (0.5 * pitch)))
        share = (np.arange(1, steps) / steps)[:, None]
        places.append((1.0 - share) * ends[i] + share * ends[j])
        mixed = (1.0 - share) * across[0][i, j] + share * across[1][i, j]
        facing.append(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
        end = np.minimum(share, 1.0 - share)[:, 0] * length[i, j]
        deviation.append(np.hypot(noise, _GROWTH * end))
        near = _to_wall(ends[i], unit[i, j], across[0][i, j], *walls, pitch, radius)
        far = _to_wall(ends[j], -unit[i, j], across[1][i, j], *walls, pitch, radius)
        if min(near, far) < length[i, j]:
            along, (near, far) = share[:, 0] * length[i, j], (d if d < length[i, j] else 0.0 for d in (near, far))
            kept = (along < near) | (length[i, j] - along < far)
            for found in (places, facing, deviation):
                found[-1] = found[-1][kept]
    chord = np.repeat(np.arange(len(places)), [len(rows) for rows in places])
    return np.concatenate(places), np.concatenate(facing), np.concatenate(deviation), chord


def _parallel(unit: np.ndarray) -> np.ndarray:
    """(n,) bool: directions (n, 3) that are parallel to that which most share; none where too few share one."""
    if not len(unit):
        return np.zeros(0, dtype=bool)
    alike = np.abs(unit @ unit.T) > _PARALLEL
    most = alike[alike.sum(axis=1).argmax()]
    return most & (most.mean() >= _SHARED)


def _broad(ends: np.ndarray, others: np.ndarray, least: float) -> bool:
    """Whether chords between ends (n, 3) and others (n, 3) lie over `least` m across their direction."""
    if not len(ends):
        return False
    along = (others[0] - ends[0]) / np.linalg.norm(others[0] - ends[0])
    middles = 0.5 * (ends + others)
    across = middles - (middles @ along)[:, None] * along
    return bool(np.ptp(across, axis=0).max() > least)


def _to_wall(
    end: np.ndarray,
    onward: np.ndarray,
    down: np.ndarray,
    feet: np.ndarray,
    facing: np.ndarray,
    pitch: float,
    radius: float,
) -> float:
    """m from an end (3,) of a chord `onward` (3,) to the first of the feet (k, 3) of a wall below it that is `facing`
    (k, 3) against it; inf where none is. `down` (3,) is the chord's normal.
    """
    offset = feet - end
    along = offset @ onward
    aside = np.abs(offset[:, 0] * onward[1] - offset[:, 1] * onward[0])
    wall = (offset @ down > 0.5 * radius) & (aside < _BESIDE * pitch) & (along > -pitch) & (facing @ onward < -_FACING)
    return max(float(along[wall].min()), 0.0) if wall.any() else np.inf


def _without(normals: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Unit normals with their part along `unit` taken out."""
    across = normals - np.einsum("...k,...k->...", normals, unit)[..., None] * unit
    return across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)


def _inside(places: np.ndarray, feet: np.ndarray, visited: np.ndarray, radius: float, pitch: float) -> np.ndarray:
    """(n,) bool: nothing that was passed freely is in the way, and something was touched above."""
    from scipy.spatial import cKDTree

    if not len(places):
        return np.zeros(0, dtype=bool)
    free = np.ones(len(places), dtype=bool)
    if len(visited):
        free = cKDTree(visited).query(places)[0] > 0.8 * radius
    above = cKDTree(feet[:, :2]).query_ball_point(places[:, :2], 0.75 * pitch)
    covered = [bool((feet[rows, 2] > place[2] + radius).any()) for rows, place in zip(above, places)]
    return free & np.array(covered)
