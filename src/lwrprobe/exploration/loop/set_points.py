"""From the generator's plan to set points that may be sent, for as many cycles as nothing new is learnt in."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.exploration.loop import set_point_kernels as k
from lwrprobe.exploration.loop.joint_space import JointSpaceTip
from lwrprobe.exploration.safety.motion_guard import MotionGuard, MotionStop
from lwrprobe.kinematics import IKSolver, IKStatus
from lwrprobe.trajectory import CartesianTrajectory

MAX_ROWS = 32
"""Rows."""

_CONVERGED = int(IKStatus.CONVERGED)


class SetPoints:
    """Steps the generator, finds the joints and holds them against all limits, row by row.

    Parameters
    ----------
    trajectory : the generator
    solver : its poses' inverse kinematics
    guard : the last look at each row

    Attributes
    ----------
    rows : (MAX_ROWS, n) rad, those that `generate` has filled
    velocities : (MAX_ROWS, 3) m/s of the tip, one a row
    status : that of the last row's inverse kinematics, an `IKStatus` value
    cut : steps of this `generate` that were cut down to the joints' speeds
    refusal : why the row behind the last one must not be sent, None where it may
    """

    def __init__(self, trajectory: CartesianTrajectory | JointSpaceTip, solver: IKSolver, guard: MotionGuard) -> None:
        self._trajectory, self._guard = trajectory, guard
        self.rows, self.velocities = np.zeros((MAX_ROWS, solver.robot.n)), np.zeros((MAX_ROWS, 3))
        self.status, self.cut = _CONVERGED, 0
        self.refusal: MotionStop | None = None
        if isinstance(trajectory, CartesianTrajectory):
            self._table = solver.table
            self._arrays = (k.Guard(solver.robot.chain, *guard.arrays), k.Rows(self.rows, self.velocities))
            motion = k.Motion(*trajectory.plan_state, trajectory.cycle)
            self._generate = entry(k.generate, motion, 0, solver.table, *[guard.measured] * 3, *self._arrays, 0, 0)

    def generate(self, q: np.ndarray, first: int, last: int) -> int:
        """Set points into `rows` from row `first` up to `last`, one cycle each, from the joints q (n,) on; the row
        behind the last one filled.

        That is less than `last` where a pose is out of reach, that row being the last, or where a row must not be sent;
        then the generator stands at that row, and does not know of it. Row 0 is held against where the joints are now.
        """
        self.refusal, self.cut = None, 0
        guard = self._guard
        measured = guard.measured if first == 0 else guard.sent
        if isinstance(self._trajectory, JointSpaceTip):
            return self._generate_joints(self._trajectory, q, measured, first, last)
        trajectory, filled, ended = self._trajectory, first, k.DUE
        going = k.RESTING if trajectory.resting else k.STEPPING
        while ended == k.DUE:
            motion = k.Motion(*trajectory.plan_state, trajectory.cycle)
            filled, ended, then, cut, detail = self._generate(
                motion, going, self._table, q, guard.step, measured, *self._arrays, filled, last
            )
            self.cut += cut
            if then > motion.time:
                trajectory.come_to(then)
                going = k.RESTING if trajectory.resting else k.STEPPED
            if filled > first:
                q, measured = self.rows[filled - 1], guard.sent
        self.status = detail if ended == k.BLOCKED else _CONVERGED
        if ended == k.REFUSED:
            self.refusal = guard.refusal(detail)
        return filled

    def _generate_joints(
        self, trajectory: JointSpaceTip, q: np.ndarray, measured: np.ndarray, first: int, last: int
    ) -> int:
        """As `generate`, of a generator that has the joints itself."""
        guard = self._guard
        for filled in range(first, last):
            row = self.rows[filled]
            trajectory.step()
            row[:] = trajectory.q
            self.cut += guard.clamp(q, row)
            verdict = guard.verdict(row, measured)
            if verdict:
                self.refusal = guard.refusal(verdict)
                return filled
            self.velocities[filled] = trajectory.velocity
            q, measured = row, guard.sent
        return last
