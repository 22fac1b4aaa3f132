"""The object's stiffness, from the first touches of a run."""

from __future__ import annotations

import numpy as np

from lwrprobe.contact.deflection import Deflection
from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import Contact
from lwrprobe.contracts.samples import Vector

MAX_SECONDS = 0.5
PATIENCE = 6
"""Samples without a new largest force, by 2 % and more, after which the rise is over."""
TOUCHES = 8
"""Touches that are looked at before the question is closed, and what is known by then stays."""
WORTH = 2e-5
"""m/N: a softer object is corrected for; a stiffer one is dented by less than 0.02 mm at 1 N."""
FEWEST = 6
SEEMING = 0.2
"""Share of the depth that may be sliding, seen with a wrong normal."""
APART = 0.15
"""Share of the speed's spread that must not follow from the force, for the two to be distinguished."""
CERTAIN = 0.3
"""Largest standard deviation of a compliance over its value."""
AGREEING = 3.0
"""Standard deviations between a fit and the median of all, up to which it counts."""
MODEL = 0.1
"""Of a compliance: standard deviation that a fit has at least, for what its line leaves out."""
PATH_ERROR = 4e-5
"""m, how far a depth in a touch is off the line that is fitted to it."""
DISCERNIBLE = 0.5
"""Of the probe's own give along the normal: less than that on top of it may as well be an error of the probe's."""


class TouchIdentification:
    """Collects travel and force of each touch and fits the stiffness of the object.

    During a touch the nominal centre moves along the normal by the deflection of probe, arm and object. The share of
    the probe is known (`Deflection.along`); the rest divided by the force is the compliance of the object. The fits of
    touches that agree with their median are weighted by their variances; a single wrong one does not count. On a stiff
    object the full force is reached within one or two samples; then there is nothing to fit, and the indentation is
    negligible.

    Parameters
    ----------
    bend : the probe's own deflection
    threshold : N, above it a touch is declared
    normal_error : rad, how wrong the contacts' normals may be: a sphere that slides on seems to sink in by that share
    """

    def __init__(self, bend: Deflection, threshold: float, normal_error: float = 0.04) -> None:
        self._bend, self._threshold, self._normal_error = bend, threshold, normal_error
        self._rows: list[tuple[float, np.ndarray, np.ndarray]] = []
        self._rotation, self._normal = np.eye(3), np.zeros(3)
        self._fits: list[tuple[float, float]] = []
        self._looked_at = self._not_risen = 0
        self._top = 0.0
        self.compliance = 0.0
        """m/N of the object, 0 while nothing worth a correction was found."""
        self.sigma = float("inf")
        """m/N, standard deviation of `compliance`: it bounds what a correction adds to a contact's error."""
        self.agreed = 0
        """Touches that `compliance` is taken from."""

    @property
    def fitted(self) -> int:
        """Touches that gave a compliance, whether they agree or not."""
        return len(self._fits)

    @property
    def certain(self) -> bool:
        """Whether contacts may be corrected: most of the touches agree, and `sigma` is small beside `compliance`."""
        return 2 * self.agreed > self.fitted and self.sigma < CERTAIN * self.compliance

    @property
    def settled(self) -> bool:
        """Whether the first touch has been evaluated."""
        return self._looked_at > 0

    def update(self, wrench: Wrench, pose: np.ndarray, contact: Contact | None) -> bool:
        """One sample and the tip's nominal pose (4, 4) at its instant; True when a touch has changed `compliance`."""
        if self._looked_at >= TOUCHES or not wrench.usable:
            return False
        if wrench.magnitude < 0.25 * self._threshold:
            return self._judge() if self._rows else False
        self._rows.append((wrench.time, pose[:3, 3].copy(), wrench.world_force.copy()))
        if contact is not None and contact.confidence_score > 0.0:
            self._normal, self._rotation = contact.normal, pose[:3, :3]
        risen = wrench.magnitude > 1.02 * self._top
        self._top = wrench.magnitude if risen else self._top
        self._not_risen = 0 if risen else self._not_risen + 1
        over = self._not_risen >= PATIENCE or wrench.time - self._rows[0][0] > MAX_SECONDS
        return self._judge() if over and self._normal.any() else False

    def _judge(self) -> bool:
        rows, self._rows = self._rows, []
        normal, self._normal = self._normal, np.zeros(3)
        self._top, self._not_risen = 0.0, 0
        if not normal.any():
            return False
        self._looked_at += 1
        places, forces = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
        depths, normal_forces = -(places - places[0]) @ normal, forces @ normal
        rising = slice(0, int(np.argmax(normal_forces)) + 1)
        sunk = float(np.ptp(depths[rising]))
        aside = (places - places[0] + np.outer(depths, normal))[rising]
        slid = float(np.linalg.norm(aside[-1]))
        if self._normal_error * slid > SEEMING * sunk:
            return False
        times = np.array([row[0] for row in rows])
        along = aside @ aside[-1] / max(slid, 1e-12)
        fit = series_compliance(times[rising], depths[rising], normal_forces[rising], along, self._normal_error)
        if fit is None:
            return False
        series, sigma = fit
        own = self._bend.along(self._rotation, normal)
        compliance = series - own
        if not (compliance > max(WORTH, DISCERNIBLE * own) and sigma < CERTAIN * compliance):
            return False
        self._fits.append((compliance, max(sigma, 1e-3 * compliance)))
        self._combine()
        return True

    def _combine(self) -> None:
        values, sigmas = np.array(self._fits).T
        middle = float(np.median(values))
        agree = np.abs(values - middle) <= AGREEING * np.hypot(sigmas, MODEL * middle)
        if not agree.any():  # two that are far apart
            self.compliance, self.sigma, self.agreed = middle, float("inf"), 0
            return
        values, weights = values[agree], sigmas[agree] ** -2
        self.compliance, self.agreed = float(weights @ values / weights.sum()), len(values)
        spread = float(np.std(values)) / np.sqrt(max(len(values) - 1, 1))
        self.sigma = max(float(weights.sum()) ** -0.5, spread, MODEL * self.compliance / np.sqrt(len(values)))


