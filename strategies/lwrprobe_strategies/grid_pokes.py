"""Grid pokes: a height map by touches from above on a grid, as machine tools probe one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe_strategies.pokes import Places, Pokes


@dataclass(slots=True, frozen=True)
class GridPokesConfig:
    """Options.

    Attributes
    ----------
    step : m between neighbouring places
    """

    step: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 < self.step < np.inf:
            raise InputError("strategy.step", self.step, "a positive length in metres")


class GridPokes(Pokes):
    """Touches from above on a grid, row by row, each row from where the last one ended."""

    Config: ClassVar[type] = GridPokesConfig

    def places(self) -> Places:
        """Evenly over the area, from border to border."""
        options, area = self.task.options or self.Config(), self.task.area
        counts = np.maximum(np.round((area.upper - area.lower)[:2] / options.step).astype(int), 1) + 1
        xs, ys = (np.linspace(area.lower[i], area.upper[i], counts[i]).tolist() for i in (0, 1))
        for row, x in enumerate(xs):
            for y in ys[:: -1 if row % 2 else 1]:
                yield x, y
