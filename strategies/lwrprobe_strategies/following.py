"""Following a surface at constant force: admittance along the normal, feed along the tangent.

The tangent is taken as in the source (Rau 2017, sections 4.2.5 and 5.3.3, figure 4.8): perpendicular to the contact
normal, in the plane of the present motion state, on the side that carries the contour onward. The normal part is
the first-order law v_n = (F - F_target) / B with an integral part that takes up a constant error of the tangent's
direction, so that it needs no steady force error.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import acos, cos, e, sin, sqrt

import numpy as np

from lwrprobe.contracts import Task

TURN = 0.08
"""rad, by which the surface may turn unseen: with a feed of F_target / (K tau tan TURN) the contact is kept."""

CONE = 0.35
"""rad"""
NORMALS = np.linspace(0.0, 0.5 * np.pi, 91)
"""rad from the stick's axis: of the surfaces that a motion may meet."""
ROOM = 0.85
"""Share of the force limit that a first touch may use; friction and the wall beside a foot take the rest."""
DIVE = 0.3
"""Share of the feed along the stick, towards its tip, from which on it is also an approach."""


@dataclass(slots=True)
class Follower:
    """Turns contact normal and force into a velocity of the tip.

    Attributes
    ----------
    task : forces, stiffness and delay come from here
    inward : m/s, how fast the tip may press towards the surface
    outward : m/s, how fast it may yield
    memory : share of the old normal kept from one sample to the next, 0 = none
    """

    task: Task
    inward: float = 0.01
    outward: float = 0.05
    memory: float = 0.5
    normal: np.ndarray = field(default_factory=lambda: np.zeros(3))
    _slope: float = 0.0
    _along: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        lateral, _, along = self.task.probe.compliance
        give = np.sin(NORMALS) ** 2 * lateral + np.cos(NORMALS) ** 2 * along
        self._along = 1.0 / (1.0 / self.task.stiffness + give)

    def restart(self, normal: np.ndarray) -> None:
        """Begin a new contour at a fresh contact."""
        self.normal = normal / np.sqrt(normal @ normal)
        self._slope = 0.0

    def tangent(self, across: np.ndarray) -> np.ndarray:
        """Unit direction onward: perpendicular to the normal and to `across`, the axis that the contour does not use.

        `across` is signed: with z up, travel in +y over an object wants +x, travel in -y wants -x: then a wall
        ahead is climbed.
        """
        # Written out: numpy's cross product of two vectors costs thirty times as much.
        nx, ny, nz = self.normal.tolist()
        ax, ay, az = across.tolist()
        x, y, z = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        size = sqrt(x * x + y * y + z * z)
        return np.array([x, y, z]) / size if size > 1e-6 else np.zeros(3)

    def velocity(
        self, normal: np.ndarray, force: float, across: np.ndarray, feed: float, rotation: np.ndarray, period: float
    ) -> np.ndarray:
        """(3,) m/s for the next `period` seconds.

        `force` is the component of the acting force along the normal [N], `rotation` (3, 3) that of the tip.
        """
        blend = self.memory * self.normal + (1.0 - self.memory) * normal
        size = np.sqrt(blend @ blend)
        self.normal = blend / size if size > 0.1 else normal
        damping = self.damping(rotation)
        error = force - self.task.force_target
        inward = min(self.approach_speed(self.normal, rotation), self.inward)
        slope = self._slope + error * period / (damping * 8.0 * self.task.delay)
        self._slope = min(max(slope, -0.5 * inward), 0.5 * feed)
        press = min(max(error / damping + self._slope, -inward), self.outward)
        slack = self.task.force_limit - self.task.force_target
        steady = self.task.force_target / (damping / e * TURN)
        onward = self.tangent(across)
        if onward @ rotation[:, 2] > DIVE:  # down a wall to a foot that nobody has felt yet, stick first
            feed = min(feed, self.approach_speed(onward, rotation))
        slowed = min(feed, steady) * min(max(1.0 - abs(error) / slack, 0.1), 1.0)
        return slowed * onward + press * self.normal

    def damping(self, rotation: np.ndarray) -> float:
        """N·s/m: B with K tau / B = 1/e, the fastest law without overshoot, K that of the series along the normal."""
        return e * self.task.delay * self.stiffness(self.normal, rotation)

    def approach_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a first touch met along `direction` (unit) stays below `ROOM` of the force limit.

        F = F_threshold + K (v tau + v^2 / (2 a)), solved for v, with the K of whatever surface would be met hardest;
        never above the task's approach speed.
        """
        task = self.task
        room = ROOM * task.force_limit - task.force_threshold
        stiffness = self._hardest(direction, rotation)
        a, tau = task.acceleration, task.delay
        safe = a * (sqrt(tau * tau + 2.0 * room / (stiffness * a)) - tau)
        return min(safe, task.approach_speed)

    def _hardest(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """N/m: the largest K(n) (d n) over the normals n of a surface that a motion along d may meet."""
        axial = min(abs(float(rotation[:, 2] @ direction)), 1.0)
        return float((self._along * np.cos(acos(axial) - NORMALS)).max())

    def stiffness(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """N/m of the series along a unit direction: object and arm as the task has it, and the probe.

        A stick is hundreds of times stiffer along its axis than across. The normal may turn towards the axis before
        the law knows, so the stiffest within `CONE` of the direction counts.
        """
        axial = min(abs(float(rotation[:, 2] @ direction)), 1.0)
        angle = max(acos(axial) - CONE, 0.0)
        lateral, _, along = self.task.probe.compliance
        return 1.0 / (1.0 / self.task.stiffness + sin(angle) ** 2 * lateral + cos(angle) ** 2 * along)

    def yielding(self, force: float, rotation: np.ndarray) -> float:
        """m/s along an overlarge force, so that what is too much is gone after about one delay."""
        excess = force - self.task.force_target
        return min(max(excess, 0.0) / (self.stiffness(self.normal, rotation) * self.task.delay), self.outward)


def rolling(centre: np.ndarray, touched: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """Unit normal of a sphere that rolls around the point last touched: from that point to the centre."""
    arm = centre - touched
    size = np.sqrt(arm @ arm)
    return arm / size if size > 1e-6 else fallback
