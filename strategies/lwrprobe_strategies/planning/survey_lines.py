"""Upright lines that show where a leaning probe fits, before it comes.

Along the stick the probe is stiff, so a stick that leans goes slowly through what is not known: 1 to 5 mm/s, where an
upright one goes at 20 to 30 mm/s. An upright line at the same place shows most of the path to be free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import ON_LINE, Line, Z

WORTH = 0.015
"""m that are not known yet, from which on a line is worth it."""


def survey_lines(lines: Sequence[Line], area: Area, body: BodySpace, reachable: Callable[[Line], bool]) -> list[Line]:
    """One for each place at which some of the lines lean, from the border as far in as the body may go.

    Parameters
    ----------
    lines : that are to be driven next
    body : where the body may be, as of its last survey
    reachable : whether the arm can drive a line
    """
    found: list[Line] = []
    for line in lines:
        leans = line.rotation is not None and -line.rotation[Z, Z] <= UPRIGHT
        if not leans or any(_alike(line, other) for other in found):
            continue
        border = float((area.lower if line.sign > 0.0 else area.upper)[line.axis])
        whole = replace(
            line, begin=border, height=float(area.lower[Z]), rotation=body.upright, expected=None, survey=True
        )
        places, needed = body.lowest(whole, body.upright)
        free = places[needed <= whole.height]
        if not len(free) or whole.sign * (float(free[-1]) - body.fits_to(whole)) < WORTH:
            continue
        if reachable(survey := replace(whole, end=float(free[-1]))):
            found.append(replace(survey, rotation=None))
    return found


def _alike(line: Line, other: Line) -> bool:
    """Whether two lines lead the same way at the same place."""
    return (line.axis, line.sign) == (other.axis, other.sign) and abs(line.place - other.place) < ON_LINE
