"""The turn of all normals aside of the path, learnt from a run's contacts after it, and taken off them.

Aside of the path the estimators take the normal from the plane of force and slip. Where friction is not opposite to
the slip, all normals are turned about the path by one angle. Places show it: the chord between two contacts of a
smooth surface is as steep against the one normal as against the other, with opposite signs. On two lines that were
followed the same way both normals are turned to the same side, and the sum of both slopes is twice the turn. Bends
that are not even count with opposite signs on lines followed to and fro.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, hypot, radians, sqrt

import numpy as np
from scipy.spatial import cKDTree

from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.sensor_errors import FRICTION, friction_turn
from lwrprobe.scene import Scene

THIN = 1e-3
"""m of path between two contacts that are compared with others: nearer ones show the same."""
FAR, NEAR = 2.3, 0.5
"""Times the distance of the lines: longest and shortest chord. Two lines with one between them are followed the same
way where lines go to and fro."""
ACROSS = 0.8
"""Cosine between a chord and the mean of both directions aside."""
ALIKE = cos(radians(30.0))
"""Cosine between two normals, below which the surface between them bends too much."""
SLIDING = 1e-3
"""m/s, below which there is no path."""
FEWEST = 40
"""Chords, and two pieces of surface, below which nothing is learnt."""
MEDIAN = 1.2533 * 1.4826
"""Standard deviation of a median: times the median deviation over the root of the number."""
DRAWN = 200
"""Times that the pieces of surface are drawn anew, with replacement (bootstrap, Efron 1979)."""


@dataclass(slots=True, frozen=True)
class SideTurn:
    """`angle` rad by which the normals were turned about their path and were turned back, and `error` rad, the standard
    deviation of what is left. Both weigh what the contacts show against what was stated."""

    angle: float
    error: float

    def report(self) -> dict[str, float]:
        """For the summary."""
        return {"angle_deg": round(degrees(self.angle), 4), "error_deg": round(degrees(self.error), 4)}


def take_side_turn_off(recorder: Recorder, scene: Scene, spacing: float | None) -> SideTurn | None:
    """Turn the normals of the contacts that follow the run, about the centres; on disk they stay as measured.

    `spacing` m of the strategy's lines. None where the run shows no angle, where friction is stated to be opposite to
    the slip, and where some contacts belong to an earlier part of the run, of which the path is not known.
    """
    stated = friction_turn(scene) * _friction(recorder) / FRICTION
    states = recorder.arm_states()
    if states is None or stated <= 0.0 or spacing is None:
        return None
    normals, radius = recorder.normals(), scene.probe.radius
    centres, aside = recorder.points() + radius * normals, aside_of(normals, states[1])
    found = learn(centres, normals, aside, spacing, stated)
    if found is None:
        return None
    normals = normals - np.tan(found.angle) * aside
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    recorder.turn(normals, np.abs(aside).max(axis=1) > 0.0, radius)
    return found


def learn(
    centres: np.ndarray, normals: np.ndarray, aside: np.ndarray, spacing: float, stated: float
) -> SideTurn | None:
    """The turn from contacts in the order of their times; None where too few lines lie beside each other.

    Parameters
    ----------
    centres, normals : (n, 3) m and unit
    aside : (n, 3) normal x path, unit, zero where the sphere stands
    spacing : m between the lines
    stated : rad, standard deviation of the angle before anything was touched
    """
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    kept = np.unique((travel / THIN).astype(np.int64), return_index=True)[1]
    kept = kept[aside[kept].any(axis=1)]
    if len(kept) < 2:
        return None
    centres, normals, aside = centres[kept], normals[kept], aside[kept]
    first, second = cKDTree(centres).query_pairs(FAR * spacing, output_type="ndarray").T
    chords = centres[second] - centres[first]
    length = np.linalg.norm(chords, axis=1)
    across = np.einsum("ni,ni->n", chords, aside[first] + aside[second])
    alike = np.einsum("ni,ni->n", normals[first], normals[second]) > ALIKE
    good = (length > NEAR * spacing) & (np.abs(across) > 2.0 * ACROSS * length) & alike
    first, second, across = first[good], second[good], across[good]
    angles = np.einsum("ni,ni->n", chords[good], normals[first] + normals[second]) / across
    # Chords over the same piece of surface cross the same bends.
    cells = np.floor((centres[first] + 0.5 * chords[good]) / (FAR * spacing))
    piece = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    if len(angles) < FEWEST or piece.max() < 1:
        return None
    sides = np.concatenate([normals[first], aside[first]], axis=1)
    error = hypot(_by_pieces(angles, piece), _between(angles, sides, piece))
    share = stated**2 / (stated**2 + error**2)
    return SideTurn(share * float(np.median(angles)), sqrt(share) * error)


def _friction(recorder: Recorder) -> float:
    """Tangent of the friction angle, as most contacts show it."""
    forces, normals = np.array([contact.force for contact in recorder.contacts]).reshape(-1, 3), recorder.normals()
    along = np.einsum("ni,ni->n", forces, normals)
    across = np.linalg.norm(forces - along[:, None] * normals, axis=1)
    return float(np.median(across / np.maximum(along, 1e-9))) if len(forces) else 0.0


def _by_pieces(angles: np.ndarray, piece: np.ndarray) -> float:
    """rad, standard deviation of the median of angles (n,) by which pieces of surface (n,) were touched.

    On lines to and fro over the same piece its bends count with opposite signs, so that a draw of pieces keeps both.
    """
    random, count, order = np.random.default_rng(0), int(piece.max()) + 1, np.argsort(angles)
    angles, piece = angles[order], piece[order]
    medians = []
    for _ in range(DRAWN):
        drawn = np.cumsum(np.bincount(random.integers(0, count, count), minlength=count)[piece])
        medians.append(angles[np.searchsorted(drawn, 0.5 * drawn[-1])])
    return float(np.std(medians))


def _between(angles: np.ndarray, sides: np.ndarray, piece: np.ndarray) -> float:
    """rad, standard deviation of the median of angles (n,) by what differs between sides of the object and directions
    of travel, from (n, 6) normals and directions aside, beyond what the bends of their pieces (n,) explain.

    The sensor's own matrix turns all normals of one side that is followed in one direction alike.
    """
    group, counts = np.unique(np.round(sides), axis=0, return_inverse=True, return_counts=True)[1:]
    weights, middle = counts / len(angles), np.median(angles)
    excess = np.empty(len(counts))
    for k in range(len(counts)):
        own = angles[group.ravel() == k]
        median = np.median(own)
        bends = MEDIAN * np.median(np.abs(own - median)) / sqrt(len(np.unique(piece[group.ravel() == k])))
        excess[k] = (median - middle) ** 2 - bends**2
    return sqrt(max(float(weights @ excess), 0.0) * float(weights @ weights))


def aside_of(normals: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """(n, 3) unit directions normal x path; zero where the sphere stands."""
    aside = np.cross(normals, velocities)
    speed = np.linalg.norm(aside, axis=1, keepdims=True)
    return np.where(speed > SLIDING, aside / np.maximum(speed, SLIDING), 0.0)
