"""Search: touch down at one place after another until something is there."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.planning.lines import X, Y, Z
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.skills.guarded_move import guarded_move
from lwrprobe_strategies.skills.skill import Procedure, skill
from lwrprobe_strategies.skills.transit import transit
from lwrprobe_strategies.tip import Tip


@skill()
def search(tip: Tip, places: Iterable[tuple[float, float]]) -> Procedure:
    """Over the top of the area to each place, and from there down until something is touched.

    Parameters
    ----------
    places : x and y, m

    Returns
    -------
    Ended.CONTACT, Ended.SHAFT_CONTACT, or Ended.NOTHING_FOUND where the area's floor was reached at all places
    """
    floor, top = float(tip.task.area.lower[Z]), float(tip.task.area.upper[Z])
    for x, y in places:
        up = np.array([tip.here[X], tip.here[Y], top])
        end = yield from transit(tip, [Waypoint(up), Waypoint(np.array([x, y, top]))])
        if end is Ended.ARRIVED:
            end = yield from guarded_move(tip, np.array([x, y, floor]))
        if end is not Ended.NO_CONTACT:
            return end
    return Ended.NOTHING_FOUND
