"""Reorient: turn the probe about the sphere's centre (Rau 2017, section 5.3.3, figures 4.11 and 5.12)."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Doubt, VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.paths import held
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

PRESSED = 2
"""Samples in a row on which the stick touches, from which on the turn has led it against something: between that and
what the sphere touches the probe is wedged, and the force that is measured is the difference of both."""
AHEAD = 0.0015
"""rad by which the wanted orientation leads while the sphere touches, so that the turn is slow: when the stick meets
something, it goes on by that at most, 0.1 mm at the stick's end."""


@skill(Overload, Blocked)
def reorient(tip: Tip, frame: TrackingFrame, touching: bool) -> Procedure:
    """Turn to the wanted orientation, `tip.rotation`; while `touching`, the force law holds the contact.

    Returns
    -------
    Ended.TURNED while touching, else Ended.ARRIVED; Ended.SHAFT_CONTACT where the turn has led the stick against
    something
    """
    pressed = 0
    while True:
        velocity = np.zeros(3)
        if touching:
            seen, control = tip.seen, tip.control
            normal = tip.normal()
            force = max(float(seen.force @ normal), 0.0)
            velocity = control.velocity(normal, force, frame.binormal, 0.0, seen.pose[:3, :3], tip.period)
        yield VelocityCommand(velocity, reason=reorient.name, pose=tip.turn(AHEAD if touching else np.inf))
        contact = tip.seen.contact
        pressed = pressed + 1 if contact is not None and contact.reason is Doubt.AXIS_MISSES else 0
        if touching and pressed >= PRESSED:
            return Ended.SHAFT_CONTACT
        if held(tip.seen.pose, tip.rotation):
            return Ended.TURNED if touching else Ended.ARRIVED
