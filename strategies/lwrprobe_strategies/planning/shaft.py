"""Where a line may meet something with the stick before the sphere, and is driven with care.

Nobody knows what stands out above a line that is driven for the first time. What stands out on one line mostly does so
on the next one, and a wall that goes straight up on one line mostly does so on the next one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lwrprobe_strategies.planning.contact_memory import ContactMemory
from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import THERE

WARY = 0.012
"""m before a place where the stick was touched, from which on a line is driven slowly: braking, and a line's slant."""
PASSED = 0.005
"""m behind a wall that the line beside met, from which on it does not matter any more."""
BEHIND = 0.0015
"""m behind the place where the line beside met a wall, from which on this line is driven slowly: what stands out above
it is flush with that wall, or the wall recedes. The stick is met as far behind as it is thinner than the sphere."""
OVERHANG = -0.15
"""Share of the normal along z, below which a touch is one of something that stands out (9 degrees)."""

WITNESSES = 4
"""Touches that are one too few: half a millimetre apart, a few of them lean by noise alone."""

Interval = tuple[float, float]


@dataclass(slots=True)
class ShaftMemory:
    """Where the stick was touched, and how far a line may be driven before that may happen again.

    Attributes
    ----------
    beside : m across a line, within which such a place matters
    """

    beside: float
    _met: list[tuple[np.ndarray, float]] = field(default_factory=list)

    def add(self, line: Line, here: np.ndarray) -> None:
        """Remember that something touched the stick on a line, the sphere being at `here` (3,)."""
        self._met.append((here.copy(), line.sign))

    def stretch(self, line: Line, here: np.ndarray, memory: ContactMemory) -> tuple[float, bool]:
        """m on the line's axis up to which it may be driven in one piece, and whether with care.

        Near the sensor the stick is as stiff across as it is along its axis.
        """
        way = line.sign * float(here[line.axis])
        length = line.sign * line.end
        for begin, end in sorted(self._careful(line, memory)):
            if end < way + THERE:
                continue
            if begin <= way + THERE:
                return line.sign * min(end, length), True
            return line.sign * min(begin, length), False
        return line.end, False

    def _careful(self, line: Line, memory: ContactMemory) -> list[Interval]:
        """Stretches of the line, by the way along it, that are driven with care; they may overlap."""
        met = [(at, sign) for at, sign in self._met if abs(at[line.aside] - line.place) < self.beside]
        touched, trail = memory.contacts(), memory.trail()
        touched = touched[np.abs(touched[:, line.aside] - line.place) < self.beside]
        ways = line.sign * touched[:, line.axis]
        if not len(touched) and (met or not (np.abs(trail[:, line.aside] - line.place) < self.beside).any()):
            return [(-np.inf, np.inf)]
        facing = line.sign * touched[:, 6 + line.axis] < 0.0
        stands_out = np.sort(ways[facing & (touched[:, 8] < OVERHANG)])[WITNESSES:].tolist()
        stands_out += [line.sign * float(at[line.axis]) for at, sign in met if sign == line.sign]
        if met and not stands_out:  # what stands out on one side may do so on the other
            stands_out = [float(ways.min())]
        if stands_out:
            # From there on until the sphere touches: an outline that recedes is met anywhere behind.
            return [(min(stands_out) - WARY, max(*stands_out, float(ways.max(initial=-np.inf))) + WARY)]
        if not facing.any():
            return []
        wall = float(ways[facing].min()) + BEHIND
        return [(wall, wall + PASSED)]
