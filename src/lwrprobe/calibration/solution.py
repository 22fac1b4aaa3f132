"""All unknowns of a calibration in one nonlinear least-squares problem, with their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from lwrprobe.calibration.model import Model
from lwrprobe.calibration.parameters import Parameters
from lwrprobe.calibration.priors import Priors
from lwrprobe.calibration.touches import Touch
from lwrprobe.contracts import InputError, LwrprobeError, Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.kinematics import Robot

FEWEST = 8
"""Touches of the sphere below which nothing is solved."""
MAX_RESIDUAL = 2e-4
"""m, root mean square of the touches' residuals above which a calibration is refused."""
MIN_PLACE_ERROR = 2e-6
"""m, by which a touch may be off in a world without gears."""
ROUNDS = 4
"""Solutions after which the error of a touch is no longer estimated anew."""
SETTLED = 0.3
"""Relative change of that error below which it is known."""
SUSPICIOUS = 4.0
"""Standard deviations by which the sum of the radii may differ from what is stated."""
RADIUS_SEEN = 5e-5
"""m, standard deviation of the sum of the radii from the touches alone, above which a wrong diameter would not show."""
APART = 4
"""Touches at the begin and at the end that say too little of a sphere that moves."""
SEEN = 1e-3
"""m, standard deviation of a shift from which on nothing is known of it."""
EXPLAINED = 0.6
"""Share of the touches' residuals that is left where the sphere really moved. Four numbers more leave 0.95 of 45."""
TELLING = 25.0
"""Square of the standard deviations that such a motion must be from none: few touches that fit say nothing of it."""
GEARS = 5e-5
"""m, by which gears move a touch; what is more may be a sphere that moved."""
LOST = 3.0
"""Times that a part of the touches must be worse than the rest to be the cause."""


class CalibrationRefused(LwrprobeError):
    """The touches do not fit together, or do not suffice; the message names the likely cause."""


@dataclass(slots=True, frozen=True)
class Solution:
    """The unknowns with their covariance.

    Attributes
    ----------
    parameters : which number is which
    x : (m,) values
    covariance : (m, m)
    place_error : m, standard deviation of one touch that the residuals show
    residual : m, root mean square of the touches' residuals
    per_touch : (t,) m
    """

    parameters: Parameters
    x: Vector
    covariance: np.ndarray
    place_error: float
    residual: float
    per_touch: Vector

    def value(self, name: str) -> Vector:
        """Part of the solution by name (`Parameters.slices`)."""
        return self.x[self.parameters.slices[name]]

    def sigma(self, name: str) -> Vector:
        """Standard deviations of that part."""
        return np.sqrt(np.diag(self.covariance)[self.parameters.slices[name]])

    def visible(self, name: str) -> np.ndarray:
        """Whether the touches have at least halved the prior's standard deviation of each number of that part."""
        return self.sigma(name) < 0.5 * self.parameters.sigma[self.parameters.slices[name]]


def solve(
    robot: Robot,
    probe: Probe,
    touches: list[Touch],
    reference_radius: float,
    centres: np.ndarray,
    table: float,
    priors: Priors | None = None,
) -> Solution:
    """Fit all unknowns to the touches (Levenberg and Marquardt; the prior is a part of the observations).

    The error that a touch has as a whole, from gears that no parameter describes, is estimated from the residuals
    (variance component, iterated).

    Parameters
    ----------
    robot, probe : as the scene states them
    touches : measured
    reference_radius : m, of the reference sphere
    centres : (p, 3) m, first guesses of the reference sphere's places; table : m, of the table's height
    priors : None = the makers' tolerances

    Raises
    ------
    InputError : a radius that is no positive length, touches with NaN, or fewer than eight of the sphere
    CalibrationRefused : residuals above 0.2 mm, with the likely cause
    """
    priors = Priors() if priors is None else priors
    _check(touches, reference_radius)
    gaps = np.concatenate([probe.force_range, probe.torque_range])
    parameters = Parameters.of(robot.n, probe, np.atleast_2d(centres), table, gaps, priors)
    model = Model(robot, probe, touches, reference_radius, parameters, priors)
    x = parameters.mean.copy()
    for _ in range(ROUNDS):
        # MINPACK uses one thread; the other methods' singular values keep all cores waiting for each other.
        fit = least_squares(
            model.residuals, x, model.jacobian, method="lm", x_scale=parameters.sigma, xtol=1e-6, ftol=1e-5
        )
        x = fit.x
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)
        known = 1.0 - np.diag(covariance) / parameters.sigma**2
        taken = _taken(known, parameters)
        left = model.per_touch(x)
        found = float(np.sqrt(left @ left / max(len(left) - taken, 0.2 * len(left))))
        found = max(found, MIN_PLACE_ERROR)
        settled = abs(found - model.place_error) < SETTLED * model.place_error
        if settled:
            break
        model.set_place_error(found)
    left = model.per_touch(x)
    solution = Solution(parameters, x, covariance, model.place_error, float(np.sqrt(np.mean(left**2))), left)
    refuse_bad(solution, touches)
    refuse_moved(model, x)
    refuse_few(solution, touches)
    return solution


