"""What the tip has met on a line: questions about where it is and what it touches, and no motion."""

from __future__ import annotations

from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.retraction import UNDER
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import along_stick, follow_contour, guarded_move, transit
from lwrprobe_strategies.tip import Tip

NEAR_SIDE = -0.3
"""Share of the normal along the line, below which the line leads into the object."""
BESIDE_LINE = 0.002
"""m across a line, from which on what is touched is not on it."""
ABOVE_FOOT = 0.002
"""m above the area's floor, from which on a wall is taken for one that goes on below."""


def on_near_side(tip: Tip, line: Line) -> bool:
    """Whether what is followed is the near side of something, into which the line leads."""
    return bool(tip.control.normal @ line.ahead < NEAR_SIDE)


def on_far_side(tip: Tip, line: Line) -> bool:
    """Whether what is followed is the far side of what the line has come over."""
    return bool(tip.control.normal @ line.ahead >= -NEAR_SIDE)


def beside_line(tip: Tip, line: Line) -> bool:
    """Whether what is touched on the path to the line's beginning stands beside the line, or behind its end."""
    off = max(abs(float(tip.here[line.aside]) - line.place), line.sign * (float(tip.here[line.axis]) - line.end))
    return tip.trace.ended is transit and off > BESIDE_LINE


def above_foot(tip: Tip, frame: TrackingFrame) -> bool:
    """Whether a line that had to be raised, or leads up a side, has met a wall above its foot.

    There the sphere goes in under what the stick met or may meet, as far as both fit.
    """
    line = frame.line
    wall = tip.trace.ended is guarded_move and not frame.level and on_near_side(tip, line)
    return (line.raised or line.low) and wall and bool(tip.here[Z] > tip.task.area.lower[Z] + ABOVE_FOOT)


def led_in_under(tip: Tip, frame: TrackingFrame) -> bool:
    """Whether the line has led in under what stands ahead, so that the stick comes near that."""
    interrupted, normal = tip.trace.ended, tip.control.normal
    if interrupted is follow_contour and not frame.level:
        return bool(normal @ frame.line.ahead < 0.0 and normal[Z] < UNDER)
    return interrupted is guarded_move


def shows_stiffness(tip: Tip) -> bool:
    """Whether a press shows for the first time how stiff the arm is."""
    return not tip.pressed and tip.reliable and along_stick(tip, tip.normal())
