"""Lines on the area's floor beside a tall object: what stands there may be lower than all lines so far.

Over a tall object the grid passes above a plate on which walls stand, and where these keep the body up, so do the lines
up their sides. A few lines as low as the body may go meet the plate; `treads` leads on from what they touch.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, product

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import GRID_X, NORMAL_Z
from lwrprobe_strategies.planning.lines import Line, X, Y, Z
from lwrprobe_strategies.planning.treads import UPWARDS

REACH = 2.5
"""Pitches from what was touched, within which more of the object is looked for."""
FAR = 0.02
"""m beside a line, up to which it shows what is there farther off: another object twice as wide is met."""
HIGHER = 0.5
"""Pitches above the floor, at which a line is still driven there where the body may come no lower."""
SHORTEST = 0.5
"""Pitches of unknown floor that are worth a line."""


def floor_lines(
    contacts: np.ndarray,
    trail: np.ndarray,
    places: tuple[np.ndarray, np.ndarray],
    task: Task,
    height: float,
    pitch: float,
    shown: float,
    body: BodySpace,
) -> list[Line]:
    """Lines along x and along y from the border, as far in as the body may go on the floor.

    So many that near the object no floor to which the body may go is left without a line beside it, and farther off,
    where another object may stand, none without a line within `FAR`. Along x only towards a side of which nothing near
    the floor was touched: the lines of the grid have passed there.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    places : (n,) m each, where lines along x may be, and where lines along y may be
    height : m, of the lines of the grid
    pitch : m, between two lines
    shown : m beside a line, up to which it shows what is there near the object
    body : where the body may be
    """
    from scipy.spatial import cKDTree

    if not len(contacts):  # the whole grid comes again, lower
        return []
    floor = float(task.area.lower[Z])
    treads = contacts[(contacts[:, NORMAL_Z] > UPWARDS) & (contacts[:, Z] < height)]
    touched = cKDTree(contacts[:, :Z])
    low = trail[trail[:, Z] < floor + task.probe.radius]
    # A line along y passes beside a side that faces along x, and shows no more of it than what reaches to the sphere.
    across = low[np.isnan(low[:, GRID_X])]
    known = [cKDTree(np.concatenate([own[:, :Z], treads[:, :Z]])) for own in (across, low)]
    foot = cKDTree(contacts[contacts[:, Z] < floor + pitch, :Z])
    left: list[tuple[Line, np.ndarray]] = []  # lines, and (n, 2) m, the places on them that are not known yet

    def near(places: np.ndarray) -> np.ndarray:
        """(n,) bool, which places (n, 2) are near the object."""
        return np.asarray(touched.query(places)[0] < REACH * pitch)

    def beside(places: np.ndarray) -> np.ndarray:
        """(n,) m, up to which a line beside places (n, 2) shows what is there."""
        return np.where(near(places), shown, max(shown, FAR))

    for axis, place in chain(product((Y,), np.sort(places[Y]).tolist()), product((X,), np.sort(places[X]).tolist())):
        one, other = float(task.area.lower[axis]), float(task.area.upper[axis])
        for begin, end in ((one, other), (other, one)):
            line = Line(axis, place, begin, end, floor, low=True, ceiling=height, expected=floor)
            along, lowest = body.lowest(line, task.orientation)
            whole = np.full((len(along), 2), place)
            whole[:, axis] = along
            count, above = int((lowest <= floor).sum()), int((lowest <= floor + HIGHER * pitch).sum())
            free, farther = whole[:count], whole[count:above]
            unknown = known[axis].query(free)[0] > beside(free)
            if not (axis == X and (count in (0, len(along)) or foot.query(free[-1])[0] < pitch)) and unknown.any():
                left.append((replace(line, end=float(free[-1, axis])), free[unknown]))
            unknown = (known[axis].query(farther)[0] > beside(farther)) & ~near(farther)
            if unknown.any():
                height_there = float(lowest[:above].max())
                left.append((replace(line, end=float(farther[-1, axis]), height=height_there), farther[unknown]))
    lines: list[Line] = []
    while left:
        line, own = left.pop(int(np.argmax([len(unknown) for _, unknown in left])))
        if np.ptp(own[:, line.axis]) < SHORTEST * pitch:
            break
        lines.append(line)
        driven = cKDTree(own)
        rest = [
            (other, unknown[driven.query(unknown)[0] > beside(unknown)])
            if other.axis == line.axis
            else (other, unknown)
            for other, unknown in left
        ]
        left = [(other, unknown) for other, unknown in rest if len(unknown)]
    return lines
