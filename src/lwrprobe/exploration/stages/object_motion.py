"""Object-motion monitor: whether the object stays in place, seen from the contacts alone, at no cost in robot time.

Two signs, both exact for whatever stands still:

- The sphere cannot be where the object is. A place of its centre behind an earlier touch, or a touch before a place
  where it has been, says that one of the two is no longer true. Lines that cross tell it.
- A sphere that slides moves across the normal. Its motion into the surface is summed up, less an allowance for normals
  that are wrong (a cumulative sum as in Page 1954): that grows while the object is being pushed, and stays below 0.1 mm
  over whole runs on objects that stand.

An object that is moved by something else, along its own surface, between two lines that never cross, is not seen.

Centres are compared, not contact points: what is wrong with a normal moves the point along the surface by up to
2 mm at an edge, and the centre not at all. Where the stick was held otherwise, errors of the arm's table and of the
probe move the centre as well: such places may contradict each other by as much as they are uncertain.
"""

from __future__ import annotations

from math import dist, hypot, inf

import numpy as np

from lwrprobe.contracts import Confidence, Contact, Doubt, SafetyStop
from lwrprobe.contracts.samples import Vector
from lwrprobe.exploration.stages.object_motion_kernels import deepest

SPACING = 0.0005
"""m between two places that are remembered."""
ASIDE = 0.001
"""m off the line of a touch's normal, up to which a place tells something about it."""
REACH = 1.5
"""Radii along that line; at two the sphere may be on the other side of something thin."""
SURE = 0.8
"""Confidence from which on a touch is compared: where friction turns at an edge the normal may be wrong by 40 degrees
for some samples, whose confidence is low."""
AGREED = 3
"""Contradictions in a row, a place each, that make a movement."""
GIVES_WAY = 0.0006
"""m into the surface, beyond what wrong normals explain, that make a movement."""
WRONG_NORMAL, WRONG_FORCE = 0.15, 0.7
"""Shares of the path that seem to lead into the surface: by a normal that is wrong by 8.6 degrees, and by the direction
of a force with friction up to 1."""
CONFIRMED, FRICTION = 0.3, 0.55
"""Share of `GIVES_WAY` by which the path must lead against the force as well, less this share of the path, which a
friction of 0.65 explains. The normal rests on the torque: an error of lever, gain or crosstalk turns it by degrees, and
a sphere that slides seems to sink in. The force by itself turns by no more than the crosstalk."""
ZERO = 2.0
"""Standard deviations by which the zero may turn the force's direction."""
TOUCHED = 4.0
"""Standard deviations of an axis of the zero, up to which a force may be the zero's alone, and no touch."""
GAP, PERIODS = 0.05, 2.5
"""s, and periods of the sensor, between two samples: from the longer of both on the path between them is not known."""
FORGIVEN = 10
"""Contradictions after which a run whose torque and force disagree ends."""
LET_GO = 12
"""Samples without a force after which a push has come to its end."""

DOWN = np.array([0.0, 0.0, -1.0])
_NOT_TOUCHING = np.zeros(3)


class ObjectMoved(SafetyStop):
    """The object is no longer where it was touched; what was touched before and after must not be put together."""


