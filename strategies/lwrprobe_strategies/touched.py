"""What a strategy remembers of its own way: where it touched, and where it passed without a touch."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

SPACING = 0.0005
"""m, between two places that are remembered."""
NOWHERE = np.full(3, np.nan)


@dataclass(slots=True)
class Touched:
    """Places as rows: sphere's centre (3), contact point (3), normal (3), x of the grid line or NaN off the grid.

    Point and normal are NaN where nothing was touched.
    """

    _touches: list[np.ndarray] = field(default_factory=list)
    _passes: list[np.ndarray] = field(default_factory=list)

    def add(self, centre: np.ndarray, point: np.ndarray, normal: np.ndarray, line_x: float) -> None:
        """Remember a touch unless the last one was as good as there."""
        _remember(self._touches, np.concatenate([centre, point, normal, [line_x]]))
        self.passed(centre, line_x)

    def passed(self, centre: np.ndarray, line_x: float) -> None:
        """Remember that the probe has stood there, touching or not."""
        _remember(self._passes, np.concatenate([centre, NOWHERE, NOWHERE, [line_x]]))

    def __len__(self) -> int:
        return len(self._touches)

    def table(self) -> np.ndarray:
        """(n, 10) all touches."""
        return np.array(self._touches).reshape(-1, 10)

    def way(self) -> np.ndarray:
        """(m, 10) all places, touching or not."""
        return np.array(self._passes).reshape(-1, 10)


def _remember(rows: list[np.ndarray], row: np.ndarray) -> None:
    if rows and np.abs(rows[-1][:3] - row[:3]).max() < SPACING and rows[-1][9] == row[9]:
        return
    rows.append(row)
