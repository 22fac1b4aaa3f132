"""Options of the strategies that cover an area by lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError

LEAST = 0.0002
"""m: finer than that nothing is touched, and a line would take for ever."""


@dataclass(slots=True, frozen=True)
class CoverageConfig:
    """Options that the strategies share.

    Attributes
    ----------
    step : m, between two lines
    first_line : `border` starts at the area's end in -x; `middle` as in the thesis's figure 4.6, with a return to
        the first contact for the other side
    reapproach : m, path along which a lost contact is sought before the grid takes over
    retreat : m, motion off a collision threat
    climb : leave a wall that leads down and come up it from the line's other end, where that is quicker
    low_lines : pass again, lower, where a line over a tall object met nothing or was given up; takes more time
    near_sides : touch walls that a line met above the lowest height down to their foot
    across : cross the faces that lie along the lines by lines along x
    find_ends : follow the object around its ends in x to where it reaches furthest
    """

    step: float = 0.010
    first_line: str = "middle"
    reapproach: float = 0.025
    retreat: float = 0.010
    climb: bool = True
    low_lines: bool = False
    near_sides: bool = True
    across: bool = True
    find_ends: bool = True

    def __post_init__(self) -> None:
        for name in ("step", "reapproach", "retreat"):
            value = getattr(self, name)
            if not (np.isfinite(value) and LEAST <= value <= 1.0):
                raise InputError(f"strategy.{name}", value, f"a length in metres, at least {LEAST:g} and at most 1")
        if self.first_line not in ("border", "middle"):
            raise InputError("strategy.first_line", self.first_line, "border, middle")
