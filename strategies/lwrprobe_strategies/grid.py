"""Grid lines over an exploration area (Rau 2017, section 4.2.3 and 4.2.4, figure 4.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import Area, InputError


@dataclass(slots=True, frozen=True)
class GridLines:
    """Lines along y, `step` apart in x, in the order in which they are driven.

    Attributes
    ----------
    x : (n,) m, of each line: from the first line to the end of the area in +x, then from the first line's
        neighbour to the end in -x
    second_side : index of the first line of the second side, n where there is none
    """

    x: np.ndarray
    second_side: int

    @classmethod
    def over(cls, area: Area, step: float, first: float | None = None) -> GridLines:
        """Lines that cover `area`; `first` is the x [m] of the first line, the area's lower end when None.

        Both ends of the area get a line of their own, so that no strip wider than `step` is left.
        """
        low, high = float(area.lower[0]), float(area.upper[0])
        if not (np.isfinite(step) and step > 0.0):
            raise InputError("strategy.step", step, "a positive length in metres")
        first = low if first is None else min(max(first, low), high)
        up = cls._towards(first, high, step)
        down = cls._towards(first, low, step)[1:]
        return cls(np.array(up + down), len(up))

    @staticmethod
    def _towards(first: float, end: float, step: float) -> list[float]:
        sign = 1.0 if end >= first else -1.0
        count = int(abs(end - first) / step + 1e-9)
        lines = [first + sign * i * step for i in range(count + 1)]
        if abs(end - lines[-1]) > 1e-9:
            lines.append(end)
        return lines

    def __len__(self) -> int:
        return len(self.x)
