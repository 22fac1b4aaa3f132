"""Where the probe is for given joint angles, and which joint angles hold it there."""

import numpy as np

from lwrprobe.kinematics import IKSolver, lwr4

tool = np.eye(4)
tool[2, 3] = 0.25  # the sphere's centre is 0.25 m beyond the last joint's frame
robot = lwr4(tool=tool)

q = np.radians([0, 35, 0, -90, 0, 55, 0])
pose = robot.fk(q)
print("tip at", np.round(pose.t, 4), "m")
print("manipulability", round(robot.manipulability(q), 4))

solver = IKSolver(robot)
result = solver.solve(pose, q + 0.1)
print(result.status.name, "with joint angles", np.round(np.degrees(result.q), 2), "deg")
print("position error", f"{np.linalg.norm(robot.fk(result.q).t - pose.t):.1e}", "m")

far = pose.A.copy()
far[0, 3] -= 1.0
print(solver.solve(far, q).status.name, "for a pose 1 m further out")
