"""Normals turned after a run towards the places of the lines on both sides, aside of their path.

Aside of the path the estimators know no more than the direction of the force: friction, matrix, hysteresis and zero of
the sensor turn it by 0.01 to 0.05 rad. The sphere's centre is known to some 0.02 mm, and the centres on two lines lie
on a surface whose normals are those of the contacts. Chords to both sides give its slope at the contact in between, as
the parabola through three places has it: over a line spacing to some 0.005 rad. That holds where the surface is smooth.
There each chord agrees with the normals at both of its ends, up to their errors. Where they differ by more, something
lies in between, and the normal stays. How much a slope is worth on a surface that waves between the lines, the run
itself shows (`weighed`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, radians

import numpy as np
from scipy.spatial import cKDTree

from lwrprobe.exploration.recording.path_normals import CORNER
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.side_turn import aside_of
from lwrprobe.exploration.stages.sensor_errors import friction_turn
from lwrprobe.scene import Scene

THIN = 0.05
"""Times the distance of the lines: path between two contacts for which slopes are found. Between them they are
interpolated. All pairs within a few spacings are looked at, so that their number does not grow with the spacing."""
FAR, NEAR = 1.5, 0.3
"""Times the distance of the lines: longest and shortest chord. The next line, also where it is not parallel."""
ALONG = 0.3
"""Tangent between a chord and the direction aside, at most."""
SAME = 1.3
"""Times the distance of the nearest place: what is on the same line. Their mean counts."""
ALIKE = cos(radians(45.0))
"""Cosine between two normals, half of a right angle: below it the other one is on another face."""
CHORD = 0.006
"""rad, one standard deviation of a slope on a smooth surface, at least: play and waves of the gears."""
FEWEST = 100
"""Slopes, below which the spread of the normals is not known."""


@dataclass(slots=True, frozen=True)
class NeighbourTurn:
    """What lines on both sides showed of n normals.

    Attributes
    ----------
    share : (n,) of the angle to the slope by which normals were turned, 0 where no slope is known
    error : (n,) rad, standard deviation of what is left of that angle, 0 where no slope is known
    """

    share: np.ndarray
    error: np.ndarray

    def report(self) -> dict[str, float]:
        """For the summary: how many of the contacts were turned, by how much of the angle, and what is left of them."""
        turned = self.share > 0.0
        if not turned.any():
            return {"turned": 0.0}
        share, error = (float(np.median(values[turned])) for values in (self.share, self.error))
        found = {"turned": float(turned.mean()), "share": share, "error_deg": degrees(error)}
        return {name: round(value, 4) for name, value in found.items()}


def turn_to_neighbours(recorder: Recorder, scene: Scene, spacing: float | None) -> NeighbourTurn | None:
    """Turn the normals of the contacts that follow the run, about the centres; on disk they stay as measured.

    `spacing` m of the strategy's lines. None where there are too few lines beside each other, where nothing is stated
    to turn the normals, and where some contacts belong to an earlier part of the run, of which the path is not known.
    """
    states = recorder.arm_states()
    if states is None or friction_turn(scene) <= 0.0 or spacing is None:
        return None
    normals, radius = recorder.normals(), scene.probe.radius
    centres, aside = recorder.points() + radius * normals, aside_of(normals, states[1])
    angles, disagreements = slopes(centres, normals, aside, spacing)
    known = np.isfinite(angles)
    if known.sum() < FEWEST:
        return None
    share, error = np.zeros((2, len(known)))
    share[known], error[known] = weighed(angles[known], disagreements[known])
    normals = normals - (share * np.where(known, angles, 0.0))[:, None] * aside
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    recorder.turn(normals, share > 0.0, radius)
    return NeighbourTurn(share, error)


def weighed(angles: np.ndarray, disagreements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of each angle (n,) rad that is the normal's, and the standard deviation (n,) rad of what is then left.

    An angle is the error of its normal and that of its slope. A bend of the surface that is not even moves an angle by
    twice as much as the disagreement (n,) rad of chord and normals, and to the other side; the normal's error moves
    the disagreement by half as much as the angle, and to the same side. So the mean product of both is half of the
    difference of both variances, and the mean square of the angles is their sum. A disagreement that is not half of
    its angle shows in the same way how far a single slope may be off.
    """
    both, difference = float((angles**2).mean()), 2.0 * float((angles * disagreements).mean())
    normal = max(0.5 * (both + difference), 0.0)
    slope = max(0.5 * (both - difference), CHORD**2) + (disagreements - 0.5 * angles) ** 2
    share = normal / (normal + slope)
    return share, np.sqrt(share * slope)


def slopes(centres: np.ndarray, normals: np.ndarray, aside: np.ndarray, spacing: float) -> np.ndarray:
    """(2, n) rad: by how much the surface of the centres rises aside against the normals, and the mean disagreement of
    both chords with the normals at their ends. Not a number where the surface is not known or not smooth.

    Parameters
    ----------
    centres, normals : (n, 3) m and unit, in the order of their times
    aside : (n, 3) normal x path, unit, zero where the sphere stands
    spacing : m between the lines
    """
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    kept = np.unique((travel / (THIN * spacing)).astype(np.int64), return_index=True)[1]
    kept = kept[aside[kept].any(axis=1)]
    if len(kept) < 2:
        return np.full((2, len(centres)), np.nan)
    found = _slopes(centres[kept], normals[kept], aside[kept], spacing)
    # A contact between one with a slope and one without has none.
    angles = np.array([np.interp(np.arange(len(centres)), kept, each, np.nan, np.nan) for each in found])
    return np.where(aside.any(axis=1), angles, np.nan)


def _slopes(centres: np.ndarray, normals: np.ndarray, aside: np.ndarray, spacing: float) -> np.ndarray:
    """The same (2, n) of contacts that all have a direction aside, each against all others."""
    pairs = cKDTree(centres).query_pairs(FAR * spacing, output_type="ndarray")
    here, there = np.concatenate([pairs, pairs[:, ::-1]]).T
    chords = centres[there] - centres[here]
    across = np.einsum("ni,ni->n", chords, aside[here])
    path = np.cross(aside[here], normals[here])
    good = (np.abs(across) > NEAR * spacing) & (np.abs(np.einsum("ni,ni->n", chords, path)) < ALONG * np.abs(across))
    good &= np.einsum("ni,ni->n", normals[here], normals[there]) > ALIKE
    here, there, chords, across = here[good], there[good], chords[good], across[good]
    rise = np.einsum("ni,ni->n", chords, normals[here]) / across
    both = 0.5 * (rise + np.einsum("ni,ni->n", chords, normals[there]) / across)
    side = 2 * here + (across > 0.0)
    nearest = np.full(2 * len(centres), np.inf)
    np.minimum.at(nearest, side, np.abs(across))
    same = np.abs(across) < SAME * nearest[side]
    count = np.bincount(side[same], minlength=2 * len(centres)).astype(np.float64)
    count[count == 0.0] = np.nan
    means = (np.bincount(side[same], v[same], 2 * len(centres)) / count for v in (across, rise, both))
    x, slope, disagreement = (mean.reshape(-1, 2).T for mean in means)
    angle = (slope[0] * x[1] - slope[1] * x[0]) / (x[1] - x[0])
    smooth = (np.abs(disagreement) < CORNER).all(axis=0) & (np.abs(angle) < CORNER)
    return np.where(smooth, [angle, disagreement.mean(axis=0)], np.nan)
