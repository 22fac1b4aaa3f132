"""How a surface is left, or a place near one, before the path to the next line begins."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Confidence, Observation
from lwrprobe_strategies.planning.free_space import FreeSpace
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.planning.paths import HELD, OFF, SpeedLimit, Waypoint

OWN_COLUMN = 0.9
"""Share of the path off a surface along the stick, from which on it is in the column of the stick."""
FLANK = 0.4
"""Share of the normal across z, from which on what is above stands beside the stick and not over it."""
PAST = 0.001
"""m between the sphere and what it passes."""
UNDER = -0.05
"""Share of the normal along z, below which the sphere is under what it touches."""


def off_surface(seen: Observation, normal: np.ndarray, distance: float, column_is_free: bool) -> list[Waypoint]:
    """A place off the surface touched, from which an upright probe may go up.

    `normal` (3,) is the surface's; `distance` m is the path off a contact that is not reliable: where its normal is
    nearly along the stick straight along that, for the sphere may meet what stands beside it. Along the stick the
    sphere, which is wider, may have come in under a ledge, unless its `column_is_free`.
    """
    if seen.contact is None:
        return []
    here, back = seen.pose[:3, 3], -seen.pose[:3, Z]
    own_column = float(normal @ back) > OWN_COLUMN
    if seen.contact.confidence is Confidence.RELIABLE:
        if not own_column:
            return [Waypoint(here + OFF * normal, SpeedLimit.GUARDED)]
        return [Waypoint(here + OFF * normal, SpeedLimit.FREE if column_is_free else SpeedLimit.COLUMN)]
    if own_column:
        return [Waypoint(here + distance * back, SpeedLimit.COLUMN)]
    return [Waypoint(here + distance * normal, SpeedLimit.GUARDED)]


def return_path(free: FreeSpace, distance: float = np.inf, wedged: bool = False) -> list[Waypoint]:
    """Back on the probe's path: for `distance` m, or to where the path up is free; `wedged` between two surfaces."""
    return [Waypoint(place, rotation=turn) for place, turn in free.return_path(distance, wedged) or []]


def out_from_under(seen: Observation, normal: np.ndarray, radius: float) -> list[Waypoint]:
    """Sideways to where the sphere, of `radius` m, may pass what it touches with its upper flank on the way up.

    No waypoint where it touches nothing above its middle, or is right under that. `normal` (3,) is the surface's.
    """
    side = float(np.hypot(normal[0], normal[1]))
    if seen.contact is None or normal[Z] > UNDER or side < FLANK:
        return []
    out = np.array([normal[0] / side, normal[1] / side, 0.0])
    return [Waypoint(seen.pose[:3, 3] + (radius * (1.0 - side) + PAST) * out, SpeedLimit.GUARDED)]


def goes_up(seen: Observation, normal: np.ndarray, upright: np.ndarray) -> bool:
    """Whether the path up from here may be taken: an upright probe that is under nothing and comes near nothing.

    `normal` (3,) of the surface followed last, `upright` (3, 3).
    """
    held = bool(np.vdot(upright, seen.pose[:3, :3]) > HELD)
    touched = seen.contact is not None and seen.contact.confidence <= Confidence.DOUBTFUL
    threatened = seen.clearance is not None and seen.clearance.threatens
    return held and not touched and not threatened and bool(normal[Z] > UNDER)
