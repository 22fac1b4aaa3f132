"""The loop: from wrench samples and arm states to set points, one arm cycle at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import dist
from time import perf_counter
from typing import Any

import numpy as np

from lwrprobe.contact import TRUSTED, UNCONFIRMED, agreed_bias
from lwrprobe.contracts import (
    Done,
    DriverError,
    Goal,
    Motion,
    Observation,
    PluginError,
    Progress,
    SafetyStop,
    Task,
    WrenchSample,
)
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.set_points import MOST, SetPoints
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.loop.state_history import StateHistory
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.safety.guards import ForceGuard, SensorLost, SilenceGuard
from lwrprobe.exploration.safety.motion_guard import MotionGuard, MotionStop, table_plane
from lwrprobe.exploration.safety.retreat import Retreat
from lwrprobe.exploration.stages.arm_clearance import ArmClearanceStage
from lwrprobe.exploration.stages.object_motion import ObjectMoved
from lwrprobe.exploration.stages.pipeline import Pipeline, reaction_delay
from lwrprobe.kinematics import IKStatus, follow, straight_line

STAGES = (
    "arm", "sensor", "condition", "estimate", "map", "carve", "watch", "clearance", "strategy", "trajectory",
    "set points", "governor", "record",
)  # fmt: skip

FORGET = 0.5
"""s without a touch, after which the surface is another one for the contact estimator."""

SETTLED = 3
"""Samples of one touch before it is believed: until then the slip that friction opposes is that of the approach."""

STEP_BACK = 0.002
"""m along the stick between two places at which the bias is taken."""

_CONVERGED = int(IKStatus.CONVERGED)

WatchFunction = Callable[["ProgressSnapshot"], None]


@dataclass(slots=True, frozen=True)
class ProgressSnapshot:
    """What a progress display is shown ten times a second of wall time."""

    time: float
    wall: float
    progress: Progress
    contacts: int
    force: float


@dataclass(slots=True)
class Outcome:
    """How a run ended and what it did on the way."""

    status: str
    reason: str
    time: float
    path: float
    contact_path: float
    peak_felt: float
    range_used: float
    cycle_us: float
    guard_interventions: int
    slowed_cycles: int
    stages: list[dict[str, Any]]
    counters: Any


class Explorer:
    """Runs one strategy over one devices until it is done, stopped or interrupted."""

    def __init__(
        self,
        scene: Any,
        pipeline: Pipeline,
        devices: Devices,
        recorder: Recorder,
        watch: WatchFunction | None,
        confirm: Confirm | None = None,
    ) -> None:
        self.scene = scene
        self.pipe = pipeline
        self.devices = devices
        self.recorder = recorder
        self.watch = watch
        self.confirm = confirm
        self.clock = StageClock(STAGES)
        self.cycle = devices.arm.cycle
        n = pipeline.robot.n
        self._q = np.zeros(n)
        self._ahead = np.zeros(n)
        self._history = StateHistory(pipeline.robot)
        contact, safety = scene.contact, scene.safety
        torque = safety.torque_share * pipeline.probe.torque_range
        self._threshold, self._light = float(contact.threshold), 0.5 * contact.target
        self._guard = ForceGuard(contact.limit, contact.target, 2.0 * scene.motion.contour_speed, torque)
        self._silence = SilenceGuard(max(safety.silence, 5.0 / devices.sensor.rate), self.cycle)
        self.motion_guard = MotionGuard(pipeline.robot, self.cycle, safety, table_plane(scene))
        self._points = SetPoints(pipeline.trajectory, pipeline.solver, self.motion_guard)
        self._times, self._joints = np.zeros(MOST), np.zeros((MOST, n))
        self._laid = 1
        self._retreat = Retreat(safety.lift)
        self._blocked = ""
        self._motion: Motion | None = None
        self._zero_time = 0.0
        self._time = 0.0
        self._last_tip: list[float] | None = None
        self._path = self._contact_path = self._peak = 0.0
        self._range_used = 0.0
        probe = pipeline.probe
        self._range = (*probe.force_range.tolist(), *probe.torque_range.tolist())
        self._slowed = 0
        self._rows = 0
        self._transitions = 0
        self._wall_shown = 0.0
        self._force = 0.0
        self._touched_last = -np.inf
        self._touch_age = 0

    # Before the strategy

    def take_place(self, pose: np.ndarray, q: np.ndarray) -> None:
        """Move to the start in joint space when the arm stands elsewhere, then rest there."""
        state = self.devices.arm.read()
        robot = self.pipe.robot
        self._q[:] = state.q
        if np.abs(state.q - q).max() > 1e-6:
            from lwrprobe.trajectory import JointTrajectory

            slow = 0.3 * robot.speed
            move = JointTrajectory(self.cycle, robot.lower, robot.upper, slow, 2.0 * slow, 10.0 * slow)
            move.reset(state.q)
            move.set_goal(q)
            if isinstance(self.pipe.clearance, ArmClearanceStage):
                why = self.pipe.clearance.objection_to_swing(state.q, q)
                if why:
                    raise SafetyStop(f"the arm was not moved to its start: {why}")
            self._ask_for_start(np.abs(state.q - q).max())
            while not move.arrived:
                if self.confirm is not None:
                    self.confirm.watch()
                move.step()
                self._command(move.q)
                self._remember(self.devices.arm.read())
        self._q[:] = q
        self.pipe.place_tip(pose, q)

    def _ask_for_start(self, farthest: float) -> None:
        """Hold the joints until the operator allows the move to the start, where somebody is to be asked."""
        if self.confirm is None or self.confirm.left <= 0:
            return
        what = f"all joints to the start at 30 % of their speed, up to {np.degrees(farthest):.1f} deg"
        while not self.confirm.ask(("start",), what):
            self._command(self._q)
            self._remember(self.devices.arm.read())

    def take_bias(self, seconds: float) -> None:
        """Take the sensor's bias where two places agree on it; raises SafetyStop when the probe stays in contact."""
        rotation = self.pipe.trajectory.pose[:3, :3].copy()
        found = agreed_bias(self.pipe.conditioner, lambda: self.listen(seconds), self._step_back, rotation)
        if not found.outcome.taken:
            raise SafetyStop(f"the bias cannot be taken at the start: {found.outcome.reason}")

    def listen(self, seconds: float) -> list[WrenchSample]:
        """What the sensor says while the arm rests."""
        samples: list[WrenchSample] = []
        begin = None
        while begin is None or self._time < begin + seconds:
            self._command(self._q)
            self._remember(self.devices.arm.read())
            begin = self._time if begin is None else begin
            samples += self.devices.sensor.read()
        return [sample for sample in samples if sample.time > begin]

    def _step_back(self) -> None:
        """A little way back along the stick, to rest; raises SafetyStop where the arm cannot go."""
        trajectory = self.pipe.trajectory
        start = trajectory.pose[:3, 3].copy()
        goal = trajectory.pose.copy()
        goal[:3, 3] -= STEP_BACK * goal[:3, 2]
        trajectory.set_goal(goal, self.scene.motion.approach_speed)
        end = self._time + 2.0
        while not trajectory.arrived and self._time < end:
            self._remember(self.devices.arm.read())
            self.devices.sensor.read()
            self._move()
        if np.linalg.norm(trajectory.pose[:3, 3] - start) < 0.5 * STEP_BACK:
            raise SafetyStop("the bias cannot be taken at the start: the arm cannot step back")

    def start(self, elapsed: float = 0.0) -> None:
        """Hand the task to the strategy; the run's time begins, `elapsed` s after its zero."""
        scene, pipe = self.scene, self.pipe
        self.motion_guard.confine(pipe.area.lower - scene.safety.margin, pipe.area.upper + scene.safety.margin)
        task = self.task()
        pipe.force.begin(task.delay)
        self._zero_time = self._time - elapsed
        self._of_plugin(pipe.strategy.start, task)

    def task(self) -> Task:
        """What is to be done, from where the tip stands."""
        scene, pipe = self.scene, self.pipe
        pose = pipe.trajectory.pose
        return Task(
            area=pipe.area,
            table=scene.table.height,
            probe=pipe.probe,
            orientation=pose[:3, :3].copy(),
            start=pose[:3, 3].copy(),
            free_speed=scene.motion.free_speed,
            approach_speed=scene.motion.approach_speed,
            contour_speed=scene.motion.contour_speed,
            acceleration=scene.motion.acceleration,
            force_threshold=scene.contact.threshold,
            force_target=scene.contact.target,
            force_limit=scene.contact.limit,
            clearance_threshold=scene.clearance.threshold,
            stiffness=scene.contact.stiffness,
            delay=reaction_delay(scene, self.cycle, self.devices.sensor.latency, self.devices.sensor.rate),
            map=pipe.voxels,
            options=pipe.options,
            reachable=self._can_follow,
            clear=self._is_clear,
        )

    # The loop

    def run(self, time_limit: float) -> Outcome:
        """Until the strategy is done; whatever ends the run early, what was measured is kept."""
        begin = perf_counter()
        self.clock = StageClock(STAGES)  # what came before was no part of the run
        status, reason, cause = "ended early", "", None
        try:
            while not isinstance(self._motion, Done):
                self._go_on(time_limit)
                if self._time - self._zero_time > time_limit:
                    reason = f"time limit of {time_limit:.0f} s of robot time"
                    break
                if self.watch is not None and perf_counter() - self._wall_shown > 0.1:
                    self._show(begin)
            else:
                reason = self._motion.reason
                status = "done" if self._motion.complete else "ended early"
        except (DriverError, SafetyStop, PluginError) as error:
            reason, cause = str(error), error
        except KeyboardInterrupt:
            reason = "interrupted"
        self.come_to_rest(cause)
        if self.watch is not None:
            self._show(begin)
        return self.outcome(status, reason)

    def outcome(self, status: str, reason: str) -> Outcome:
        """What has happened so far, under a status and a reason."""
        if self.pipe.sweep is not None:
            self.pipe.sweep.leave()
        return Outcome(
            status,
            reason,
            self._time - self._zero_time,
            self._path,
            self._contact_path,
            self._peak,
            self._range_used,
            self.clock.cycle_median(),
            self._guard.interventions,
            self._slowed,
            self.clock.table(),
            self.pipe.conditioner.counters,
        )

    def come_to_rest(self, error: Exception | None = None) -> None:
        """Brake inside the limits, go back where nothing is felt any more, then hold.

        After a `MotionStop` the arm brakes by itself, and a device that no longer answers has stopped by itself.
        """
        try:
            if isinstance(error, MotionStop):
                for _ in range(int(0.5 / self.cycle)):
                    self.devices.arm.read()
                return
            self.pipe.trajectory.stop()
            self._follow(1.0)
            if isinstance(error, SensorLost | ObjectMoved):
                self._go_back()
            self.devices.arm.stop()
        except (DriverError, SafetyStop):
            return

    def _go_back(self) -> None:
        """Blind now: off the surface and back on the tip's own way, where nothing was in it a moment ago."""
        trajectory = self.pipe.trajectory
        for place in self._retreat.places(trajectory.pose[:3, 3], self.scene.safety.retreat):
            pose = trajectory.pose.copy()
            pose[:3, 3] = place
            trajectory.set_goal(pose, self.scene.motion.approach_speed)
            self._follow(5.0)

    def _follow(self, seconds: float) -> None:
        """Carry out what the generator has been told, without asking the strategy."""
        for _ in range(int(seconds / self.cycle)):
            if self.pipe.trajectory.resting:
                break
            self._remember(self.devices.arm.read())
            self._move()

    def _go_on(self, time_limit: float) -> None:
        """One cycle, and those after it that nothing new is learnt in."""
        clock, devices = self.clock, self.devices
        clock.start(self._laid)
        self._remember(devices.arm.read())
        clock.lap("arm")
        try:
            samples = devices.sensor.read()
        except DriverError as error:
            raise SensorLost(str(error)) from error
        clock.lap("sensor")
        for sample in samples:
            self._one_sample(sample)
        self._silence.check(self._time)
        self._move(self._foreseen(time_limit))

    def _foreseen(self, time_limit: float) -> int:
        """How many cycles can be gone through at once: nobody who looks once a cycle would have anything to say."""
        stepped = self.devices.stepped
        if stepped is None or isinstance(self._motion, Done) or not self.motion_guard.settled:
            return 1
        left = int((self._zero_time + time_limit - self._time) / self.cycle)
        most = min(MOST, left, self._silence.looks_left)
        return 1 if most <= 1 else 1 + stepped.cycles_until_sample(most - 1)

    def _one_sample(self, sample: WrenchSample) -> None:
        clock, pipe = self.clock, self.pipe
        pose, velocity = self._history.tip_at(sample.time)
        rotation, place = pose[:3, :3], pose[:3, 3].copy()  # kernels take their vectors in one piece
        wrench = pipe.conditioner.condition(sample, rotation)
        self._silence.heard(sample.status | wrench.status)
        failing = pipe.conditioner.failing
        if failing:
            raise SensorLost(f"the sensor cannot be relied on: {failing}")
        clock.lap("condition")
        size = wrench.magnitude
        if size > self._light:
            for felt, most in zip(wrench.force.tolist() + wrench.torque.tolist(), self._range):
                self._range_used = max(self._range_used, abs(felt) / most)
        contact = None
        if size >= self._threshold:
            if sample.time - self._touched_last > FORGET:
                pipe.estimator.reset()
            self._touched_last = sample.time
            centre = place
            if pipe.deflection is not None:
                centre = pipe.deflection.centre(place, rotation, wrench.world_force)
            contact = pipe.estimator.estimate(wrench, centre, rotation, velocity)
            contact.time = sample.time - self._zero_time
            clock.lap("estimate")
            self._touch_age += 1
            # A light touch says little: the error of its normal goes with one over the force.
            settled = self._touch_age > SETTLED and size >= self._light
            if contact.trust >= TRUSTED and settled and pipe.force.settled:
                pipe.voxels.insert_point(contact.point)
                clock.lap("map")
                self.recorder.contact(contact, sample.sequence)
                clock.lap("record")
        else:
            self._touch_age = 0
            if pipe.sweep is not None:
                pipe.sweep.move_to(place)
                clock.lap("carve")
        if contact is not None and pipe.sweep is not None:
            pipe.sweep.leave()
        pipe.force.update(wrench, pose, contact)
        if pipe.object_motion is not None and pipe.force.settled and not wrench.status & UNCONFIRMED:
            time = sample.time - self._zero_time
            pipe.object_motion.see(time, place, wrench.world_force, contact, pipe.force.compliance)
        clock.lap("watch")
        near = pipe.clearance.nearest(pose, self._history.q) if pipe.clearance is not None else None
        clock.lap("clearance")
        seen = Observation(
            time=sample.time - self._zero_time,
            pose=pose,
            velocity=velocity,
            force=wrench.world_force,
            contact=contact,
            clearance=near,
            goal_reached=pipe.trajectory.arrived,
            blocked=self._blocked,
        )
        confirmed = not wrench.status & UNCONFIRMED
        override = self._guard.check(self._time, wrench.world_force, wrench.torque, confirmed)
        if confirmed or override is None:
            motion = pipe.force.limit(self._of_plugin(pipe.strategy.step, seen), wrench, self._history.acceleration)
        else:
            motion = override  # maybe a spike: the strategy is not shown it, the tip holds still until the next sample
        clock.lap("strategy")
        if self.confirm is not None and override is None:
            motion = self.confirm.filter(motion)
        self._adopt(override or motion, urgent=override is not None)
        clock.lap("trajectory")
        self._account(seen, place, size)
        clock.lap("record")

    def _adopt(self, motion: Motion, urgent: bool = False) -> None:
        """Hand a motion to the generator, unless the arm could not follow it a moment from now.

        An urgent one goes as far as it can: to stand still would be to go on pressing.
        """
        trajectory = self.pipe.trajectory
        self._motion = motion
        if isinstance(motion, Done):
            trajectory.stop()
        elif isinstance(motion, Goal):
            if not self._reachable(motion.pose):
                return
            trajectory.set_goal(motion.pose, motion.speed, motion.turn_rate)
        else:
            if not urgent:
                ahead = trajectory.pose.copy()
                ahead[:3, 3] += 0.1 * motion.velocity
                if not self._reachable(ahead):
                    return
            trajectory.set_feed(motion.velocity, motion.hold, motion.pose)

    def _can_follow(self, poses: Sequence[np.ndarray]) -> bool:
        begin, q = self.pipe.trajectory.pose.copy(), self._q
        for end in poses:
            seen = follow(self.pipe.robot, straight_line(begin, end, 0.02, 0.1), q, solver=self.pipe.solver)
            if not seen.complete:
                return False
            begin, q = end, seen.q[-1]
        return True

    def _is_clear(self, poses: Sequence[np.ndarray]) -> bool:
        stage = self.pipe.clearance
        way = [self.pipe.trajectory.pose.copy(), *poses]
        return stage is None or stage.clear(way, self._q)

    def _reachable(self, pose: np.ndarray) -> bool:
        status = self.pipe.judge(pose, self._q, self._ahead)
        self._blocked = "" if status == IKStatus.CONVERGED else f"out of reach: {IKStatus(status).name.lower()}"
        if not self._blocked and self.pipe.clearance is not None:
            self._blocked = self.pipe.clearance.objection(self.pipe.trajectory.pose, pose, self._q)
        if self._blocked:
            self.pipe.trajectory.stop()
        return not self._blocked

    def _move(self, most: int = 1) -> None:
        """Set points of up to `most` cycles; the last one's answer is yet to be read."""
        clock, points, governor = self.clock, self._points, self.pipe.governor
        laid, q = 0, self._q
        while True:
            first, last = laid, most
            if governor is not None and most > 1:
                last = int(min(most, first + governor.due))
            laid = points.generate(q, first, last)
            if points.status != _CONVERGED:
                self._blocked = f"out of reach: {IKStatus(points.status).name.lower()}"
                self.pipe.trajectory.stop()
            # The governor slows down ahead of this; should it be late, the tip falls behind its line for a moment.
            self._slowed += points.cut
            if laid == most or laid < last:
                break
            q = points.rows[laid - 1]
            clock.lap("set points")
            self._govern(q, laid - first)
        clock.lap("set points")
        self._send(laid)
        self._laid = laid
        clock.lap("arm")
        self._govern(self._q, laid - first)

    def _govern(self, q: np.ndarray, cycles: int) -> None:
        """Have the governor look ahead after so many cycles, the last of which has the joints q (n,)."""
        governor = self.pipe.governor
        if governor is None:
            return
        governor.watch(q, cycles)
        if governor.blocked_in < np.inf and not self._blocked:
            # It looks as far ahead as a stop takes: now the tip still stops within its limits.
            self._blocked = "out of reach: ahead on the way"
            self.pipe.trajectory.stop()
        self.clock.lap("governor")

    def _send(self, count: int) -> None:
        """Have the first set points laid carried out, and the last one begun."""
        points = self._points
        answered = count if points.refusal is not None else count - 1
        if answered > 0:
            self._carry_out(answered)
        if points.refusal is not None:
            self.devices.arm.stop()
            raise points.refusal
        last = points.rows[count - 1]
        self.devices.arm.command(last)
        self._q[:] = last

    def _carry_out(self, count: int) -> None:
        """Set points with their answers, none of which comes with a wrench sample."""
        assert self.devices.stepped is not None
        points, times, joints = self._points, self._times[:count], self._joints[:count]
        done, status = self.devices.stepped.step_many(points.rows[:count], times, joints, self.motion_guard.following)
        early = done < count
        if early:
            if done == 0:
                return
            times, joints = times[:done], joints[:done]
        self._time = float(times[-1])
        self._history.note_rows(times, points.velocities[:done], joints)
        try:
            self.motion_guard.watch_rows(points.rows[:done], times, joints, status, early)
        except MotionStop:
            self.devices.arm.stop()
            raise
        self._silence.check(self._time, done)

    def _command(self, q: np.ndarray) -> None:
        try:
            self.motion_guard.check(q)
        except MotionStop:
            self.devices.arm.stop()
            raise
        self.devices.arm.command(q)
        self._q[:] = q

    # Keeping track

    def _remember(self, state: Any) -> None:
        self._time = state.time
        self._history.note(state.time, self.pipe.trajectory.velocity, state.q)
        self.motion_guard.watch(state)

    def _account(self, seen: Observation, tip: np.ndarray, force: float) -> None:
        contact, near = seen.contact, seen.clearance
        place = tip.tolist()
        if self._last_tip is not None:
            length = dist(place, self._last_tip)
            self._path += length
            if contact is not None:
                self._contact_path += length
        self._last_tip = place
        self._retreat.note(tip, contact.normal if contact is not None else None)
        self._peak = max(self._peak, force)
        self._force = force
        self._rows += 1
        trace = getattr(self.pipe.strategy, "trace", ())
        if len(trace) > self._transitions:
            for step in trace[self._transitions :]:
                self.recorder.transition(*step)
            self._transitions = len(trace)
        if self._rows % 5 == 0:
            distance = near.distance if near is not None else np.inf
            state = self.pipe.strategy.progress().state
            self.recorder.way(seen.time, tip, force, contact is not None, distance, state)

    def _show(self, begin: float) -> None:
        now = perf_counter()
        self._wall_shown = now
        progress = self.pipe.strategy.progress()
        assert self.watch is not None
        self.watch(
            ProgressSnapshot(
                self._time - self._zero_time, now - begin, progress, len(self.recorder.contacts), self._force
            )
        )

    def _of_plugin(self, call: Callable[[Any], Any], argument: Any) -> Any:
        try:
            return call(argument)
        except Exception as error:
            name = self.scene.strategy.name
            raise PluginError(f"strategy plug-in {name!r} failed: {type(error).__name__}: {error}") from error
