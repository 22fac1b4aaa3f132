"""Surface of the mesh that no contact vouches for: how much of it there is, where, and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area, InputError, TriangleMesh
from lwrprobe.evaluation import touched
from lwrprobe.evaluation.mesh_error import sample_mesh
from lwrprobe.exploration.recording.groups import groups

SAMPLES = 4000
SMALLEST = 20e-6
"""m^2; the mesh differs from the object by as much along its edges."""
TOGETHER = 0.004
"""m between two samples of one place: a few times their mean distance on an object of 10 cm."""
DOWN = -0.3
"""Share of the normal along z, below which a surface faces down."""

OUTSIDE = "below or beside the area"
FACES_DOWN = "faces down"
MEETS = "the stick or the body of the probe would touch"
UNKNOWN = "the body of the probe would enter unknown space"
NOT_FOLLOWED = "no line was followed there to its end"
REASONS = (OUTSIDE, FACES_DOWN, MEETS, UNKNOWN, NOT_FOLLOWED)


@dataclass(slots=True, frozen=True)
class Untouched:
    """One place without contacts, or the part of it that has the same reason.

    Attributes
    ----------
    area : m^2
    lower, upper : (3,) m, the box around it
    reason : one of `REASONS`
    """

    area: float
    lower: np.ndarray
    upper: np.ndarray
    reason: str

    def as_dict(self) -> dict[str, object]:
        """Millimetres."""
        box = [[round(1e3 * float(v), 1) for v in corner] for corner in (self.lower, self.upper)]
        return {"area_mm2": round(1e6 * self.area, 1), "place": box, "reason": self.reason}


def untouched(
    mesh: TriangleMesh,
    points: np.ndarray,
    normals: np.ndarray,
    pitch: float,
    radius: float,
    area: Area,
    hindrance: Callable[[np.ndarray, np.ndarray], str] = lambda centre, facing: NOT_FOLLOWED,
) -> list[Untouched]:
    """Places of the mesh without a contact within half the line pitch plus 1 mm that faces the same way; largest first.

    Parameters
    ----------
    mesh : reconstructed, m
    points, normals : (n, 3) m and (n, 3) unit, of the contacts
    pitch : m, between two lines
    radius : m, of the sphere
    area : where the sphere's centre could go
    hindrance : one of the last three `REASONS`, of a place (3,) of the sphere's centre and the normal (3,) there
    """
    floor = float(area.lower[2]) - radius
    try:
        samples, facing = sample_mesh(mesh, floor, SAMPLES)
    except InputError:  # nothing of the mesh is above what the sphere can touch
        return []
    facing = facing / np.maximum(np.linalg.norm(facing, axis=1), 1e-30)[:, None]
    left = ~touched(samples, facing, points, normals, pitch)
    each = _area_above(mesh, floor) / len(samples)
    samples, facing = samples[left], facing[left]
    centres = samples + radius * facing
    outside = ((centres < area.lower) | (centres > area.upper)).any(axis=1)
    why = np.where(outside, REASONS.index(OUTSIDE), REASONS.index(FACES_DOWN))
    for k in np.flatnonzero(~outside & (facing[:, 2] >= DOWN)):
        why[k] = REASONS.index(hindrance(centres[k], facing[k]))
    found = []
    for place in groups(samples, TOGETHER):
        if len(place) * each < SMALLEST:
            continue
        for reason in np.unique(why[place]):
            part = samples[place[why[place] == reason]]
            found.append(Untouched(len(part) * each, part.min(axis=0), part.max(axis=0), REASONS[reason]))
    return sorted(found, key=lambda one: -one.area)


def _area_above(mesh: TriangleMesh, floor: float) -> float:
    """m^2 of the faces whose middle lies above a height."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    high = (a + b + c)[:, 2] > 3.0 * floor
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)[high].sum())