class ObjectMotionMonitor:
    """Remembers where the sphere was, touching or not, and looks for contradictions.

    Parameters
    ----------
    radius : m, of the sphere
    tolerance : m, by which places may contradict each other
    threshold : N, above it a touch is declared; half of it is a force all the same
    knows_friction : the contacts' normals are free of it
    turned : m for each rad by which the stick is held otherwise, by which places may contradict each other beyond it
    rate : Hz, of the sensor
    """

    def __init__(
        self,
        radius: float,
        tolerance: float,
        threshold: float,
        knows_friction: bool = True,
        turned: float = 0.0,
        rate: float = 125.0,
    ) -> None:
        self._radius, self._tolerance, self._threshold, self._zero = radius, tolerance, threshold, 0.0
        self._slope = WRONG_NORMAL if knows_friction else WRONG_FORCE
        self._places, self._normals, self._sticks = np.empty((1024, 3)), np.zeros((1024, 3)), np.zeros((1024, 3))
        self._turned, self._stick_held = turned, DOWN
        self._gap = max(GAP, PERIODS / rate)
        self._count = self._agreed = 0
        self._last = [inf] * 3
        self._before: tuple[float, list[float], tuple[float, float, float]] | None = None
        self._pushed = self._against_force = self._path = self._inward = 0.0
        self._disagreement = 0.0
        self._let_go = 0
        self._stick = False
        self._push_began = self._doubt_began = 0.0
        self.moved_since: float | None = None
        """s, from which on the object was no longer where it had been; None while it stands."""
        self._worst = self._max_pushed = self._doubtful = 0.0
        self._forgiven = 0

    def see(
        self,
        time: float,
        place: Vector,
        force: Vector,
        contact: Contact | None,
        compliance: float = 0.0,
        disagreement: float = 0.0,
        zero: float = 0.0,
        stick: Vector = DOWN,
    ) -> None:
        """Take in where the sphere's centre is, (3,) m, the force on it, (3,) N, and the contact if there is one.

        `time` counts in s, `compliance` is how far, in m/N, the surface is known to deform. `disagreement` is that of
        torque and force where it is larger than expected, else 0: normals are wrong then, and contradictions follow.
        `zero` is one standard deviation, in N, of an axis of the force's zero by now: a small force points anywhere,
        and may be none. `stick` is the stick's direction, (3,).

        Raises ObjectMoved, and SafetyStop where contradictions go on while torque and force disagree.
        """
        self._doubtful, self._zero, self._stick_held = disagreement, zero, stick
        trusted = contact is not None and contact.confidence is Confidence.RELIABLE
        centre = contact.centre if contact is not None else place
        self._note_stick(force, contact)
        if self._stick:
            self._before = None
        else:
            self._push(time, centre, force, contact if trusted else None, compliance)
        indentation = self._threshold * compliance
        if contact is None:
            if self._is_further(place):
                self._compare(time, place, _NOT_TOUCHING, indentation)
        elif (
            contact.confidence_score >= SURE
            and hypot(*force.tolist()) > TOUCHED * zero
            and self._is_further(contact.centre)
        ):
            # The contact point is corrected for the surface's deformation, the place is not.
            self._compare(time, contact.point + self._radius * contact.normal, contact.normal, indentation)

    def recall(self, place: Vector, contact: Contact | None, stick: Vector = DOWN) -> None:
        """Remember a place of an earlier part of the run, as `see` would have."""
        self._stick_held = stick
        if contact is None:
            centre, normal = place, _NOT_TOUCHING
        elif contact.confidence_score >= SURE:
            centre, normal = contact.point + self._radius * contact.normal, contact.normal
        else:
            return
        if self._is_further(place if contact is None else contact.centre):
            self._remember(centre, normal)

    def report(self) -> dict[str, float | None]:
        """For the summary."""
        return {
            "moved_since_s": self.moved_since,
            "contradiction_mm": round(1e3 * self._worst, 4),
            "pushed_mm": round(1e3 * self._max_pushed, 4),
            "torque_disagreement": round(self._disagreement, 4),
        }

    def _note_stick(self, force: Vector, contact: Contact | None) -> None:
        """Whether the stick is what presses: the path of the sphere then says nothing of the surface."""
        self._let_go = self._let_go + 1 if hypot(*force.tolist()) < 0.25 * self._threshold else 0
        if contact is not None:
            self._stick = contact.reason is Doubt.AXIS_MISSES
        elif self._let_go >= LET_GO:
            self._stick = False

    def _push(self, time: float, place: Vector, force: Vector, contact: Contact | None, compliance: float) -> None:
        """Sum up the motion into the surface."""
        size = hypot(*force.tolist())
        if self._let_go >= LET_GO:
            self._pushed = self._against_force = 0.0
        if size < 0.5 * self._threshold:
            self._before = None
            return
        turned = ZERO * self._zero / size
        normal, slope = (contact.normal, self._slope) if contact is not None else (force / size, WRONG_FORCE + turned)
        here, (nx, ny, nz) = place.tolist(), normal.tolist()
        before, self._before = self._before, (time, here, (nx, ny, nz))
        if before is None or not 0.0 < time - before[0] < self._gap:
            return
        if self._pushed == 0.0:
            self._push_began = time
        (x, y, z), (x0, y0, z0), (mx, my, mz) = here, before[1], before[2]
        # The mean of both normals: along a curve the chord leads into the surface as seen from one of its ends alone.
        out = 0.5 * ((x - x0) * (mx + nx) + (y - y0) * (my + ny) + (z - z0) * (mz + nz))
        self._pushed = max(0.0, self._pushed - out - slope * dist(here, before[1]))
        self._max_pushed = max(self._max_pushed, self._pushed)
        (fx, fy, fz), step = force.tolist(), dist(here, before[1])
        back = ((x - x0) * fx + (y - y0) * fy + (z - z0) * fz) / size
        self._against_force = max(0.0, self._against_force - back - (FRICTION + turned) * step)
        self._path, self._inward = (self._path + step, self._inward - out) if self._pushed > 0.0 else (0.0, 0.0)
        allowed = GIVES_WAY + 2.0 * compliance * size
        if self._pushed <= allowed:
            return
        if self._against_force <= CONFIRMED * allowed:
            if self._path > 0.0:
                self._disagreement = max(self._disagreement, self._inward / self._path)
        else:
            what = f"it gave way at {_coordinates(place)} m, under a force of {size:.2g} N"
            self._moved(what, self._push_began)

    def _compare(self, time: float, centre: Vector, normal: Vector, indentation: float) -> None:
        touching = normal is not _NOT_TOUCHING
        reach = REACH * self._radius
        before = self._places, self._normals, self._sticks, self._count
        found = deepest(*before, centre, normal, self._stick_held, self._turned, touching, ASIDE, reach)
        self._worst = max(self._worst, found)
        if found > self._tolerance + indentation:
            self._agreed += 1
            if self._agreed == 1:
                self._doubt_began = time
            if self._agreed >= AGREED:
                what = f"at {_coordinates(centre)} m the touches contradict each other by {1e3 * found:.1f} mm"
                self._moved(what, self._doubt_began)
            return  # a place in doubt speaks for neither
        if touching:
            self._agreed = 0
        self._remember(centre, normal)

    def _is_further(self, centre: Vector) -> bool:
        """Whether a place is another one than the last; it is the last then."""
        here = centre.tolist()
        if max(abs(a - b) for a, b in zip(here, self._last)) < SPACING:
            return False
        self._last = here
        return True

    def _moved(self, what: str, since: float) -> None:
        if self._doubtful > 0.0:
            self._forgiven += 1
            self._count = self._agreed = 0
            self._pushed = self._against_force = 0.0
            if self._forgiven > FORGIVEN:
                raise SafetyStop(
                    f"torque and force disagree by {self._doubtful:.1%}, and the touches contradict each other: "
                    "calibrate the sensor (lwrprobe calibrate)"
                )
            return
        self.moved_since = since
        raise ObjectMoved(f"the object has moved: {what}; contacts from {since:.2f} s on are left out")

    def _remember(self, place: Vector, normal: Vector) -> None:
        if self._count == len(self._places):
            self._places = np.concatenate([self._places, np.empty_like(self._places)])
            self._normals = np.concatenate([self._normals, np.zeros_like(self._normals)])
            self._sticks = np.concatenate([self._sticks, np.zeros_like(self._sticks)])
        k = self._count
        self._places[k], self._normals[k], self._sticks[k] = place, normal, self._stick_held
        self._count += 1


def _coordinates(place: Vector) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in place) + ")"
