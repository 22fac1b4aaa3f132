"""Where the object goes on beyond the area: the sphere stood at the area's border and still touched.

A mesh is closed there all the same; that side of it is the border's, not the object's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area

AT_BORDER = 0.0005
"""m, from the border, within which the sphere's centre stands at it."""
FACING = 0.7
"""Share of the normal that points out of the area, from which on the surface ends inside."""
FEWEST = 3

_SIDES = (("-x", 0, -1.0), ("+x", 0, 1.0), ("-y", 1, -1.0), ("+y", 1, 1.0), ("+z", 2, 1.0))


@dataclass(slots=True, frozen=True)
class OpenBorder:
    """A side of the area through which the object was cut.

    Attributes
    ----------
    side : `-x`, `+x`, `-y`, `+y` or `+z`
    contacts : how many were made with the centre at that border
    lower, upper : (3,) m, the box around them
    """

    side: str
    contacts: int
    lower: np.ndarray
    upper: np.ndarray

    def as_dict(self) -> dict[str, object]:
        """Millimetres."""
        box = [[round(1e3 * float(v), 2) for v in corner] for corner in (self.lower, self.upper)]
        return {"side": self.side, "contacts": self.contacts, "box_mm": box}


def open_borders(points: np.ndarray, normals: np.ndarray, radius: float, area: Area) -> list[OpenBorder]:
    """Sides of the area at which contacts (n, 3) m with unit normals (n, 3) run out; below, the table closes it."""
    found = []
    centres = points + radius * normals
    for side, axis, sign in _SIDES:
        limit = area.upper[axis] if sign > 0.0 else area.lower[axis]
        inside, ends = sign * (limit - centres[:, axis]), sign * normals[:, axis] >= FACING
        # The last line along y may be as far from the border as the sphere reaches; an end seen there says it is none.
        last = axis == 0 and not (ends & (inside < 2.0 * radius)).any()
        out = (inside < (radius if last else 0.0) + AT_BORDER) & ~ends
        if out.sum() >= FEWEST:
            found.append(OpenBorder(side, int(out.sum()), points[out].min(axis=0), points[out].max(axis=0)))
    return found
