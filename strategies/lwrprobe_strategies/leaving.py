"""How a surface is left, or a place near one, before the way to the next line begins."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Observation
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.felt import believed
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.touched import Touched
from lwrprobe_strategies.way import HOVER, OFF, Pace, Waypoint

OWN_COLUMN = 0.9
"""Share of the way off a surface along the stick, from which on nothing can be met on it."""
UNDER = -0.05
"""Share of the normal along z, below which the sphere is under what it touches."""
FARTHEST_OUT = 0.04
"""m, of the way out from under an object."""
STRAIGHT = 0.002
"""m in height, within which a line has been driven straight from its beginning."""


def off(seen: Observation, normal: np.ndarray, retreat: float, touched: Touched) -> Waypoint | None:
    """A place off the surface touched, or from under the one last touched, from which the way up is free.

    `normal` (3,) is the surface's, `retreat` m the way off what is not believed to be one touch of the sphere.
    """
    here = seen.pose[:3, 3]
    flat = np.array([normal[0], normal[1], 0.0])
    size = float(np.sqrt(flat @ flat))
    if normal[Z] > UNDER and seen.contact is None:
        return None
    if normal[Z] > UNDER or size < 0.1:
        # Up along the stick the probe's own column is free.
        own_column = float(normal @ -seen.pose[:3, Z]) > OWN_COLUMN
        far = OFF if believed(seen) else retreat
        return Waypoint(here + far * normal, Pace.FREE if own_column else Pace.FEELING)
    # Under an object: out from under it, past all that has been touched on that side.
    out = flat / size
    past = float((touched.table()[:, :3] @ out).max(initial=-np.inf) - here @ out) + HOVER
    return Waypoint(here + min(max(past, retreat), FARTHEST_OUT) * out, Pace.FEELING)


def back(seen: Observation, line: Line) -> Waypoint | None:
    """From under what comes near, or from under the place where the line should have ended: the way it has come."""
    here = seen.pose[:3, 3]
    threatened = seen.clearance is not None and seen.clearance.threatens
    straight = abs(here[Z] - line.height) < STRAIGHT
    if not straight or not (threatened or line.instead is not None):
        return None
    begin = here.copy()
    begin[line.axis] = line.begin
    return Waypoint(begin)
