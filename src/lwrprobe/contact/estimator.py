"""Where the sphere is touched: estimators with one signature, chosen by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from typing import Final, Protocol

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contact import fused_kernels, kernels
from lwrprobe.contact.wrench import Wrench, WrenchNoise
from lwrprobe.contracts import Contact, InputError, Probe, UnknownNameError
from lwrprobe.contracts.contact import NORMAL_AT_HALF_CONFIDENCE, Doubt
from lwrprobe.contracts.samples import Vector

REASONS: Final = tuple(Doubt)
"""Why a contact is trusted little, in the order of the kernels' reasons. *near-zero force* is one under
`Settings.near_zero`, *axis misses the sphere* one that no friction up to `Settings.max_friction` explains, *imprecise*
one whose expected error is above `Settings.trusted_error`; `fused` alone sees an *ambiguous normal*."""


@dataclass(slots=True, frozen=True)
class Settings:
    """What all estimators have in common.

    Attributes
    ----------
    noise : of one conditioned reading; None = the probe's resolutions (`WrenchNoise.of`)
    near_zero : N, below it a force has no direction
    max_friction : largest friction coefficient thought possible
    trusted_error : rad, expected error of the normal at which a contact is just trusted
    lever_error : m, how well the sphere's centre is known in the sensor frame (see `lwrprobe calibrate`)
    zero_error : N, how far the zero of a force axis may have drifted since the bias was taken; torque axes in
        proportion to the resolutions
    zero_time : s within which the zero wanders by that much (`fused`)
    lag : N, width of the hysteresis of a force axis; torque axes in proportion to their ranges (`fused`)
    indentation : m/N, of the object under the sphere; the point is given where the surface lies without force
    speed_noise : m/s, standard deviation of the velocity's components at least; changes from sample to sample show
        whether it is more (`fused`)
    hidden_compliance : m/N, of all compliance that the centre's velocity does not show (`fused`)
    """

    noise: WrenchNoise | None = None
    near_zero: float = 0.05
    max_friction: float = 1.5
    trusted_error: float = NORMAL_AT_HALF_CONFIDENCE
    lever_error: float = 5e-5
    zero_error: float = 0.003
    zero_time: float = 120.0
    lag: float = 0.0
    indentation: float = 0.0
    speed_noise: float = 5e-4
    hidden_compliance: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("near_zero", "max_friction", "trusted_error", "zero_time"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"contact.{name}", value, "a positive number")
        for name in ("lever_error", "zero_error", "lag", "indentation", "speed_noise", "hidden_compliance"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"contact.{name}", value, "a finite number, zero or more")


class Estimator(Protocol):
    """One signature for all."""

    name: str

    def estimate(self, wrench: Wrench, centre: Vector, rotation: np.ndarray, velocity: Vector) -> Contact:
        """The contact of one conditioned wrench; never raises, never NaN, confidence 0 and a reason when there is none.

        A contact with confidence 0 still has a normal along the force, along which the tip can yield; it is the zero
        vector where there is no force.

        Parameters
        ----------
        wrench : sensor frame
        centre : (3,) m, the sphere's centre in the world (where it really is, see `Deflection`)
        rotation : (3, 3), sensor frame in the world
        velocity : (3,) m/s, of the sphere's centre in the world
        """

    def reset(self) -> None:
        """Forget what earlier samples showed of the surface, before a jump to another place."""

    def set_indentation(self, compliance: float) -> None:
        """m/N of the object under the sphere from now on (`Settings.indentation`); raises InputError."""

    def set_lever_error(self, error: float) -> None:
        """m, error of torque over force from now on (`Settings.lever_error`)."""

    def set_noise(self, noise: WrenchNoise) -> None:
        """Noise of one reading from now on (`Settings.noise`)."""


class KernelEstimator:
    """What all estimators can be told later: it is in the parameters (n,) of their kernel, see `shared_params`."""

    _params: np.ndarray

    def set_indentation(self, compliance: float) -> None:
        """See `Estimator.set_indentation`."""
        self._params[kernels.P_INDENTATION] = as_indentation(compliance)

    def set_lever_error(self, error: float) -> None:
        """See `Estimator.set_lever_error`."""
        self._params[kernels.P_LEVER_ERROR] = error

    def set_noise(self, noise: WrenchNoise) -> None:
        """See `Estimator.set_noise`."""
        self._params[kernels.P_FORCE_NOISE], self._params[kernels.P_TORQUE_NOISE] = noise.force, noise.torque


class SampleEstimator(KernelEstimator):
    """An estimator that looks at one sample alone.

    `force_direction` is the thesis's (Rau 2017): `point = centre - r f/|f|`, wrong by r sin(atan(mu)) along the surface
    under friction mu. `wrench_axis` is intrinsic contact sensing (Bicchi, Salisbury, Brock 1993, sec. 4): a contact
    transmits a pure force, so its point is where the line of action of the wrench enters the sphere.
    """

    def __init__(self, name: str, kernel: Callable, params: np.ndarray) -> None:
        self.name = name
        self._params = params
        self._given = Given()
        self._kernel = entry(kernel, self._given.row, params, np.empty(kernels.OUTPUT))

    def estimate(self, wrench: Wrench, centre: Vector, rotation: np.ndarray, velocity: Vector) -> Contact:
        """See `Estimator.estimate`."""
        out = np.empty(kernels.OUTPUT)
        reason = self._kernel(self._given.fill(wrench, centre, rotation, velocity), self._params, out)
        return self._given.contact(out, reason)

    def reset(self) -> None:
        """Nothing is remembered."""


def make_estimator(name: str, probe: Probe, settings: Settings | None = None) -> Estimator:
    """The estimator of that name; raises UnknownNameError listing the known ones."""
    settings = Settings() if settings is None else settings
    check_estimator(name)
    return ESTIMATORS[name](probe, settings)


def check_estimator(name: str) -> None:
    """Raises UnknownNameError listing the known estimators, without the kernels that making one takes."""
    if name not in ESTIMATORS:
        raise UnknownNameError("contact.estimator", name, ESTIMATORS)


def as_indentation(compliance: float) -> float:
    """A compliance [m/N] that may be taken off."""
    if not (np.isfinite(compliance) and compliance >= 0.0):
        raise InputError("contact.indentation", compliance, "a finite number, zero or more")
    return float(compliance)


def shared_params(probe: Probe, settings: Settings, size: int = kernels.P_OWN) -> np.ndarray:
    """Parameter array of the kernels, with room for an estimator's own."""
    if not (np.isfinite(probe.radius) and probe.radius > 0.0 and np.isfinite(probe.sensor_distance)):
        raise InputError("probe", (probe.radius, probe.sensor_distance), "a positive radius and a finite distance")
    noise = settings.noise or WrenchNoise.of(probe)
    params = np.zeros(size)
    params[kernels.P_RADIUS], params[kernels.P_DISTANCE] = probe.radius, probe.sensor_distance
    params[kernels.P_COMPLIANCE : kernels.P_COMPLIANCE + 3] = probe.compliance
    params[kernels.P_FORCE_NOISE], params[kernels.P_TORQUE_NOISE] = noise.force, noise.torque
    params[kernels.P_NEAR_ZERO] = settings.near_zero
    params[kernels.P_MAX_SINE] = np.sin(np.arctan(settings.max_friction))
    params[kernels.P_TRUSTED_ERROR] = settings.trusted_error
    params[kernels.P_LEVER_ERROR] = settings.lever_error
    params[kernels.P_INDENTATION] = settings.indentation
    ratio = probe.torque_resolution / probe.force_resolution if probe.force_resolution > 0.0 else 0.0
    along, across = ratio * settings.zero_error, probe.sensor_distance * settings.zero_error
    params[kernels.P_ZERO_ALONG] = (along / probe.radius) ** 2
    params[kernels.P_ZERO_ACROSS] = (along**2 + across**2) / probe.radius**2
    return params


