"""Lines on the area's floor beside a tall object: what stands there may be lower than all lines so far.

Over a tall object the grid passes above a plate on which walls stand, and where these keep the body up, so do the lines
up their sides. A few lines as low as the body may go meet the plate; `treads` leads on from what they touch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.body_space import BodySpace
from lwrprobe_strategies.planning.contact_memory import GRID_X, NORMAL_Z
from lwrprobe_strategies.planning.lines import NEIGHBOUR, Line, X, Y, Z
from lwrprobe_strategies.planning.treads import UPWARDS

REACH = 2.5
"""Pitches from what was touched, within which more of it is looked for."""
FAR = 0.02
"""m beside a line, up to which it shows what is there farther off: another object twice as wide is met."""
AROUND = 4.0
"""Pitches from where a plate was met, within which more of it is looked for."""
BETWEEN = 0.75
"""Pitches beside a line, up to which it shows what is there where a plate was met."""
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
    body: BodySpace,
    plate: np.ndarray,
) -> list[Line]:
    """Lines along x and along y from the border, as far in as the body may go on the floor, those that show most first.

    So many that no floor to which the body may go is farther from a line than that shows what is there: least near a
    plate that was met, more near the object, and most farther off, where another object may stand.

    Parameters
    ----------
    contacts, trail : (m, 10) and (k, 10) as in `ContactMemory.contacts` and `ContactMemory.trail`
    places : (n,) m each, where lines along x may be, and where lines along y may be
    height : m, of the lines of the grid
    pitch : m, between two lines
    body : where the body may be
    plate : (p, 2) m, where lines on the floor have met a plate
    """
    if not len(contacts):  # the whole grid comes again, lower
        return []
    floor = _Floor(contacts, trail, task, height, pitch, body, plate)
    left: list[tuple[Line, np.ndarray]] = []  # lines, and (n, 2) m, the places on them that are not known yet
    for axis in (Y, X):
        one, other = float(task.area.lower[axis]), float(task.area.upper[axis])
        for place in np.sort(places[axis]).tolist():
            for begin, end in ((one, other), (other, one)):
                left += floor.candidates(Line(axis, place, begin, end, floor.height, low=True, ceiling=height))
    lines: list[Line] = []
    while left:
        line, own = left.pop(int(np.argmax([len(unknown) for _, unknown in left])))
        if np.ptp(own[:, line.axis]) < SHORTEST * pitch:
            break
        lines.append(line)
        left = [(other, floor.still_unknown(other, unknown, line, own)) for other, unknown in left]
        left = [(other, unknown) for other, unknown in left if len(unknown)]
    return lines


class _Floor:
    """What is known of the area's floor; parameters as of `floor_lines`.

    Attributes
    ----------
    height : m, of a sphere's centre on it
    """

    def __init__(
        self,
        contacts: np.ndarray,
        trail: np.ndarray,
        task: Task,
        height: float,
        pitch: float,
        body: BodySpace,
        plate: np.ndarray,
    ) -> None:
        from scipy.spatial import cKDTree

        self.height = float(task.area.lower[Z])
        self._pitch, self._body, self._upright = pitch, body, task.orientation
        self._object, self._plate = cKDTree(contacts[:, :Z]), cKDTree(plate)
        self._feet = cKDTree(contacts[contacts[:, Z] < self.height + pitch, :Z])
        treads = contacts[(contacts[:, NORMAL_Z] > UPWARDS) & (contacts[:, Z] < height), :Z]
        low = trail[trail[:, Z] < self.height + task.probe.radius]
        # A line along y passes beside a side that faces along x, and shows of it only what reaches to the sphere.
        across = low[np.isnan(low[:, GRID_X])]
        self._known = [cKDTree(np.concatenate([own[:, :Z], treads])) for own in (across, low)]

    def candidates(self, line: Line) -> list[tuple[Line, np.ndarray]]:
        """A line as far as the body may go on the floor, and as far as it may go a little higher, where that is far
        from the object; with each the (n, 2) m on it of which nothing is known. Those that show nothing are left out.
        """
        along, lowest = self._body.lowest(line, self._upright)
        places = np.full((len(along), 2), line.place)
        places[:, line.axis] = along
        on_floor = int((lowest <= self.height).sum())
        above = int((lowest <= self.height + HIGHER * self._pitch).sum())
        found = []
        free, farther = places[:on_floor], places[on_floor:above]
        unknown = free[self._is_unknown(line.axis, free)]
        if len(unknown) and (line.axis == Y or self._leads_to_a_side(free, places)):
            found.append((self._up_to(line, free), unknown))
        unknown = farther[self._is_unknown(line.axis, farther) & ~self._is_near(farther)]
        if len(unknown):
            higher = replace(line, height=float(lowest[:above].max()))
            found.append((self._up_to(higher, farther), unknown))
        return found

    def still_unknown(self, line: Line, places: np.ndarray, driven: Line, shown: np.ndarray) -> np.ndarray:
        """(k, 2) m, of the unknown `places` (n, 2) on a line, those that another one, which goes over the unknown
        places `shown` (m, 2), leaves unknown: all, where that leads along the other axis.
        """
        if line.axis != driven.axis:
            return places
        apart = np.linalg.norm(places[:, None] - shown, axis=2).min(axis=1)
        return places[apart > self._shown_beside(places)]

    def _up_to(self, line: Line, places: np.ndarray) -> Line:
        """The line to the last of the places (n, 2) on it."""
        return replace(line, end=float(places[-1, line.axis]), expected=self.height)

    def _leads_to_a_side(self, free: np.ndarray, places: np.ndarray) -> bool:
        """Whether a line along x over `places` (n, 2), which is `free` (m, 2) on the floor, leads to a side of which
        nothing near the floor was touched. Where none stands, the lines of the grid have passed.
        """
        return len(free) < len(places) and bool(self._feet.query(free[-1])[0] >= self._pitch)

    def _is_unknown(self, axis: int, places: np.ndarray) -> np.ndarray:
        """(n,) bool, at which places (n, 2) a line along an axis shows what nothing has shown yet."""
        return np.asarray(self._known[axis].query(places)[0] > self._shown_beside(places))

    def _is_near(self, places: np.ndarray) -> np.ndarray:
        """(n,) bool, which places (n, 2) are near the object."""
        return np.asarray(self._object.query(places)[0] < REACH * self._pitch)

    def _shown_beside(self, places: np.ndarray) -> np.ndarray:
        """(n,) m, up to which a line beside places (n, 2) shows what is there."""
        near = NEIGHBOUR * self._pitch
        shown = np.where(self._is_near(places), near, max(near, FAR))
        shown[self._plate.query(places)[0] < AROUND * self._pitch] = BETWEEN * self._pitch
        return shown
