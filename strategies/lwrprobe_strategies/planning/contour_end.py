"""Where a contour has nothing more to give: at an end of the object, at the table, under an edge, on the return."""

from __future__ import annotations

import numpy as np

from lwrprobe.control import ContourControl
from lwrprobe_strategies.planning.lines import X, Z
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame

UNDERSIDE = -0.6
"""Share of the normal along z, below which a descending contour ends: the stick touches at -0.9."""
DOWNWARDS = -0.2
"""Share of the tangent along z, below which a contour that has come to such a normal has come down: the tangent of one
that is met from below, on the way up a wall, is level at first, and leads out from under that and up again."""
PAST_END = 0.03
"""Share of the normal across the line, from which on the end of the object counts as passed."""
TURNED_BACK = -0.5
"""Share of the tangent towards the next line, below which a level contour leads away from it again."""


def past_end(control: ContourControl, frame: TrackingFrame, here: np.ndarray, beside: float) -> bool:
    """Past the place where the normal points along the line; or more than `beside` m around, too far for an end."""
    line, normal = frame.line, control.normal
    gone = (here[line.aside] - line.place) * line.outline
    return bool(normal[line.aside] * line.outline > PAST_END or gone > beside)


def turned_back(control: ContourControl, frame: TrackingFrame, onward: float) -> bool:
    """Around the object's end, and now away from the next line again, which lies along x in the sense `onward`."""
    return control.tangent(frame.binormal)[X] * onward < TURNED_BACK


def at_table(control: ContourControl, frame: TrackingFrame, here: np.ndarray) -> bool:
    """As low as the tip may be, at a place (3,), and further down."""
    return frame.at_floor(here) and control.tangent(frame.binormal)[Z] < 0.0


def under(control: ContourControl, frame: TrackingFrame) -> bool:
    """Whether an upright probe has come down around a lower edge: its stick is about to touch what is above."""
    return not control.normal[Z] > UNDERSIDE and control.tangent(frame.binormal)[Z] < DOWNWARDS
