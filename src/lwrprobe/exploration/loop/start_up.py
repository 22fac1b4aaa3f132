"""Before the strategy takes over: the arm goes to its start, and the sensor's bias is taken there."""

from __future__ import annotations

import numpy as np

from lwrprobe.contact import agreed_bias
from lwrprobe.contracts import SafetyStop, WrenchSample
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.loop_delay import LoopDelay
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.stages.arm_clearance import ArmClearanceStage
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.trajectory import JointTrajectory

SLOW = 0.3
"""Share of the joints' speeds with which the arm moves to its start."""
STEP_BACK = 0.002
"""m along the stick between two places at which the bias is taken."""


class StartUp:
    """Brings arm and sensor to where a strategy may start.

    Parameters
    ----------
    pipeline : generator, inverse kinematics, wrench conditioner
    devices : arm and sensor
    arm : its motion
    recorder : takes the samples of the pauses
    approach_speed : m/s, of a step back
    confirm : asks the operator before the arm moves, None = does not ask

    Attributes
    ----------
    loop_delay : of arm and sensor, as far as measured
    """

    def __init__(
        self,
        pipeline: Pipeline,
        devices: Devices,
        arm: ArmMotion,
        recorder: Recorder,
        approach_speed: float,
        confirm: Confirm | None,
    ) -> None:
        self._pipeline, self._devices, self._arm, self._recorder = pipeline, devices, arm, recorder
        self._speed, self._confirm = approach_speed, confirm
        self.loop_delay = LoopDelay()

    def take_place(self, pose: np.ndarray, q: np.ndarray) -> None:
        """Move to the start in joint space when the arm stands elsewhere, then rest there.

        Raises SafetyStop where the arm would come too near to the table or to itself on that path.
        """
        arm, robot = self._arm, self._pipeline.robot
        now = self._devices.arm.read().q
        arm.q[:] = now
        farthest = float(np.abs(now - q).max())
        if farthest > 1e-6:
            speed = SLOW * robot.speed
            move = JointTrajectory(arm.cycle, robot.lower, robot.upper, speed, 2.0 * speed, 10.0 * speed)
            move.reset(now)
            move.set_goal(q)
            if isinstance(self._pipeline.clearance, ArmClearanceStage):
                why = self._pipeline.clearance.objection_to_swing(now, q)
                if why:
                    raise SafetyStop(f"the arm was not moved to its start: {why}")
            self._ask(farthest)
            while not move.arrived:
                if self._confirm is not None:
                    self._confirm.watch()
                move.step()
                arm.command(move.q)
                arm.observe()
        arm.q[:] = q
        self._pipeline.place_tip(pose, q)

    def take_bias(self, seconds: float) -> None:
        """Take the sensor's bias where two places agree on it; raises SafetyStop when the probe stays in contact."""
        rotation = self._pipeline.trajectory.pose[:3, :3].copy()
        found = agreed_bias(self._pipeline.conditioner, lambda: self.listen(seconds), self._step_back, rotation)
        if not found.outcome.taken:
            raise SafetyStop(f"the bias cannot be taken at the start: {found.outcome.reason}")
        self._pipeline.adopt_noise(found.outcome.noise)

    def listen(self, seconds: float) -> list[WrenchSample]:
        """The sensor's samples while the arm rests."""
        arm = self._arm
        samples: list[WrenchSample] = []
        begin = None
        while begin is None or arm.time < begin + seconds:
            arm.hold()
            self._note_arm()
            begin = arm.time if begin is None else begin
            new = self._devices.sensor.read()
            for sample in new:
                self.loop_delay.note_age(arm.time - sample.time)
            samples += new
        self.loop_delay.rest()
        received = [sample for sample in samples if sample.time > begin]
        if self._recorder.bag is not None:
            self._recorder.bag.record_at_rest(received, arm.q)
        return received

    def _note_arm(self) -> None:
        arm = self._arm
        self.loop_delay.note(arm.time, arm.q, arm.history.newest)

    def _ask(self, farthest: float) -> None:
        """Hold the joints until the operator allows the move to the start, where the operator is to be asked."""
        if self._confirm is None or self._confirm.left <= 0:
            return
        what = f"all joints to the start at 30 % of their speed, up to {np.degrees(farthest):.1f} deg"
        while not self._confirm.ask(("start",), what):
            self._arm.hold()

    def _step_back(self) -> None:
        """A little back along the stick, to rest; raises SafetyStop where the arm cannot go."""
        arm, trajectory = self._arm, self._pipeline.trajectory
        start = trajectory.pose[:3, 3].copy()
        goal = trajectory.pose.copy()
        goal[:3, 3] -= STEP_BACK * goal[:3, 2]
        trajectory.set_goal(goal, self._speed)
        end = arm.time + 2.0
        while not trajectory.arrived and arm.time < end:
            arm.observe()
            self._note_arm()
            self._devices.sensor.read()
            arm.move()
        if np.linalg.norm(trajectory.pose[:3, 3] - start) < 0.5 * STEP_BACK:
            raise SafetyStop("the bias cannot be taken at the start: the arm cannot step back")
