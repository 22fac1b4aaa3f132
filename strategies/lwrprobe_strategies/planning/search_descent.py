"""How low the probe may come at a place where it searches, and on which helices it comes down there.

The body above the stick is wider than the sphere, and feels nothing. A first helix, around the place, comes down to
where the body is above all that may be there. Within that one the probe goes lower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.planning.paths import RISE, body, line_height

BESIDE = 0.001
"""m between the body above the stick and what the first helix has shown to be free."""


@dataclass(slots=True, frozen=True)
class SearchDescent:
    """Radii and heights of the two helices.

    Attributes
    ----------
    inner, outer : m, radii of the helix at the place, and of the one around it
    clear : m, lowest height of the sphere's centre at which the body clears whatever the area may hold
    low : m, the same within the outer helix
    """

    inner: float
    outer: float
    clear: float
    low: float

    @classmethod
    def of(cls, task: Task) -> SearchDescent:
        """For a task's probe and area."""
        inner, clear, needed = task.probe.radius, line_height(task), [float(half.max()) for half, _ in body(task)]
        narrow = [wide for wide in needed if wide < 2.0 * min(needed)]
        outer = inner + max(narrow, default=0.0) + BESIDE - task.probe.radius
        return cls(inner, outer, clear, _lowest_inside(task, clear, outer + task.probe.radius, inner))

    @property
    def twice(self) -> bool:
        """The helix around the place comes first."""
        return self.outer > 0.0 and self.clear > self.low


def _lowest_inside(task: Task, clear: float, swept: float, radius: float) -> float:
    """m, lowest height of an upright probe on a helix of a radius [m], within one that came down to a height.

    `swept` m from the axis nothing is above the height `clear` m less the sphere's radius.
    """
    lowest = float(task.area.lower[Z])
    for half, bottom in body(task):
        inside = radius + float(half.max()) <= swept
        tallest = clear if inside else float(task.area.upper[Z])
        lowest = max(lowest, tallest - task.probe.radius + task.clearance_threshold - bottom)
    return min(lowest, clear)


def outline_height(points: np.ndarray, task: Task) -> float:
    """m, lowest at which an upright body is clear of what was touched, points (n, 3)."""
    bottom = min((bottom for _, bottom in body(task)), default=np.inf)
    return max(float(task.area.lower[Z]), float(points[:, Z].max()) + RISE + task.clearance_threshold - bottom)
