"""How a skill ends: by an outcome of its own, or by an interruption that the supervisor raises in it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import numpy as np


class Ended(StrEnum):
    """Outcomes without data; the value is the event in the run's trace."""

    ARRIVED = "arrived"
    """The place is reached, nothing is touched."""
    CONTACT = "contact"
    """Something is touched that was not touched before."""
    SHAFT_CONTACT = "the stick touches"
    """No contact of the sphere explains the force."""
    NO_CONTACT = "end of the line, nothing touched"
    LINE_END = "end of the line"
    """A contour has come to the end of its line."""
    TABLE = "table height reached"
    CEILING = "upper end of the area reached"
    """A contour would have to leave the area upwards to go on."""
    CIRCLING = "leads in a circle"
    """A contour goes on and on without leading further along its line."""
    UNDERSIDE = "lower edge reached"
    """A contour has come down around an edge below which an upright probe cannot follow."""
    NOTHING_FOUND = "nothing found"
    RELEASED = "force released"
    RETRACTED = "retracted"
    TURNED = "turned"
    """The probe has the new orientation and still touches."""
    EDGE = "edge found"
    NEXT_LINE = "next line reached"
    END_FOUND = "end of the object found"
    DESCENT = "a wall better climbed"


@dataclass(slots=True, frozen=True)
class Lost:
    """The contact was lost.

    Attributes
    ----------
    point : (3,) m, world frame, of the surface touched last
    """

    point: np.ndarray

    def __str__(self) -> str:
        return "contact lost"


Outcome = Ended | Lost


class Interruption(Exception):
    """Raised in the innermost skill by the supervisor. A skill that does not handle it ends by it."""

    event: ClassVar[str]

    def __str__(self) -> str:
        return self.event


class Overload(Interruption):
    """The force is well above the wanted one."""

    event = "overlarge force"


class CollisionThreat(Interruption):
    """A link has come nearer to what was touched than it may."""

    event = "collision threat"


class UnknownSpace(Interruption):
    """The last motion would take the body behind the stick, which senses no contact, where something may be."""

    event = "the body would enter unknown space"


class Blocked(Interruption):
    """The last motion could not be carried out."""

    event = "cannot move on"


class Jammed(Interruption):
    """The tip follows a surface and does not come on: between two walls, or in a corner."""

    event = "no progress"
