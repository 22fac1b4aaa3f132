"""Run as a module: uses every kernel of a package once; prints the wall and CPU seconds that took, imports excluded."""

from __future__ import annotations

import sys
import time

import numpy as np
import spatialmath  # noqa: F401  before the clock: half a second of plain Python

from lwrprobe.kinematics import IKSolver, lwr4
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, JointTrajectory


def kinematics() -> None:
    """Tip, Jacobian, their batches, link frames, tracking, cold start, null space, branches."""
    robot = lwr4()
    solver, q, out = IKSolver(robot), np.full(robot.n, 0.3), np.empty(robot.n)
    pose, jac = np.empty((4, 4)), np.empty((6, robot.n))
    robot.fk_into(q, pose)
    robot.jacobian_into(q, jac)
    robot.fk_batch(q[None])
    robot.fk_batch(np.tile(q, (1000, 1)))
    robot.jacobian_batch(q[None])
    robot.link_frames(q)
    solver.track(pose, q, out)
    solver.reach(pose, q, out)
    solver.solve(pose, posture=q)
    solver.on_branch(pose, solver.branches(pose)[0].signs, 0.0)


def trajectory() -> None:
    """Both generators."""
    CartesianTrajectory(1e-3, CartesianLimits(0.25, 2.0, 40.0, 1.0, 5.0, 100.0))
    JointTrajectory(1e-3, -np.ones(7), np.ones(7), np.ones(7), np.ones(7), np.ones(7))


if __name__ == "__main__":
    use = {"kinematics": kinematics, "trajectory": trajectory}[sys.argv[1]]
    wall, cpu = time.perf_counter(), time.process_time()
    use()
    print(time.perf_counter() - wall, time.process_time() - cpu)
