"""Upright lines that show where a leaning probe fits, before it comes.

Along the stick the probe is stiff, so a stick that leans goes slowly through what is not known: 1 to 5 mm/s, where an
upright one goes at 20 to 30 mm/s. An upright line at the same place shows most of the path to be free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.free_space import UPRIGHT
from lwrprobe_strategies.planning.lines import ON_LINE, Line, Z

WORTH = 0.015
"""m that are not known yet, from which on a line is worth it."""


def survey_lines(
    lines: Sequence[Line], upright: np.ndarray, area: Area, body: BodySpace, reachable: Callable[[Line], bool]
) -> list[Line]:
    """One for each place at which some of the lines lean, from the border as far in as the body may go.

    Parameters
    ----------
    lines : that are to be driven next
    upright : (3, 3), the orientation of an upright tip
    body : where the body may be, as of its last survey
    reachable : whether the arm can drive a line
    """
    found: list[Line] = []
    for line in lines:
        if line.rotation is None or -line.rotation[Z, Z] > UPRIGHT:
            continue
        border = float((area.lower if line.sign > 0.0 else area.upper)[line.axis])
        whole = replace(line, begin=border, height=float(area.lower[Z]), rotation=upright, expected=None, survey=True)
        same = ((o.axis, o.sign) == (whole.axis, whole.sign) and abs(o.place - whole.place) < ON_LINE for o in found)
        places, needed = body.lowest(whole, upright)
        fits = needed <= whole.height
        end = float(places[np.flatnonzero(fits)[-1]]) if fits.any() else border
        if any(same) or whole.sign * (end - body.fits_to(whole, upright)) < WORTH:
            continue
        if reachable(survey := replace(whole, end=end)):
            found.append(replace(survey, rotation=None))
    return found
