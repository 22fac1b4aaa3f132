"""What a strategy asks for, handed to the generator unless the arm could not follow it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.contracts import Done, Goal, Motion
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.joint_space import JointSpaceTip
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.kinematics import IKStatus, follow, sensitivity, straight_line
from lwrprobe.kinematics.path import rotations

LOOK_AHEAD = 0.1
"""s of a velocity command that the arm must be able to follow."""
STRIDE, STRIDE_TURN = 0.005, 0.04
"""m and rad between the poses at which a straight path is checked: a turn of 0.1 rad may lead through a posture in
which the arm is stretched, and out of it."""
OFF_LIMITS = 0.01
"""rad that a joint keeps from the ends of its range on a path that is planned. At the end of its range the other joints
cannot replace it: a small overshoot of the tip makes them jump."""
STRETCHED = 1.1
"""Times the sensitivity up to which paths are planned, from which on no motion leads on: joints still follow a stop."""
APART = np.array([0.02, 0.02, 0.02, 0.002])
"""Between two poses for which that is asked, as long as the answer is no: of the rotations' elements, and m."""


class MotionRequest:
    """Checks reach and clearance of what the strategy asks for, and answers its questions about both.

    Parameters
    ----------
    pipeline : generator, inverse kinematics, clearance
    arm : where the joints are

    Attributes
    ----------
    asked : the strategy's last motion, None before the first
    current : the motion that was handed on last, the strategy's or a guard's, None before the first
    """

    def __init__(self, pipeline: Pipeline, arm: ArmMotion) -> None:
        self._pipeline, self._arm = pipeline, arm
        self._ahead = np.zeros(pipeline.robot.n)
        self._asked_for, self._stretched = np.full((4, 4), np.inf), False
        self.asked: Motion | None = None
        self.current: Motion | None = None

    def adopt(self, motion: Motion, urgent: bool = False) -> None:
        """Hand a motion to the generator, unless the arm could not follow it a moment from now.

        An urgent one goes as far as it can: to stand still would be to go on pressing.
        """
        trajectory = self._pipeline.trajectory
        self.current = motion
        if isinstance(motion, Done):
            trajectory.stop()
        elif isinstance(motion, Goal):
            if self._permitted(motion.pose, self._soon(trajectory.velocity)):
                trajectory.set_goal(motion.pose, motion.speed)
        else:
            if not urgent:
                ahead = self._soon(motion.velocity)
                if not self._permitted(ahead, ahead):
                    return
            trajectory.set_velocity(motion.velocity, motion.hold, motion.pose)

    def pause(self) -> None:
        """Come to rest until the next motion is adopted."""
        self._pipeline.trajectory.stop()

    def reachable(self, poses: Sequence[np.ndarray]) -> bool:
        """Whether the arm can take the tip straight through these poses (4, 4) in turn; see `Task.reachable`."""
        begin, q, solver = self._pipeline.trajectory.pose.copy(), self._arm.q, self._pipeline.solver
        margin = self._pipeline.robot.limit_margin
        least = min(OFF_LIMITS, margin(q))
        most = max(self._pipeline.sensitivity, sensitivity(solver, begin, q))
        for end in poses:
            line = straight_line(begin, end, STRIDE, STRIDE_TURN)
            found = follow(self._pipeline.robot, line, q, solver=solver)
            if not found.complete or min(map(margin, found.q)) < least:
                return False
            if any(sensitivity(solver, *at) > most for at in zip(line, found.q)):
                return False
            begin, q = end, found.q[-1]
        return True

    def clear(self, poses: Sequence[np.ndarray]) -> bool:
        """Whether all links keep their distance on the path through these poses (4, 4); see `Task.clear`."""
        stage = self._pipeline.clearance
        return stage is None or stage.clear([self._pipeline.trajectory.pose.copy(), *poses], self._arm.q)

    def _soon(self, velocity: np.ndarray) -> np.ndarray:
        """(4, 4), where the tip is a moment from now with a velocity (3,) m/s, turning as it does now."""
        trajectory = self._pipeline.trajectory
        soon = trajectory.pose.copy()
        soon[:3, 3] += LOOK_AHEAD * velocity
        turn = LOOK_AHEAD * trajectory.angular_velocity
        angle = float(np.linalg.norm(turn))
        if angle > 0.0:
            soon[:3, :3] = rotations(turn / angle, np.array([angle]))[0] @ soon[:3, :3]
        return soon

    def _permitted(self, pose: np.ndarray, soon: np.ndarray) -> bool:
        """Whether the arm may go to a pose (4, 4), past one where it is soon; else the generator is stopped and the arm
        says what blocks it."""
        pipeline, arm = self._pipeline, self._arm
        status = pipeline.ik_status(pose, arm.q, self._ahead)
        arm.blocked = "" if status == IKStatus.CONVERGED else f"out of reach: {IKStatus(status).name.lower()}"
        if not arm.blocked and self._stretches(soon):
            arm.blocked = "out of reach: the joints could not follow a stop of the tip"
        if not arm.blocked and pipeline.clearance is not None:
            arm.blocked = pipeline.clearance.objection(pipeline.trajectory.pose, pose, arm.q)
        if arm.blocked:
            pipeline.trajectory.stop()
        return not arm.blocked

    def _stretches(self, pose: np.ndarray) -> bool:
        """Whether the joints could not follow a stop of the tip at a pose (4, 4), and even less so than here."""
        pipeline, solver, q = self._pipeline, self._pipeline.solver, self._arm.q
        if isinstance(pipeline.trajectory, JointSpaceTip):
            return False
        if self._stretched or (np.abs(pose - self._asked_for)[:3] >= APART).any():
            self._asked_for, self._stretched = pose.copy(), False
            if solver.track(pose, q, self._ahead) == IKStatus.CONVERGED:
                there = sensitivity(solver, pose, self._ahead)
                too_much = there > STRETCHED * pipeline.sensitivity
                self._stretched = too_much and there > sensitivity(solver, pipeline.trajectory.pose, q)
        return self._stretched
