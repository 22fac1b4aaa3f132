"""The probe and the robot shapes near it, in the tip frame.

The tip frame sits at the sphere's centre, its z axis points out of the flange along the stick. The sensor
frame has the same orientation and lies `sensor_distance` behind the tip (at z = -sensor_distance).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lwrprobe.contracts.samples import Vector
from lwrprobe.errors import InputError


@dataclass(slots=True, frozen=True)
class LinkShape:
    """A convex body of the robot that must not touch the object.

    Attributes
    ----------
    name : `stick`, `sensor`, `holder`, `finger_left`, ...
    kind : `cylinder` (flat ends), `capsule` or `box`
    size : m; cylinder and capsule (radius, length), box (x, y, z) full edges. A capsule's length is that of its
        axis, without the caps
    pose : (4, 4) from the shape's frame (centre of the body, axis along z) to the frame of `carrier`
    carrier : `tip`, or the index of the arm's link frame as text (`"6"`)
    """

    name: str
    kind: Literal["cylinder", "capsule", "box"]
    size: tuple[float, ...]
    pose: np.ndarray
    carrier: str = "tip"

    def __post_init__(self) -> None:
        wanted = 3 if self.kind == "box" else 2
        if len(self.size) != wanted or not all(np.isfinite(s) and s > 0 for s in self.size):
            raise InputError(f"link {self.name}.size", self.size, f"{wanted} positive lengths in metres")


@dataclass(slots=True, frozen=True)
class Probe:
    """Sphere, stick and sensor as the estimators need them.

    Attributes
    ----------
    radius : m, of the sphere
    sensor_distance : m, from the sensor frame's origin to the sphere's centre
    stick_radius : m
    compliance : (3,) m/N of the tip against the sensor along the tip frame's x, y, z (zero = rigid)
    mass, centre_of_mass : kg and (3,) m in the sensor frame, of what hangs on the sensor
    force_range, torque_range : (3,) N and N·m, ends of the sensor's range
    force_resolution, torque_resolution : N and N·m, one count
    links : shapes that must not touch the object (never the sphere)
    """

    radius: float = 0.005
    sensor_distance: float = 0.05
    stick_radius: float = 0.002
    compliance: Vector = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.0
    centre_of_mass: Vector = field(default_factory=lambda: np.zeros(3))
    force_range: Vector = field(default_factory=lambda: np.array([12.0, 12.0, 17.0]))
    torque_range: Vector = field(default_factory=lambda: np.array([0.12, 0.12, 0.12]))
    force_resolution: float = 1.0 / 320.0
    torque_resolution: float = 1.0 / 64000.0
    links: tuple[LinkShape, ...] = ()
