"""Moving the tip by straight lines in joint space: the thesis's mode, in which the tip's own path bows.

The class has the interface of `CartesianTrajectory` that the loop uses. A goal becomes joint values (inverse kinematics
along the straight line to it, so that the arm stays on its branch) and the joints go there together. A velocity command
becomes such a goal as far ahead as the tip gets while the command holds, set anew at every call, as the thesis does it:
it stops by itself. There is one generator, whose limits hold through every change from goals to velocities and back.
"""

from __future__ import annotations

import numpy as np

from lwrprobe.kinematics import IKSolver, IKStatus, Robot, straight_line
from lwrprobe.kinematics.path import axis_angle, rotations
from lwrprobe.trajectory import CartesianLimits, JointTrajectory

LOOK_AHEAD = 0.1
"""s, no velocity command is extrapolated further than that; a longer one is renewed meanwhile."""
STRIDE, STRIDE_TURN = 0.02, 0.1
"""m and rad between the poses at which inverse kinematics follows the line to a goal."""
SLOWEST = 1e-4
"""Least share of the joints' speed limits that a motion is scaled to."""


class JointSpaceTip:
    """Online generator of the tip's motion in joint space.

    Each joint keeps its own speed limit; its acceleration and jerk are those with which it would move the tip of the
    outstretched arm by the Cartesian ones. The speed asked for bounds the tip's largest speed on that path.

    Parameters
    ----------
    cycle : s
    robot : the arm with its tool
    solver : its inverse kinematics
    limits : of the tip

    Attributes
    ----------
    q : (n,) joint values now
    pose : (4, 4) of the tip, now; velocity : (3,) m/s; angular_velocity : (3,) rad/s
    arrived : the last goal is reached and the joints rest

    The arrays are the generator's own and change with every step.
    """

    def __init__(self, cycle: float, robot: Robot, solver: IKSolver, limits: CartesianLimits) -> None:
        self.cycle, self.limits = cycle, limits
        self._robot, self._solver = robot, solver
        acceleration, jerk = (np.full(robot.n, bound / robot.length) for bound in (limits.acceleration, limits.jerk))
        self._joints = JointTrajectory(cycle, robot.lower, robot.upper, robot.speed, acceleration, jerk)
        self.q, self._qd = self._joints.q, self._joints.qd
        self.pose, self.velocity, self.angular_velocity = np.eye(4), np.zeros(3), np.zeros(3)
        self._jacobian = np.empty((6, robot.n))
        self._reachable = b""
        self._wanted, self._aim = np.empty(robot.n), np.empty(robot.n)
        self._asked: tuple | None = None
        self._to_goal = False
        self._commanded, self._turn, self._left = np.zeros(3), np.eye(3), 0.0
        self._look()

    @property
    def arrived(self) -> bool:
        """The last goal is reached and the joints rest."""
        return self._to_goal and self._joints.arrived

    @property
    def resting(self) -> bool:
        """Nothing moves."""
        return self._joints.resting

    def reset(self, q: np.ndarray) -> None:
        """Rest at joint values q (n,), now."""
        self._joints.reset(q)
        self._asked, self._to_goal, self._left = None, True, 0.0
        self._look()

    def ik_status(self, pose: np.ndarray) -> int:
        """An `IKStatus` value: whether the arm can go to a pose (4, 4) from here without leaving its branch."""
        key = pose.tobytes()
        if key != self._reachable:
            status = self._follow(pose)
            # what was in vain from here may be free from elsewhere
            self._reachable = key if status == IKStatus.CONVERGED else b""
            return status
        return IKStatus.CONVERGED

    def set_goal(self, pose: np.ndarray, speed: float, turn_rate: float | None = None) -> int:
        """Go to a pose (4, 4) and rest there, the tip at `speed` m/s and `turn_rate` rad/s at most; an `IKStatus`.

        Where the pose cannot be reached the motion continues as before.
        """
        asked = (pose.tobytes(), speed, turn_rate)
        if asked != self._asked:
            status = self.ik_status(pose)
            if status != IKStatus.CONVERGED:
                return status
            self._asked, self._to_goal, self._left = asked, True, 0.0
            self._go(self._wanted, speed, turn_rate)
        return IKStatus.CONVERGED

    def set_velocity(self, velocity: np.ndarray, hold_seconds: float, pose: np.ndarray | None = None) -> int:
        """Keep the tip at a velocity (3,) m/s; stop by itself `hold_seconds` after the last call; an `IKStatus`.

        `pose` gives an orientation to turn to meanwhile; without, the one at the first call is held.
        """
        if pose is not None:
            self._turn = pose[:3, :3].copy()
        elif self._to_goal or self._left <= 0.0:
            self._turn = self.pose[:3, :3].copy()
        self._asked, self._to_goal = None, False
        self._commanded, self._left = np.array(velocity, dtype=np.float64), hold_seconds
        return self._aim_ahead()

    def stop(self) -> None:
        """Come to rest as fast as the limits allow."""
        self._asked, self._to_goal, self._left = None, False, 0.0
        self._joints.stop()

    def step(self) -> None:
        """Advance by one cycle."""
        if self._left > LOOK_AHEAD:
            self._left -= self.cycle
            self._aim_ahead()
        self._joints.step()
        self._look()

    def _look(self) -> None:
        self._robot.fk_into(self.q, self.pose)
        self._robot.jacobian_into(self.q, self._jacobian)
        twist = self._jacobian @ self._qd
        self.velocity[:], self.angular_velocity[:] = twist[:3], twist[3:]

    def _follow(self, pose: np.ndarray) -> int:
        """Joint values at a pose into `_wanted`, found along the straight line to it."""
        seed = self.q
        if np.abs(pose - self.pose).max() < STRIDE:
            return self._solver.track(pose, seed, self._wanted)
        for at in straight_line(self.pose, pose, STRIDE, STRIDE_TURN)[1:]:
            status = self._solver.track(at, seed, self._aim)
            if status != IKStatus.CONVERGED:
                return status
            self._wanted[:] = self._aim
            seed = self._wanted
        return IKStatus.CONVERGED

    def _aim_ahead(self) -> int:
        """Aim at where the velocity command leads while it holds."""
        speed = float(np.sqrt(self._commanded @ self._commanded))
        ahead = min(self._left, LOOK_AHEAD)
        axis, angle = axis_angle(self.pose[:3, :3].T @ self._turn)
        if speed * ahead < 1e-9 and angle < 1e-9:
            self._joints.stop()
            return IKStatus.CONVERGED
        target = np.eye(4)
        target[:3, :3] = self.pose[:3, :3] @ rotations(axis, np.array([min(angle, self.limits.turn_rate * ahead)]))[0]
        target[:3, 3] = self.pose[:3, 3] + ahead * self._commanded
        status = self._solver.track(target, self.q, self._aim)
        if status == IKStatus.CONVERGED:
            self._go(self._aim, speed or self.limits.speed, None)
        else:
            self.stop()
        return status

    def _go(self, q: np.ndarray, speed: float, turn_rate: float | None) -> None:
        self._joints.set_goal(np.clip(q, self._robot.lower, self._robot.upper), self._share(q, speed, turn_rate))

    def _share(self, q: np.ndarray, speed: float, turn_rate: float | None) -> float:
        """The share of the joints' speed limits at which the tip keeps to the speeds asked for as far as q."""
        change = q - self.q
        busiest = float(np.abs(change / self._robot.speed).max())
        if busiest == 0.0:
            return 1.0
        linear = turning = 0.0
        for part in (0.0, 0.5, 1.0):
            self._robot.jacobian_into(self.q + part * change, self._jacobian)
            twist = self._jacobian @ change
            linear = max(linear, float(np.sqrt(twist[:3] @ twist[:3])))
            turning = max(turning, float(np.sqrt(twist[3:] @ twist[3:])))
        # all joints share one law of time; at the full limits the busiest takes `busiest` seconds for its change
        linear, turning = linear / busiest, turning / busiest
        speed = min(speed, self.limits.speed)
        turn_rate = self.limits.turn_rate if turn_rate is None else min(turn_rate, self.limits.turn_rate)
        share = min(1.0, speed / max(linear, 1e-12), turn_rate / max(turning, 1e-12))
        return max(share, SLOWEST)
