"""Retract: away from something along a direction."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip


@skill(Overload, Blocked)
def retract(tip: Tip, frame: TrackingFrame, along: np.ndarray, distance: float) -> Procedure:
    """Move a distance [m] along a direction (3,) of any length; a zero vector means upwards.

    Returns
    -------
    Ended.RETRACTED, or Ended.LINE_END where the line ends on the way
    """
    size = float(np.sqrt(along @ along))
    along = along / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
    left = distance
    while True:
        yield VelocityCommand(along * tip.task.approach_speed, reason=retract.name)
        if frame.past_end(tip.here):
            return Ended.LINE_END
        left -= float(tip.seen.velocity @ along) * tip.period
        if left <= 0.0:
            return Ended.RETRACTED
