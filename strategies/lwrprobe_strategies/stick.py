"""Where something has met the stick before the sphere: what stands out above a line."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.way import THERE

WARY = 0.012
"""m before a place where something has met the stick, from which on a line is driven slowly."""
PASSED = 0.005
"""m behind such a place, from which on it does not matter any more."""


@dataclass(slots=True)
class Stick:
    """The places where it was met, and how far a line may be driven before it may be met again.

    Attributes
    ----------
    beside : m across a line, within which such a place matters
    """

    beside: float
    _met: list[tuple[np.ndarray, float]] = field(default_factory=list)

    def meets(self, line: Line, here: np.ndarray) -> None:
        """Remember that on a line something has met it, the sphere being `here` (3,)."""
        self._met.append((here.copy(), line.sign))

    def piece(self, line: Line, here: np.ndarray) -> tuple[float, bool]:
        """m along the line's axis up to which it may be driven as one piece, and whether with care.

        What meets the stick near the sensor is met as hard as what meets the sphere along the stick.
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
