"""OrientationChange: the probe is turned so that it points at the object (Rau 2017, section 5.3.3, figure 5.12)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe_strategies.coverage import Coverage
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.encounter import on_far_side
from lwrprobe_strategies.planning.lean import LeanPlanner, horizontal
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.skills import Procedure, follow_contour
from lwrprobe_strategies.supervisor import Program

MORE, LEAST_MORE = float(np.radians(10.0)), float(np.radians(5.0))
"""rad by which it leans further where leaning has not helped; and below which the turn is not worth it: the next threat
comes a few millimetres later, and a turn in contact is the hardest on the force, most of all with a stick that leans
far."""
MAX_THREATS = 4
"""On one line; what still comes near after as many turns is given up."""
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
    """The sides of an object that may be taller than the stick are touched with the probe tilted away from them.

    An upright probe answers a threat as in `GridVersion`: off the surface, and on along the line. Afterwards the sides
    are touched from their feet upwards, with the probe leaning back into space that is known to be free; a threat there
    makes it lean more. Unlike in the thesis (Rau 2017), where the probe turns at the threat between two fixed
    orientations, the direction of the turn follows from the surface's normal.
    """

    Config: ClassVar[type] = OrientationChangeConfig

    def program(self) -> Program:
        """As the other strategies do."""
        self.planner = LeanPlanner(self.task, self.tip.rotation, float(np.radians(self.options.tilt_deg)))
        return super().program()

    def avoid(self) -> Procedure | None:
        """Upright: off the far side and on along the line, or give the line up. Leaning: lean more, or give it up.

        In a horizontal plane: on in the line's vertical plane.
        """
        tip, drive = self.tip, self.drive
        if drive.frame.line.outline or drive.threats > MAX_THREATS:
            return drive.give_up()
        if drive.frame.level:
            return drive.contour_upright()
        if tip.rotation is self.upright:
            return self._on_along_line()
        foot = np.array([*tip.here[:Z], self.task.area.lower[Z]])
        now = self.planner.angle(tip.rotation)
        rotation = self.planner.lean(self._away(), [tip.here], [foot], now + MORE)
        if rotation is None or self.planner.angle(rotation) < now + LEAST_MORE:
            return drive.give_up()
        return drive.turn(rotation)

    def avoid_unknown_space(self) -> Procedure | None:
        """Leaning does not help where nothing is known of what is there."""
        return self._on_along_line() if self.tip.rotation is self.upright else self.drive.give_up()

    def _on_along_line(self) -> Procedure | None:
        """Off a far side, and on along the line: its foot is touched afterwards."""
        drive, line = self.drive, self.drive.frame.line
        leads_on = on_far_side(self.tip, line) and not drive.frame.level and not line.outline and not line.low
        return drive.retract_onward() if leads_on and drive.threats <= MAX_THREATS else drive.give_up()

    def _away(self) -> np.ndarray:
        """(3,) horizontal, off the surface that is followed and off what comes near."""
        near, tip = self.tip.seen.clearance, self.tip
        away = np.zeros(3) if near is None or not near.threatens else horizontal(near.on_robot - near.on_map)
        if tip.trace.ended is follow_contour:
            return horizontal(away + SURFACE_WEIGHT * horizontal(tip.control.normal))
        return horizontal(away + horizontal(-tip.rotation[:, Z]))  # what stands ahead is unknown: lean back from it

    def side_orientations(self, away: np.ndarray) -> Sequence[np.ndarray]:
        """Upright, or leaning away from the side, which may stand ahead of the stick."""
        return (self.upright, *self.planner.orientations(away))
