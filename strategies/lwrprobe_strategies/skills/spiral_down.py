"""Spiral down: on a helix about an upright axis, until something is touched."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin

import numpy as np

from lwrprobe.contracts import VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, Ended, Overload
from lwrprobe_strategies.planning.lines import AT_END, X, Y, Z
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.skills.stick_doubt import StickDoubt
from lwrprobe_strategies.tip import Tip

GAIN = 5.0
"""1/s, of the return to the helix."""
MAX_RETURN = 0.2
"""Share of the speed that the return may take."""
SOFT_HALF = 0.5
"""Share of the stick, from the sphere on, in which it bends more than the arm."""
MAX_TURNS = 12


@skill(Overload, Blocked, seeks_contact=True)
def spiral_down(tip: Tip, axis: tuple[float, float], bottom: float, above: float = 0.0) -> Procedure:
    """Circle about an axis and sink, from where the tip is; then once around at the lowest height.

    The stick goes where the sphere was a turn before, so it meets nothing higher than the pitch above the sphere. The
    pitch is the one with which the descent takes least.

    Parameters
    ----------
    axis : x and y, m
    bottom : m, lowest height of the sphere's centre
    above : m above the sphere's centre, up to which something may be where the tip begins

    Returns
    -------
    Ended.CONTACT, Ended.SHAFT_CONTACT where the stick touches and not the sphere, or Ended.NO_CONTACT at the bottom
    """
    radius = hypot(tip.here[X] - axis[X], tip.here[Y] - axis[Y])
    pitch = best_pitch(tip, radius, float(tip.here[Z]) - bottom)
    doubt, turned = StickDoubt(), 0.0
    while True:
        here = tip.here
        angle = atan2(here[Y] - axis[Y], here[X] - axis[X])
        level = float(here[Z]) <= bottom + AT_END  # a level plan may rest that far above
        along = direction(radius, 0.0 if level else pitch, angle)
        speed = min(turn_speed(tip, along, max(pitch, above)), tip.stick_limit(along))
        back = GAIN * (radius - hypot(here[X] - axis[X], here[Y] - axis[Y]))
        back = min(max(back, -MAX_RETURN * speed), MAX_RETURN * speed)
        outward = np.array([cos(angle), sin(angle), 0.0])
        velocity = doubt.velocity(tip, along) if doubt.found else speed * along + back * outward
        yield VelocityCommand(velocity, reason=spiral_down.name)
        tip.memory.passed(tip.here, np.nan)
        if doubt.doubtful(tip):
            if doubt.decided(tip):
                return Ended.SHAFT_CONTACT
            continue
        if tip.touches:
            tip.control.begin(tip.normal())
            return Ended.CONTACT
        if level:
            turned += abs(
                float(np.remainder(atan2(tip.here[Y] - axis[Y], tip.here[X] - axis[X]) - angle + pi, 2 * pi) - pi)
            )
            if turned >= 2.0 * pi:
                return Ended.NO_CONTACT


def direction(radius: float, pitch: float, angle: float) -> np.ndarray:
    """(3,) unit, along a helix of a radius and a pitch [m] that leads down, at an angle [rad] about its axis."""
    around = 2.0 * pi * radius
    length = hypot(around, pitch)
    return np.array([-sin(angle) * around, cos(angle) * around, -pitch]) / length


def turn_speed(tip: Tip, along: np.ndarray, pitch: float) -> float:
    """m/s along a unit vector (3,), at which neither sphere nor stick presses too much."""
    reach = max(pitch - tip.task.probe.radius, 0.0)
    soft = reach <= SOFT_HALF * tip.task.probe.sensor_distance
    stick = tip.control.stick_speed(reach, share=1.0) if soft else tip.control.stick_speed(reach)
    return min(tip.control.approach_speed(along, tip.seen.pose[:3, :3]), stick)


def best_pitch(tip: Tip, radius: float, depth: float) -> float:
    """m, of the helix that leads a depth [m] down in the shortest time."""

    def seconds(turns: int) -> float:
        pitch = depth / turns
        return turns * hypot(2.0 * pi * radius, pitch) / turn_speed(tip, direction(radius, pitch, 0.0), pitch)

    return max(depth, 1e-6) / min(range(1, MAX_TURNS + 1), key=seconds) if depth > 0.0 else 0.0
