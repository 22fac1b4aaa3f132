"""OrientationChange: the probe is turned so that it points at the object (Rau 2017, section 5.3.3, figure 5.12)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe_strategies.coverage import Coverage
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.planning.lean import LeanPlanner, horizontal
from lwrprobe_strategies.planning.lines import ON_FLOOR, Line, Y, Z
from lwrprobe_strategies.planning.paths import BORDER
from lwrprobe_strategies.skills import Procedure, follow_contour
from lwrprobe_strategies.supervisor import Program

ABOVE = 0.003
"""m above what makes a probe lean, where it is set upright again."""
MORE = float(np.radians(10.0))
"""rad by which it leans further where leaning has not helped."""
MAX_THREATS = 4
"""On one line; what still comes near after as many turns is given up."""
SAME = 0.05
"""Change of the rotation's elements, below which a turn is not worth it (3 degrees)."""
SURFACE_WEIGHT = 2.0
"""Weight of the surface's normal against the direction of the threat: the surface is certain, the threat one pair."""


@dataclass(slots=True, frozen=True)
class OrientationChangeConfig(CoverageConfig):
    """The shared options, and how far the probe is turned.

    Attributes
    ----------
    tilt_deg : degrees out of the vertical by which the stick leans away from the surface at most
    """

    step: float = 0.015
    tilt_deg: float = 40.0

    def __post_init__(self) -> None:
        # dataclass(slots=True) makes a new class, which the bare super() does not know.
        CoverageConfig.__post_init__(self)
        if not 5.0 <= self.tilt_deg <= 80.0:
            raise InputError("strategy.tilt_deg", self.tilt_deg, "5 to 80 degrees")


class OrientationChange(Coverage):
    """A threat in Z_Y turns the probe so that it points at the object, and the contour goes on; in X_Y it goes to Z_Y.

    Departures: the direction of the turn follows from the surface's normal at the contact, where the source chooses
    between two fixed orientations. And where the object may be taller than the stick is long, lines begin at the lowest
    height with the probe leaning back, so that the near side is touched from its foot upwards as well; the source
    drives them above the height at which an upright probe is safe.
    """

    Config: ClassVar[type] = OrientationChangeConfig

    def program(self) -> Program:
        """As the other strategies do."""
        self.leaning_since = -np.inf  # m, the height at which the last threat made it lean
        max_angle = float(np.radians((self.task.options or self.Config()).tilt_deg))
        self.planner = LeanPlanner(self.task, self.tip.rotation, max_angle)
        self.floor = float(self.task.area.lower[Z])
        return super().program()

    def avoid(self) -> Procedure | None:
        """In X_Y: change the motion state. In Z_Y: lean away; give the line up where that has not helped."""
        tip = self.tip
        if self.frame.line.outline or self.threats > MAX_THREATS:
            return self.give_up()
        if self.frame.level:
            return self.contour_upright()
        foot = np.array([tip.here[0], tip.here[1], self.floor])
        min_angle = self.planner.angle(tip.rotation) + MORE if self.threats > 1 else 0.0
        rotation = self.planner.lean(self._away(), [tip.here], [foot], min_angle)
        if rotation is None or np.abs(rotation - tip.rotation).max() < SAME:
            return self.give_up()
        tip.rotation, self.leaning_since = rotation, float(tip.here[Z])
        return self.turn()

    def _away(self) -> np.ndarray:
        """(3,) horizontal, off the surface that is followed and off what comes near."""
        near, tip = self.tip.seen.clearance, self.tip
        assert near is not None
        away = horizontal(near.on_robot - near.on_map)
        if tip.trace.ended is follow_contour:
            return horizontal(away + SURFACE_WEIGHT * horizontal(tip.control.normal))
        return horizontal(away + horizontal(-tip.rotation[:, Z]))  # what stands ahead is unknown: lean back from it

    def turn_wanted(self) -> np.ndarray | None:
        """Upright again as soon as that is safe: above where the body is clear, and above what it leaned away from."""
        if self.tip.rotation is self.upright:
            return None
        safe = max(self.lines.height, self.leaning_since) + ABOVE
        return self.upright if self.tip.here[Z] > safe else None

    def prepared(self, line: Line, here: np.ndarray) -> tuple[Line, np.ndarray]:
        """From the lowest height and leaning back, away from what may stand ahead, where the arm can do that."""
        self.leaning_since = -np.inf
        if line.on_surface or line.outline or line.raised or line.height <= self.floor + ON_FLOOR:
            return line, self.upright
        low = replace(line, height=self.floor)
        back = -line.ahead
        if line.axis == Y:
            back = horizontal(back + self._outward(line.place))
        # On the border it turns where it stands; elsewhere it comes over the top, where nothing is.
        beside = line.axis == Y and abs(here[Y] - line.begin) < BORDER
        over = np.array([low.start[0], low.start[1], self.task.area.upper[Z]])
        way = [low.start, low.at(0.5 * (low.begin + low.end))]
        rotation = self.planner.lean(back, [here] if beside else [], way if beside else [over, *way])
        return (line, self.upright) if rotation is None else (low, rotation)

    def _outward(self, x: float) -> np.ndarray:
        """(3,) off the object's end in x, on lines beyond what was touched: how far it goes on is not known yet."""
        touched = self.tip.memory.contacts()[:, 0]
        if len(touched) and not touched.min() <= x <= touched.max():
            return np.array([np.sign(x - touched.min()), 0.0, 0.0])
        return np.zeros(3)
