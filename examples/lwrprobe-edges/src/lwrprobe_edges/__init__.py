"""Find the upper edge of an object, and follow it around at constant force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Done, InputError
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import find_edge, follow_and_regain, search
from lwrprobe_strategies.supervisor import Program, SkillStrategy


@dataclass(slots=True, frozen=True)
class EdgesConfig:
    """Options: `closed` m, distance to the first place of the edge at which the way around it is closed."""

    closed: float = 0.003

    def __post_init__(self) -> None:
        if not 0.0 < self.closed < 0.1:
            raise InputError("strategy.closed", self.closed, "a length in metres, between 0 and 0.1")


class Edges(SkillStrategy):
    """Touches down in the middle, slides in +x to the edge, and follows the edge once around the object."""

    Config = EdgesConfig

    def program(self) -> Program:
        """Search, find the edge, follow it."""
        tip, area = self.tip, self.task.area
        middle = 0.5 * (area.lower + area.upper)
        if (yield from search(tip, [(middle[0], middle[1])])) is not Ended.CONTACT:
            return Done("nothing in the middle of the area", complete=False)
        if (yield from find_edge(tip, axis=0, sign=1.0)) is not Ended.EDGE:
            return Done("no edge in +x", complete=False)
        self.first, self.left = tip.here.copy(), False
        frame = TrackingFrame.around(area, sense=1.0, height=float(tip.here[2]))
        end = yield from follow_and_regain(tip, frame, self.around, distance=0.03)
        return Done("once around the edge" if end is Ended.EDGE else str(end), complete=end is Ended.EDGE)

    def around(self) -> Ended | None:
        """Back at the first place, after having left it."""
        away = float(np.abs(self.tip.here - self.first).max())
        self.left = self.left or away > 2.0 * self.task.options.closed
        return Ended.EDGE if self.left and away < self.task.options.closed else None
