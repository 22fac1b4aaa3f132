"""GridVersion: a collision threat ends the contour, and the grid goes on (Rau 2017, section 5.3.3, figure 5.10)."""

from __future__ import annotations

from lwrprobe.contracts import Observation
from lwrprobe_strategies.contouring import Contouring
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.states import State


class GridVersion(Contouring):
    """Grid lines along y; a contour is aborted at a collision threat and the grid goes on in its direction."""

    def avoid(self, seen: Observation) -> State:
        """Abort: leave along the surface's normal, then go on along the line.

        Before an object's near side the line leads into the object: there, and after a second threat on the same
        line, the line is given up and the next one begins from above.
        """
        self._aborts += 1
        onward = self.course.ahead()
        if self._aborts > 2 or self.follower.normal @ onward < -0.3 or self.course.line.rim:
            return self.give_up_line(seen)
        away = self.follower.normal.copy()
        away[Z] = max(away[Z], 0.0)
        return self.retreat(seen, away + 0.2 * onward)
