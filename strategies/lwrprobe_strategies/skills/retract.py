"""Retract: away from something along a direction."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.lines import UP, Z
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

COLUMN = 0.9
"""Share of a retraction along z, from which on the sphere follows the column of its stick."""


@skill(Overload, Blocked)
def retract(tip: Tip, frame: TrackingFrame, along: np.ndarray, distance: float) -> Procedure:
    """Move a distance [m] along a direction (3,) of any length; a zero vector means upwards.

    Returns
    -------
    Ended.RETRACTED, also where something blocks the path, or Ended.LINE_END where the line ends on the path
    """
    size = float(np.sqrt(along @ along))
    along = along / size if size > 1e-9 else UP
    left = distance
    speed = tip.control.column_speed if along[Z] > COLUMN else tip.control.approach_speed(along, tip.seen.pose[:3, :3])
    while True:
        yield VelocityCommand(along * min(speed, tip.stick_limit(along)), reason=retract.name)
        if float(tip.seen.force @ along) < -tip.task.force_threshold:
            return Ended.RETRACTED
        if frame.past_end(tip.here):
            return Ended.LINE_END
        left -= float(tip.seen.velocity @ along) * tip.period
        if left <= 0.0:
            return Ended.RETRACTED
