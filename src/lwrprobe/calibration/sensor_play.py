"""A sensor's hysteresis as a play of each axis: the reading follows the load at up to half a width behind it.

Where the reading stands in the play is told as a share of half the width: 1 = as far above the load as it can be.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.contracts.samples import Vector

NOTICED = 4.0
"""Standard deviations of a reading's noise by which an axis must turn back before it counts as turned."""


def held_back(readings: Sequence[np.ndarray], weights: Sequence[Vector], half: Vector) -> np.ndarray:
    """(t, 6): where the reading of each axis stands while the probe rests before each of t touches.

    A press takes the reading below the load, letting go above it, on axes that were loaded by more than the play. The
    weight of the probe turns with it, which moves the load within the play or the reading along.

    Parameters
    ----------
    readings : t arrays (m, 6) N and N m, of a touch less those before it
    weights : t of (6,) N and N m, of what hangs on the sensor, in the sensor frame
    half : (6,) N and N m, half the width of each axis' play; 0 = an axis without
    """
    wide = np.maximum(half, 1e-12)
    above, before, out = np.zeros(6), weights[0], []
    for touch, weight in zip(readings, weights):
        above = np.clip(above - (weight - before) / wide, -1.0, 1.0)
        out.append(np.where(half > 0.0, above, 0.0))
        peak = np.take_along_axis(touch, np.abs(touch).argmax(axis=0)[None], axis=0)[0]
        above = np.clip(np.clip(above - peak / wide, -1.0, 1.0) + peak / wide, -1.0, 1.0)
        before = weight
    return np.array(out)


def directions(readings: np.ndarray, begin: Vector, noise: Vector) -> np.ndarray:
    """(m, 6) whether each axis of readings (m, 6) has last grown, 1, or fallen, -1, by more than its noise (6,).

    Before it has done either it is as at the `begin` (6,). While a load turns back within the play its reading stands
    still: from its extreme to where it is seen to turn the numbers lead evenly from one to the other.
    """
    noise = NOTICED * noise
    out = np.empty_like(readings)
    extreme, direction = readings[0].copy(), np.where(np.abs(readings[0]) > noise, np.sign(readings[0]), begin)
    since = np.zeros(readings.shape[1], dtype=int)
    for k, now in enumerate(readings):
        onward = (now - extreme) * np.sign(direction)
        back = onward < -noise
        for axis in np.flatnonzero(back):
            between = np.arange(since[axis] + 1, k)
            first, last = direction[axis], -np.sign(direction[axis])
            out[between, axis] = first + (last - first) * (between - since[axis]) / (k - since[axis])
        direction = np.where(back, -np.sign(direction), np.where(onward > noise, np.sign(direction), direction))
        moved = back | (onward > 0.0)
        extreme, since = np.where(moved, now, extreme), np.where(moved, k, since)
        out[k] = direction
    return out