def refuse_moved(model: Model, x: Vector) -> None:
    """Raise CalibrationRefused where the touches tell of a reference sphere that moved between two of them.

    Unknowns of the arm take up a part of such a motion, and the touches' error is estimated from what remains. So each
    instant is asked: by how much would the sphere have to have moved then for the touches to agree best?
    """
    before = float(np.sqrt(np.mean(model.per_touch(x) ** 2)))
    model.set_place_error(min(model.place_error, GEARS))
    jacobian, left = model.jacobian(x), model.residuals(x)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    best, since, shift, step = 0.0, 0, np.zeros(3), np.zeros(len(x))
    for touch in range(APART, model.touches - APART):
        rows = model.by_shift(x, touch)
        across = jacobian.T @ rows
        information = rows.T @ rows - across.T @ covariance @ across
        slope = rows.T @ left - across.T @ covariance @ (jacobian.T @ left)
        if np.linalg.eigvalsh(information)[0] > 1.0 / SEEN**2:
            found = -np.linalg.solve(information, slope)
            if found @ information @ found > best:
                best, since, shift = float(found @ information @ found), touch, found
                step = -covariance @ (jacobian.T @ (left + rows @ found))
    moved = float(np.linalg.norm(shift))
    if moved <= MAX_RESIDUAL or best < TELLING:
        return
    after = float(np.sqrt(np.mean(model.per_touch(x + step, shift, since) ** 2)))
    if after < EXPLAINED * before:
        raise CalibrationRefused(
            f"the touches contradict each other: the reference sphere has moved by {1e3 * moved:.2f} mm before touch "
            f"{since + 1} of {model.touches}, at most {1e3 * MAX_RESIDUAL:g} mm are allowed: clamp the sphere"
        )


def refuse_bad(solution: Solution, touches: list[Touch]) -> None:
    """Raise CalibrationRefused, with the likely cause, where the touches contradict each other or the scene."""
    off, sigma = _radius_alone(solution)
    assumed = float(solution.parameters.sigma[solution.parameters.slices["radius"]][0])
    if sigma <= RADIUS_SEEN and abs(off) > SUSPICIOUS * np.hypot(assumed, sigma):
        raise CalibrationRefused(
            f"the sum of the radii differs by {1e3 * off:+.3f} mm from what is stated: the diameter of the reference "
            "sphere, or `probe.radius`, is wrong"
        )
    if solution.residual > MAX_RESIDUAL:
        raise CalibrationRefused(
            f"the touches contradict each other by {1e3 * solution.residual:.3f} mm, at most {1e3 * MAX_RESIDUAL:g} mm "
            f"are allowed: {_cause(solution.per_touch, touches)}"
        )


def refuse_few(solution: Solution, touches: list[Touch]) -> None:
    """Raise CalibrationRefused where a wrong diameter would not show."""
    sigma = _radius_alone(solution)[1]
    if sigma > RADIUS_SEEN:
        count = sum(touch.target == "sphere" for touch in touches)
        raise CalibrationRefused(
            f"{count} touches of the sphere show the sum of the radii to {1e3 * sigma:.3f} mm only, "
            f"{1e3 * RADIUS_SEEN:g} mm are needed for a wrong diameter to be noticed: too many touches are missing, "
            "lie on one side, or do not agree"
        )


def _radius_alone(solution: Solution) -> tuple[float, float]:
    """m, by which the sum of the radii differs from the stated one, and its standard deviation: what the touches show.

    The stated radius was one of the observations. Without it a wrong diameter is not drawn towards what is stated.
    """
    at = solution.parameters.slices["radius"]
    before, after = float(solution.parameters.sigma[at][0]) ** 2, float(solution.covariance[at, at][0, 0])
    alone = 1.0 / max(1.0 / after - 1.0 / before, 1e-12 / before)
    return alone / after * float((solution.x - solution.parameters.mean)[at][0]), float(np.sqrt(alone))


def _cause(left: Vector, touches: list[Touch]) -> str:
    """What most likely makes the residuals (t,) m of the touches large."""
    sphere = np.array([touch.target == "sphere" for touch in touches])
    if np.sqrt(np.mean(left[~sphere] ** 2)) > LOST * np.sqrt(np.mean(left[sphere] ** 2)) if (~sphere).any() else False:
        return "the touches of the table do not lie in a plane"
    mine = left[sphere]
    worst = np.sort(np.abs(mine))[::-1]
    few = max(1, len(mine) // 10)
    if np.sqrt(np.mean(worst[few:] ** 2)) < MAX_RESIDUAL / LOST:
        return f"{few} of {len(mine)} touches did not meet the sphere with the probe's sphere"
    half = len(mine) // 2
    early, late = np.std(mine[:half]), np.std(mine[half:])
    if max(early, late) > LOST * min(early, late) or abs(mine[:half].mean() - mine[half:].mean()) > 2.0 * min(
        early, late
    ):
        return "the reference sphere has moved during the calibration"
    return (
        "a stick or a holder that is loose, a reference that is no sphere, or a robot whose kinematic table is far "
        "from the one stated"
    )


def _check(touches: list[Touch], reference_radius: float) -> None:
    if not (np.isfinite(reference_radius) and reference_radius > 0.0):
        raise InputError("reference_radius", reference_radius, "a positive length")
    count = sum(touch.target == "sphere" for touch in touches)
    if count < FEWEST:
        raise InputError("touches", count, f"at least {FEWEST} touches of the reference sphere")
    for touch in touches:
        if not all(
            np.isfinite(part).all() for part in (touch.times, touch.wrenches, touch.arm_times, touch.arm_joints)
        ):
            raise InputError("touches", "NaN or infinite values", "finite numbers only")
        if len(touch.times) < 6:
            raise InputError("touches", len(touch.times), "at least six samples a touch")


def _taken(known: Vector, parameters: Parameters) -> float:
    """How many numbers the places have determined: each counts by how much the touches determine it."""
    places = ("tool", "centre", "radius", "arm", "surface", "dh", "ripple", "table")
    return float(sum(known[parameters.slices[name]].sum() for name in places))
