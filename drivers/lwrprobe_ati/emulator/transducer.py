"""One emulated transducer: gages behind a matrix, with gain, bias, noise and the end of their range."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

Wrench = Callable[[float], np.ndarray]
"""(6,) N and N·m at an instant on the clock of `time.monotonic`."""

COUNTS = 1_000_000.0
"""Per N and per N·mm, in calibration 1."""
RATINGS = (12.0, 12.0, 17.0, 120.0, 120.0, 120.0)
"""N and N·mm."""
_FULL_SCALE = 32767
_VOLT_COUNTS = 90.25  # counts of calibration 3 (10000 a mV) per step of a gage
_GAIN, _VOLT_GAIN = 610, 76
_MILLI = np.array([1.0, 1.0, 1.0, 1000.0, 1000.0, 1000.0])


def _beams() -> np.ndarray:
    """(6, 6) of an ideal sensor on three beams 120 degrees apart, each with a vertical and a horizontal gage pair."""
    s, h = sqrt(3.0) / 2.0, 0.5
    return np.array(
        [
            [0.0, 0.0, 0.0, -600.0 * s, 0.0, 600.0 * s],
            [0.0, 600.0, 0.0, -600.0 * h, 0.0, -600.0 * h],
            [580.0, 0.0, 580.0, 0.0, 580.0, 0.0],
            [0.0, 3700.0, 3700.0 * s, -3700.0 * h, -3700.0 * s, -3700.0 * h],
            [-3800.0, 0.0, 3800.0 * h, 3700.0 * s, 3800.0 * h, -3700.0 * s],
            [0.0, 2270.0, 0.0, 2270.0, 0.0, 2270.0],
        ]
    )


class Transducer:
    """Input 1..6 of the device.

    Parameters
    ----------
    number : which input
    noise : steps of a gage, standard deviation
    seed : of its noise and of its individual matrix
    """

    def __init__(self, number: int, noise: float, seed: int) -> None:
        self.number = number
        self.calibration = 1
        self.multiply = True
        self.filter = ("MEAN", 8)
        self.automatic, self.powered, self.plugged = False, False, True
        self.bias = np.zeros(6)
        self.biased = False
        self.forced_saturation = False
        self.bridge_low = False
        self.stuck = False
        self.load: Wrench = lambda now: np.zeros(6)
        self.noise = noise
        self._random = np.random.default_rng((seed, number))
        spread = 1.0 + 0.02 * self._random.standard_normal((6, 6))
        cross = 12.0 * self._random.standard_normal((6, 6)) * np.repeat([1.0, 5.0], 3)[:, None]
        self.matrix = np.round(_beams() * spread + cross, 4)
        self.offsets = self._random.integers(28_000, 32_500, 6)
        self.gains = self._random.integers(_GAIN - 40, _GAIN + 40, 6)
        self._inverse = np.linalg.inv(self.matrix)
        self._held: tuple[list[int], bool] | None = None

    def counts(self, now: float) -> tuple[list[int], bool]:
        """Six counts as the chosen calibration gives them, and whether a gage is at its end."""
        if self.stuck and self._held is not None:
            return self._held
        gages, saturated = self._gages(now)
        gages = gages - self.bias
        match self.calibration, self.multiply:
            case 1, True:
                values = self.matrix @ gages
            case 3, True:
                values = _VOLT_COUNTS * np.round(gages * _VOLT_GAIN / _GAIN)
            case _:
                values = gages
        limits = np.iinfo(np.int32)
        self._held = np.clip(np.round(values), limits.min, limits.max).astype(int).tolist(), saturated
        return self._held

    def set_power(self, on: bool) -> None:
        """Switch the input; without a plug nothing is powered by it."""
        self.automatic = on
        self.powered = on and self.plugged

    def plug(self, on: bool) -> None:
        """Put the transducer's plug into the input, or pull it; an input in automatic mode follows."""
        self.plugged = on
        self.powered = on and self.automatic

    def set_bias(self, on: bool, now: float) -> None:
        """Subtract the present reading from now on, or nothing."""
        self.bias = self._gages(now)[0] if on else np.zeros(6)
        self.biased = on

    def table(self) -> list[str]:
        """Lines of the console's `cal`."""
        lines = ["Tr Cal Gain Offset Row Axis G0 G1 G2 G3 G4 G5", "-- --- ---- ------ --- ---- " + "-- " * 6]
        matrix, unit_force, unit_torque, counts, ratings = self._active()
        properties = [
            f"Serial: FT{20000 + self.number}",
            "Date:   2016/11/07",
            f"Part:   {'SI-12-0.12' if self.calibration == 1 else 'VOLTAGE'}",
            f"Force:  {counts:8d} counts/{unit_force}",
            f"Torque: {counts:8d} counts/{unit_torque}",
            f"Mult:   {'ON' if self.multiply else 'OFF'}",
        ]
        for row, (axis, extra) in enumerate(zip(("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"), properties)):
            gages = " ".join(f"{value:10.7g}" for value in matrix[row])
            head = f"{self.number:2d} {self.calibration:3d} {self.gains[row]:4d} {self.offsets[row]:6d} {row:3d}"
            lines.append(f"{head} {axis:>4s} {gages} {extra}")
        lines.append(f"{self.number:2d}    0 MaxRatings:")
        lines.append(f"{self.number:2d}    0 " + " ".join(f"{value:g}" for value in ratings))
        return lines

    def _active(self) -> tuple[np.ndarray, str, str, int, tuple[float, ...]]:
        match self.calibration:
            case 1:
                return self.matrix, "N", "N-mm", int(COUNTS), RATINGS
            case 2:
                return np.eye(6), "N", "N-mm", 1, (32768.0,) * 6
            case _:
                return _VOLT_COUNTS * np.eye(6), "mV", "mV", 10_000, (250.0,) * 6

    def _gages(self, now: float) -> tuple[np.ndarray, bool]:
        exact = self._inverse @ (COUNTS * _MILLI * self.load(now))
        if self.noise:
            exact = exact + self.noise * self._random.standard_normal(6)
        if self.forced_saturation:
            exact[0] = 2.0 * _FULL_SCALE
        saturated = bool(np.abs(exact).max() >= _FULL_SCALE)
        return np.clip(np.round(exact), -_FULL_SCALE, _FULL_SCALE), saturated
