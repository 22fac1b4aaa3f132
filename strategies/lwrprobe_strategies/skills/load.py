"""Approach, load and unload: press on a surface along a direction with a growing force, and let go again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lwrprobe.contracts import Goal, VelocityCommand
from lwrprobe.control import normal_velocity
from lwrprobe_strategies.outcomes import Blocked, Ended
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.tip import Tip

HOLD = 0.03
"""s without a sample, after which a press stands still."""
MAX_TIME = 3.0
"""s that a load may take; a surface that yields that far is none."""
FREE = 0.1
"""N, below which nothing is pressed any more."""
MIN_PATH = 2e-5
"""m of a load on a surface that does not yield."""


@skill(Blocked)
def rest(tip: Tip, seconds: float) -> Procedure:
    """Stand still in free space; the run follows the sensor's zero meanwhile, as on every path to a goal.

    Returns
    -------
    Ended.ARRIVED
    """
    held = Goal(tip.seen.pose.copy(), tip.task.free_speed, rest.name)
    for _ in _until(tip, seconds):
        yield held
    return Ended.ARRIVED


@skill(Blocked, seeks_contact=True)
def approach(tip: Tip, normal: np.ndarray, distance: float, speed_share: float = 1.0) -> Procedure:
    """Go against a normal (3,) for a distance [m], as slowly as a contact demands; stand still while no sample comes.

    `speed_share` is that of the approach speed which is used.

    Returns
    -------
    Ended.CONTACT, or Ended.NO_CONTACT at the end
    """
    begin = tip.here.copy()
    speed = speed_share * tip.control.approach_speed(normal, tip.seen.pose[:3, :3])
    while float((begin - tip.here) @ normal) < distance:
        if tip.touches:
            return Ended.CONTACT
        yield VelocityCommand(-normal * speed, hold=HOLD, reason=approach.name)
    return Ended.NO_CONTACT


@skill(Blocked, seeks_contact=True)
def load(tip: Tip, normal: np.ndarray, force: float, seconds: float, speed_share: float = 1.0) -> Procedure:
    """Raise the force along a normal (3,), out of the surface, to `force` [N] within about `seconds`.

    The target of the force law grows evenly. `speed_share` is that of the approach speed which is used at most.

    Returns
    -------
    Ended.CONTACT with the force reached, or Ended.NO_CONTACT where it was not reached in time
    """
    damping = tip.control.damping(normal, tip.seen.pose[:3, :3])
    inward = speed_share * tip.control.approach_speed(normal, tip.seen.pose[:3, :3])
    first = float(tip.seen.force @ normal)
    for elapsed in _until(tip, MAX_TIME):
        now = float(tip.seen.force @ normal)
        if now >= force:
            return Ended.CONTACT
        target = first + (force - first) * (elapsed / seconds + 0.2)
        speed = normal_velocity(now - target, damping, 0.0, inward, 0.0)
        yield VelocityCommand(normal * speed, hold=HOLD, reason=load.name)
    return Ended.NO_CONTACT


@skill(Blocked, seeks_contact=True)
def unload(tip: Tip, normal: np.ndarray, distance: float, seconds: float) -> Procedure:
    """Move out along a normal (3,) at the speed that takes back a load over a distance [m] within `seconds`.

    Returns
    -------
    Ended.RELEASED
    """
    speed = max(distance, MIN_PATH) / seconds
    for _ in _until(tip, MAX_TIME):
        if float(tip.seen.force @ normal) < FREE:
            break
        yield VelocityCommand(normal * speed, hold=HOLD, reason=unload.name)
    return Ended.RELEASED


def _until(tip: Tip, seconds: float) -> Iterator[float]:
    """s since the first call, as long as they are below `seconds`."""
    begin = tip.seen.time
    while (elapsed := tip.seen.time - begin) < seconds:
        yield elapsed