class Given:
    """One estimate's input as the kernels want it: `row` (INPUT,)."""

    def __init__(self) -> None:
        self.row = np.zeros(kernels.INPUT)
        self._centre = self.row[6:9]
        self._pack = Struct(f"{kernels.INPUT}d").pack_into
        self._memory = self.row.data.cast("B")

    def fill(self, wrench: Wrench, centre: Vector, rotation: np.ndarray, velocity: Vector) -> np.ndarray:
        """The row, with these in it."""
        # Number by number: less than half the time of an assignment to each part of the array.
        self._pack(
            self._memory, 0, *wrench.force.tolist(), *wrench.torque.tolist(), *centre.tolist(), *velocity.tolist(),
            *rotation.ravel().tolist(), wrench.status, wrench.time, wrench.zeroing,
        )  # fmt: skip
        return self.row

    def contact(self, out: np.ndarray, reason: int) -> Contact:
        """The kernels' output as a `Contact`."""
        confidence = out.item(kernels.O_CONFIDENCE)
        time = self.row.item(kernels.I_TIME)
        return Contact(time, out[0:3], out[3:6], out[6:9], self._centre.copy(), confidence, REASONS[reason])


class FusedEstimator(KernelEstimator):
    """Both single-sample estimators with their noise models, friction estimated while sliding, and previous normals.

    Each source is a quadratic form in the normal, weighted by its variance (see `fused_kernels`): the wrench axis; the
    velocity, which is perpendicular to the normal while the sphere slides; friction, which opposes the slip, so that
    force, slip and normal lie in one plane; the friction angle, estimated by a scalar Kalman filter; the previous
    normal, extrapolated with its recent rate of turn. Velocity and friction are used only while the wrench axis does
    not contradict them (chi-squared test, one sample and running mean), because a probe that sticks does not slide.
    While the sphere slides, the normal is known without the torque. The remaining torque is then attributed to the
    drift of the sensor's zero, which a long lever magnifies: 10 mN at 50 mm turn the wrench axis of 1 N by 6 degrees.
    """

    name = "fused"

    def __init__(self, probe: Probe, settings: Settings) -> None:
        self._params = shared_params(probe, settings, fused_kernels.PARAMS)
        self._params[fused_kernels.P_SPEED_NOISE] = settings.speed_noise
        self._params[fused_kernels.P_HIDDEN_COMPLIANCE] = settings.hidden_compliance
        self._params[fused_kernels.P_SLIP_ANGLE] = 0.003
        self._params[fused_kernels.P_MIN_SPEED] = max(5e-4, 1.5 * settings.speed_noise)
        self._params[fused_kernels.P_MEMORY] = 0.25
        self._params[fused_kernels.P_WALL_CLEARANCE] = 1.5e-4
        self._params[fused_kernels.P_ZERO_TIME] = settings.zero_time
        self._params[fused_kernels.P_LAG] = settings.lag
        self._state = np.zeros(fused_kernels.STATE)
        self._state[fused_kernels.S_FRICTION] = 0.3
        self._state[fused_kernels.S_FRICTION_VAR] = 0.3**2
        self._given = Given()
        out = np.empty(kernels.OUTPUT)
        self._kernel = entry(fused_kernels.fused, self._given.row, self._params, self._state, out)

    def estimate(self, wrench: Wrench, centre: Vector, rotation: np.ndarray, velocity: Vector) -> Contact:
        """See `Estimator.estimate`."""
        out = np.empty(kernels.OUTPUT)
        reason = self._kernel(self._given.fill(wrench, centre, rotation, velocity), self._params, self._state, out)
        return self._given.contact(out, reason)

    def reset(self) -> None:
        """Forget the surface; keep the estimate of the friction."""
        self._state[fused_kernels.S_BEGUN] = 0.0

    @property
    def friction(self) -> tuple[float, float]:
        """Friction coefficient as estimated so far, and its standard deviation."""
        state = self._state
        return float(state[fused_kernels.S_FRICTION]), float(np.sqrt(state[fused_kernels.S_FRICTION_VAR]))


def _force_direction(probe: Probe, settings: Settings) -> Estimator:
    return SampleEstimator("force_direction", kernels.force_direction, shared_params(probe, settings))


def _wrench_axis(probe: Probe, settings: Settings) -> Estimator:
    return SampleEstimator("wrench_axis", kernels.wrench_axis, shared_params(probe, settings))


ESTIMATORS: Final[dict[str, Callable[[Probe, Settings], Estimator]]] = {
    "force_direction": _force_direction,
    "wrench_axis": _wrench_axis,
    "fused": FusedEstimator,
}
"""Known estimators by name."""