def series_compliance(
    times: Vector, depths: Vector, forces: Vector, aside: Vector | None = None, normal_error: float = 0.0
) -> tuple[float, float] | None:
    """m/N of everything in series and its standard deviation, from a press; None where it is not determined.

    Least squares on `x = x0 + c F - d v + e s`. The term in speed covers the damping of the surface and a time offset
    between force and position. The term in `aside`, the path along the surface, covers the error of the normal, held
    near zero by `normal_error` rad. Where force and speed are proportional, as under a first-order force law, the
    speed is left out. Times, paths (positive when pressing, and along the surface) and forces are (n,) in s, m, N.
    """
    if len(times) < FEWEST or np.ptp(forces) <= 0.0 or (np.diff(times) <= 0.0).any():
        return None
    speeds = np.gradient(depths, times)
    plain = np.column_stack([np.ones_like(forces), forces])
    apart = speeds - plain @ np.linalg.lstsq(plain, speeds, rcond=None)[0]
    changing = np.std(speeds) > 1e-6 * np.abs(speeds).max()
    design = np.column_stack([plain, speeds]) if changing and np.std(apart) > APART * np.std(speeds) else plain
    if aside is not None and np.ptp(aside) > PATH_ERROR and normal_error > 0.0:
        prior = np.zeros(design.shape[1] + 1)
        prior[-1] = PATH_ERROR / normal_error
        design = np.vstack([np.column_stack([design, aside]), prior])
        depths = np.append(depths, 0.0)
    scale = np.abs(design).max(axis=0)
    found, _, rank, _ = np.linalg.lstsq(design / scale, depths, rcond=1e-6)
    if rank < design.shape[1]:
        return None
    left = depths - design @ (found / scale)
    spread = np.linalg.pinv(design.T @ design) * float(left @ left) / max(len(depths) - design.shape[1], 1)
    return float(found[1] / scale[1]), float(np.sqrt(spread[1, 1]))
