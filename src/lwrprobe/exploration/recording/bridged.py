"""Where the sphere touched on two sides at once: between those touches lies what it is too large for.

A sphere in a slot narrower than itself rests on both rims, in an inner edge on both walls. Its centre hardly moves
while the contact leaps across; nothing is known of what lies between, and no surface is claimed there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.exploration.recording.groups import groups

LEAP = 0.003
"""m, from one contact to the next, from which on something was passed over."""
STILL = 0.25
"""Share of the leap by which the centre may have moved: on a surface with twice the sphere's radius that is a half."""
AT_ONCE = 1.5
"""s between the two touches: a probe between two walls needs a moment to leave."""
BEFORE = 0.0015
"""m of the centre's path before a leap, on which an edge shows: the sphere pivots about it, and the contact stays."""
PIVOT = 0.5
"""Share of that path by which the contact on an edge moves at most."""


@dataclass(slots=True, frozen=True)
class Bridged:
    """A zone that the sphere bridged.

    Attributes
    ----------
    kind : `gap` between two rims, `inner edge` between two walls
    width : m, between the two touches, the largest one of the zone
    lower, upper : (3,) m, the box around the middles of its leaps
    leaps : how often it was passed over
    """

    kind: str
    width: float
    lower: np.ndarray
    upper: np.ndarray
    leaps: int

    def as_dict(self) -> dict[str, object]:
        """Millimetres."""
        box = [[round(1e3 * float(v), 2) for v in corner] for corner in (self.lower, self.upper)]
        return {"kind": self.kind, "width_mm": round(1e3 * self.width, 2), "box_mm": box, "leaps": self.leaps}


def bridged(points: np.ndarray, normals: np.ndarray, times: np.ndarray, radius: float, pitch: float) -> list[Bridged]:
    """Zones that a sphere of `radius` m passed over, the widest first.

    Parameters
    ----------
    points, normals : (n, 3) m and unit, of the contacts in the order they were made
    times : (n,) s
    pitch : m, between two lines; leaps that are no farther apart belong to one zone
    """
    if len(points) < 2:
        return []
    centres = points + radius * normals
    step, moved = np.diff(points, axis=0), np.linalg.norm(np.diff(centres, axis=0), axis=1)
    leap = np.linalg.norm(step, axis=1)
    # In front of the surface just left: behind it lies the other side of a convex edge.
    inward = np.einsum("ij,ij->i", step, normals[:-1]) > 0.0
    found = np.flatnonzero((leap > LEAP) & (moved < STILL * leap) & (np.diff(times) < AT_ONCE) & inward)
    classified = [_classified(points, centres, int(i)) for i in found]
    kinds, widths = [kind for kind, _ in classified], np.array([width for _, width in classified])
    middles = 0.5 * (points[found] + points[found + 1])
    zones = []
    for kind in sorted(set(kinds)):
        own = np.flatnonzero([k == kind for k in kinds])
        for group in groups(middles[own], 1.3 * pitch):
            members = own[group]
            box = middles[members]
            zones.append(Bridged(kind, float(widths[members].max()), box.min(axis=0), box.max(axis=0), len(members)))
    return sorted(zones, key=lambda zone: -zone.width)


def _classified(points: np.ndarray, centres: np.ndarray, i: int) -> tuple[str, float]:
    """What was passed over between contacts i and i + 1, and how wide it is, m.

    A gap where the contact stood still on an edge before the leap or after it: on a wall it moves with the centre.
    Between the rims two contacts at once may be taken for one in the middle: those a moment away tell the width.
    """
    pivots, ends = False, []
    for at, step in ((i, -1), (i + 1, 1)):
        k = at
        while 0 <= k + step < len(points) and np.linalg.norm(centres[k] - centres[at]) < BEFORE:
            k += step
        path, moved = np.linalg.norm(centres[k] - centres[at]), np.linalg.norm(points[k] - points[at])
        pivots = pivots or bool(BEFORE <= path < 3.0 * BEFORE and moved < PIVOT * path)
        ends.append(points[k])
    if not pivots:
        return "inner edge", float(np.linalg.norm(points[i + 1] - points[i]))
    return "gap", float(np.linalg.norm(ends[1] - ends[0]))
