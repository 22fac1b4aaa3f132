"""The state machine of the contouring strategies as one table (Rau 2017, figure 5.8).

A collision threat alone is not answered by the table but by the strategy (`Contouring.avoid`): that is where the three
differ.

The source's motion states are X_Y, Z_Y and TO_FIRST_CONTACT; they say in which plane a contour runs (`Plane`). What
the source keeps in flags between them (contact, lost, re-approach, collision) are the states and events here.
"""

from __future__ import annotations

from enum import StrEnum


class Plane(StrEnum):
    """The source's motion states: along which two world axes a contact is followed."""

    X_Y = "X_Y"
    Z_Y = "Z_Y"
    Z_X = "Z_X"
    """On lines across, which the source does not have."""
    TO_FIRST_CONTACT = "TO_FIRST_CONTACT"


class State(StrEnum):
    """What the probe is doing."""

    TRANSFER = "transfer"
    """Free, guarded moves to the start of a line."""
    LINE = "line"
    """Along a grid line, nothing touched."""
    CONTOUR = "contour"
    """Following the surface."""
    REAPPROACH = "re-approach"
    """The contact was lost; looking for the surface around the last touch."""
    RELEASE = "release"
    """The force was overlarge; moving along it."""
    RETREAT = "retreat"
    """Away from a collision threat."""
    TILT = "tilt"
    """Turning the probe about the sphere's centre while it touches."""
    FINISHED = "finished"


class Event(StrEnum):
    """What can happen in a state."""

    ARRIVED = "arrived"
    CONTACT = "contact"
    LOST = "contact lost"
    GAVE_UP = "nothing found"
    STICK = "the stick touches"
    OVERLOAD = "overlarge force"
    RELEASED = "force released"
    NEXT_LINE = "next line reached"
    END_FOUND = "end of the object found"
    TABLE = "table height reached"
    DESCENT = "a wall better climbed"
    LINE_END = "end of the line"
    THREAT = "collision threat"
    TURN = "another orientation wanted"
    BLOCKED = "cannot move on"
    COVERED = "area covered"


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.TRANSFER, Event.ARRIVED): State.LINE,
    (State.TRANSFER, Event.CONTACT): State.CONTOUR,
    (State.TRANSFER, Event.OVERLOAD): State.RELEASE,
    (State.TRANSFER, Event.COVERED): State.FINISHED,
    (State.TRANSFER, Event.BLOCKED): State.TRANSFER,
    (State.LINE, Event.CONTACT): State.CONTOUR,
    (State.LINE, Event.OVERLOAD): State.RELEASE,
    (State.LINE, Event.STICK): State.TRANSFER,
    (State.LINE, Event.LINE_END): State.TRANSFER,
    (State.LINE, Event.BLOCKED): State.TRANSFER,
    (State.CONTOUR, Event.LOST): State.REAPPROACH,
    (State.CONTOUR, Event.OVERLOAD): State.RELEASE,
    (State.CONTOUR, Event.TABLE): State.LINE,
    (State.CONTOUR, Event.LINE_END): State.TRANSFER,
    (State.CONTOUR, Event.DESCENT): State.TRANSFER,
    (State.CONTOUR, Event.BLOCKED): State.TRANSFER,
    (State.REAPPROACH, Event.CONTACT): State.CONTOUR,
    (State.REAPPROACH, Event.GAVE_UP): State.LINE,
    (State.REAPPROACH, Event.TABLE): State.LINE,
    (State.REAPPROACH, Event.LINE_END): State.TRANSFER,
    (State.REAPPROACH, Event.OVERLOAD): State.RELEASE,
    (State.REAPPROACH, Event.BLOCKED): State.TRANSFER,
    (State.CONTOUR, Event.NEXT_LINE): State.CONTOUR,
    (State.CONTOUR, Event.END_FOUND): State.TRANSFER,
    (State.RELEASE, Event.RELEASED): State.CONTOUR,
    (State.RELEASE, Event.LINE_END): State.TRANSFER,
    (State.CONTOUR, Event.TURN): State.TILT,
    (State.TILT, Event.ARRIVED): State.CONTOUR,
    (State.TILT, Event.LOST): State.LINE,
    (State.TILT, Event.OVERLOAD): State.RELEASE,
    (State.TILT, Event.BLOCKED): State.TRANSFER,
    (State.RETREAT, Event.ARRIVED): State.LINE,
    (State.RETREAT, Event.LINE_END): State.TRANSFER,
    (State.RETREAT, Event.BLOCKED): State.TRANSFER,
    (State.RETREAT, Event.OVERLOAD): State.RELEASE,
}
