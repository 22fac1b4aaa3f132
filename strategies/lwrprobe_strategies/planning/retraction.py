"""How a surface is left, or a place near one, before the path to the next line begins."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Confidence, Observation
from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.paths import HOVER, OFF, Pace, Waypoint

OWN_COLUMN = 0.9
"""Share of the way off a surface along the stick, from which on the way is free: the probe itself fills it."""
UNDER = -0.05
"""Share of the normal along z, below which the sphere is under what it touches."""
SIDEWAYS = 0.1
"""Length of the normal's horizontal part, from which on it says where out from under an object is."""
MAX_OUT = 0.04
"""m, of the way out from under an object."""
STRAIGHT = 0.002
"""m in height, within which a line has been driven straight from its beginning."""


def off_surface(seen: Observation, normal: np.ndarray, distance: float, memory: ContactMemory) -> Waypoint | None:
    """A place off the surface touched, or out from under the one touched last, from which the way up is free.

    `normal` (3,) is the surface's; `distance` m is the way off a contact that is not reliable. None where nothing is
    touched and nothing lies above.
    """
    here = seen.pose[:3, 3]
    flat = np.array([normal[0], normal[1], 0.0])
    size = float(np.sqrt(flat @ flat))
    if normal[Z] > UNDER and seen.contact is None:
        return None
    if normal[Z] > UNDER or size < SIDEWAYS:
        own_column = float(normal @ -seen.pose[:3, Z]) > OWN_COLUMN
        reliable = seen.contact is not None and seen.contact.confidence is Confidence.RELIABLE
        return Waypoint(here + (OFF if reliable else distance) * normal, Pace.FREE if own_column else Pace.GUARDED)
    out = flat / size
    past = float((memory.contacts()[:, :3] @ out).max(initial=-np.inf) - here @ out) + HOVER
    return Waypoint(here + min(max(past, distance), MAX_OUT) * out, Pace.GUARDED)


def back_along(seen: Observation, line: Line) -> Waypoint | None:
    """The line's beginning, where a link has come near something or the line should have met something.

    None where the line has not been driven straight, or where nothing speaks against going up.
    """
    here = seen.pose[:3, 3]
    threatened = seen.clearance is not None and seen.clearance.threatens
    straight = abs(here[Z] - line.height) < STRAIGHT
    if not straight or not (threatened or line.fallback is not None):
        return None
    begin = here.copy()
    begin[line.axis] = line.begin
    return Waypoint(begin)
