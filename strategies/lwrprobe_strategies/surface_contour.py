"""SurfaceContour: a collision threat changes the plane of the contour (Rau 2017, section 5.3.3, figure 5.11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lwrprobe_strategies.coverage import Coverage
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.encounter import on_far_side
from lwrprobe_strategies.planning.lines import ON_FLOOR, Line, X, Y, Z
from lwrprobe_strategies.skills import Procedure

MAX_THREATS = 4
"""On one line; a contour that is threatened again after as many leads nowhere."""
AROUND = 0.5
"""Share of the normal along y, below which a level contour has come around the object's end."""


@dataclass(slots=True, frozen=True)
class SurfaceContourConfig(CoverageConfig):
    """As the shared options, with the thesis's step for this strategy."""

    step: float = 0.015


class SurfaceContour(Coverage):
    """A threat changes the plane of the contour: from the vertical plane through the line to a horizontal one, or back.

    The object is followed without a break. Unlike in the thesis (Rau 2017), where the next threat ends the horizontal
    contour, it ends where the contour comes to the next grid line: that line is followed from the side it is on.
    """

    Config: ClassVar[type] = SurfaceContourConfig

    def leaves_descents(self, line: Line) -> bool:
        """What may be taller than the stick is descended as far as that goes, then followed in a horizontal plane."""
        tall = self.lines.height > self.task.area.lower[Z] + ON_FLOOR
        return not tall and super().leaves_descents(line)

    def avoid(self) -> Procedure | None:
        """Go on in the other plane; give the line up when that has led nowhere.

        On a line along x off the far side of something, and on along the line: it comes into a hollow, or out of one.
        """
        drive, line, level = self.drive, self.drive.frame.line, self.drive.frame.level
        around_the_end = level and abs(self.tip.control.normal[Y]) < AROUND
        if drive.threats > MAX_THREATS or around_the_end or line.on_surface:
            return drive.give_up()
        if line.axis == X:
            # Beside the foot of a near side nothing is known of what the body would meet on its path around.
            onward = on_far_side(self.tip, line) and not line.low and not line.outline
            return drive.retract_onward() if onward else drive.give_up()
        return drive.contour_upright() if level else drive.contour_level()
