"""Whether another method explains the contacts better than the one that was asked for.

A few wrong contacts can hollow out a mesh that obeys every one of them. That shows in the contacts themselves: many of
them then lie off the mesh. Only in this case are methods compared by cross-validation (Hastie, Tibshirani, Friedman,
The Elements of Statistical Learning, 2009, section 7.10): contacts are held out in blocks as wide as the gap between
two lines, since the neighbours on its own line tell a contact's place under any method.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lwrprobe.contracts import InputError, Reconstruction, TouchRecord, TriangleMesh

SUSPICIOUS = 1e-4
"""m, mean distance of the contacts to the mesh from which on other methods are looked at."""
TIMES = 2.0
"""Of another method's distance, which the method's own has to reach for the two to be compared."""

CLEARLY = 0.8
"""Of what held-out contacts are off with the method that was asked for, below which another one is taken. On thin walls
all methods miss most of what is held out, and a tenth less says nothing."""
FOLDS = 3
"""Parts of the contacts, each of which is held out once."""

_BLOCK = 1.5  # of the pitch: edge of the blocks that are held out
_VOTES = 5  # contacts nearest to a place of the mesh, most of which should face its way
_SAMPLES = 30_000  # points of a mesh from whose triangles a distance is taken
_LOOKED_AT = 3000  # contacts or free places that are measured, of many

Method = Callable[[TouchRecord], Reconstruction]


@dataclass(slots=True, frozen=True)
class Better:
    """Another method's surface, and why it is taken.

    Attributes
    ----------
    name : of the method
    surface : of all contacts
    score, instead_of : m, what held-out contacts and the free path are off on average, with it and with the method
        that was asked for
    """

    name: str
    surface: Reconstruction
    score: float
    instead_of: float

    @property
    def why(self) -> str:
        """In one sentence."""
        return (
            f"{self.name} predicts contacts that were held out better, to {1e3 * self.score:.2f} mm in place of "
            f"{1e3 * self.instead_of:.2f} mm"
        )


def better_method(
    record: TouchRecord, found: Reconstruction, own: Method, others: Mapping[str, Method], pitch: float
) -> Better | None:
    """The best of the `others` where it explains contacts clearly better than the surface `found` by `own`, else None.

    `pitch` [m] lies between the record's lines.
    """
    contacts = _some(record.points)
    residual = _residual(found.mesh, contacts)
    if residual <= SUSPICIOUS:
        return None
    made = {name: surface for name, method in others.items() if (surface := _made(method, record)) is not None}
    if not _floats(found.mesh, record, pitch):
        made = {name: surface for name, surface in made.items() if not _floats(surface.mesh, record, pitch)}
    near = [name for name, surface in made.items() if residual >= TIMES * _residual(surface.mesh, contacts)]
    if not near:
        return None
    instead_of = _score(own, found, record, pitch)
    scores = {name: _score(others[name], made[name], record, pitch) for name in near}
    best = min(near, key=scores.__getitem__)
    return Better(best, made[best], scores[best], instead_of) if scores[best] < CLEARLY * instead_of else None


def blocks(points: np.ndarray, pitch: float) -> np.ndarray:
    """(n,) the fold that each of the points (n, 3) m is held out in, in blocks wider than the pitch between lines."""
    return np.floor(points / (_BLOCK * pitch)).astype(np.int64).sum(axis=1) % FOLDS


def offsets(mesh: TriangleMesh, points: np.ndarray) -> np.ndarray:
    """(n,) m from a mesh to points (n, 3), positive outside: to the plane of the triangle whose sample is nearest."""
    from scipy.spatial import cKDTree

    samples, normals, spacing = _samples(mesh)
    apart, near = cKDTree(samples).query(points)
    above = np.einsum("ij,ij->i", points - samples[near], normals[near])
    # Farther away than the samples are from one another, the distance to a sample is the better figure.
    return np.where(apart < 3.0 * spacing, above, np.copysign(apart, above))


def lines_apart(mesh: TriangleMesh, points: np.ndarray) -> float:
    """m between lines through contacts (n, 3), as their mesh has them, from the lowest contact on.

    Between lines a distance p apart places are evenly up to p / 2 away from the next one. Lines that cross leave less.
    """
    from scipy.spatial import cKDTree

    places = _samples(mesh)[0]
    places = _some(places[places[:, 2] >= points[:, 2].min()])
    if not len(places):
        return np.inf
    return float(np.percentile(cKDTree(points).query(places)[0], 95.0)) / 0.475


def _samples(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray, float]:
    """Points all over a mesh and its normals there (n, 3), and how far they are apart [m]."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    random = np.random.default_rng(0)
    face = random.choice(len(corners), _SAMPLES, p=doubled / doubled.sum())
    share = random.random((_SAMPLES, 2))
    share[share.sum(axis=1) > 1.0] = 1.0 - share[share.sum(axis=1) > 1.0]
    first = corners[face, 0]
    sides = corners[face, 1:] - first[:, None]
    unit = normals[face] / doubled[face, None]
    return first + np.einsum("ij,ijk->ik", share, sides), unit, float(np.sqrt(0.5 * doubled.sum() / _SAMPLES))


