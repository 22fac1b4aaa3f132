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
DIRECTIONS = 200
"""Steps from across the stick to along it, for which the speed of an approach is worked out beforehand."""
ROOM = 0.85
"""Share of the force limit that a first touch may use; friction and the wall beside a foot take the rest."""
DIVE = 0.3
"""Share of the feed along the stick, towards its tip, from which on it is also an approach."""

Vector = tuple[float, float, float]


@dataclass(slots=True)
class Follower:
    """Turns contact normal and force into a velocity of the tip.

    It is asked with every sample, so vectors are taken apart and put together by hand: numpy takes a microsecond for
    each of many small things.

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
    _safe: list[float] = field(init=False)
    _give: tuple[float, float, float] = field(init=False)

    def __post_init__(self) -> None:
        task = self.task
        lateral, _, along = task.probe.compliance.tolist()
        self._give = 1.0 / task.stiffness, lateral, along
        give = np.sin(NORMALS) ** 2 * lateral + np.cos(NORMALS) ** 2 * along
        # The largest K(n) (d n) over the normals n of a surface that a motion along d may meet; it grows with the share
        # of d along the stick, so that the end of each step counts.
        axial = np.arccos(np.linspace(0.0, 1.0, DIRECTIONS + 1))
        hardest = (np.cos(axial[:, None] - NORMALS) / (1.0 / task.stiffness + give)).max(axis=1)
        room = ROOM * task.force_limit - task.force_threshold
        a, tau = task.acceleration, task.delay
        safe = a * (np.sqrt(tau * tau + 2.0 * room / (hardest * a)) - tau)
        self._safe = np.minimum(np.minimum.accumulate(safe), task.approach_speed).tolist()

    def restart(self, normal: np.ndarray) -> None:
        """Begin a new contour at a fresh contact."""
        self.normal = normal / np.sqrt(normal @ normal)
        self._slope = 0.0

    def tangent(self, across: Vector) -> Vector:
        """Unit direction onward: perpendicular to the normal and to `across`, the axis that the contour does not use.

        `across` is signed: with z up, travel in +y over an object wants +x, travel in -y wants -x: then a wall
        ahead is climbed.
        """
        return _perpendicular(*self.normal.tolist(), *across)

    def velocity(
        self, normal: np.ndarray, force: float, across: Vector, feed: float, rotation: np.ndarray, period: float
    ) -> np.ndarray:
        """(3,) m/s for the next `period` seconds.

        `force` is the component of the acting force along the normal [N], `rotation` (3, 3) that of the tip.
        """
        keep, new = self.memory, 1.0 - self.memory
        (mx, my, mz), (nx, ny, nz) = self.normal.tolist(), normal.tolist()
        bx, by, bz = keep * mx + new * nx, keep * my + new * ny, keep * mz + new * nz
        size = sqrt(bx * bx + by * by + bz * bz)
        if size > 0.1:
            nx, ny, nz = bx / size, by / size, bz / size
        self.normal = np.array((nx, ny, nz))
        ax, ay, az = rotation[:, 2].tolist()
        axial = nx * ax + ny * ay + nz * az
        task = self.task
        damping = e * task.delay * self._stiffness(axial)
        error = force - task.force_target
        inward = min(self._approach(axial), self.inward)
        slope = self._slope + error * period / (damping * 8.0 * task.delay)
        self._slope = min(max(slope, -0.5 * inward), 0.5 * feed)
        press = min(max(error / damping + self._slope, -inward), self.outward)
        slack = task.force_limit - task.force_target
        steady = task.force_target / (damping / e * TURN)
        tx, ty, tz = _perpendicular(nx, ny, nz, *across)
        dive = tx * ax + ty * ay + tz * az
        if dive > DIVE:  # down a wall to a foot that nobody has felt yet, stick first
            feed = min(feed, self._approach(dive))
        slowed = min(feed, steady) * min(max(1.0 - abs(error) / slack, 0.1), 1.0)
        return np.array((slowed * tx + press * nx, slowed * ty + press * ny, slowed * tz + press * nz))

    def approach_speed(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """m/s at which a first touch met along `direction` (unit) stays below `ROOM` of the force limit.

        F = F_threshold + K (v tau + v^2 / (2 a)), solved for v, with the K of whatever surface would be met hardest;
        never above the task's approach speed.
        """
        return self._approach(float(rotation[:, 2] @ direction))

    def _approach(self, axial: float) -> float:
        """`approach_speed` by the share of the direction along the stick."""
        return self._safe[min(int(abs(axial) * DIRECTIONS) + 1, DIRECTIONS)]

    def stiffness(self, direction: np.ndarray, rotation: np.ndarray) -> float:
        """N/m of the series along a unit direction: object and arm as the task has it, and the probe.

        A stick is hundreds of times stiffer along its axis than across. The normal may turn towards the axis before
        the law knows, so the stiffest within `CONE` of the direction counts.
        """
        return self._stiffness(float(rotation[:, 2] @ direction))

    def _stiffness(self, axial: float) -> float:
        angle = max(acos(min(abs(axial), 1.0)) - CONE, 0.0)
        series, lateral, along = self._give
        return 1.0 / (series + sin(angle) ** 2 * lateral + cos(angle) ** 2 * along)

    def yielding(self, force: float, rotation: np.ndarray) -> float:
        """m/s along an overlarge force, so that what is too much is gone after about one delay."""
        excess = force - self.task.force_target
        return min(max(excess, 0.0) / (self.stiffness(self.normal, rotation) * self.task.delay), self.outward)


def _perpendicular(nx: float, ny: float, nz: float, ax: float, ay: float, az: float) -> tuple[float, float, float]:
    """Unit vector along n x a, zero where they are parallel."""
    x, y, z = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    size = sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-6 else (0.0, 0.0, 0.0)


def rolling(centre: np.ndarray, touched: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """Unit normal of a sphere that rolls around the point last touched: from that point to the centre."""
    arm = centre - touched
    size = np.sqrt(arm @ arm)
    return arm / size if size > 1e-6 else fallback
