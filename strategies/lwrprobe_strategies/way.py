"""Ways through free space, and how much is known about each piece of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

import numpy as np


class Pace(Enum):
    """How fast a piece of way may be driven."""

    FREE = auto()
    """Nothing is there: the probe has been there, or its column has, or it lies above the area."""
    FEELING = auto()
    """Something may be touched: as slow as the series of probe and object demands in that direction."""


@dataclass(slots=True)
class Waypoint:
    """Go there on a straight line.

    Attributes
    ----------
    place : (3,) m, of the sphere's centre
    pace : of the way there
    rotation : (3, 3) of the tip to turn to on the way there, None = as it is
    """

    place: np.ndarray
    pace: Pace = Pace.FREE
    rotation: np.ndarray | None = None
