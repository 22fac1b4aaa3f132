"""GridVersion: a collision threat ends the contour, and the grid goes on (Rau 2017, section 5.3.3, figure 5.10)."""

from __future__ import annotations

from lwrprobe_strategies.coverage import Coverage
from lwrprobe_strategies.encounter import on_near_side
from lwrprobe_strategies.skills import Procedure

MAX_THREATS = 2
"""On one line; what still comes near after as many is given up."""


class GridVersion(Coverage):
    """Grid lines along y; a contour is aborted at a collision threat and the grid goes on in its direction."""

    def avoid(self) -> Procedure | None:
        """Abort: retract along the surface's normal, then go on along the line.

        Before an object's near side the line leads into the object: there, and at the third threat on one line, the
        line is given up and the next one begins from above.
        """
        drive, line = self.drive, self.drive.frame.line
        if drive.threats > MAX_THREATS or on_near_side(self.tip, line) or line.outline:
            return drive.give_up()
        return drive.retract_onward()
