"""Which stretches of a line are driven as if the stick could meet something, before anything is known to overhang.

What stands out above a line is not known when that is driven for the first time. A wall that goes straight up on one
line mostly does so on the next one.
"""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.planning.contact_memory import NORMAL_X, ContactMemory
from lwrprobe_strategies.planning.free_space import SIDE
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.paths import THERE

PASSED = 0.005
"""m behind a wall that the line beside met, from which on it is no longer the same wall that is expected."""
UNEXPECTED = 2.2
"""Times the speed at which the stick may be met, where nothing has shown that it will be: at its stiff end a contact
then gives about 1.45 times the force limit, in its lower 60 % no more than the limit."""
ABOVE = 0.005
"""m above a line, from which on what the one beside it touched may stand out there."""
SHORT_OF = 0.008
"""m before the end of a line that met nothing, from which on the same line higher up is driven with care again: the
sphere is 3 mm wider than the stick."""
BEHIND = 0.0015
"""m behind the place where the line beside met a wall, from which on this line is driven slowly: what stands out above
it is flush with that wall, or the wall recedes. The stick is met as far behind as it is thinner than the sphere."""


def stretch(
    line: Line, here: np.ndarray, memory: ContactMemory, beside: float, before: float = 0.0
) -> tuple[float, float]:
    """m on the line's axis up to which it may be driven in one piece from a place (3,), and how fast at most.

    That is in times the speed at which the stick may be met: 1 where it may well be; `UNEXPECTED` where the line beside
    went over something, from `before` m in front of the wall that it met, and beyond that wall where no line has passed
    yet; inf where one passed and met nothing.
    `beside` m is the distance across the line, within which what was driven and touched matters.
    """
    reached = line.sign * float(here[line.axis])
    begin, end, far = _careful(line, memory, beside)
    last = line.sign * line.end
    for limit, times in ((begin - before, np.inf), (begin, UNEXPECTED), (end, 1.0), (far, UNEXPECTED)):
        if reached + THERE < limit:
            return line.sign * min(limit, last), times
    return line.end, np.inf


def stick_led_to(line: Line, below: Line, reached: float) -> float | None:
    """m on a leaning line's axis, up to which the stick has been when the same line was driven lower down.

    That line, `below`, met nothing and led to `reached` m; None where it was not the same one.
    """
    if line.rotation is None or line.rotation is not below.rotation or line.height < below.height:
        return None
    if (line.axis, line.place, line.sign) != (below.axis, below.place, below.sign):
        return None
    behind = (line.height - below.height) * line.rotation[:Z, Z] / line.rotation[Z, Z]  # m, the stick, up there
    beside = abs(float(behind[line.aside]))
    return reached + float(behind[line.axis]) - line.sign * SHORT_OF if beside < SIDE else None


def _careful(line: Line, memory: ContactMemory, beside: float) -> tuple[float, float, float]:
    """The stretch of the line, by the distance along it, that is driven with care.

    And where that ends beyond which the line beside was above this one, or has not been.
    """
    touched = memory.contacts()
    near = np.abs(touched[:, line.aside] - line.place) < beside
    along = line.sign * touched[near, line.axis]
    facing = line.sign * touched[near, NORMAL_X + line.axis] < 0.0
    begin, end = _not_passed(line, memory.trail(), beside)
    if not facing.any():
        return begin, end, -np.inf
    wall = float(along[facing].min()) + BEHIND
    far = float(along[touched[near, Z] > line.height + ABOVE].max(initial=-np.inf))
    return wall, wall + PASSED, max(far, end)


def _not_passed(line: Line, trail: np.ndarray, beside: float) -> tuple[float, float]:
    """The stretch of the line, by the distance along it, beside which the probe has not been; inf, -inf without one.

    A line beside it may have come from the other end, and no farther than to what it met there.
    """
    passed = line.sign * trail[np.abs(trail[:, line.aside] - line.place) < beside, line.axis]
    begin, end = line.sign * line.begin, line.sign * line.end
    passed = np.sort(passed[(passed > begin) & (passed < end)])
    if not len(passed):
        return -np.inf, np.inf
    places = np.concatenate([[begin], passed, [end]])
    gaps = np.flatnonzero(np.diff(places) > 2.0 * beside)
    return (float(places[gaps[0]]), float(places[gaps[-1] + 1])) if len(gaps) else (np.inf, -np.inf)
