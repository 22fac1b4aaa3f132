"""Point probing from above, one place after another, as a coordinate measuring machine does it: the baselines.

A sphere that rests where it has come down shows its normal no better than the zero of the sensor allows, which with a
real sensor is ten degrees. So each touch ends with a short slide: the force comes to what is wanted, and the slip shows
the normal.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator

import numpy as np

from lwrprobe.contracts import Done
from lwrprobe_strategies.outcomes import Ended, Interruption
from lwrprobe_strategies.planning.lines import Line, X, Y, Z
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.planning.tracking_frame import TrackingFrame
from lwrprobe_strategies.skills import Procedure, follow_contour, search, transit
from lwrprobe_strategies.supervisor import Program, SkillStrategy

OFF = 0.01
"""m off a contact whose normal is not reliable."""
SLIDE = 0.003
"""m of that slide, at most."""
CERTAIN = 8
"""Samples in a row with a certain normal, after which it ends before."""

Places = Generator[tuple[float, float], float, None]
"""Yields x and y of the next place, m, and is sent the height at which the sphere's centre ended there, m."""


class Pokes(SkillStrategy):
    """Down at one place after another, until something is touched or the area's floor is reached."""

    @abstractmethod
    def places(self) -> Places:
        """Where to touch."""

    def program(self) -> Program:
        """One touch after another."""
        tip, places, count = self.tip, self.places(), 0
        place = next(places, None)
        while place is not None:
            count += 1
            try:
                end = yield from search(tip, [place])
                height = float(tip.here[Z])
                if end is Ended.CONTACT:
                    yield from self.slide()
                contact = tip.seen.contact
                if end is Ended.CONTACT and contact is not None and tip.reliable:
                    tip.memory.add(tip.here, contact.point, contact.normal, np.nan)
            except Interruption:
                height = float(tip.here[Z])  # whatever stopped it: off, and on to the next place
            yield from self.leave()
            try:
                place = places.send(height)
            except StopIteration:
                place = None
        return Done(f"{count} pokes")

    def slide(self) -> Procedure:
        """Towards the middle of the area, until the contact is certain."""
        tip, area, certain = self.tip, self.task.area, 0

        def until() -> Ended | None:
            nonlocal certain
            pressed = float(np.linalg.norm(tip.seen.force)) > 0.5 * self.task.force_target
            certain = certain + 1 if tip.reliable and pressed else 0
            return Ended.CONTACT if certain >= CERTAIN else None

        inward = 1.0 if tip.here[Y] < 0.5 * (area.lower[Y] + area.upper[Y]) else -1.0
        begin = float(tip.here[Y])
        line = Line(Y, float(tip.here[X]), begin, begin + inward * SLIDE, float(tip.here[Z]))
        return (yield from follow_contour(tip, TrackingFrame(line, area), until))

    def leave(self) -> Procedure:
        """Off what is touched, and up."""
        tip = self.tip
        away = off_surface(tip.seen, tip.normal(), OFF, tip.column_is_free)
        tip.leave()
        top = np.array([*tip.here[:2], self.task.area.upper[Z]])
        return (yield from transit(tip, [*away, Waypoint(top)]))
