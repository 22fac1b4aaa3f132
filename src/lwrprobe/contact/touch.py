"""One touch, looked at as a whole: where the surface is without force, and how stiff the touch was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.contracts.samples import Vector

_FEWEST = 4


@dataclass(slots=True, frozen=True)
class TouchFit:
    """Force against commanded depth of one touch, fitted down to zero force.

    Attributes
    ----------
    zero : m, depth at which the force begins
    zero_sigma : m, its standard deviation
    stiffness : N/m, slope at the largest force: the series of all that gives way
    stiffness_sigma : N/m
    hertzian : the curved law was needed
    residual : N, root mean square of what is left
    """

    zero: float
    zero_sigma: float
    stiffness: float
    stiffness_sigma: float
    hertzian: bool
    residual: float


def zero_force_point(displacements: np.ndarray, forces: np.ndarray, least: float = 0.05) -> TouchFit:
    """Extrapolate a slow touch to zero force.

    Two laws for the place in terms of the force: a line, `x = x0 + F / K`, and a line in series with Hertz's sphere on
    flat, `x = x0 + F / K + h F^(2/3)` (Hertz 1881; F proportional to the indentation to the 3/2). The curved one is
    taken only when it is better by more than noise explains (a drop of the squared error by a factor 1 + 12 / n) and
    h is positive.

    Parameters
    ----------
    displacements : (n,) m, depth commanded into the surface
    forces : (n,) N, pressing positive
    least : N, readings below it are taken as not yet touching

    Raises
    ------
    InputError : unequal lengths, NaN, fewer than four readings above `least`, or a force that does not grow
    """
    x, f = np.asarray(displacements, dtype=np.float64), np.asarray(forces, dtype=np.float64)
    if x.shape != f.shape or x.ndim != 1 or not (np.isfinite(x).all() and np.isfinite(f).all()):
        raise InputError("displacements", (x.shape, f.shape), "two lists of finite numbers of the same length")
    pressed = f > least
    if pressed.sum() < _FEWEST:
        raise InputError("forces", f"{pressed.sum()} readings above {least} N", f"at least {_FEWEST}")
    x, f = x[pressed], f[pressed]
    if np.ptp(f) < least or np.ptp(x) <= 0.0 or np.corrcoef(x, f)[0, 1] < 0.5:
        raise InputError("forces", f"a change of {np.ptp(f):.3g} N", "a force that grows with the depth")
    origin = x.mean()
    straight, straight_cov, straight_error = _fit(np.column_stack([np.ones_like(f), f]), x - origin)
    curved, curved_cov, curved_error = _fit(np.column_stack([np.ones_like(f), f, f ** (2.0 / 3.0)]), x - origin)
    better = straight_error > curved_error * (1.0 + 12.0 / len(f))
    hertzian = bool(better and curved[1] > 0.0 and curved[2] > 0.0)
    a, cov = (curved, curved_cov) if hertzian else (straight, straight_cov)
    top = f.max()
    slope = np.array([0.0, 1.0, 2.0 / 3.0 * top ** (-1.0 / 3.0)])[: len(a)]  # dx/dF at the largest force
    compliance = float(slope @ a)
    if not compliance > 0.0:
        raise InputError("forces", "a falling force", "a force that grows with the depth")
    stiffness = 1.0 / compliance
    left = x - origin - (a[0] + a[1] * f + (a[2] * f ** (2.0 / 3.0) if hertzian else 0.0))
    return TouchFit(
        zero=float(origin + a[0]),
        zero_sigma=float(np.sqrt(cov[0, 0])),
        stiffness=stiffness,
        stiffness_sigma=float(stiffness**2 * np.sqrt(slope @ cov @ slope)),
        hertzian=hertzian,
        residual=float(stiffness * np.sqrt(np.mean(left**2))),
    )


def _fit(design: np.ndarray, values: Vector) -> tuple[Vector, np.ndarray, float]:
    """Least squares: parameters, their covariance, sum of squared errors."""
    found, *_ = np.linalg.lstsq(design, values, rcond=None)
    error = values - design @ found
    square = float(error @ error)
    freedom = max(len(values) - design.shape[1], 1)
    return found, np.linalg.pinv(design.T @ design) * square / freedom, square
