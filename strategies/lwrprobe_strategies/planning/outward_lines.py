"""The first lines of `active`: from the middle of the area outwards, each from where something is touched from above.

Nothing is known yet of what the stick may meet. On a path down beside the border, and level from there to the object,
it may be met anywhere; on a surface that is touched from above the sphere is met first.
"""

from __future__ import annotations

from lwrprobe.contracts import Area
from lwrprobe_strategies.planning.lines import Line, X, Y, Z


def outward_lines(area: Area, low: float) -> list[Line]:
    """Lines to the four sides of the area, along y first; the surface is sought down to `low` m."""
    middle = 0.5 * (area.lower + area.upper)
    return [
        Line(
            axis,
            float(middle[1 - axis]),
            float(middle[axis]),
            float(side[axis]),
            low,
            on_surface=True,
            free_to=float(area.upper[Z]),
        )
        for axis in (Y, X)
        for side in (area.upper, area.lower)
    ]
