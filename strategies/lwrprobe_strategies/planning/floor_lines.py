"""Lines on the area's floor beside a tall object: what stands there may be lower than all lines so far.

Over a tall object the grid passes above a plate on which walls stand, and where these keep the body up, so do the lines
up their sides. A few lines as low as the body may go meet the plate; `treads` leads on from what they touch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
NARROW = 0.012
"""m, up to which a strip of unknown floor far from the object is left out: what is 45 mm wide is met beside it."""
AROUND = 4.0
"""Pitches from where a plate was met, within which more of it is looked for."""
BETWEEN = 0.75
"""Pitches beside a line, up to which it shows what is there where a plate was met."""
HIGHER = 0.5
"""Pitches above the floor, at which a line is still driven there where the body may come no lower."""
SHORTEST = 0.5
"""Pitches of unknown floor that are worth a line."""
GRAIN = 0.25
"""Pitches between two places far from the object that are looked at."""
SAME = 1e-4
"""m, of two distances that are one: lines lie at multiples of the pitch, and their places 1 mm apart."""


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
    """Lines along x and along y from the border, as far in as the body may go on the floor.

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
    candidates: list[_Candidate] = []
    for axis in (Y, X):
        one, other = float(task.area.lower[axis]), float(task.area.upper[axis])
        for place in np.sort(places[axis]).tolist():
            for begin, end in ((one, other), (other, one)):
                candidates += floor.candidates(Line(axis, place, begin, end, floor.height, low=True, ceiling=height))
    lines = _near_lines(floor, candidates, SHORTEST * pitch)
    return lines + _far_lines(floor, candidates, lines, SHORTEST * pitch)


def _near_lines(floor: _Floor, candidates: list[_Candidate], shortest: float) -> list[Line]:
    """Lines on the floor near the object, until none is left on which more than `shortest` m are not known."""
    left, lines = [(one, one.near) for one in candidates], []
    while left:
        driven, own = left.pop(int(np.argmax([len(unknown) for _, unknown in left])))
        if not len(own) or np.ptp(own[:, driven.line.axis]) < shortest:
            break
        lines.append(driven.line)
        left = [(one, floor.still_unknown(one.line, unknown, driven.line, own)) for one, unknown in left]
    return lines


def _far_lines(floor: _Floor, candidates: list[_Candidate], near: list[Line], shortest: float) -> list[Line]:
    """Lines far from the object, besides those `near` it, until none shows a strip more than `NARROW` m wide and
    `shortest` m long.
    """
    if not candidates:
        return []
    points = floor.far_points()
    apart = np.array([_apart(one.line, points) for one in candidates])  # (k, n)
    reached = apart.min(axis=0) < floor.pitch
    points, shows = points[reached], apart[:, reached] <= FAR + SAME
    left = ~shows[[k for k, one in enumerate(candidates) if one.line in near]].any(axis=0)
    lines: list[Line] = []
    for axis in (Y, X):  # crossing lines would show the same twice
        along = [k for k, one in enumerate(candidates) if one.line.axis == axis]
        while worth := [k for k in along if floor.is_strip(points[shows[k] & left, axis], shortest)]:
            first = points[(shows[worth] & left).any(axis=0), 1 - axis].min()
            reach = [k for k in worth if candidates[k].line.place <= first + FAR + SAME]
            best = max(reach, key=lambda k: (candidates[k].line.place, (shows[k] & left).sum()))
            lines.append(candidates[best].line)
            left &= ~shows[best]
    return lines


@dataclass(slots=True, frozen=True, eq=False)
class _Candidate:
    """A line that may be driven.

    Attributes
    ----------
    line : as far as the body may go
    near : (n, 2) m, those near the object of which nothing is known and that it shows
    """

    line: Line
    near: np.ndarray


def _apart(line: Line, points: np.ndarray) -> np.ndarray:
    """(n,) m, from a line to points (n, 2)."""
    low, high = sorted((line.begin, line.end))
    beyond = np.maximum(np.maximum(low - points[:, line.axis], points[:, line.axis] - high), 0.0)
    return np.hypot(beyond, points[:, line.aside] - line.place)


