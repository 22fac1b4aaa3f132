"""What a strategy remembers of its own touches."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

SPACING = 0.0005
"""m, between two touches that are remembered."""


@dataclass(slots=True)
class Touched:
    """Touches as rows: sphere's centre (3), contact point (3), normal (3), x of the grid line or NaN off the grid."""

    _rows: list[np.ndarray] = field(default_factory=list)

    def add(self, centre: np.ndarray, point: np.ndarray, normal: np.ndarray, line_x: float) -> None:
        """Remember a touch unless the last one was as good as there."""
        if self._rows and np.abs(self._rows[-1][:3] - centre).max() < SPACING and self._rows[-1][9] == line_x:
            return
        self._rows.append(np.concatenate([centre, point, normal, [line_x]]))

    def __len__(self) -> int:
        return len(self._rows)

    def table(self) -> np.ndarray:
        """(n, 10) all touches."""
        return np.array(self._rows).reshape(-1, 10)
