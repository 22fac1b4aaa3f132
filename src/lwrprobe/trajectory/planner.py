"""The guard around Ruckig: numbers in, pieces of constant jerk out, False instead of an exception."""

from __future__ import annotations

from collections.abc import Sequence
from struct import pack_into

import numpy as np
import ruckig

from lwrprobe.trajectory.profile_kernels import PIECES

TOGETHER = ruckig.Synchronization.Phase
"""Straight where the motion allows, else all at the same time."""
SAME_TIME = ruckig.Synchronization.Time
ALONE = getattr(ruckig.Synchronization, "No")  # noqa: B009 (`.No` trips type checkers on the way to None)

TRIES = 3
"""Plans that may fail one after the other before an aim is given up."""

_SOLVED = (ruckig.Result.Working, ruckig.Result.Finished)


class Planner:
    """Time-optimal jerk-limited motion of n axes from any state (Berscheid, Kroeger, RSS 2021, through Ruckig).

    Ruckig is asked for whole trajectories only and never inside a step: its answer is read out as pieces of
    constant jerk once, checked by the caller's kernel, and evaluated by this package. Way-points are never set
    (Ruckig would send them to a remote service).

    Parameters
    ----------
    synchronization : per axis, `TOGETHER`, `SAME_TIME` or `ALONE`
    to_velocity : per axis, True where the target is a velocity and not a position

    Attributes
    ----------
    pieces : of the last plan, 7 durations [s] and 7 jerks of each moving axis in order, then, if asked
        for, 2 durations and 2 jerks of the brake before them, of each moving axis
    """

    __slots__ = ("_input", "_memory", "_moves", "_ruckig", "_to_velocity", "_trajectory", "pieces")

    def __init__(self, synchronization: Sequence[ruckig.Synchronization], to_velocity: Sequence[bool]) -> None:
        axes = len(synchronization)
        self._ruckig = ruckig.Ruckig(axes)
        self._trajectory = ruckig.Trajectory(axes)
        self._input = ruckig.InputParameter(axes)
        interface = ruckig.ControlInterface
        self._input.per_dof_control_interface = [interface.Velocity if v else interface.Position for v in to_velocity]
        self._input.per_dof_synchronization = list(synchronization)
        self._input.current_position = [0.0] * axes
        self._to_velocity = list(to_velocity) if any(to_velocity) else None
        self._moves: list[float] = []
        self.pieces = np.zeros(axes * 2 * PIECES)
        self._memory = self.pieces.data.cast("B")

    def solve(self, request: np.ndarray, brakes: bool) -> bool:
        """Plan a request: rows TARGET .. MOVES of `profile_kernels`, finite, limits positive, current position 0.

        `brakes`: the motion may be beyond its limits at the start, so that Ruckig brakes first. Fills `pieces`;
        False where Ruckig reports an error or raises.
        """
        target, rate, second, max_rate, max_second, max_jerk, moves = request.tolist()
        given = self._input
        given.target_position = target
        if self._to_velocity:
            given.target_velocity = [t if v else 0.0 for t, v in zip(target, self._to_velocity)]
        given.current_velocity = rate
        given.current_acceleration = second
        given.max_velocity = max_rate
        given.max_acceleration = max_second
        given.max_jerk = max_jerk
        if moves != self._moves:
            self._moves = moves
            given.enabled = [m != 0.0 for m in moves]
        try:
            if self._ruckig.calculate(given, self._trajectory) not in _SOLVED:
                return False
            profiles = self._trajectory.profiles[0]
        except Exception:  # several types, and ValueError for codes that are missing from Ruckig's own enum
            return False
        numbers: list[float] = []
        for profile, moved in zip(profiles, moves):
            if moved:
                numbers += profile.t
                numbers += profile.j
        if brakes:
            for profile, moved in zip(profiles, moves):
                if moved:
                    numbers += profile.brake.t
                    numbers += profile.brake.j
        pack_into(f"{len(numbers)}d", self._memory, 0, *numbers)  # a third of the time of an array assignment
        return True
