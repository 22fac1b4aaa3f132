"""Transit: through free space along a path."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt

import numpy as np

from lwrprobe.contracts import Goal
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.paths import SpeedLimit, Waypoint, direction, tip_pose
from lwrprobe_strategies.skills.guarded_move import slowed
from lwrprobe_strategies.skills.inner_edge import MAX_FRICTION
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

AT_REST = 0.1
"""s without motion at a goal, after which its place is reached: the gears may keep the tip off it for good."""
YIELDS = 0.7
"""Share of a path along the force, from which on it yields to that force."""


@skill(Overload, Blocked, seeks_contact=True)
def transit(tip: Tip, path: Sequence[Waypoint], rotation: np.ndarray | None = None) -> Procedure:
    """Go through the waypoints in turn, each on a straight, jerk-limited line.

    A contact that is being left when the transit begins does not end it, nor does its force on a path yielding to it.

    Parameters
    ----------
    path : where to go; with no waypoint the tip stays where it is
    rotation : (3, 3) in which the tip is held until a waypoint has another one, None = as wanted

    Returns
    -------
    Ended.ARRIVED, or Ended.CONTACT where something is touched on the path
    """
    rotation = tip.rotation if rotation is None else rotation
    if not path:
        yield Goal(tip.seen.pose, tip.task.free_speed, transit.name)
        return Ended.CONTACT if tip.touches else Ended.ARRIVED
    for waypoint in path:
        if waypoint.rotation is not None:
            rotation = waypoint.rotation
        speed = speed_to(tip, waypoint, rotation)
        goal = Goal(tip_pose(waypoint.place, rotation), speed, transit.name)
        rests = 0.0
        while True:
            if waypoint.speed_limit in (SpeedLimit.GUARDED, SpeedLimit.LEVEL):
                goal = slowed(goal, min(speed, tip.stick_limit(direction(tip.here, waypoint.place))))
            elif waypoint.speed_limit is SpeedLimit.COLUMN:
                # What still touches may stand out above, too, and friction on it keeps the sphere from giving way.
                along = direction(tip.here, waypoint.place)
                touching = tip.control.approach_speed(along, tip.seen.pose[:3, :3]) if tip.leaving else speed
                goal = slowed(goal, min(speed, touching))
            else:  # off a surface, where the probe has been, the path is not quite the one on which it came
                goal = slowed(goal, min(speed, tip.near_limit(direction(tip.here, waypoint.place))))
            if ends_in_contact(tip, waypoint):
                return Ended.CONTACT
            try:
                yield goal
            except Overload:
                if not yields(tip, waypoint):
                    raise
            rests = rests + tip.period if tip.seen.goal_reached else 0.0
            if waypoint.reached(tip.seen.pose) or rests >= AT_REST:
                break
        if ends_in_contact(tip, waypoint):
            return Ended.CONTACT
    return Ended.ARRIVED


def speed_to(tip: Tip, waypoint: Waypoint, rotation: np.ndarray) -> float:
    """m/s on the path to a waypoint, with the tip turning from how it is held to `rotation` (3, 3)."""
    along = direction(tip.here, waypoint.place)
    return min(tip.speeds(turn).at(waypoint.speed_limit, along) for turn in (tip.seen.pose[:3, :3], rotation))


def ends_in_contact(tip: Tip, waypoint: Waypoint) -> bool:
    """Whether something is touched on the path to a waypoint; it is the contact that is tracked from then on."""
    if meets(tip, waypoint):
        tip.leaving = False
    if tip.touches:
        tip.control.begin(tip.normal())
    return tip.touches


def meets(tip: Tip, waypoint: Waypoint) -> bool:
    """Whether the force on the path away from what is touched acts against the motion, by more than friction there.

    A turn in place has no direction that a force could act against.
    """
    if not tip.leaving or waypoint.is_at(tip.here):
        return False
    force = tip.seen.force
    against = -float(force @ direction(tip.here, waypoint.place))
    aside = float(force @ force) - against * against
    return against > tip.task.force_threshold + MAX_FRICTION * sqrt(max(aside, 0.0))


def yields(tip: Tip, waypoint: Waypoint) -> bool:
    """Whether the path leaves what is touched along the force: there is no better answer to it."""
    if not tip.leaving:
        return False
    motion, force = waypoint.place - tip.here, tip.seen.force
    return float(motion @ force) > YIELDS * hypot(*motion.tolist()) * hypot(*force.tolist())
