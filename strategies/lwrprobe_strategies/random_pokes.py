"""Random pokes: touches from above at random places."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe_strategies.pokes import Places, Pokes


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


class RandomPokes(Pokes):
    """Touches from above at random places."""

    Config: ClassVar[type] = RandomPokesConfig

    def places(self) -> Places:
        """Anywhere in the area."""
        options, area = self.task.options or self.Config(), self.task.area
        drawn = np.random.default_rng(options.seed).uniform(area.lower[:2], area.upper[:2], (options.pokes, 2))
        for place in drawn:
            yield float(place[0]), float(place[1])
