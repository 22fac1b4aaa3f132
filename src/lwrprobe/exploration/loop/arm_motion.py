"""One stretch of motion: set points from the generator to the arm, each held against all limits before it is sent."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import ArmState, ArmStatus, BufferedArm
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.set_points import MAX_ROWS, SetPoints
from lwrprobe.exploration.loop.simulated_time import SimulatedTime
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.loop.state_history import StateHistory
from lwrprobe.exploration.safety.motion_guard import MotionGuard, MotionStop, table_plane
from lwrprobe.exploration.safety.reaction import ReactionExcess
from lwrprobe.exploration.safety.silence_guard import SilenceGuard
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.kinematics import IKStatus
from lwrprobe.scene import Scene
from lwrprobe.scene.scene_robot import gears_of

_CONVERGED = int(IKStatus.CONVERGED)
_UNANSWERED = int(ArmStatus.UNANSWERED)


class ArmMotion:
    """Has the arm follow the generator, and remembers where it was.

    Parameters
    ----------
    scene : its safety table
    pipeline : generator, inverse kinematics, governor
    devices : the arm
    clock : takes the time of each stage
    silence : the guard of the sensor, which has to look once a cycle

    Attributes
    ----------
    cycle : s between two set points
    time : s, the arm's clock at its last state
    q : (n,) rad, the last set point
    stretch : cycles of the last stretch
    blocked : why the generator stands still, empty where it does not
    excess : time by which the loop reacts later than stated
    slowed : cycles in which a step was cut down to the joints' speed limits
    history : the arm's last states
    guard : of the set points
    """

    def __init__(
        self, scene: Scene, pipeline: Pipeline, devices: Devices, clock: StageClock, silence: SilenceGuard
    ) -> None:
        robot = pipeline.robot
        self._pipeline = pipeline
        self._arm, self._trajectory, self._governor = devices.arm, pipeline.trajectory, pipeline.governor
        self._simulated = SimulatedTime.of(devices, robot.n)
        self._buffered = devices.arm if isinstance(devices.arm, BufferedArm) else None
        self._clock, self._silence = clock, silence
        self.cycle = devices.arm.cycle
        self.time, self.q = 0.0, np.zeros(robot.n)
        self.stretch, self.slowed, self.blocked = 1, 0, ""
        self.history = StateHistory(robot, gears_of(scene, robot.n))
        sensor = devices.sensor
        self.excess = ReactionExcess(self.cycle, sensor.latency, 1.0 / sensor.rate)
        self.guard = MotionGuard(robot, self.cycle, scene.safety, table_plane(scene))
        self._points = SetPoints(pipeline.trajectory, pipeline.solver, self.guard)

    def observe(self) -> ArmState:
        """The arm's next state; raises MotionStop where it does not follow."""
        state = self._arm.read()
        if self._buffered is not None:
            for passed in self._buffered.passed():
                self._note(passed)
        self._note(state)
        return state

    def _note(self, state: ArmState) -> None:
        self.time = state.time
        self.history.note(state.time, self._trajectory.velocity, state.q)
        self.excess.note_state(state.time, bool(state.status & _UNANSWERED))
        self.guard.watch(state)

    def rest(self, state: ArmState) -> None:
        """Begin anew where the arm rests after it has stopped by itself."""
        self.guard.forget()
        self.time, self.blocked = state.time, ""
        self.q[:] = state.q
        self._pipeline.place_tip(self._pipeline.robot.fk(self.q), self.q)
        self.history.note(state.time, np.zeros(3), state.q)

    def command(self, q: np.ndarray) -> None:
        """One set point (n,) rad from elsewhere than the generator; raises MotionStop where it must not be sent."""
        try:
            self.guard.check(q)
        except MotionStop:
            self._arm.stop()
            raise
        self._arm.command(q)
        self.q[:] = q

    def hold(self) -> None:
        """One cycle at the last set point."""
        self.command(self.q)
        self.observe()

    def finish_plan(self, seconds: float) -> None:
        """Carry out what the generator has planned, for some seconds at most, without asking the strategy."""
        for _ in range(int(seconds / self.cycle)):
            if self._trajectory.resting:
                break
            self.observe()
            self.move()

    def cycles_ahead(self, limit: int) -> int:
        """How many cycles may be generated at once, up to `limit`, since nothing new is measured meanwhile."""
        if self._simulated is None or not self.guard.settled:
            return 1
        return self._simulated.cycles(min(MAX_ROWS, limit, self._silence.looks_left))

    def move(self, cycles: int = 1) -> None:
        """Send set points of up to `cycles` cycles; the answer to the last one is yet to be read."""
        clock, points, governor = self._clock, self._points, self._governor
        done, q = 0, self.q
        while True:
            first, last = done, cycles
            if governor is not None and cycles > 1:
                last = int(min(cycles, first + governor.due))
            done = points.generate(q, first, last)
            if points.status != _CONVERGED:
                self.blocked = f"out of reach: {IKStatus(points.status).name.lower()}"
                self._trajectory.stop()
            # The governor slows down ahead of this; should it be late, the tip falls behind its line for a moment.
            self.slowed += points.cut
            if done == cycles or done < last:
                break
            q = points.rows[done - 1]
            clock.lap("set points")
            self._look_ahead(q, done - first)
        clock.lap("set points")
        self._send(done)
        self.stretch = done
        clock.lap("arm")
        self._look_ahead(self.q, done - first)

    def _look_ahead(self, q: np.ndarray, cycles: int) -> None:
        """Have the governor look ahead after so many cycles, the last of which has the joints q (n,)."""
        governor = self._governor
        if governor is None:
            return
        governor.watch(q, cycles)
        if governor.blocked_in < np.inf and not self.blocked:
            # It looks as far ahead as a stop takes: now the tip still stops within its limits.
            self.blocked = "out of reach: ahead on the path"
            self._trajectory.stop()
        self._clock.lap("governor")

    def _send(self, count: int) -> None:
        """Have the first `count` set points carried out, the last one only begun."""
        points = self._points
        answered = count if points.refusal is not None else count - 1
        if answered > 0:
            self._carry_out(answered)
        if points.refusal is not None:
            self._arm.stop()
            raise points.refusal
        last = points.rows[count - 1]
        self._arm.command(last)
        self.q[:] = last

    def _carry_out(self, count: int) -> None:
        """Set points with their answers, none of which comes with a wrench sample."""
        assert self._simulated is not None
        points = self._points
        times, joints, status = self._simulated.step(points.rows[:count], self.guard.following)
        done = len(times)
        if done == 0:
            return
        self.time = float(times[-1])
        self.history.note_rows(times, points.velocities[:done], joints)
        try:
            self.guard.watch_rows(points.rows[:done], times, joints, status, done < count)
        except MotionStop:
            self._arm.stop()
            raise
        self._silence.check(self.time, done)
