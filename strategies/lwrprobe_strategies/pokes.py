"""Touches from above, one place after another: rivals to measure strategies by."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator

import numpy as np

from lwrprobe.contracts import Done
from lwrprobe_strategies.outcomes import Ended, Interruption
from lwrprobe_strategies.planning.lines import Z
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.skills import search, transit
from lwrprobe_strategies.supervisor import Program, SkillStrategy

OFF = 0.01
"""m off a contact whose normal is not reliable."""

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
                contact = tip.seen.contact
                if end is Ended.CONTACT and contact is not None and tip.reliable:
                    tip.memory.add(tip.here, contact.point, contact.normal, np.nan)
            except Interruption:
                pass  # whatever stopped it: off, and on to the next place
            height = float(tip.here[Z])
            yield from self.leave()
            try:
                place = places.send(height)
            except StopIteration:
                place = None
        return Done(f"{count} pokes")

    def leave(self) -> Program:
        """Off what is touched, and up."""
        tip = self.tip
        away = off_surface(tip.seen, tip.normal(), OFF)
        tip.leave()
        top = np.array([*tip.here[:2], self.task.area.upper[2]])
        yield from transit(tip, [*away, Waypoint(top)])
        return Done("")
