"""From the generator's plan to set points that may be sent, for as many cycles as nothing new is learnt in."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import entry
from lwrprobe.exploration import set_point_kernels as k
from lwrprobe.exploration.joint_space import JointSpaceTip
from lwrprobe.exploration.motion_guard import MotionGuard, MotionStop
from lwrprobe.kinematics import IKSolver, IKStatus
from lwrprobe.trajectory import CartesianTrajectory

MOST = 32
"""Rows."""


class SetPoints:
    """Steps the generator, finds the joints and holds them against all limits, row by row.

    Parameters
    ----------
    trajectory : the generator
    solver : its poses' inverse kinematics
    guard : the last look at each row

    Attributes
    ----------
    rows : (MOST, n) rad, those that `lay` laid first
    velocities : (MOST, 3) m/s of the tip, one a row
    status : `IKStatus` of the last row
    cut : steps of this `lay` that were cut down to the joints' speeds
    refusal : why the row behind the last one must not be sent, None where it may
    """

    def __init__(self, trajectory: CartesianTrajectory | JointSpaceTip, solver: IKSolver, guard: MotionGuard) -> None:
        self._trajectory, self._guard = trajectory, guard
        n = solver.robot.n
        self.rows, self.velocities = np.zeros((MOST, n)), np.zeros((MOST, 3))
        self.status, self.cut = IKStatus.CONVERGED, 0
        self.refusal: MotionStop | None = None
        self._notes = np.zeros(k.NOTES)
        self._table, self._chain, self._step = solver.table, solver.robot.chain, guard.step
        if isinstance(trajectory, CartesianTrajectory):
            self._lay = entry(k.lay, *self._arguments(k.RESTING, np.zeros(n), guard.measured, 0, MOST))

    def lay(self, q: np.ndarray, most: int) -> int:
        """Set points of up to `most` cycles into `rows`, the first one step from the joints q (n,); how many there are.

        Fewer than `most` where a pose is out of reach, that row being the last, or where a row must not be sent; then
        the generator stands at that row and has not been told.
        """
        self.refusal, self.cut = None, 0
        if isinstance(self._trajectory, JointSpaceTip):
            return self._lay_joints(q, most)
        trajectory, notes = self._trajectory, self._notes
        laid, measured, ended = 0, self._guard.measured, k.DUE
        going = k.RESTING if trajectory.resting else k.STEPPING
        while ended == k.DUE:
            arguments = self._arguments(going, q, measured, laid, most)
            before = notes[k.TIME]
            count, ended = self._lay(*arguments)
            self.cut += int(notes[k.CUT])
            if notes[k.TIME] > before:
                trajectory.come_to(float(notes[k.TIME]))
                going = k.RESTING if trajectory.resting else k.STEPPED
            if count > 0:
                laid += count
                q, measured = self.rows[laid - 1], self._guard.sent
        self.status = IKStatus(int(notes[k.STATUS]))
        if ended == k.REFUSED:
            self.refusal = self._guard.refusal(int(notes[k.VERDICT]))
        return laid

    def _arguments(self, going: int, q: np.ndarray, measured: np.ndarray, first: int, most: int) -> tuple:
        """Of the kernel, with the generator where it is."""
        plan, state, time, event = self._trajectory.course
        self._notes[:] = time, event, self._trajectory.cycle, k.CONVERGED, 0.0, k.GOOD
        rows, velocities = self.rows[first:most], self.velocities[first:most]
        return (
            plan, state, self._notes, going, self._table, q, self._step, measured,
            self._chain, *self._guard.arrays, rows, velocities,
        )  # fmt: skip

    def _lay_joints(self, q: np.ndarray, most: int) -> int:
        """As `lay`, of a generator that has the joints itself."""
        guard, measured = self._guard, self._guard.measured
        for laid, row in enumerate(self.rows[:most]):
            self._trajectory.step()
            row[:] = self._trajectory.q
            self.cut += guard.rein(q, row)
            verdict = guard.verdict(row, measured)
            if verdict:
                self.refusal = guard.refusal(verdict)
                return laid
            self.velocities[laid] = self._trajectory.velocity
            q, measured = row, guard.sent
        return most
