"""SurfaceContour: a collision threat changes the plane of the contour (Rau 2017, section 5.3.3, figure 5.11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lwrprobe.contracts import Observation
from lwrprobe_strategies.contouring import Contouring, ContouringConfig, Y
from lwrprobe_strategies.course import Z
from lwrprobe_strategies.itinerary import ALMOST
from lwrprobe_strategies.lines import Line
from lwrprobe_strategies.states import Plane, State


@dataclass(slots=True, frozen=True)
class SurfaceContourConfig(ContouringConfig):
    """As the shared options, with the source's step for this strategy."""

    step: float = 0.015


class SurfaceContour(Contouring):
    """A threat turns the contour from Z_Y into X_Y or back; the object is followed without a break.

    Departure: a contour in X_Y that has come as far as the next grid line turns back into Z_Y there and takes that
    line from the side it is on; the source leaves the X_Y contour to the next threat.
    """

    Config: ClassVar[type] = SurfaceContourConfig

    def leaves_descents(self, line: Line) -> bool:
        """What may be taller than the stick is descended as far as that goes, and then followed around in X_Y."""
        tall = self.itinerary.height > self.task.area.lower[Z] + ALMOST
        return not tall and Contouring.leaves_descents(self, line)

    def avoid(self, seen: Observation) -> State:
        """Change the motion state and go on contouring; give the line up when that has led nowhere."""
        self._aborts += 1
        plane = self.course.plane
        around_the_end = plane is Plane.X_Y and abs(self.follower.normal[Y]) < 0.5
        line = self.course.line
        # Beside the foot of a near side nothing is known of what the body would meet on its way around.
        if self._aborts > 4 or around_the_end or line.axis != Y or line.on_surface:
            return self.give_up_line(seen)
        return self.follow_in(Plane.X_Y if plane is Plane.Z_Y else Plane.Z_Y)
