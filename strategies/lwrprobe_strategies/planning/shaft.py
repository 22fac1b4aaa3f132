"""Places where the stick was touched before the sphere: something stands out above the line there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lwrprobe_strategies.planning.lines import Line
from lwrprobe_strategies.planning.paths import THERE

WARY = 0.012
"""m before a place where the stick was touched, from which on a line is driven slowly: braking, and a line's slant."""
PASSED = 0.005
"""m behind such a place, from which on it does not matter any more."""


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

    def stretch(self, line: Line, here: np.ndarray) -> tuple[float, bool]:
        """m on the line's axis up to which it may be driven in one piece, and whether with care.

        Near the sensor the stick is as stiff across as it is along its axis.
        """
        way = self._ahead(line, here)
        if way is None:
            return line.end, False
        careful = way <= WARY + THERE
        end = float(here[line.axis]) + line.sign * (way + 2.0 * PASSED if careful else way - WARY)
        return min(end * line.sign, line.end * line.sign) * line.sign, careful

    def _ahead(self, line: Line, here: np.ndarray) -> float | None:
        """m along the line to the next such place; None where there is none.

        What stands out on one side may do so on the other: a line that comes from there may meet it anywhere.
        """
        beside = [(at, sign) for at, sign in self._met if abs(at[line.aside] - line.place) < self.beside]
        ways = [float(at[line.axis] - here[line.axis]) * line.sign for at, sign in beside if sign == line.sign]
        if beside and not ways:
            return 0.0
        return min((way for way in ways if way > -PASSED), default=None)
