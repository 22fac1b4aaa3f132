"""Lines beside the object, where those of the grid have not passed: they show where the body behind the stick may go.

A level contour comes around the object to the next line of the grid, a line that is given up is left, and one that has
come over the object may go on as high as that: what lies between the object and the border then stays unknown. No side
below the grid's height can be touched there, and no plate on which the object stands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.contact_memory import NORMAL, NORMAL_X, NORMAL_Y, NORMAL_Z, POINT
from lwrprobe_strategies.planning.lines import ON_LINE, Line, X, Y, Z
from lwrprobe_strategies.planning.low_sides import FACING, WORTH, left_below
from lwrprobe_strategies.planning.treads import UPWARDS
from lwrprobe_strategies.planning.upright_body import lowest_beside

AT_BORDER = 0.003
"""m, within which a place is one on the border."""


def outer_parts(
    contacts: np.ndarray, trail: np.ndarray, places: np.ndarray, task: Task, height: float, pitch: float
) -> list[Line]:
    """From the border to where the object was touched, at `places` (n,) m, for each side on which no line has passed.

    Only where something is left below, there or beside the next line, and where an upright body would clear what was
    touched: it is wider than a line, and what is unknown beside it holds it up as well. And where a tread below the
    grid was touched before that side: it most likely goes on there.

    Parameters
    ----------
    task : the area, and the probe's body
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    height : m, at which the grid is driven
    pitch : m, between two lines
    """
    lines: list[Line] = []
    trail = trail[trail[:, Z] < height + task.probe.radius]
    area, treads = task.area, contacts[(contacts[:, NORMAL_Z] > UPWARDS) & (contacts[:, Z] < height)]
    for sign, border in ((-1.0, float(area.lower[Y])), (1.0, float(area.upper[Y]))):
        facing = contacts[sign * contacts[:, NORMAL_Y] > FACING]
        if not len(facing):
            continue
        left = np.array(
            [
                place
                for place in places.tolist()
                if _before(sign, place, facing, treads, pitch) or _left(place, border, facing, contacts, task, pitch)
            ]
        )
        for place in np.sort(places).tolist():
            if not (np.abs(left - place) < pitch + ON_LINE).any():
                continue
            own = trail[np.abs(trail[:, X] - place) < ON_LINE, Y]
            end = sign * _outline(sign, place, facing)
            if (sign * own > sign * border - AT_BORDER).any() or sign * (border - end) < AT_BORDER:
                continue
            lines.append(Line(Y, place, border, end, height))
    return lines


def _left(place: float, border: float, facing: np.ndarray, contacts: np.ndarray, task: Task, pitch: float) -> bool:
    """Whether something is left below the lowest contact of a side, down to where an upright body may come there."""
    floor, side = float(task.area.lower[Z]), facing[np.abs(facing[:, X] - place) < pitch + ON_LINE]
    if not len(side) or side[:, Z].min() - floor <= 0.5 * pitch:
        return False
    low = side[np.argmin(side[:, Z])]
    away = low[NORMAL] * (1.0, 1.0, 0.0) / np.hypot(low[NORMAL_X], low[NORMAL_Y])
    whole = Line(Y, place, border, float(low[Y]), floor, ceiling=float(low[Z]))
    whole = replace(whole, height=lowest_beside(whole, contacts[:, POINT], task))
    if low[Z] - whole.height <= 0.5 * pitch:
        return False
    return left_below(whole, low[POINT], away, 0.0, contacts, pitch) > WORTH * pitch * pitch


def _before(sign: float, place: float, facing: np.ndarray, treads: np.ndarray, pitch: float) -> bool:
    """Whether one of the treads (n, 10) was touched before the side that was touched there."""
    near = treads[np.abs(treads[:, X] - place) < pitch + ON_LINE]
    return bool((sign * near[:, Y] > _outline(sign, place, facing)).any())


def _outline(sign: float, place: float, facing: np.ndarray) -> float:
    """How far out the side was touched, m towards the border: between the nearest contacts on either hand."""
    hands = (facing[facing[:, X] <= place], facing[facing[:, X] >= place])
    nearest = [hand[np.abs(hand[:, X] - place).argmin(), X] for hand in hands if len(hand)]
    outermost = [(sign * facing[np.abs(facing[:, X] - x) < ON_LINE, Y]).max() for x in nearest]
    return float(np.interp(place, nearest, outermost))
