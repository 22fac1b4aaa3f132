"""A force loop over the simulated world: three straight axes, a probe pointing down, and a delay that is exact."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.bench.gantry import build_world
from lwrprobe.control import ForceLaw

TOP = 0.055
"""m, height of the sphere's centre over the block's top."""
UPRIGHT = np.diag([1.0, -1.0, -1.0])
"""(3, 3) of the tip in the world."""


@dataclass(slots=True)
class Response:
    """What a touch did.

    Attributes
    ----------
    peak_approach : N, until the tip stood still for the first time
    peak : N, ever
    rest : N, mean of the last quarter of the hold; swing : N, largest less smallest there
    depths, forces : m and N, of the approach from the first reading above the threshold's twentieth on
    """

    peak_approach: float
    peak: float
    rest: float
    swing: float
    depths: list[float] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)


def press(
    law: ForceLaw, delay: float, threshold: float, braking: float, settings: list[str], *, cycle: float = 1e-4
) -> Response:
    """Approach the block's top at the law's speed, brake at the threshold, then hold the target force by the law.

    The loop sees each force `delay` [s] late, to the cycle. `settings` are the scene's.
    """
    world = build_world(settings, cycle=cycle, noise_force=0.0)
    gap = 2e-4
    height = TOP + gap
    world.place(np.array([0.0, 0.0, height]))
    delayed: deque[float] = deque([0.0] * (round(delay / cycle) + 1))
    speed, touched, response = law.approach_speed, False, Response(0.0, 0.0, 0.0, 0.0)
    held: list[float] = []
    hold_steps = round(max(15.0 * law.damping / law.stiffness, 20.0 * delay, 0.02) / cycle)
    slowest = (gap + 2.0 * law.force_limit / law.stiffness) / law.approach_speed + law.approach_speed / braking + delay
    steps_left = round(3.0 * slowest / cycle) + 100
    while steps_left > 0 and len(held) < hold_steps:
        seen = delayed.popleft()
        if not touched:
            touched = seen >= threshold
        elif speed > 0.0:
            speed = max(0.0, speed - braking * cycle)
        if speed > 0.0:
            height -= speed * cycle
            steps_left -= 1
        else:
            height += law.normal_velocity(seen) * cycle
        world.command(np.array([0.0, 0.0, height]))
        world.advance()
        force = -float(world.wrench[2])
        delayed.append(force)
        response.peak = max(response.peak, force)
        if speed > 0.0:
            response.peak_approach = response.peak
            if force > 0.05 * threshold:
                response.depths.append(TOP - height)
                response.forces.append(force)
        else:
            held.append(force)
    last = np.array(held[-len(held) // 4 :] if held else [np.nan])
    response.rest, response.swing = float(last.mean()), float(np.ptp(last))
    return response
