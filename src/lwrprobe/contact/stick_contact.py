"""Where the stick is touched, when no contact of the sphere explains the wrench."""

from __future__ import annotations

from math import hypot

import numpy as np

from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import Probe
from lwrprobe.contracts.samples import Vector


def stick_contact(wrench: Wrench, centre: Vector, rotation: np.ndarray, probe: Probe) -> np.ndarray | None:
    """(3,) m, the point of the stick's side through which the force acts; None where it acts elsewhere.

    A single contact transmits a pure force, so its line of action passes the point: t = p x f, solved for the place
    along the stick with p on the side that the force presses on. A contact of the sphere lies within its radius.

    Parameters
    ----------
    wrench : sensor frame
    centre : (3,) m, the sphere's centre in the world
    rotation : (3, 3), sensor frame in the world
    """
    fx, fy, fz = wrench.force.tolist()
    tx, ty, _ = wrench.torque.tolist()
    across = hypot(fx, fy)
    if not across > 0.5 * hypot(across, fz):
        return None
    place = ((ty * fx - tx * fy) / across - probe.stick_radius * fz) / across
    if not 0.0 <= place < probe.sensor_distance - probe.radius:
        return None
    side = -probe.stick_radius / across
    point: np.ndarray = centre + rotation @ np.array([side * fx, side * fy, place - probe.sensor_distance])
    return point
