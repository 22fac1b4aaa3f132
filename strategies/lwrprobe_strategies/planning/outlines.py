"""Lines that find the object's ends in x, where the outermost contact shows that the end lies beside it."""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.planning.contact_memory import NORMAL_X, NORMAL_Y, NORMAL_Z, POINT_X
from lwrprobe_strategies.planning.lines import Line, X, Y, Z

BELOW = 0.003
"""m below the height of a line, down to which an outermost touch may lie and be sought at that height instead."""
FACING = 0.5
"""Share of the normal along x, from which on a touch is one of an end in x."""
UPWARD = 0.3
"""Share of the normal along z, up to which a touch is one of a wall."""
WIDENS = 0.05
"""Share of the normal along z, from which on an object is wider below."""
BEYOND = 0.002
"""m by which a line leads on past where the outermost touch was: a contact is known to a fraction of that."""
BENT = 0.06
"""Share of the normal across x, from which on an end in x is not yet the object's end (3.4 degrees)."""


def outlines(contacts: np.ndarray, places: np.ndarray, height: float) -> list[Line]:
    """Lines that find the object's ends in x, where the outermost touch says that the end lies beside it.

    Each touches the object where it reached furthest and follows it around, in the horizontal plane, to where the
    normal points along x.
    """
    lines: list[Line] = []
    for sign in (1.0, -1.0):
        facing = contacts[sign * contacts[:, NORMAL_X] > FACING]
        if not len(facing):
            continue
        # An upper edge is touched as far out as the wall under it, but beside it the probe would pass over the top.
        walls = facing[np.abs(facing[:, NORMAL_Z]) < UPWARD]
        facing = walls if len(walls) else facing
        last = facing[np.argmax(sign * facing[:, POINT_X])]
        free = places[sign * places > sign * last[X] + 1e-3]
        across = last[NORMAL_Y] / max(float(np.hypot(last[NORMAL_X], last[NORMAL_Y])), 1e-9)
        if abs(across) < BENT or not len(free) or last[Z] < height - BELOW:
            continue
        begin = float(free[np.argmin(sign * free)])
        # What faces up there reaches further out below.
        level = height if last[NORMAL_Z] > WIDENS else max(float(last[Z]), height)
        end = float(last[X]) - sign * BEYOND
        lines.append(Line(X, float(last[Y]), begin, end, level, outline=-1 if across > 0.0 else 1))
    return lines
