"""Lines on the area's floor beside a tall object: what stands there may be lower than all lines so far.

Over a tall object the grid passes above a plate on which walls stand, and where these keep the body up, so do the lines
up their sides. A few lines as low as the body may go meet the plate; `treads` leads on from what they touch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import NORMAL_Z
from lwrprobe_strategies.planning.lines import Line, Y, Z
from lwrprobe_strategies.planning.treads import UPWARDS

REACH = 2.5
"""Pitches from what was touched, within which more of the object is looked for."""
SHORTEST = 0.5
"""Pitches of unknown floor that are worth a line."""


def floor_lines(
    contacts: np.ndarray,
    trail: np.ndarray,
    places: np.ndarray,
    task: Task,
    height: float,
    pitch: float,
    shown: float,
    body: BodySpace,
) -> list[Line]:
    """Lines along y from the border, at some of the `places` (n,) m, as far in as the body may go on the floor.

    So many that near the object no floor to which the body may go is left without a line beside it.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    height : m, of the lines of the grid
    pitch : m, between two lines
    shown : m beside a line, up to which it shows what is there
    body : where the body may be
    """
    from scipy.spatial import cKDTree

    floor, low, high = float(task.area.lower[Z]), float(task.area.lower[Y]), float(task.area.upper[Y])
    treads = contacts[(contacts[:, NORMAL_Z] > UPWARDS) & (contacts[:, Z] < height)]
    touched = cKDTree(contacts[:, :Z])
    known = cKDTree(np.concatenate([trail[trail[:, Z] < floor + task.probe.radius, :Z], treads[:, :Z]]))
    left: list[tuple[Line, np.ndarray]] = []  # lines, and (n, 2) m, the places on them that are not known yet
    for place in np.sort(places).tolist():
        for begin, end in ((low, high), (high, low)):
            line = Line(Y, place, begin, end, floor, low=True, ceiling=height, expected=floor)
            ys, lowest = body.lowest(line, task.orientation)
            free = np.column_stack([np.full(len(ys), place), ys])[lowest <= floor]
            unknown = (touched.query(free)[0] < REACH * pitch) & (known.query(free)[0] > shown)
            if unknown.any():
                left.append((replace(line, end=float(free[-1, Y])), free[unknown]))
    lines: list[Line] = []
    while left:
        line, own = left.pop(int(np.argmax([len(unknown) for _, unknown in left])))
        if np.ptp(own[:, Y]) < SHORTEST * pitch:
            break
        lines.append(line)
        near = cKDTree(own)
        rest = [(other, unknown[near.query(unknown)[0] > shown]) for other, unknown in left]
        left = [(other, unknown) for other, unknown in rest if len(unknown)]
    return lines
