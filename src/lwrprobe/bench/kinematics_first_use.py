"""Run as a script: uses every kinematics kernel once; prints the wall and CPU seconds that took, imports excluded."""

import time

import numpy as np

from lwrprobe.kinematics import IKSolver, lwr4


def use_everything() -> None:
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


if __name__ == "__main__":
    import spatialmath  # noqa: F401  before the clock: half a second of plain Python

    wall, cpu = time.perf_counter(), time.process_time()
    use_everything()
    print(time.perf_counter() - wall, time.process_time() - cpu)
