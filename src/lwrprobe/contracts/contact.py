"""A touch, as the contact estimator sees it."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from lwrprobe.contracts.samples import Vector


@dataclass(slots=True)
class Contact:
    """One estimated contact between sphere and object, in the world frame.

    Attributes
    ----------
    time : s, of the wrench sample it comes from
    point : (3,) m, on the object's surface
    normal : (3,) unit, out of the object
    force : (3,) N, acting on the sphere
    centre : (3,) m, the sphere's centre at that instant
    trust : 0 (do not use) .. 1
    reason : why the trust is low, empty when it is not; one of the names the estimators' page lists
    """

    time: float
    point: Vector
    normal: Vector
    force: Vector
    centre: Vector
    trust: float = 1.0
    reason: str = ""

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
