"""A touch, as the contact estimator sees it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import sqrt

from lwrprobe.contracts.samples import Vector


class Doubt(StrEnum):
    """Why a contact is trusted little."""

    NONE = ""
    NEAR_ZERO = "near-zero force"
    """The force is so small that noise decides its direction."""
    SATURATED = "saturated axis"
    """One of the six axes is at the end of its range."""
    AXIS_MISSES = "axis misses the sphere"
    """The line of action passes the sphere, or meets it at a slope that no friction explains: the stick touches, or
    there are two contacts."""
    STALE = "stale"
    """The sample is late, out of order or a repetition."""
    INVALID = "invalid"
    """No reading (NaN, infinite, out of range), or the bridge voltage is low."""
    UNCONFIRMED = "unconfirmed jump"
    """The sample may be a spike; the next one decides."""
    IMPRECISE = "imprecise"
    """At this force the noise leaves a large expected error of the normal."""
    AMBIGUOUS = "ambiguous normal"
    """The normal turned more than one contact on a moving sphere can: an inner edge with two contacts."""


class Confidence(IntEnum):
    """What a contact may be used for; each level includes those below it."""

    NONE = 0
    """No contact of the sphere explains the force. The normal is the direction of the force."""
    DOUBTFUL = 1
    """There is a normal. It may also be the stick that touches."""
    IMPRECISE = 2
    """The sphere touches; the point is too imprecise for the map."""
    RELIABLE = 3
    """One surface, touched by the sphere: the point may enter the map."""


RELIABLE_FROM = 0.5
"""Confidence score from which on a contact may enter the map."""
NORMAL_AT_HALF_CONFIDENCE = 0.1
"""rad, expected error of a normal whose confidence score is one half, if an estimator is not told otherwise; an error e
has the score 1 / (1 + (e / it)^2)."""
DOUBTFUL_TO = 0.1
"""Confidence score up to which the stick may be what touches."""


@dataclass(slots=True)
class Contact:
    """One estimated contact between sphere and object, in the world frame.

    Attributes
    ----------
    time : s since the start of the run, of the wrench sample it comes from
    point : (3,) m, on the object's surface; on the stick where the force acts there, and not on the sphere
    normal : (3,) unit, out of the object
    force : (3,) N, acting on the sphere
    centre : (3,) m, the sphere's centre at that instant
    confidence_score : 0 (do not use) .. 1, the weight of the point in a reconstruction; see `confidence`
    reason : why the score is low
    """

    time: float
    point: Vector
    normal: Vector
    force: Vector
    centre: Vector
    confidence_score: float = 1.0
    reason: Doubt = Doubt.NONE

    @property
    def confidence(self) -> Confidence:
        """What the contact may be used for."""
        if self.confidence_score >= RELIABLE_FROM:
            return Confidence.RELIABLE
        if self.confidence_score > DOUBTFUL_TO:
            return Confidence.IMPRECISE
        return Confidence.DOUBTFUL if self.confidence_score > 0.0 else Confidence.NONE

    @property
    def magnitude(self) -> float:
        """N, length of the force."""
        return sqrt(self.force.dot(self.force))


@dataclass(slots=True)
class Clearance:
    """The nearest pair between the robot's link shapes (never the sphere) and what has been touched.

    Where a scene has the arm's own links watched, also between them, or between them and the table.

    Attributes
    ----------
    distance : m, 0 in collision, `inf` while the map is empty; never too large, and exact below `required`. Farther
        off, where a run has no need to measure, it may be as little as a third of the true distance
    on_robot, on_map : (3,) m, world frame, the witness points; a moment old where the distance is not exact
    link : name of the link shape
    required : m, the distance that this link has to keep
    against : what the second point lies on: `table`, a link's name, or empty for the map
    """

    distance: float
    on_robot: Vector
    on_map: Vector
    link: str
    required: float = 0.0
    against: str = ""

    @property
    def threatens(self) -> bool:
        """True while the link is nearer than it may come."""
        return self.distance < self.required
