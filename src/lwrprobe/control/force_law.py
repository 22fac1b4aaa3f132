"""The force law: how a normal force becomes a velocity, and which damping and speeds are safe.

The law is an admittance of first order, `v_n = (F - F_target) / B`, along the outward normal.

Symbols: K series stiffness, tau total reaction delay (sensor, network, loop, half a hold), B damping, a braking,
S = K tau / B. With a continuous delay the law is stable for S < pi/2 and does not overshoot for S <= 1/e.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from lwrprobe.contracts import InputError
from lwrprobe.control import contour_kernels as kernels

NO_OVERSHOOT = math.exp(-1.0)
"""Largest stability number without overshoot."""

REFUSED_ABOVE = 1.0
"""Contact is refused beyond this stability number; pi/2 is where the loop itself goes unstable."""

MIN_DAMPING = 1.0
"""N s/m; without a delay any damping is stable, and none would mean an infinite velocity."""


def normal_velocity(error: float, damping: float, steady: float, inward: float, outward: float) -> float:
    """m/s along the outward normal: `error / damping + steady`, from -`inward` to `outward`.

    This function is the law. Every loop over a normal force calls it, or its kernel from another kernel.

    Parameters
    ----------
    error : N, force less target force
    damping : N s/m, B
    steady : m/s, the part that takes up a constant error of the tangent; 0 where nothing slides
    inward, outward : m/s, largest speed towards the surface and away from it
    """
    return float(kernels.normal_velocity(error, damping, steady, inward, outward))


def damping_without_overshoot(stiffness: float, delay: float) -> float:
    """N s/m, B = e K tau: the smallest damping without overshoot (S = 1/e)."""
    return float(kernels.damping_without_overshoot(stiffness, delay))


@dataclass(slots=True, frozen=True)
class ForceLaw:
    """The law's numbers along one normal, chosen beforehand.

    Attributes
    ----------
    stiffness : N/m, series stiffness K; delay : s, tau
    damping : N·s/m, B
    approach_speed : m/s, at which a first touch stays below the limit
    contour_speed : m/s, at which a turn ahead stays below the limit and above zero
    force_target, force_limit : N
    warnings : sentences, empty when all is well
    """

    stiffness: float
    delay: float
    damping: float
    approach_speed: float
    contour_speed: float
    force_target: float
    force_limit: float
    warnings: tuple[str, ...] = field(default=())

    @property
    def stability_number(self) -> float:
        """S = K tau / B."""
        return self.stiffness * self.delay / self.damping

    def normal_velocity(self, force: float) -> float:
        """m/s along the outward normal: (F - F_target) / B, inward never faster than the approach."""
        return normal_velocity(force - self.force_target, self.damping, 0.0, self.approach_speed, math.inf)


@dataclass(slots=True, frozen=True)
class Refusal:
    """No safe way to touch this.

    Attributes
    ----------
    reason : one sentence with the numbers
    stability_number : S, as far as it could be computed
    """

    reason: str
    stability_number: float


def choose_force_law(
    stiffness: float,
    delay: float,
    force_target: float,
    force_limit: float,
    *,
    force_threshold: float = 0.0,
    braking: float = 1.0,
    damping: float | None = None,
    turn: float = 0.5 * math.pi,
    slope: float = math.radians(10.0),
    tip_mass: float = 0.0,
    arm_stiffness: float | None = None,
    min_speed: float = 2e-4,
    max_speed: float = 0.05,
    reserve: float = 0.8,
) -> ForceLaw | Refusal:
    """Damping and speeds that keep the force below the limit, or the reason why there are none.

    Damping: B = e K tau (S = 1/e) unless given. Approach: `approach_speed` on the force left between threshold and
    limit, with what a moving mass adds (`run_on`). Contour: `contour_speed`. A given damping is kept; S above 1/e is
    warned of, above 1 refused.

    Parameters
    ----------
    stiffness : N/m, estimated on the first slow touch, or an upper bound
    delay : s
    force_target, force_limit, force_threshold : N
    braking : m/s²
    damping : N·s/m, None = chosen
    turn : rad, sharpest concave corner expected while contouring (a right angle)
    slope : rad, steepest steady misdirection of the tangent that must not break the contact
    tip_mass : kg, what strikes before the loop can act
    arm_stiffness : N/m, of the spring that drives `tip_mass`, part of `stiffness`; None = the mass moves on freely
    min_speed, max_speed : m/s, below the first a touch is of no use and is refused; the second caps
    reserve : share of the force up to the limit that is planned with

    Raises
    ------
    InputError : values that are not positive and finite, or threshold < target < limit broken
    """
    given = {"stiffness": stiffness, "force_target": force_target, "braking": braking, "min_speed": min_speed}
    for name, value in given.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"force.{name}", value, "a positive number")
    if not (math.isfinite(delay) and delay >= 0.0):
        raise InputError("force.delay", delay, "zero seconds or more")
    if not 0.0 <= force_threshold <= force_target < force_limit < math.inf:
        raise InputError("force.limit", (force_threshold, force_target, force_limit), "threshold <= target < limit")
    if damping is not None and not (math.isfinite(damping) and damping > 0.0):
        raise InputError("force.damping", damping, "a positive number")

    k_tau = stiffness * delay
    b = damping if damping is not None else max(damping_without_overshoot(stiffness, delay), MIN_DAMPING)
    s = k_tau / b
    if s > REFUSED_ABOVE:
        return Refusal(f"stability number K tau / B = {s:.3g} is above {REFUSED_ABOVE:g}: the force would swing", s)
    spare = reserve * (force_limit - force_threshold)
    late = delay + run_on(tip_mass, stiffness, arm_stiffness)
    approach = min(approach_speed(spare, stiffness, late, braking), max_speed)
    if approach < min_speed:
        return Refusal(
            f"the force would pass {force_limit:g} N at any useful speed: with {stiffness:.3g} N/m and a delay of "
            f"{1e3 * delay:.3g} ms at most {1e3 * approach:.3g} mm/s are safe, {1e3 * min_speed:g} mm/s are needed",
            s,
        )
    contour = min(contour_speed(stiffness, delay, force_target, force_limit, b, turn, slope, reserve), max_speed)
    warnings = []
    if s > NO_OVERSHOOT * (1.0 + 1e-9):
        warnings.append(f"stability number K tau / B = {s:.3g} is above 1/e: the force overshoots")
    if contour < min_speed:
        warnings.append(f"contouring at {1e3 * contour:.3g} mm/s only: stiff surface, long delay")
    return ForceLaw(stiffness, delay, b, approach, contour, force_target, force_limit, tuple(warnings))


def run_on(mass: float, stiffness: float, arm_stiffness: float | None = None) -> float:
    """s by which a mass that strikes at any speed v seems to add to the delay: it presses with K v times this.

    A mass m at speed v is driven through a spring k_a whose far end keeps that speed, and meets a spring k_c:
    m x'' + (k_a + k_c) x = k_a v t gives F = K v t + v (k_c / (k_a + k_c))^(3/2) sqrt(k_c m) sin(w t), with K of both
    springs in series. Without k_a that is v sqrt(k_c m).

    Parameters
    ----------
    mass : kg
    stiffness : N/m, K, of all that gives way in series
    arm_stiffness : N/m, k_a, more than K; None = nothing drives the mass, and K is k_c
    """
    if mass <= 0.0:
        return 0.0
    if arm_stiffness is None:
        return math.sqrt(mass / stiffness)
    if not stiffness < arm_stiffness < math.inf:
        return 0.0
    met = 1.0 / (1.0 / stiffness - 1.0 / arm_stiffness)
    return met / arm_stiffness * math.sqrt(mass / (arm_stiffness + met))


def approach_speed(spare: float, stiffness: float, delay: float, braking: float) -> float:
    """m/s at which the force overshoots by `spare` [N] at most: v = a (-tau + sqrt(tau² + 2 dF / (K a)))."""
    return braking * (-delay + math.sqrt(delay * delay + 2.0 * spare / (stiffness * braking)))


def peak_force(speed: float, stiffness: float, delay: float, braking: float, force_threshold: float) -> float:
    """N reached on approach: F_th + K (v tau + v² / (2 a))."""
    return force_threshold + stiffness * (speed * delay + speed * speed / (2.0 * braking))


def contour_speed(
    stiffness: float,
    delay: float,
    force_target: float,
    force_limit: float,
    damping: float,
    turn: float = 0.5 * math.pi,
    slope: float = math.radians(10.0),
    reserve: float = 0.8,
) -> float:
    """m/s along the surface, the least of two.

    A concave corner of angle `turn` meets the tip at v sin(turn) for the delay: v <= (F_max - F_set) / (K tau
    sin(turn)). A tangent that is `slope` off costs the first-order law the force B v tan(slope), which must stay
    below the target.
    """
    corner = math.inf
    if stiffness * delay > 0.0:
        corner = reserve * (force_limit - force_target) / (stiffness * delay * max(math.sin(turn), 1e-9))
    return min(corner, reserve * force_target / (damping * math.tan(slope)))
