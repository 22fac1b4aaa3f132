"""The motions of a line before it touches anything: off what was touched last, to its beginning, and along it."""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.encounter import BESIDE_LINE
from lwrprobe_strategies.planning.approaches import Departure
from lwrprobe_strategies.planning.contact_memory import POINT
from lwrprobe_strategies.planning.lines import NEIGHBOUR, Line, Z
from lwrprobe_strategies.planning.shaft import stick_led_to, stretch
from lwrprobe_strategies.planning.upright_body import clear_of
from lwrprobe_strategies.retraction_planner import RetractionPlanner
from lwrprobe_strategies.skills import Procedure, guarded_move, transit
from lwrprobe_strategies.tip import Tip

MAX_DETOURS = 2
"""Times that the path to one line is begun again."""
BACK = 2.0
"""Times the distance to a line, over which the tip comes back to it: only what lies between lines that keep their
distance counts as known."""
SET_OUT = 0.001
"""m from where a path begins, within which what it meets keeps the tip where it is, and does not stand in its way."""
WORTH = 0.003
"""m that are known to be free ahead, from which on they are driven fast, in a piece of their own."""


class FreeMotion:
    """Plans the motions through free space, by what the paths and lines before have shown.

    Parameters
    ----------
    tip : what the skills share
    upright : (3, 3), the orientation of the upright tip
    spacing : m, between two lines
    retractions : how the tip leaves what it touches

    Attributes
    ----------
    line_rotation : (3, 3), the orientation in which the present line was begun
    detours : how often the path to the present line was begun again
    rests_first : the tip stands still for one sample before it goes on along a line; what touched last was the stick
    """

    def __init__(self, tip: Tip, upright: np.ndarray, spacing: float, retractions: RetractionPlanner) -> None:
        self._tip, self._upright, self._retractions = tip, upright, retractions
        self._neighbour_distance = NEIGHBOUR * spacing
        self.line_rotation, self.detours, self.rests_first = upright, 0, False
        self._met: list[np.ndarray] = []  # (3,) m, where paths to a line have met something
        self._led: tuple[Line, float] | None = None  # the last line that met nothing, and m on its axis, how far

    def leave(self) -> Procedure:
        """Off what is touched, to where a path may begin."""
        return transit(self._tip, self._retractions.path(), self.line_rotation)

    def approach(self, line: Line) -> Procedure:
        """Off what is touched, and to the beginning of a line."""
        tip = self._tip
        self._set_out = tip.here
        retraction = self._retractions.path()
        start = retraction[-1].place if retraction else tip.here
        before = tip.rotation
        tip.rotation = self.line_rotation = self._upright if line.rotation is None else line.rotation
        speeds, clear = tip.expected_speeds(tip.rotation), clear_of(tip.memory.contacts()[:, POINT], tip.task)
        met = np.array(self._met).reshape(-1, 3)
        held = before if not retraction or retraction[-1].rotation is None else retraction[-1].rotation
        departure = Departure(
            start, tip.rotation, tip.task.area, tip.free, speeds, clear, self._may_go, tip.body, held, met
        )
        return transit(tip, retraction + departure.path_to(line), before)

    def _may_go(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether a path may lead from one pose (4, 4) to another: the arm can, and the body may."""
        body = self._tip.body
        return self._tip.task.reachable([begin, end]) and (body is None or body.allows(begin, end))

    def detour(self) -> bool:
        """The path to a line has met something: it begins again here, by what is known now; False if often enough."""
        tip = self._tip
        self.detours += 1
        if np.abs(tip.here - self._set_out).max() < SET_OUT:
            self._retractions.go_back()
        else:
            self._met.append(tip.here.copy())
        if self.detours > MAX_DETOURS:
            return False
        tip.rotation = tip.seen.pose[:3, :3].copy()  # it may have been interrupted while it turned
        return True

    def along(self, line: Line) -> Procedure:
        """On along a line until something is touched."""
        tip, known, beside = self._tip, self._known_to(line), self._neighbour_distance

        def next_stretch(here: np.ndarray) -> tuple[np.ndarray, float | None]:
            aside, along = abs(float(here[line.aside]) - line.place), float(here[line.axis])
            on_line = aside <= BESIDE_LINE and float(here[Z]) >= line.height - BESIDE_LINE
            times: float | None = None
            if on_line and line.sign * (known - along) > WORTH:
                end = known
            else:
                end, times = stretch(line, here, tip.memory, beside, beside if tip.overhangs.found else 0.0)
            if aside > BESIDE_LINE:
                end = line.sign * min(line.sign * along + BACK * aside, line.sign * end)
            target = line.at(end)
            target[Z] = here[Z]
            return target, times

        rest, self.rests_first = self.rests_first, False
        return guarded_move(tip, line.at(line.end), line.ahead, next_stretch, line.grid_x, rest)

    def met_nothing(self, line: Line) -> None:
        """A line is left where the tip is, and has met nothing up to there."""
        self._led = line, float(self._tip.here[line.axis])

    def _known_to(self, line: Line) -> float:
        """m on a line's axis, up to which all of the probe is known to fit; asked for where it leans."""
        body, held = self._tip.body, self._tip.rotation
        if body is None or held is self._upright or held is not self.line_rotation:
            return line.begin
        known = [body.fits_to(line), None if self._led is None else stick_led_to(line, *self._led)]
        return line.sign * max(line.sign * place for place in known if place is not None)
