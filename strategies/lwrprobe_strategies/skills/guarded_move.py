"""Guarded move: straight on until something is touched (Rau 2017, section 4.2.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan

import numpy as np

from lwrprobe.contracts import Goal, VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Overload
from lwrprobe_strategies.planning.lines import AT_END
from lwrprobe_strategies.planning.paths import direction
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.skills.stick_doubt import StickDoubt
from lwrprobe_strategies.tip import Tip

ALIKE = 0.1
"""Share of a speed, below which a change is not worth a new plan."""
HELD_BACK = 5e-4
"""m, by which play and waves of its gears may keep the tip from a goal at which the motors rest."""
FACING = -0.3
"""Normal along the motion, below which what is being left blocks the path."""

Stretch = Callable[[np.ndarray], tuple[np.ndarray, float | None]]
"""From a place (3,) to how far the tip may go in one piece (3,), and at how many times the speed at which the stick may
be met; None where all of the probe is known to fit."""


@skill(Overload, CollisionThreat, Blocked, seeks_contact=True)
def guarded_move(
    tip: Tip,
    end: np.ndarray,
    ahead: np.ndarray | None = None,
    stretch: Stretch | None = None,
    grid_x: float = nan,
    rest: bool = False,
) -> Procedure:
    """Go straight to a place, no faster than a contact on the path allows.

    Parameters
    ----------
    end : (3,) m, where the motion ends without a contact
    ahead : (3,) unit, along which `end` lies and what is met blocks the path, None = from here to `end`
    stretch : how far to go in one piece, None = to the end; and how fast, see `Stretch`
    grid_x : m, of the grid line that is driven, for the memory
    rest : stand still for one sample first

    Returns
    -------
    Ended.CONTACT, Ended.SHAFT_CONTACT where the stick touches and not the sphere, or Ended.NO_CONTACT at the end
    """
    along = direction(tip.here, end)
    ahead = along if ahead is None else ahead
    ax, ay, az = ahead.tolist()
    last = float(end @ ahead) - AT_END
    goal: Goal | None = None
    fastest = 0.0
    times: float | None = inf
    doubt = StickDoubt(rest)
    while True:
        if not doubt.found and (goal is None or tip.seen.goal_reached):
            target, times = (end, inf) if stretch is None else stretch(tip.here)
            along = direction(tip.here, target)
            fastest = tip.known_speed if times is None else tip.control.approach_speed(along, tip.seen.pose[:3, :3])
            goal = Goal(tip.pose_at(target), min(fastest, _limit(tip, along, times)), guarded_move.name)
        elif goal is not None:
            goal = slowed(goal, min(fastest, _limit(tip, along, times)))
        try:
            if doubt.found or goal is None:
                yield VelocityCommand(doubt.velocity(tip, ahead), reason=guarded_move.name)
            else:
                yield goal
        finally:
            tip.memory.passed(tip.here, grid_x)
        if doubt.doubtful(tip):
            if doubt.decided(tip):
                return Ended.SHAFT_CONTACT
            continue
        if tip.touches or (tip.seen.contact is not None and float(tip.normal() @ ahead) < FACING):
            tip.control.begin(tip.normal())
            return Ended.CONTACT
        x, y, z = tip.here.tolist()
        short = last - (x * ax + y * ay + z * az)
        if short <= 0.0 or (tip.seen.goal_reached and short < HELD_BACK):
            return Ended.NO_CONTACT


def _limit(tip: Tip, ahead: np.ndarray, times: float | None) -> float:
    """m/s along a unit vector (3,), that what may be met there allows; `times` as in `Stretch`."""
    if times is None:
        return tip.near_limit(ahead)
    limit = tip.stick_limit(ahead)
    if times < inf:
        limit = min(limit, times * tip.control.stick_speed(tip.overhangs.reach(tip.here, ahead), ahead))
    return limit


def slowed(goal: Goal, speed: float) -> Goal:
    """The same goal at another speed [m/s]; the goal itself where the change is not worth a new plan."""
    return goal if abs(speed - goal.speed) < ALIKE * goal.speed else replace(goal, speed=speed)
