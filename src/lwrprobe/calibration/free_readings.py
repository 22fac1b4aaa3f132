"""The load of the sensor, from readings in free space at many orientations, while the zero drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lwrprobe.calibration.touches import FreeReading
from lwrprobe.contact.payload import GRAVITY
from lwrprobe.contracts import InputError
from lwrprobe.contracts.samples import Vector

FEWEST = 8


@dataclass(slots=True, frozen=True)
class Load:
    """Stick and sphere on the sensor.

    Attributes
    ----------
    mass : kg; mass_sigma : kg
    com : (3,) m, centre of mass in the sensor frame; com_sigma : (3,) m
    drift : (6,) N/s and N m/s, of the zero
    """

    mass: float
    mass_sigma: float
    com: Vector
    com_sigma: Vector
    drift: Vector


def identify_load(readings: list[FreeReading], rotations: np.ndarray) -> Load:
    """Mass and centre of mass by linear least squares, with a zero and an even drift of each axis.

    As `contact.identify_payload`, which knows no drift: over a calibration the zero drifts by more than the weight.
    `rotations` (k, 3, 3) are the sensor's in the world. Raises InputError for fewer than eight readings.
    """
    if len(readings) < FEWEST:
        raise InputError("readings", len(readings), f"at least {FEWEST} readings in free space")
    times = np.array([reading.time for reading in readings])
    times = times - times.mean()
    wrenches = np.array([reading.wrench for reading in readings])
    gravity = -GRAVITY * np.asarray(rotations)[:, 2]
    count, ones = len(times), np.tile(np.eye(3), (len(times), 1))
    drifts = np.kron(times[:, None], np.eye(3))
    force, force_cover = _fit(np.hstack([ones, drifts, gravity.reshape(-1, 1)]), wrenches[:, :3].ravel())
    moments = np.zeros((count, 3, 3))
    x, y, z = gravity.T
    moments[:, 0, 1], moments[:, 0, 2], moments[:, 1, 2] = z, -y, x
    moments -= moments.transpose(0, 2, 1)
    torque, torque_cover = _fit(np.hstack([ones, drifts, moments.reshape(-1, 3)]), wrenches[:, 3:].ravel())
    mass = max(float(force[6]), 1e-6)
    return Load(
        mass=float(force[6]),
        mass_sigma=float(np.sqrt(force_cover[6, 6])),
        com=torque[6:] / mass,
        com_sigma=np.sqrt(np.diag(torque_cover)[6:]) / mass,
        drift=np.concatenate([force[3:6], torque[3:6]]),
    )


def _fit(design: np.ndarray, seen: Vector) -> tuple[Vector, np.ndarray]:
    found, *_ = np.linalg.lstsq(design, seen, rcond=None)
    left = seen - design @ found
    scale = float(left @ left) / max(len(seen) - design.shape[1], 1)
    return found, scale * np.linalg.pinv(design.T @ design)
