"""What lies between the motors, whose positions an arm reports, and its links."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts import InputError
from lwrprobe.kinematics import gear_kernels as kernels

Array = np.ndarray


class Gears:
    """Play and wave of each joint's harmonic drive. The links follow the motors at up to half of the play.

    The play is engaged as the motors' motion tells: until a joint has moved by its play, the link is taken to stand in
    the middle of it.

    Parameters
    ----------
    waves : rad of a gear's wave to one of the joint
    sine, cosine : (n,) rad, of the wave over the motor's position
    play : rad, width

    Raises InputError for sizes that differ, and for a play that is no finite number from 0 on.
    """

    def __init__(self, waves: float, sine: Array, cosine: Array, play: float) -> None:
        self._waves = float(waves)
        self._sine, self._cosine = np.array(sine, dtype=np.float64), np.array(cosine, dtype=np.float64)
        if self._sine.ndim != 1 or self._sine.shape != self._cosine.shape:
            raise InputError("gears.cosine", self._cosine.shape, f"the shape {self._sine.shape} of gears.sine")
        if not (np.isfinite(play) and play >= 0.0):
            raise InputError("gears.play", play, "a finite angle, zero or more")
        self._half = 0.5 * float(play)
        self._played: Array | None = None
        row = np.zeros((1, self._sine.size))
        self._kernel = entry(kernels.links, row, 0.0, self._sine, self._cosine, 0.0, self._sine, row)

    def links(self, motors: Array) -> Array:
        """(m, n) rad of the motor positions (m, n) that follow the last ones."""
        if self._played is None:
            self._played = motors[0].copy()
        out = np.empty_like(motors)
        self._kernel(motors, self._waves, self._sine, self._cosine, self._half, self._played, out)
        return out