def _residual(mesh: TriangleMesh, points: np.ndarray) -> float:
    return float(np.abs(offsets(mesh, points)).mean())


def _score(method: Method, whole: Reconstruction, record: TouchRecord, pitch: float) -> float:
    """m: what held-out contacts are off on average, a pitch at most, and what speaks against the `whole` mesh."""
    block = blocks(record.points, pitch)
    total, count = 0.0, 0
    for fold in range(FOLDS):
        held = block == fold
        points = _some(record.points[held])
        surface = _made(method, _without(record, held)) if len(points) else whole
        far = np.full(len(points), pitch) if surface is None else np.abs(offsets(surface.mesh, points))
        total, count = total + float(np.minimum(far, pitch).sum()), count + len(points)
    return total / count + _needless(whole.mesh, record, pitch) + _in_the_way(whole.mesh, record, pitch)


def _floats(mesh: TriangleMesh, record: TouchRecord, pitch: float) -> bool:
    """Whether a mesh ends above the table, by more than the probe leaves out and the pitch.

    What stands on a table reaches down to it. Contacts that were all held out above say nothing of that.
    """
    if record.table is None or record.lowest is None:
        return False
    return bool(mesh.vertices[:, 2].min() > record.lowest + pitch)


def _needless(mesh: TriangleMesh, record: TouchRecord, pitch: float) -> float:
    """m, mean over the mesh: how far contacts are beyond half a pitch, a pitch at most or where most face against it.

    A surface that bends around every wrong contact is near to all of them, and most of it is near none.
    """
    from scipy.spatial import cKDTree

    places, facing = _samples(mesh)[:2]
    low = -np.inf if record.table is None or record.lowest is None else record.lowest
    high = places[:, 2] > low
    places, facing = _some(places[high]), _some(facing[high])
    if not len(places):
        return pitch
    count = min(_VOTES, len(record.points))
    apart, near = cKDTree(record.points).query(places, k=np.arange(1, count + 1))
    beyond = np.clip(apart[:, 0] - 0.5 * pitch, 0.0, pitch)
    if record.normals is not None:
        against = np.einsum("ijk,ik->ij", record.normals[near], facing) < 0.0
        beyond[against.mean(axis=1) > 0.5] = pitch
    return float(beyond.mean())


def _in_the_way(mesh: TriangleMesh, record: TouchRecord, pitch: float) -> float:
    """m, mean over the free path: how deep the sphere was in the mesh, a pitch at most."""
    if record.free_path is None or record.probe_radius is None or not len(record.free_path):
        return 0.0
    path = _some(record.free_path[np.isfinite(record.free_path).all(axis=1)])
    return float(np.clip(record.probe_radius - offsets(mesh, path), 0.0, pitch).mean())


def _made(method: Method, record: TouchRecord) -> Reconstruction | None:
    try:
        surface = method(record)
    except InputError:
        return None
    return surface if len(surface.mesh.faces) else None


def _without(record: TouchRecord, held: np.ndarray) -> TouchRecord:
    left: dict[str, Any] = {"points": record.points[~held]}
    for name in ("normals", "confidence", "times"):
        if (value := getattr(record, name)) is not None:
            left[name] = value[~held]
    return replace(record, **left)


def _some(rows: np.ndarray) -> np.ndarray:
    """At most a few thousand of the rows (n, 3), evenly."""
    return rows[:: len(rows) // _LOOKED_AT + 1]
