"""Normals turned towards the path after a run: while the sphere follows a surface, its path is tangent to it.

During the run the direction of travel is that of an instant, which noise and the waves of the gears turn, and only the
past is known. Afterwards the path lies there on both sides of each contact: the chord from a place before it to one as
far behind it has the surface's direction, also where the surface bends evenly. A normal is turned until it is
perpendicular to its chord, by the share that the chord is the more certain.

Where the force swings, or the sphere hardly moves, the estimator cannot tell that it slides. Friction and errors of the
torque then turn the normal by up to 0.3 rad, while the path is as good as elsewhere. Aside of the path such a normal is
drawn into the plane of force and path, in which friction lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from lwrprobe.contracts.contact import NORMAL_AT_HALF_CONFIDENCE
from lwrprobe.exploration.recording.recorder import Recorder

REACHES = (5e-4, 3e-4)
"""m of path on each side: a tenth of the sphere's radius. Shorter, the noise of places turns the chord; the second is
for what lies near the end of a path."""
LEADS = 0.5
"""Times that, by which the path leads away on each side at least."""
GAP = 0.05
"""s between two touches, from which on the path between them is not known unless they lie near each other."""
HOP, NEAR = 0.25, 1e-3
"""s and m: a swing that takes the sphere off the surface for less than both does not end the path."""
SHARE = 0.7
"""Of the turn to the chord, at least. A chord is off by some 0.006 rad, a normal along its path by 0.01 in the profile
`lab`."""
CHORD = 0.006
"""rad, one standard deviation in the profile `lab`: play, what is left of the waves, the sensor's hysteresis."""
CORNER = 0.08
"""rad between a normal and what is perpendicular to its chord, from which on the path may have a corner there, or a
jump, and rad of the path's own bend from which on it has. The chord beside a corner is off by half of the bend."""
LARGEST = 0.6
"""The same angle, from which on normal and path have nothing to do with each other: more than friction turns it."""
PLANE = 0.025
"""rad, standard deviation of a normal in the plane of force and path, aside of the path."""


@dataclass(slots=True, frozen=True)
class PathTurn:
    """What paths showed of n normals.

    Attributes
    ----------
    share : (n,) of the angle to the chord by which normals were turned
    off : (n,) rad between normals and what is perpendicular to their chords before that, not a number without a chord
    """

    share: np.ndarray
    off: np.ndarray

    def left(self, along: np.ndarray, chords: np.ndarray) -> np.ndarray:
        """(n,) rad, standard deviation of the normals along their path, of which `along` (n,) rad was expected.

        `chords` (n,) rad: of the chords, `CHORD` at least.

        Normals are no better than they agree with the path; those without a chord no better than the others.
        """
        seen = np.minimum(np.abs(self.off), LARGEST)
        known = np.isfinite(seen)
        spread = sqrt(float((seen[known] ** 2).mean())) if known.any() else 0.0
        before = np.maximum(along, np.where(known, seen, spread))
        chord = self.share * np.maximum(CHORD, chords)
        return np.where(self.share > 0.0, np.hypot((1.0 - self.share) * before, chord), before)


def turn_to_path(recorder: Recorder, radius: float) -> PathTurn:
    """Turn the normals of the contacts that follow the run, about the centres; on disk they stay as measured.

    `radius` m of the sphere. Not turned are those at the ends of a path, at corners and where the sphere stood still.
    """
    points, normals = recorder.points(), recorder.normals()
    centres = points + radius * normals
    chords, bends = _chords_of(recorder, centres)
    off = np.einsum("ni,ni->n", chords, normals)
    led = chords.any(axis=1)
    share = np.where(led & (np.abs(off) < LARGEST), _shares(np.abs(off), bends), 0.0)
    normals = _unit(normals - (share * off)[:, None] * chords)
    normals = _drawn_to_force(recorder, normals, np.where((share > 0.0)[:, None], chords, 0.0))
    recorder.turn(normals, share > 0.0, radius)
    return PathTurn(share, np.where(led, off, np.nan))


