"""Time between force and pose, from driving over the same place in both directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError

_KNOTS = 24
_LIMIT = 0.1  # s


@dataclass(slots=True, frozen=True)
class TimeSkew:
    """By how much the forces' time stamps are ahead of the poses'.

    Attributes
    ----------
    delay : s, positive when a force is stamped later than the pose at which it arose; subtract it from the force's
        stamp
    sigma : s, standard deviation
    residual : N, what the best delay leaves
    """

    delay: float
    sigma: float
    residual: float


def time_skew(positions: np.ndarray, forces: np.ndarray, times: np.ndarray, limit: float = _LIMIT) -> TimeSkew:
    """Delay of the force against the pose by a back-and-forth scan.

    The force is a function of the place, g(x), whichever way the probe comes; a delay makes the way there and the way
    back differ by twice speed times delay. For each trial delay, g is fitted as a piecewise linear function of the
    place at the earlier time, with one constant for each direction (friction changes sign), and the delay with the
    least squared error is taken.

    Parameters
    ----------
    positions : (n,) m along the scan, or (n, 3); forces : (n,) N, or (n, 3); times : (n,) s, growing
    limit : s, delays are sought within plus and minus this

    Raises
    ------
    InputError : shapes, NaN, times that do not grow, a scan that never comes back, or a force that is the same all
        along (then no delay can be seen)
    """
    t = np.asarray(times, dtype=np.float64)
    x, f = _along(positions), np.asarray(forces, dtype=np.float64).reshape(len(t), -1)
    if x.shape != t.shape or len(t) < 4 * _KNOTS:
        raise InputError("times", (x.shape, t.shape), f"one time for each position, at least {4 * _KNOTS}")
    if not (np.isfinite(t).all() and np.isfinite(x).all() and np.isfinite(f).all()):
        raise InputError("positions", "NaN or infinite values", "finite numbers only")
    if not (np.diff(t) > 0.0).all():
        raise InputError("times", "not growing", "times that grow")
    speed = np.gradient(x, t)
    fast = 0.2 * np.abs(speed).max()
    if min((speed > fast).sum(), (speed < -fast).sum()) < _KNOTS:
        raise InputError("positions", "one direction only", "a scan there and back over the same place")

    inside = (t > t[0] + limit) & (t < t[-1] - limit) & (np.abs(speed) > fast)
    if inside.sum() < 2 * _KNOTS:
        raise InputError("times", f"{t[-1] - t[0]:.3g} s", f"a scan much longer than the limit of {limit} s")
    error = _Error(t, x, f, speed, inside)
    trial = np.linspace(-limit, limit, 81)
    values = np.array([error.at(d) for d in trial])
    best = int(np.argmin(values))
    low, high = trial[max(best - 1, 0)], trial[min(best + 1, len(trial) - 1)]
    delay = _golden(error.at, low, high)
    least, step = error.at(delay), 0.25 * (trial[1] - trial[0])
    bend = (error.at(delay + step) - 2.0 * least + error.at(delay - step)) / step**2
    noise = least / max(f[inside].size - 2 * _KNOTS, 1)
    sigma = float(np.sqrt(2.0 * noise / bend)) if bend > 0.0 else np.inf
    if not sigma < 0.25 * limit or best in (0, len(trial) - 1):
        raise InputError("forces", "no delay fits better than others", "a scan over a place where the force changes")
    return TimeSkew(float(delay), sigma, float(np.sqrt(least / f[inside].size)))


class _Error:
    """Squared error of the best g(x) for a trial delay."""

    def __init__(self, t: np.ndarray, x: np.ndarray, f: np.ndarray, speed: np.ndarray, inside: np.ndarray) -> None:
        self.t, self.x, self.f, self.speed, self.inside = t, x, f[inside], speed, inside

    def at(self, delay: float) -> float:
        early = self.t[self.inside] - delay
        place = np.interp(early, self.t, self.x)
        knots = np.linspace(place.min(), place.max(), _KNOTS)
        cell = np.clip(np.searchsorted(knots, place) - 1, 0, _KNOTS - 2)
        share = (place - knots[cell]) / (knots[1] - knots[0])
        design = np.zeros((len(place), _KNOTS + 1))
        rows = np.arange(len(place))
        design[rows, cell], design[rows, cell + 1] = 1.0 - share, share
        design[:, _KNOTS] = np.sign(np.interp(early, self.t, self.speed))
        # 25 hat functions are well conditioned; a cell without readings is what the small ridge is for
        square = design.T @ design + 1e-9 * len(place) * np.eye(_KNOTS + 1)
        found = np.linalg.solve(square, design.T @ self.f)
        return float(((self.f - design @ found) ** 2).sum())


def _along(positions: np.ndarray) -> np.ndarray:
    """Way along the direction in which the scan is longest."""
    x = np.asarray(positions, dtype=np.float64)
    if x.ndim == 1:
        return x
    if x.ndim != 2 or x.shape[1] != 3 or not np.isfinite(x).all():
        raise InputError("positions", x.shape, "(n,) or (n, 3) finite numbers")
    centred = x - x.mean(axis=0)
    return centred @ np.linalg.svd(centred, full_matrices=False)[2][0]


def _golden(function: Callable[[float], float], low: float, high: float) -> float:
    """Minimum of a unimodal function by golden section (Kiefer 1953), to a thousandth of the interval."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = low, high
    c, d = b - ratio * (b - a), a + ratio * (b - a)
    fc, fd = function(c), function(d)
    while b - a > 1e-3 * (high - low):
        if fc < fd:
            b, d, fd = d, c, fc
            c = b - ratio * (b - a)
            fc = function(c)
        else:
            a, c, fc = c, d, fd
            d = a + ratio * (b - a)
            fd = function(d)
    return 0.5 * (a + b)
