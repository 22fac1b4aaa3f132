"""Random pokes: touches from above at random places, as a rival to measure others by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import Done, InputError
from lwrprobe_strategies.outcomes import Ended, Interruption
from lwrprobe_strategies.planning.paths import Waypoint
from lwrprobe_strategies.planning.retraction import off_surface
from lwrprobe_strategies.skills import search, transit
from lwrprobe_strategies.supervisor import Program, SkillStrategy

OFF = 0.01
"""m off a contact whose normal is not reliable."""


@dataclass(slots=True, frozen=True)
class RandomPokesConfig:
    """Options.

    Attributes
    ----------
    pokes : how many
    seed : of the places
    """

    pokes: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        if self.pokes < 1:
            raise InputError("strategy.pokes", self.pokes, "at least 1")
        if self.seed < 0:
            raise InputError("strategy.seed", self.seed, "at least 0")


class RandomPokes(SkillStrategy):
    """Down at one random place after another, until something is touched or the area's floor is reached."""

    Config: ClassVar[type] = RandomPokesConfig

    def program(self) -> Program:
        """One touch after another."""
        options, area, tip = self.task.options or self.Config(), self.task.area, self.tip
        places = np.random.default_rng(options.seed).uniform(area.lower[:2], area.upper[:2], (options.pokes, 2))
        for x, y in places.tolist():
            try:
                end = yield from search(tip, [(x, y)])
                contact = tip.seen.contact
                if end is Ended.CONTACT and contact is not None and tip.reliable:
                    tip.memory.add(tip.here, contact.point, contact.normal, np.nan)
            except Interruption:
                pass  # whatever stopped it: off, and on to the next place
            yield from self.leave()
        return Done(f"{options.pokes} pokes")

    def leave(self) -> Program:
        """Off what is touched, and up."""
        tip = self.tip
        away = off_surface(tip.seen, tip.normal(), OFF)
        tip.leave()
        top = np.array([*tip.here[:2], self.task.area.upper[2]])
        yield from transit(tip, [*away, Waypoint(top)])
        return Done("")
