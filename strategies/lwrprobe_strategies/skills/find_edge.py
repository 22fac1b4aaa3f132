"""Find edge: slide over a surface in one direction until it bends away."""

from __future__ import annotations

from math import radians, sin

from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Jammed, Outcome, Overload
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.follow_and_regain import follow_and_regain
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

BEND = sin(radians(40.0))
"""Share of the normal along the motion, from which on the sphere rolls over an edge; smooth objects bend slowly."""


@skill(Overload, CollisionThreat, Blocked, Jammed)
def find_edge(tip: Tip, axis: int, sign: float, bend: float = BEND, distance: float = 0.02) -> Procedure:
    """Slide along a horizontal world axis, in contact, until the normal leans that way. A lost contact is sought.

    Parameters
    ----------
    axis : 0 along x, 1 along y
    sign : +1 or -1, of the motion
    bend : share of the normal along the motion that makes an edge
    distance : m of path, after which a lost contact is given up

    Returns
    -------
    Ended.EDGE with the edge touched, Ended.LINE_END at the area's border, Ended.TABLE, Ended.CEILING or
    Ended.NOTHING_FOUND
    """
    frame = TrackingFrame.through(tip.here, axis, sign, tip.task.area)

    def bends() -> Outcome | None:
        touches = tip.seen.contact is not None
        return Ended.EDGE if touches and float(tip.control.normal[axis]) * sign > bend else None

    return (yield from follow_and_regain(tip, frame, bends, distance))
