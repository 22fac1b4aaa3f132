"""Normals turned towards the path after a run: while the sphere follows a surface, its path is tangent to it.

During the run the direction of travel is that of an instant, which noise and the waves of the gears turn, and only the
past is known. Afterwards the path lies there on both sides of each contact: the chord from a place before it to one as
far behind it has the surface's direction, also where the surface bends evenly. A normal is turned until it is
perpendicular to its chord, by the share that the chord is the more certain.
"""

from __future__ import annotations

from dataclasses import replace

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
"""rad between a normal and what is perpendicular to its chord, from which on the path has a corner there, or a jump."""


def turn_to_path(recorder: Recorder, radius: float) -> np.ndarray:
    """Turn the normals of the contacts that follow the run, about the centres; on disk they stay as measured.

    `radius` m of the sphere. Returns which contacts were turned, (n,) bool: not those at the ends of a path, at corners
    and where the sphere stood still.
    """
    points, normals = recorder.points(), recorder.normals()
    centres = points + radius * normals
    chords = _chords(np.array([contact.time for contact in recorder.contacts]), centres)
    off = np.einsum("ni,ni->n", chords, normals)
    turned = chords.any(axis=1) & (np.abs(off) < CORNER)
    normals = normals - np.where(turned, SHARE * off, 0.0)[:, None] * chords
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for k in np.flatnonzero(turned):
        recorder.contacts[k] = replace(recorder.contacts[k], point=centres[k] - radius * normals[k], normal=normals[k])
    return turned


def _chords(times: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(n, 3) unit directions from a place before each centre to one behind it; zero where there are none."""
    chords = np.zeros_like(centres)
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
    return chords
