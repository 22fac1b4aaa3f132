"""The payload of the sensor (stick and sphere): identified once, then subtracted from every reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lwrprobe.contracts import InputError, Probe, WrenchSample
from lwrprobe.contracts.samples import Vector

GRAVITY = 9.80665
"""m/s², standard gravity; the world's z axis points up."""


@dataclass(slots=True, frozen=True)
class Payload:
    """Mass on the sensor and the sensor's own offset.

    Attributes
    ----------
    mass : kg
    com : (3,) m, centre of mass in the sensor frame
    bias : (6,) N and N·m, what the sensor reads without any load
    residual : (6,) N and N·m, root mean square of what the model leaves on each axis
    drift : (6,) N/s and N·m/s, of the sensor's zero; `bias` counts at the mean of the readings' times
    mass_sigma, com_sigma : kg and (3,) m, standard deviations; zero where the payload is stated and not identified
    """

    mass: float
    com: Vector
    bias: Vector
    residual: Vector = field(default_factory=lambda: np.zeros(6))
    drift: Vector = field(default_factory=lambda: np.zeros(6))
    mass_sigma: float = 0.0
    com_sigma: Vector = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, probe: Probe) -> Payload:
        """The payload that the probe's description states, with no bias."""
        return cls(probe.mass, np.array(probe.centre_of_mass, dtype=np.float64), np.zeros(6))

    def weight(self, rotation: np.ndarray) -> Vector:
        """(6,) wrench of the weight in the sensor frame; `rotation` (3, 3) of the sensor in the world."""
        force = -self.mass * GRAVITY * np.asarray(rotation)[2]
        return np.concatenate([force, np.cross(self.com, force)])


def identify_payload(samples: Sequence[WrenchSample], rotations: Sequence[np.ndarray]) -> Payload:
    """Mass, centre of mass and bias from readings in free space at several orientations, while the zero drifts evenly.

    Linear least squares: `f = b_f + d_f s + m g` gives mass and force bias, `t = b_t + d_t s - [g]x (m c)` moment and
    torque bias, with g the gravity vector in the sensor frame and s the time. One sample an orientation; several at the
    same one are averaged by the fit. The centre of mass is zero where the mass is too small (under a milligram).

    Parameters
    ----------
    samples : n readings, the probe touching nothing
    rotations : n arrays (3, 3), sensor frame in the world

    Raises
    ------
    InputError : fewer than three samples, NaN, or orientations that do not separate bias from weight (the direction
        of gravity in the sensor frame must have changed by at least 10 degrees about two axes)
    """
    if len(samples) != len(rotations) or len(samples) < 3:
        raise InputError("samples", (len(samples), len(rotations)), "at least three, one rotation each")
    forces = np.array([s.force for s in samples], dtype=np.float64)
    torques = np.array([s.torque for s in samples], dtype=np.float64)
    gravity = -GRAVITY * np.array([np.asarray(r)[2] for r in rotations], dtype=np.float64)
    if not (np.isfinite(forces).all() and np.isfinite(torques).all() and np.isfinite(gravity).all()):
        raise InputError("samples", "NaN or infinite values", "finite numbers only")
    spread = np.linalg.svd(gravity - gravity.mean(axis=0), compute_uv=False) / np.sqrt(len(samples))
    if spread[1] < GRAVITY * np.sin(np.radians(10.0)) / 3.0:
        raise InputError("rotations", "orientations too alike", "tilts of 10 degrees and more about two axes")

    times = np.array([s.time for s in samples])
    zero = np.hstack([np.tile(np.eye(3), (len(times), 1)), np.kron((times - times.mean())[:, None], np.eye(3))])
    from_force, force_cover, force_left = _fit(np.hstack([zero, gravity.reshape(-1, 1)]), forces)
    moments = -np.concatenate([_cross_matrix(g) for g in gravity])
    from_torque, torque_cover, torque_left = _fit(np.hstack([zero, moments]), torques)

    mass = float(from_force[6])
    known = mass > 1e-6
    return Payload(
        mass=mass,
        com=from_torque[6:] / mass if known else np.zeros(3),
        bias=np.concatenate([from_force[:3], from_torque[:3]]),
        residual=np.concatenate([force_left, torque_left]),
        drift=np.concatenate([from_force[3:6], from_torque[3:6]]),
        mass_sigma=float(np.sqrt(force_cover[6, 6])),
        com_sigma=np.sqrt(np.diag(torque_cover)[6:]) / mass if known else np.zeros(3),
    )


def _fit(design: np.ndarray, seen: np.ndarray) -> tuple[Vector, np.ndarray, Vector]:
    """Least squares: numbers (k,), their covariance (k, k), and the root mean square that is left on each of 3 axes."""
    found, *_ = np.linalg.lstsq(design, seen.ravel(), rcond=None)
    left = seen - (design @ found).reshape(-1, 3)
    scale = float(np.sum(left**2)) / max(seen.size - design.shape[1], 1)
    return found, scale * np.linalg.pinv(design.T @ design), np.sqrt(np.mean(left**2, axis=0))


def _cross_matrix(v: Vector) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