def _shares(off: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """(n,) of the angles `off` (n,) rad by which normals are turned, on a path that bends by (n,) rad.

    What an angle has beyond the chord's own error is the normal's. On a straight piece the normal is wrong, as that of
    a bad sensor is at times; at a corner the chord cuts it off.
    """
    least = np.where((bends < CORNER) | (off < CORNER), SHARE, 0.0)
    chord = np.maximum(CHORD, 0.5 * bends)
    return np.maximum(least, 1.0 - (chord / np.maximum(off, chord)) ** 2)


def _drawn_to_force(recorder: Recorder, normals: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """(n, 3) normals, the less certain ones in the plane of force and chord; without a chord (n, 3) as they are."""
    if not len(normals):
        return normals
    forces = np.array([contact.force for contact in recorder.contacts])
    forces = forces - np.einsum("ni,ni->n", forces, chords)[:, None] * chords
    across = normals - np.einsum("ni,ni->n", normals, chords)[:, None] * chords
    wanted = _unit(forces) * np.linalg.norm(across, axis=1, keepdims=True) + (normals - across)
    confidence = np.array([contact.confidence_score for contact in recorder.contacts])
    variance = NORMAL_AT_HALF_CONFIDENCE**2 * (1.0 / np.clip(confidence, 0.01, 1.0) - 1.0)
    share = np.where(chords.any(axis=1), variance / (variance + PLANE**2), 0.0)
    return _unit(normals + share[:, None] * (wanted - normals))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _chords_of(recorder: Recorder, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chords (n, 3) and bends (n,) rad at the contacts with centres (n, 3) m, on the path of all touches."""
    times = [contact.time for contact in recorder.contacts] + [time for time, _ in recorder.passed]
    places = np.concatenate([centres, np.array([place for _, place in recorder.passed]).reshape(-1, 3)])
    order = np.argsort(times, kind="stable")
    here = np.empty(len(order), dtype=np.int64)
    here[order] = np.arange(len(order))
    path = np.array(times)[order], places[order]
    chords, bends = _chords(*path, REACHES[0])
    for reach in REACHES[1:]:
        short, bent = _chords(*path, reach)
        missing = ~chords.any(axis=1)
        chords[missing], bends[missing] = short[missing], bent[missing]
    return chords[here[: len(centres)]], bends[here[: len(centres)]]


def _chords(times: np.ndarray, centres: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) unit directions from a place before each centre to one behind it, zero where there are none; and the angle
    (n,) rad between the two halves of that way, which is `reach` m long to each side."""
    chords, bends = np.zeros_like(centres), np.zeros(len(centres))
    steps, pauses = np.linalg.norm(np.diff(centres, axis=0), axis=1), np.diff(times)
    ended = (pauses > GAP) & ((pauses > HOP) | (steps > NEAR))
    for run in np.split(np.arange(len(times)), np.flatnonzero(ended) + 1):
        if len(run) < 3:
            continue
        places = centres[run]
        travel = np.concatenate([[0.0], np.cumsum(steps[run[:-1]])])
        inside = np.flatnonzero((travel >= reach) & (travel <= travel[-1] - reach))
        ends = (travel[inside] + reach, travel[inside] - reach)
        behind, before = (np.column_stack([np.interp(end, travel, axis) for axis in places.T]) for end in ends)
        chord = behind - before
        length = np.linalg.norm(chord, axis=1)
        first, second = places[inside] - before, behind - places[inside]
        # Where the sphere stands, its noise travels and leads nowhere; nor does it where it is pressed in and let go.
        halves = np.minimum(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1))
        led = (length > reach) & (halves > LEADS * reach)
        chords[run[inside[led]]] = chord[led] / length[led, None]
        sines = np.linalg.norm(np.cross(first, second), axis=1)
        bends[run[inside]] = np.arctan2(sines, np.einsum("ni,ni->n", first, second))
    return chords, bends
