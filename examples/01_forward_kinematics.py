"""Where the probe's tip is for given joint angles, and which joint angles hold it there."""

import numpy as np

from lwrprobe.kinematics import IKSolver, lwr4

tool = np.eye(4)
tool[2, 3] = 0.25  # the sphere's centre, 0.25 m beyond the wrist
robot = lwr4(tool=tool)

q = np.radians([0, 35, 0, -90, 0, 55, 0])
pose = robot.fk(q)
print("tip at", np.round(pose.t, 4), "m")
print("manipulability", round(robot.manipulability(q), 4))

result = IKSolver(robot).solve(pose, q + 0.1)
print(result.status.name, "in joint angles", np.round(np.degrees(result.q), 2), "deg")
assert np.allclose(robot.fk(result.q).A, pose.A, atol=1e-5)