class _Floor:
    """What is known of the area's floor; parameters as of `floor_lines`.

    Attributes
    ----------
    height : m, of a sphere's centre on it
    pitch : m, between two lines
    grain : m, between two places far from the object that are looked at
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

        self.height, self.grain = float(task.area.lower[Z]), GRAIN * pitch
        self.pitch, self._body, self._upright = pitch, body, task.orientation
        self._bounds = task.area.lower[:Z], task.area.upper[:Z]
        self._object, self._plate = cKDTree(contacts[:, :Z]), cKDTree(plate)
        self._feet = cKDTree(contacts[contacts[:, Z] < self.height + pitch, :Z])
        treads = contacts[(contacts[:, NORMAL_Z] > UPWARDS) & (contacts[:, Z] < height), :Z]
        low = trail[trail[:, Z] < self.height + task.probe.radius]
        # A line along y passes beside a side that faces along x, and shows of it only what reaches to the sphere.
        across = low[np.isnan(low[:, GRID_X])]
        self._known = [cKDTree(np.concatenate([own[:, :Z], treads])) for own in (across, low)]

    def candidates(self, line: Line) -> list[_Candidate]:
        """A line as far as the body may go on the floor, and as far as it may go a little higher, where it may."""
        along, lowest = self._body.lowest(line, self._upright)
        places = np.full((len(along), 2), line.place)
        places[:, line.axis] = along
        on_floor = int((lowest <= self.height).sum())
        above = int((lowest <= self.height + HIGHER * self.pitch).sum())
        free, whole = places[:on_floor], places[:above]
        found, near = [], np.empty((0, 2))
        if on_floor and (line.axis == Y or self._leads_to_a_side(free, places)):
            near = free[self._is_near(free) & self._is_unknown(line.axis, free)]
        if on_floor:
            found.append(_Candidate(self._up_to(line, free), near))
        if above > on_floor:
            higher = replace(line, height=float(lowest[:above].max()))
            found.append(_Candidate(self._up_to(higher, whole), np.empty((0, 2))))
        return found

    def still_unknown(self, line: Line, places: np.ndarray, driven: Line, shown: np.ndarray) -> np.ndarray:
        """(k, 2) m, of the unknown `places` (n, 2) on a line, those that another one, which goes over the unknown
        places `shown` (m, 2), leaves unknown: all, where that leads along the other axis.
        """
        if line.axis != driven.axis or not len(places):
            return places
        apart = np.linalg.norm(places[:, None] - shown, axis=2).min(axis=1)
        return places[apart > self._shown_beside(places) + SAME]

    def far_points(self) -> np.ndarray:
        """(n, 2) m, places far from the object of which nothing is known, in a square grid over the area."""
        axes = (np.arange(low, high + SAME, self.grain) for low, high in zip(*self._bounds))
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        points = points[~self._is_near(points)]
        return points[self._known[Y].query(points)[0] > FAR + SAME]

    def is_strip(self, along: np.ndarray, shortest: float) -> bool:
        """Whether places far from the object, at m `along` (n,) an axis, are a strip wide enough for something to stand
        in it that no line beside it meets, and `shortest` m long.
        """
        length = float(np.ptp(along)) + self.grain if len(along) else 0.0
        return length > shortest and len(along) * self.grain**2 > NARROW * length

    def _up_to(self, line: Line, places: np.ndarray) -> Line:
        """The line to the last of the places (n, 2) on it."""
        return replace(line, end=float(places[-1, line.axis]), expected=self.height)

    def _leads_to_a_side(self, free: np.ndarray, places: np.ndarray) -> bool:
        """Whether a line along x over `places` (n, 2), which is `free` (m, 2) on the floor, leads to a side of which
        nothing near the floor was touched. Where none stands, the lines of the grid have passed.
        """
        return len(free) < len(places) and bool(self._feet.query(free[-1])[0] >= self.pitch)

    def _is_unknown(self, axis: int, places: np.ndarray) -> np.ndarray:
        """(n,) bool, at which places (n, 2) a line along an axis shows what nothing has shown yet."""
        return np.asarray(self._known[axis].query(places)[0] > self._shown_beside(places) + SAME)

    def _is_near(self, places: np.ndarray) -> np.ndarray:
        """(n,) bool, which places (n, 2) are near the object or a plate that was met."""
        beside_object = self._object.query(places)[0] < REACH * self.pitch
        return np.asarray(beside_object | (self._plate.query(places)[0] < AROUND * self.pitch))

    def _shown_beside(self, places: np.ndarray) -> np.ndarray:
        """(n,) m, up to which a line beside places (n, 2) near the object shows what is there."""
        shown = np.full(len(places), NEIGHBOUR * self.pitch)
        shown[self._plate.query(places)[0] < AROUND * self.pitch] = BETWEEN * self.pitch
        return shown
