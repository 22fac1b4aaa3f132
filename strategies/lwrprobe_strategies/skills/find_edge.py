"""Find edge: slide over a surface in one direction until it bends away."""

from __future__ import annotations

from math import radians, sin

from lwrprobe.contracts import Confidence
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Jammed, Overload
from lwrprobe_strategies.planning.lines import Line, X, Y
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.follow_contour import leaves_upwards, slide
from lwrprobe_strategies.skills.reapproach import reapproach
from lwrprobe_strategies.skills.release import release
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
    distance : m of way, after which a lost contact is given up

    Returns
    -------
    Ended.EDGE with the edge touched, Ended.LINE_END at the area's border, Ended.TABLE, Ended.CEILING or
    Ended.NOTHING_FOUND
    """
    area = tip.task.area
    end = float((area.upper if sign > 0.0 else area.lower)[axis])
    line = Line(axis, float(tip.here[Y if axis == X else X]), float(tip.here[axis]), end, float(tip.here[2]))
    frame = TrackingFrame(line, area)
    while True:
        normal, contact = tip.normal(), tip.seen.contact
        if contact is not None and contact.confidence is not Confidence.NONE:
            tip.memory.add(tip.here, contact.point, contact.normal, frame.grid_x)
        point = tip.here - tip.task.probe.radius * normal
        try:
            motion = slide(tip, frame, normal, find_edge.name)
            yield motion
        except Overload:
            released = yield from release(tip, frame)
            if released is not Ended.RELEASED:
                return released
            continue
        if frame.past_end(tip.here):
            return Ended.LINE_END
        if leaves_upwards(tip, frame, motion):
            return Ended.CEILING
        if tip.seen.contact is None:
            sought = yield from reapproach(tip, frame, point, distance)
            if sought is not Ended.CONTACT:
                return sought
        if float(tip.control.normal[axis]) * sign > bend:
            return Ended.EDGE
