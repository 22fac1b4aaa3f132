"""How low the probe may come at a place where it searches, and on which circles it comes down there.

The body above the stick is wider than the sphere, and senses no contact. A helix comes down to where the body is above
all that may be there; within that the probe goes straight down. What of the body is wider still has its own circle,
near the top of the area, before the probe goes lower than that part allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Task
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.planning.upright_body import RISE, body, line_height

BESIDE = 0.001
"""m between the body above the stick and what a circle has shown to be free."""
NARROW = 2.0
"""Times the narrowest part of the body, below which a part goes down within the helix."""
RING_DEPTH = 0.4
"""Share of the stick by which the circle lies below the top of the area at most: its soft part alone meets anything."""


@dataclass(slots=True, frozen=True)
class SearchDescent:
    """Circles and heights of a descent.

    Attributes
    ----------
    helix, ring : m, radii of the helix and of the circle around it; 0 where none is needed, or none is of use
    ring_height : m, of the sphere's centre on the circle
    clear : m, lowest height of the sphere's centre at which the body clears whatever the area may hold
    low : m, the same on the axis of the helix once that came down to `clear`
    deep : m, the same once the circle was driven, too
    """

    helix: float
    ring: float
    ring_height: float
    clear: float
    low: float
    deep: float

    @classmethod
    def of(cls, task: Task) -> SearchDescent:
        """For a task's probe and area."""
        probe, top, clear = task.probe, float(task.area.upper[Z]), line_height(task)
        widths = [float(half.max()) for half, _ in body(task)]
        within = max((wide for wide in widths if wide < NARROW * min(widths)), default=0.0)
        helix = max(within + BESIDE - probe.radius, 0.0) if widths and clear < top else 0.0
        ring = max(widths, default=0.0) + BESIDE - probe.radius
        # Between helix and circle nothing is left out that is wider than the stick.
        useful = 0.0 < helix < ring <= helix + 2.0 * (probe.radius + probe.stick_radius)
        inside, swept = clear - probe.radius, helix + probe.radius
        low = _lowest(task, inside, swept, top - probe.radius)
        within_helix = _lowest(task, inside, swept, -np.inf)
        bottom = min((bottom for half, bottom in body(task) if float(half.max()) > swept), default=np.inf)
        height = max(top - RING_DEPTH * probe.sensor_distance, within_helix + bottom - task.clearance_threshold)
        height = min(height, top)
        deep = _lowest(task, inside, swept, height) if useful else low
        return cls(helix, ring if useful and deep < low else 0.0, height, clear, low, deep)


def _lowest(task: Task, inside: float, swept: float, beside: float) -> float:
    """m, lowest height of an upright probe where nothing is above `inside` within `swept`, nor above `beside` around.

    All in metres.
    """
    lowest = float(task.area.lower[Z])
    for half, bottom in body(task):
        tallest = inside if float(half.max()) <= swept else beside
        lowest = max(lowest, tallest + task.clearance_threshold - bottom)
    return min(lowest, line_height(task))


def outline_height(points: np.ndarray, task: Task) -> float:
    """m, lowest at which an upright body is clear of what was touched, points (n, 3)."""
    bottom = min((bottom for _, bottom in body(task)), default=np.inf)
    return max(float(task.area.lower[Z]), float(points[:, Z].max()) + RISE + task.clearance_threshold - bottom)
