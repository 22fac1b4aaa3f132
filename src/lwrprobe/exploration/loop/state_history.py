"""The arm's last states: a wrench sample is older than the newest, and belongs to the tip of its own instant."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.contracts.samples import Vector
from lwrprobe.exploration.loop import state_history_kernels as k
from lwrprobe.kinematics import Gears, Robot

HISTORY = 64
"""Cycles that are remembered: longer than any sample is late."""
VELOCITY_SPAN = 0.004
"""s over which the measured velocity is a mean: as long as a sample is under way, so that it lies after the sample."""


class StateHistory:
    """Joint states and tip velocities of the last `HISTORY` cycles of one robot.

    Parameters
    ----------
    robot : its kinematics
    gears : between what the arm reports and its joints; None = nothing is known of them

    Attributes
    ----------
    q : (n,) joint values of the links at the instant that `tip_at` was asked for last
    """

    def __init__(self, robot: Robot, gears: Gears | None = None) -> None:
        self._gears = gears
        self._chain = robot.chain
        self._ring = np.zeros((HISTORY, k.JOINTS + 2 * robot.n))
        self._count = 0
        self.q = np.zeros(robot.n)
        three, pose = np.zeros(3), np.zeros((4, 4))
        self._note = entry(k.note, self._ring, 0, 0.0, three, self.q, self.q)
        self._acceleration = entry(k.acceleration, self._ring, 0)
        self._note_rows = entry(k.note_rows, self._ring, 0, three, np.zeros((1, 3)), self._ring, self._ring)
        self._scratch = np.zeros(robot.n)
        self._mean_velocity = entry(
            k.mean_velocity, self._ring, 0, 0.0, VELOCITY_SPAN, self._chain, self._scratch, three
        )  # fmt: skip
        self._tip_at = entry(k.tip_at, self._ring, 0, 0.0, self._chain, self.q, pose, three)

    def note(self, time: float, velocity: Vector, q: Vector) -> None:
        """The arm stands at q (n,) now, and its tip is to move at a velocity (3,) m/s, world frame."""
        links = q if self._gears is None else self._gears.links(q[None])[0]
        self._note(self._ring, self._count, time, velocity, q, links)
        self._count += 1

    def note_rows(self, times: Vector, velocities: np.ndarray, joints: np.ndarray) -> None:
        """`note` for times (m,), velocities (m, 3) and joints (m, n), oldest first."""
        links = joints if self._gears is None else self._gears.links(joints)
        self._note_rows(self._ring, self._count, times, velocities, joints, links)
        self._count += len(times)

    def tip_at(self, time: float) -> tuple[np.ndarray, Vector]:
        """Tip pose (4, 4) and commanded velocity (3,) m/s at an instant not long ago, joints interpolated linearly."""
        pose, velocity = np.empty((4, 4)), np.empty(3)
        self._tip_at(self._ring, self._count, time, self._chain, self.q, pose, velocity)
        return pose, velocity

    def measured_velocity(self, time: float) -> Vector:
        """(3,) m/s of the tip from the measured joints, the mean over the `VELOCITY_SPAN` after a recent instant.

        Where not so much is known after it, the mean is over the last `VELOCITY_SPAN` known.
        """
        velocity = np.empty(3)
        self._mean_velocity(self._ring, self._count, time, VELOCITY_SPAN, self._chain, self._scratch, velocity)
        return velocity

    @property
    def newest(self) -> Vector:
        """(n,) joint values of the newest state."""
        return self._ring[(self._count - 1) % HISTORY, k.JOINTS : k.JOINTS + self.q.size]

    @property
    def acceleration(self) -> float:
        """m/s^2 of the tip over the last cycle, inf before there are two states."""
        return self._acceleration(self._ring, self._count)
