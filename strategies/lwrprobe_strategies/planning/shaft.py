"""Which stretches of a line are driven as if the stick could meet something, before anything is known to overhang.

Nobody knows what stands out above a line that is driven for the first time. A wall that goes straight up on one line
mostly does so on the next one.
"""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import THERE

PASSED = 0.005
"""m behind a wall that the line beside met, from which on it does not matter any more."""
BEHIND = 0.0015
"""m behind the place where the line beside met a wall, from which on this line is driven slowly: what stands out above
it is flush with that wall, or the wall recedes. The stick is met as far behind as it is thinner than the sphere."""


def stretch(line: Line, here: np.ndarray, memory: ContactMemory, beside: float) -> tuple[float, bool]:
    """m on the line's axis up to which it may be driven in one piece from a place (3,), and whether with care.

    `beside` m is the distance across the line, within which what was driven and touched matters.
    """
    reached = line.sign * float(here[line.axis])
    begin, end = _careful(line, memory, beside)
    if end < reached + THERE:
        return line.end, False
    if begin <= reached + THERE:
        return line.sign * min(end, line.sign * line.end), True
    return line.sign * min(begin, line.sign * line.end), False


def _careful(line: Line, memory: ContactMemory, beside: float) -> tuple[float, float]:
    """The stretch of the line, by the way along it, that is driven with care; empty where it ends before it begins."""
    touched, trail = memory.contacts(), memory.trail()
    touched = touched[np.abs(touched[:, line.aside] - line.place) < beside]
    if not len(touched) and not (np.abs(trail[:, line.aside] - line.place) < beside).any():
        return -np.inf, np.inf
    facing = touched[line.sign * touched[:, 6 + line.axis] < 0.0]
    if not len(facing):
        return np.inf, -np.inf
    wall = float((line.sign * facing[:, line.axis]).min()) + BEHIND
    return wall, wall + PASSED
