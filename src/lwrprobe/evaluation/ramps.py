"""Colour ramps: what a number looks like in a picture, and the same ramp as CSS for its legend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(slots=True, frozen=True)
class Ramp:
    """Evenly spaced colours as #rrggbb, linear between them."""

    stops: tuple[str, ...]

    def rgb(self) -> np.ndarray:
        """(k, 3) of the stops, 0..1."""
        return np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in self.stops]) / 255.0

    def colours(self, share: np.ndarray) -> np.ndarray:
        """(n, 3) 0..1 of shares (n,), which are cut to 0..1."""
        at, stops = np.linspace(0.0, 1.0, len(self.stops)), self.rgb()
        return np.column_stack([np.interp(share, at, stops[:, m]) for m in range(3)])

    def css(self) -> str:
        """A background that shows the ramp from left to right."""
        return f"linear-gradient(90deg,{','.join(self.stops)})"


HEIGHT = Ramp(("#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838"))
"""Dark to bright blue to yellow, for everybody's eyes (cividis)."""

ERROR = Ramp(("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"))
"""Dark where little, bright where much (viridis)."""

DEVIATION = Ramp(("#313695", "#74add1", "#ffffbf", "#f46d43", "#a50026"))
"""Blue below, pale at, red above its middle."""
