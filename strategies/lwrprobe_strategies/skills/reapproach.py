"""Re-approach: seek a lost contact (Rau 2017, section 4.2.5, phase 2, figure 4.9).

In the thesis the probe moves straight against the last force. Past an edge that line leads over the top without a
contact. Here the sphere rolls around the point touched last.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Jammed, Overload
from lwrprobe_strategies.planning.contour_end import at_table
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

ONWARD, INWARD = 0.7, 0.5
"""Shares of the motion along the tangent and against the normal: a spiral towards the point that surely closes."""


@skill(Overload, CollisionThreat, Blocked, Jammed, seeks_contact=True)
def reapproach(tip: Tip, frame: TrackingFrame, point: np.ndarray, distance: float) -> Procedure:
    """Roll around the point touched last until something is touched again.

    Parameters
    ----------
    frame : of the contour that was lost
    point : (3,) m, on the surface touched last
    distance : m of path, after which the contact is given up

    Returns
    -------
    Ended.CONTACT, Ended.LINE_END, Ended.TABLE at the area's floor, or Ended.NOTHING_FOUND
    """
    sought = 0.0
    while True:
        here, control = tip.here, tip.control
        around = rolling(here, point, control.normal)
        control.normal = around
        onward = ONWARD * np.array(control.tangent(frame.binormal)) - INWARD * around
        onward /= np.sqrt(onward @ onward)
        speed = min(
            control.return_speed(onward, tip.seen.pose[:3, :3]), tip.task.contour_speed, tip.stick_limit(onward)
        )
        try:
            yield VelocityCommand(frame.bounded(here, speed * onward), reason=reapproach.name)
        finally:
            tip.memory.passed(tip.here, frame.line.grid_x)
        if tip.seen.contact is not None:
            control.begin(tip.normal())
            return Ended.CONTACT
        if frame.past_end(tip.here):
            return Ended.LINE_END
        if at_table(control, frame, tip.here):
            return Ended.TABLE
        sought += float(np.sqrt(tip.seen.velocity @ tip.seen.velocity)) * tip.period
        if sought > distance:
            return Ended.NOTHING_FOUND


def rolling(centre: np.ndarray, point: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """(3,) unit normal of a sphere that rolls around a point: from the point to the sphere's centre."""
    arm = centre - point
    size = np.sqrt(arm @ arm)
    return arm / size if size > 1e-6 else fallback
