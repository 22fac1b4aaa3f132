"""Release: give way to an overlarge force (Rau 2017, section 5.3.3, `exploration()`)."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Ended, Jammed
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

RELEASED = 1.25
"""Times the wanted force, below which the force is released: what the force law corrects by itself."""

UPWARDS = 0.7
"""Share of the motion that leads up, from which on too little of it remains at the upper end of the area."""


@skill(Jammed)
def release(tip: Tip, frame: TrackingFrame) -> Procedure:
    """Move along the force until it is near the wanted one.

    Parameters
    ----------
    frame : of the contour; the motion stays in its area

    Returns
    -------
    Ended.RELEASED, Ended.SHAFT_CONTACT where it was the stick that a level contour has led against something,
    Ended.LINE_END where the line ends on the path, or Ended.CEILING where only a motion upwards out of the area would
    release the force
    """
    stick = False
    while True:
        stick |= frame.level and tip.stick_touches
        velocity = tip.control.release_velocity(tip.seen.force, tip.seen.pose[:3, :3])
        upwards = bool(velocity[Z] > UPWARDS * np.sqrt(velocity @ velocity))
        yield VelocityCommand(frame.bounded(tip.here, velocity), reason=release.name)
        if frame.past_end(tip.here):
            return Ended.LINE_END
        if np.sqrt(tip.seen.force @ tip.seen.force) <= RELEASED * tip.task.force_target:
            return Ended.SHAFT_CONTACT if stick else Ended.RELEASED
        if upwards and frame.at_ceiling(tip.here):
            return Ended.CEILING
