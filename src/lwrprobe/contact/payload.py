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
    """

    mass: float
    com: Vector
    bias: Vector
    residual: Vector = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def of(cls, probe: Probe) -> Payload:
        """The payload that the probe's description states, with no bias."""
        return cls(probe.mass, np.array(probe.centre_of_mass, dtype=np.float64), np.zeros(6))

    def weight(self, rotation: np.ndarray) -> Vector:
        """(6,) wrench of the weight in the sensor frame; `rotation` (3, 3) of the sensor in the world."""
        force = -self.mass * GRAVITY * np.asarray(rotation)[2]
        return np.concatenate([force, np.cross(self.com, force)])


def identify_payload(samples: Sequence[WrenchSample], rotations: Sequence[np.ndarray]) -> Payload:
    """Mass, centre of mass and bias from readings in free space at several orientations.

    Linear least squares: `f = b_f + m g` gives mass and force bias, `t = b_t - [g]x (m c)` moment and torque bias,
    with g the gravity vector in the sensor frame. One sample an orientation; several at the same one are averaged
    by the fit. The centre of mass is zero where the mass is too small (under a milligram).

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

    n = len(samples)
    identity = np.tile(np.eye(3), (n, 1))
    from_force, *_ = np.linalg.lstsq(np.hstack([identity, gravity.reshape(-1, 1)]), forces.ravel(), rcond=None)
    cross = np.concatenate([_cross_matrix(g) for g in gravity])
    from_torque, *_ = np.linalg.lstsq(np.hstack([identity, -cross]), torques.ravel(), rcond=None)

    mass, moment = float(from_force[3]), from_torque[3:]
    com = moment / mass if mass > 1e-6 else np.zeros(3)
    force_error = forces - from_force[:3] - mass * gravity
    torque_error = torques - from_torque[:3] - np.cross(moment, gravity)
    residual = np.sqrt(np.mean(np.hstack([force_error, torque_error]) ** 2, axis=0))
    return Payload(mass, com, np.concatenate([from_force[:3], from_torque[:3]]), residual)


def _cross_matrix(v: Vector) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
