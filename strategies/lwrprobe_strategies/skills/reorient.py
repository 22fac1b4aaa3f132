"""Reorient: turn the probe about the sphere's centre (Rau 2017, section 5.3.3, figures 4.11 and 5.12)."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.paths import held
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip


@skill(Overload, Blocked)
def reorient(tip: Tip, frame: TrackingFrame, touching: bool) -> Procedure:
    """Turn to the wanted orientation, `tip.rotation`; while `touching`, the force law holds the contact.

    Returns
    -------
    Ended.TURNED while touching, else Ended.ARRIVED
    """
    while True:
        velocity = np.zeros(3)
        if touching:
            seen, control = tip.seen, tip.control
            normal = tip.normal()
            force = max(float(seen.force @ normal), 0.0)
            velocity = control.velocity(normal, force, frame.binormal, 0.0, seen.pose[:3, :3], tip.period)
        yield VelocityCommand(velocity, reason=reorient.name, pose=tip.turn())
        if held(tip.seen.pose, tip.rotation):
            return Ended.TURNED if touching else Ended.ARRIVED
