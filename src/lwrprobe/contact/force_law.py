"""How hard, how fast, how damped: the force law, chosen from stiffness, delay and force limit.

Symbols: K series stiffness, tau total reaction delay (sensor, network, loop, half a hold), B damping of the
first-order law `v_n = (F - F_target) / B`, a braking, S = K tau / B. For the law with a continuous delay S < pi/2 is
stable and S <= 1/e does not overshoot; S decides everything else as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import InputError
from lwrprobe.contracts.samples import Vector

NO_OVERSHOOT = math.exp(-1.0)
"""Largest stability number without overshoot."""

REFUSED_ABOVE = 1.0
"""Contact is refused beyond this stability number; pi/2 is where the loop itself goes unstable."""


@dataclass(slots=True, frozen=True)
class ForceLaw:
    """Numbers with which a surface is touched and followed.

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
        return max((force - self.force_target) / self.damping, -self.approach_speed)

    def feed(self, force: float, turn: float = 0.0) -> float:
        """m/s along the tangent: full at the target, less the farther the force is off it, and at a turn ahead.

        `turn` [rad] is the angle between the present normal and the one expected next; it costs its sine.
        """
        room = self.force_limit - self.force_target if force > self.force_target else self.force_target
        off = min(abs(force - self.force_target) / room, 1.0)
        return self.contour_speed * (1.0 - 0.9 * off) * (1.0 - 0.75 * abs(math.sin(min(abs(turn), 0.5 * math.pi))))

    def release(self, force: Vector) -> Vector:
        """(3,) m/s that gives way to an overlarge force, along the force itself."""
        magnitude = float(np.sqrt(force @ force))
        if magnitude <= self.force_target:
            return np.zeros(3)
        return force * ((magnitude - self.force_target) / (self.damping * magnitude))


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
    least_speed: float = 2e-4,
    most_speed: float = 0.05,
    reserve: float = 0.8,
) -> ForceLaw | Refusal:
    """Damping and speeds that keep the force below the limit, or the reason why there are none.

    Damping: B = e K tau (S = 1/e) unless given. Approach: `approach_speed` on the force left between threshold and
    limit, and the impact floor `v sqrt(K m)`. Contour: `contour_speed`. A given damping is kept; S above 1/e is
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
    least_speed, most_speed : m/s, below the first a touch is of no use and is refused; the second caps
    reserve : share of the room up to the limit that is planned with

    Raises
    ------
    InputError : values that are not positive and finite, or threshold < target < limit broken
    """
    given = {"stiffness": stiffness, "force_target": force_target, "braking": braking, "least_speed": least_speed}
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
    b = damping if damping is not None else max(math.e * k_tau, 1.0)
    s = k_tau / b
    if s > REFUSED_ABOVE:
        return Refusal(f"stability number K tau / B = {s:.3g} is above {REFUSED_ABOVE:g}: the force would swing", s)
    room = reserve * (force_limit - force_threshold)
    approach = min(approach_speed(room, stiffness, delay, braking), most_speed)
    if tip_mass > 0.0:
        approach = min(approach, room / math.sqrt(stiffness * tip_mass))
    if approach < least_speed:
        return Refusal(
            f"the force would pass {force_limit:g} N at any useful speed: with {stiffness:.3g} N/m and a delay of "
            f"{1e3 * delay:.3g} ms at most {1e3 * approach:.3g} mm/s are safe, {1e3 * least_speed:g} mm/s are needed",
            s,
        )
    contour = min(contour_speed(stiffness, delay, force_target, force_limit, b, turn, slope, reserve), most_speed)
    warnings = []
    if s > NO_OVERSHOOT * (1.0 + 1e-9):
        warnings.append(f"stability number K tau / B = {s:.3g} is above 1/e: the force overshoots")
    if contour < least_speed:
        warnings.append(f"contouring at {1e3 * contour:.3g} mm/s only: stiff surface, long delay")
    return ForceLaw(stiffness, delay, b, approach, contour, force_target, force_limit, tuple(warnings))


def approach_speed(room: float, stiffness: float, delay: float, braking: float) -> float:
    """m/s at which the force overshoots by `room` [N] at most: v = a (-tau + sqrt(tau² + 2 dF / (K a)))."""
    return braking * (-delay + math.sqrt(delay * delay + 2.0 * room / (stiffness * braking)))


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


def sideways_force_limit(torque_range: float, sensor_distance: float, reserve: float = 0.9) -> float:
    """N across the stick at which the torque saturates: T / L; the torque of a nano17 goes before its force."""
    if not (torque_range > 0.0 and sensor_distance > 0.0):
        raise InputError("torque_range", (torque_range, sensor_distance), "positive torque and distance")
    return reserve * torque_range / sensor_distance
