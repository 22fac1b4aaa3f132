"""Normals turned towards the path after a run: while the sphere follows a surface, its path is tangent to it.

During the run the direction of travel is that of an instant, which noise and the waves of the gears turn, and only the
past is known. Afterwards the path lies there on both sides of each contact: the chord from a place before it to one as
far behind it has the surface's direction, also where the surface bends evenly. A normal is turned until it is
perpendicular to its chord, by the share that the chord is the more certain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from lwrprobe.exploration.recording.recorder import Recorder

REACH = 5e-4
"""m of path on each side: a tenth of the sphere's radius. Shorter, the noise of places turns the chord."""
GAP = 0.05
"""s between two contacts, from which on the path between them is not known."""
SHARE = 0.7
"""Of the turn to the chord. A chord is off by some 0.006 rad, a normal along its path by 0.01 in the profile `lab`."""
CHORD = 0.006
"""rad, one standard deviation: play and what is left of the waves, over the length of a chord."""
CORNER = 0.08
"""rad between a normal and what is perpendicular to its chord, from which on the path may have a corner there, or a
jump, and rad of the path's own bend from which on it has."""
LARGEST = 0.3
"""The same angle, from which on normal and path have nothing to do with each other."""


@dataclass(slots=True, frozen=True)
class PathTurn:
    """What paths showed of n normals.

    Attributes
    ----------
    turned : (n,) bool, normals that were turned
    off : (n,) rad between normals and what is perpendicular to their chords before that, not a number without a chord
    """

    turned: np.ndarray
    off: np.ndarray

    def left(self, along: np.ndarray) -> np.ndarray:
        """(n,) rad, standard deviation of the normals along their path, of which `along` (n,) rad was expected.

        Normals are no better than they agree with the path; those without a chord no better than the others.
        """
        seen = np.minimum(np.abs(self.off), LARGEST)
        known = np.isfinite(seen)
        spread = sqrt(float((seen[known] ** 2).mean())) if known.any() else 0.0
        before = np.maximum(along, np.where(known, seen, spread))
        return np.where(self.turned, np.hypot((1.0 - SHARE) * before, SHARE * CHORD), before)


def turn_to_path(recorder: Recorder, radius: float) -> PathTurn:
    """Turn the normals of the contacts that follow the run, about the centres; on disk they stay as measured.

    `radius` m of the sphere. Not turned are those at the ends of a path, at corners and where the sphere stood still.
    """
    points, normals = recorder.points(), recorder.normals()
    centres = points + radius * normals
    chords, bends = _chords(np.array([contact.time for contact in recorder.contacts]), centres)
    off = np.einsum("ni,ni->n", chords, normals)
    led = chords.any(axis=1)
    # At a corner the chord cuts it off. On a straight piece the normal is wrong, as that of a bad sensor is at times.
    turned = led & (np.abs(off) < np.where(bends < CORNER, LARGEST, CORNER))
    normals = normals - np.where(turned, SHARE * off, 0.0)[:, None] * chords
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for k in np.flatnonzero(turned):
        recorder.contacts[k] = replace(recorder.contacts[k], point=centres[k] - radius * normals[k], normal=normals[k])
    return PathTurn(turned, np.where(led, off, np.nan))


def _chords(times: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) unit directions from a place before each centre to one behind it, zero where there are none; and the angle
    (n,) rad between the two halves of that way."""
    chords, bends = np.zeros_like(centres), np.zeros(len(centres))
    for run in np.split(np.arange(len(times)), np.flatnonzero(np.diff(times) > GAP) + 1):
        if len(run) < 3:
            continue
        places = centres[run]
        travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
        inside = np.flatnonzero((travel >= REACH) & (travel <= travel[-1] - REACH))
        ends = (travel[inside] + REACH, travel[inside] - REACH)
        behind, before = (np.column_stack([np.interp(end, travel, axis) for axis in places.T]) for end in ends)
        chord = behind - before
        length = np.linalg.norm(chord, axis=1)
        # Where the sphere stands, its noise travels and leads nowhere.
        led = length > REACH
        chords[run[inside[led]]] = chord[led] / length[led, None]
        first, second = places[inside] - before, behind - places[inside]
        sines = np.linalg.norm(np.cross(first, second), axis=1)
        bends[run[inside]] = np.arctan2(sines, np.einsum("ni,ni->n", first, second))
    return chords, bends
