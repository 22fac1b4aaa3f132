"""Slide out: back along the probe's own path, past what it touches on both sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended
from lwrprobe_strategies.planning.paths import Waypoint, direction, held
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

PASSED = 0.001
"""m from a place of the path, within which it is passed: what is touched keeps the sphere beside it."""
STUCK, MOVED = 1.0, 3e-4
"""s, in which the tip has to come nearer to a place by so many metres."""


@skill(Blocked)
def slide_out(tip: Tip, frame: TrackingFrame, path: Sequence[Waypoint]) -> Procedure:
    """Go through the waypoints and give way to all that presses: a rigid path ends between two surfaces.

    What leads into the force is left out of the motion, and a force above the wanted one is released. It is as slow as
    a first touch, and the probe does not turn.

    Parameters
    ----------
    frame : the motion stays in its area
    path : where to go

    Returns
    -------
    Ended.ARRIVED, or Ended.CONTACT where the tip gets no farther, or would have to turn
    """
    for waypoint in path:
        if waypoint.rotation is not None and not held(tip.seen.pose, waypoint.rotation):
            return Ended.CONTACT
        nearest, rests = np.inf, 0.0
        while True:
            here, rotation, force = tip.here, tip.seen.pose[:3, :3], tip.seen.force
            left = float(np.linalg.norm(waypoint.place - here))
            if left < PASSED:
                break
            nearest, rests = (left, 0.0) if left < nearest - MOVED else (nearest, rests + tip.period)
            if rests > STUCK:
                return Ended.CONTACT
            along = direction(here, waypoint.place)
            velocity = tip.control.approach_speed(along, rotation) * given_way(along, force, tip.task.force_threshold)
            if float(force @ force) > tip.task.force_target**2:
                velocity = velocity + tip.control.release_velocity(force, rotation)
            tip.leave()
            yield VelocityCommand(frame.bounded(here, velocity), reason=slide_out.name)
    return Ended.ARRIVED


def given_way(along: np.ndarray, force: np.ndarray, least: float) -> np.ndarray:
    """(3,) what is left of a unit vector (3,) without its part into a force (3,) of at least `least` N."""
    size = float(np.sqrt(force @ force))
    if size < least:
        return along
    pressed = min(float(along @ force) / size, 0.0)
    return np.asarray(along - pressed * force / size)
