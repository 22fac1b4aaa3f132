"""The loop: from wrench samples and arm states to set points, one arm cycle at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from lwrprobe.contact import Counters
from lwrprobe.contracts import (
    Done,
    DriverError,
    Motion,
    MotionInterrupted,
    Observation,
    PluginError,
    Progress,
    SafetyStop,
    StorageError,
    Task,
)
from lwrprobe.contracts.plugins import failed
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.loop.recovery import Recovery
from lwrprobe.exploration.loop.run_record import RunRecord
from lwrprobe.exploration.loop.sample_step import SampleStep
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.loop.start_up import StartUp
from lwrprobe.exploration.loop.stop_rules import StopRules
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.safety.motion_guard import MotionStop
from lwrprobe.exploration.safety.silence_guard import SensorLost, SensorSilent, Silence, SilenceGuard
from lwrprobe.exploration.stages.object_motion import ObjectMoved
from lwrprobe.exploration.stages.pipeline import Pipeline, reaction_delay
from lwrprobe.exploration.stages.touch_law import arm_stiffness, tip_mass
from lwrprobe.scene import Scene

STAGES = (
    "arm", "sensor", "condition", "estimate", "map", "carve", "watch", "clearance", "strategy", "trajectory",
    "set points", "governor", "record", "bag",
)  # fmt: skip

OVERSHOOT = 0.01
"""m of the margin around the area that stays for the arm's deviations when a strategy raises the area."""
SHOW_EVERY = 0.1
"""s of wall-clock time between two progress snapshots."""

Question = Callable[[Sequence[np.ndarray]], bool]
WatchFunction = Callable[["ProgressSnapshot"], None]


@dataclass(slots=True, frozen=True)
class ProgressSnapshot:
    """What a progress display is shown ten times a second of wall time.

    Attributes
    ----------
    time : s since the start of the run, on the robot's clock
    wall : s of wall-clock time since then
    progress : the strategy's
    contacts : number stored so far
    force : N, at the last sample
    """

    time: float
    wall: float
    progress: Progress
    contacts: int
    force: float


@dataclass(slots=True)
class Outcome:
    """How a run ended and what it did until then.

    Attributes
    ----------
    status : `done` or `ended early`
    reason : one sentence
    time : s on the robot's clock
    touches : samples with a contact, accepted or not
    path, contact_path : m, of the sphere's centre, and the part of it in contact
    peak_force : N, the largest measured
    peak_bound : N, what it may have been between two samples
    late_by : s by which the loop reacted later to a force than stated, at worst
    interruptions : that the run has survived, one table each
    gaps : how often samples were missing and the tip gave way
    range_used : largest share of the sensor's range
    cycle_us : us of computing time, median over the arm's cycles
    guard_interventions : how often the force guard took over
    slowed_cycles : cycles in which a step was cut down to the joints' speed limits
    stages : computing time a stage, see `StageClock.table`
    counters : of the wrench samples
    stopped_by : `strategy` where that was done, the key of `[run.until]` that was reached, empty for an early end
    missed : what `[run.until]` wanted of the surface and the strategy could not reach, a sentence each
    """

    status: str
    reason: str
    time: float
    touches: int
    path: float
    contact_path: float
    peak_force: float
    peak_bound: float
    late_by: float
    interruptions: list[dict[str, Any]]
    gaps: int
    range_used: float
    cycle_us: float
    guard_interventions: int
    slowed_cycles: int
    stages: list[dict[str, Any]]
    counters: Counters
    stopped_by: str = ""
    missed: Sequence[str] = ()


class Explorer:
    """Runs one strategy over arm and sensor until it is done, stopped or interrupted.

    Parameters
    ----------
    scene : the settings
    pipeline : composed from the scene
    devices : arm and sensor, open
    recorder : takes contacts and path
    watch : shown a snapshot some ten times a second, None = no display
    confirm : asks the operator for the first motions, None = does not ask
    message : called with a sentence when the run is interrupted, and when it goes on

    Attributes
    ----------
    arm : its motion, with the motion guard
    start_up : what comes before the strategy
    recovery : what comes after an interruption
    outcome : how the run ended, None while it runs
    """

    def __init__(
        self,
        scene: Scene,
        pipeline: Pipeline,
        devices: Devices,
        recorder: Recorder,
        watch: WatchFunction | None = None,
        confirm: Confirm | None = None,
        message: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._scene, self._pipeline, self._devices, self._recorder, self._watch = (
            scene, pipeline, devices, recorder, watch,
        )  # fmt: skip
        cycle = devices.arm.cycle
        self._clock = StageClock(STAGES)
        period = 1.0 / devices.sensor.rate
        self._silence = SilenceGuard(max(scene.safety.silence, 5.0 * period), cycle, period)
        self.arm = ArmMotion(scene, pipeline, devices, self._clock, self._silence)
        self.start_up = StartUp(pipeline, devices, self.arm, recorder, scene.motion.approach_speed, confirm)
        self._request = MotionRequest(pipeline, self.arm)
        self._record = RunRecord(scene, pipeline, recorder)
        parts = LoopParts(
            scene, pipeline, self.arm, self._request, recorder, self._record, self._clock, self._silence, confirm
        )
        self._sample = SampleStep(parts)
        self.recovery = Recovery(parts, devices, self._sample, message)
        self.outcome: Outcome | None = None
        self._until = StopRules(scene.run.until, recorder, pipeline)

    @property
    def time(self) -> float:
        """s since the start of the run, on the robot's clock."""
        return self.arm.time - self._sample.zero_time

    @property
    def zero_time(self) -> float:
        """s on the robot's clock at which the run's time began; later by each pause in which it stood still."""
        return self._sample.zero_time

    @property
    def observation(self) -> Observation | None:
        """What the strategy was shown last."""
        return self._sample.observation

    @property
    def asked(self) -> Motion | None:
        """The strategy's last motion."""
        return self._request.asked

    def begin(self, elapsed: float = 0.0) -> None:
        """Hand the task to the strategy; the run's time begins, `elapsed` s after its zero."""
        area, margin = self._pipeline.area, self._scene.safety.margin
        self.arm.guard.confine(area.lower - margin, area.upper + margin)
        task, sensor = self.task(), self._devices.sensor
        arm_delay = self._devices.arm_delay
        stated = reaction_delay(self._scene, self.arm.cycle, sensor.latency, sensor.rate, None, arm_delay)
        self._pipeline.force.begin(task.delay, stated, task.arm_mass)
        self._sample.zero_time = self.arm.time - elapsed
        if self._recorder.bag is not None:
            self._recorder.bag.begin(self._sample.zero_time, elapsed, self._pipeline.trajectory.pose, task)
        try:
            self._pipeline.strategy.start(task)
        except StorageError:
            raise
        except Exception as error:
            raise failed("strategy", self._scene.strategy.name, error) from error
        self._pipeline.ask_line_spacing()

    def task(self) -> Task:
        """What is to be done, from where the tip stands."""
        sensor = self._devices.sensor
        measured, arm_delay = self.start_up.loop_delay, self._devices.arm_delay
        delay = reaction_delay(self._scene, self.arm.cycle, sensor.latency, sensor.rate, measured, arm_delay)
        reachable, clear = self._answered(self._request.reachable), self._answered(self._request.clear)
        mass = tip_mass(self._pipeline.robot, self._devices.arm_mass, self.arm.q)
        return make_task(self._scene, self._pipeline, delay, reachable, clear, mass)

    def _answered(self, ask: Question) -> Question:
        """The question with its answers in the bag, where one is recorded."""
        bag = self._recorder.bag
        return ask if bag is None else lambda poses: bag.answer(ask(poses))

    def observations(self, time_limit: float) -> Generator[Observation, None, None]:
        """What the strategy is shown during the run; whatever ends it early, what was measured is kept.

        The arm is brought to rest at the end, also where the caller stops earlier; then `outcome` says how it ended.
        """
        begin, shown = perf_counter(), 0.0
        self._clock.reset()  # what came before was no part of the run
        status, reason, cause, stopped_by = "ended early", "stopped by the caller", None, ""
        try:
            while not isinstance(self._request.current, Done):
                try:
                    yield from self._cycle(time_limit)
                except MotionInterrupted as error:
                    self.recovery.after_stop(error)
                except SensorSilent as error:
                    self.recovery.after_silence(error)
                if self.time > time_limit:
                    reason = f"time limit of {time_limit:.0f} s of robot time"
                    break
                stopped_by, met = self._until.met(self.time)
                if stopped_by:
                    status, reason = "done", met
                    break
                if self._watch is not None and perf_counter() - shown > SHOW_EVERY:
                    shown = self._show(begin)
            else:
                reason = self._request.current.reason
                status = "done" if self._request.current.complete else "ended early"
                stopped_by = "strategy" if self._request.current.complete else ""
        except (DriverError, SafetyStop, PluginError, StorageError) as error:
            reason, cause = str(error), error
        except KeyboardInterrupt:
            reason = "interrupted"
        finally:
            self.end(status, reason, cause, stopped_by)
            with suppress(PluginError):  # a strategy that cannot say how far it is ends no run that has ended
                self._show(begin)

    def end(self, status: str, reason: str, cause: Exception | None = None, stopped_by: str = "") -> Outcome:
        """Bring the arm to rest; what has happened so far, under a status and a reason."""
        self.come_to_rest(cause)
        if self._pipeline.sweep is not None:
            self._pipeline.sweep.leave()
        self.outcome = Outcome(
            status=status,
            reason=reason,
            time=self.time,
            touches=self._record.touches,
            path=self._record.path,
            contact_path=self._record.contact_path,
            peak_force=self._record.peak_force,
            peak_bound=self._record.peak_bound,
            late_by=self.arm.excess.largest,
            interruptions=self.recovery.table(),
            gaps=self._silence.yields,
            range_used=self._record.range_used,
            cycle_us=self._clock.cycle_median(),
            guard_interventions=self._sample.force_guard.interventions,
            slowed_cycles=self.arm.slowed,
            stages=self._clock.table(),
            counters=self._pipeline.conditioner.counters,
            stopped_by=stopped_by,
            missed=self._until.missed() if stopped_by == "strategy" else (),
        )
        return self.outcome

    def come_to_rest(self, cause: Exception | None = None) -> None:
        """Brake inside the limits, retreat where nothing is measured any more, then hold.

        After a `MotionStop` the arm brakes by itself, and a device that no longer answers has stopped by itself.
        """
        arm, trajectory, safety = self._devices.arm, self._pipeline.trajectory, self._scene.safety
        try:
            if isinstance(cause, MotionStop):
                for _ in range(int(0.5 / self.arm.cycle)):
                    arm.read()
                return
            trajectory.stop()
            self.arm.finish_plan(1.0)
            retreat = self._sample.retreat
            if isinstance(cause, SensorLost | ObjectMoved) and not retreat.gone:
                # Without a sensor: off the surface and back on the tip's own path, which was free a moment ago.
                for place in retreat.places(trajectory.pose[:3, 3], safety.retreat):
                    pose = trajectory.pose.copy()
                    pose[:3, 3] = place
                    trajectory.set_goal(pose, self._scene.motion.approach_speed)
                    self.arm.finish_plan(5.0)
            arm.stop()
        except (DriverError, SafetyStop):
            return

    def _cycle(self, time_limit: float) -> list[Observation]:
        """One cycle, and those after it in which nothing new is measured; what the strategy was shown."""
        clock, arm = self._clock, self.arm
        clock.start(arm.stretch)
        arm.observe()
        clock.lap("arm")
        try:
            samples = self._devices.sensor.read()
        except DriverError as error:
            raise SensorLost(str(error)) from error
        clock.lap("sensor")
        if samples:
            arm.excess.note_age(arm.time - samples[-1].time)
        seen = [self._sample.process(sample) for sample in samples]
        silence = self._silence.check(arm.time)
        if silence is Silence.OVERDUE:
            self._request.pause()
        elif silence is Silence.MISSING:
            arm.excess.note_silence(self._silence.late)
            self._sample.give_way()
        cycles = 1
        if not isinstance(self._request.current, Done):
            cycles = arm.cycles_ahead(int((self._sample.zero_time + time_limit - arm.time) / arm.cycle))
        arm.move(cycles)
        return seen

    def _show(self, begin: float) -> float:
        """Show a snapshot; the wall-clock time [s] of now."""
        now = perf_counter()
        if self._watch is not None:
            progress = self._pipeline.progress()
            contacts = len(self._recorder.contacts)
            self._watch(ProgressSnapshot(self.time, now - begin, progress, contacts, self._record.force))
        return now


def make_task(
    scene: Scene, pipeline: Pipeline, delay: float, reachable: Question, clear: Question, arm_mass: float = 0.0
) -> Task:
    """What is to be done, from where the generator has the tip.

    `delay` is s from a force to the arm's reaction, `arm_mass` kg of the arm as its tip shows it.
    """
    pose = pipeline.trajectory.pose
    return Task(
        area=pipeline.area,
        probe=pipeline.probe,
        orientation=pose[:3, :3].copy(),
        start=pose[:3, 3].copy(),
        free_speed=scene.motion.free_speed,
        approach_speed=scene.motion.approach_speed,
        contour_speed=scene.motion.contour_speed,
        acceleration=scene.motion.acceleration,
        force_threshold=scene.contact.threshold,
        force_target=scene.contact.target,
        force_limit=scene.contact.limit,
        torque_limit=scene.safety.torque_share * min(scene.probe.torque_range[:2]),
        clearance_threshold=scene.clearance.threshold,
        stiffness=scene.contact.stiffness,
        delay=delay,
        softer=pipeline.force.speeds.softer,
        arm_mass=arm_mass,
        arm_stiffness=arm_stiffness(scene),
        search_for=scene.area.search_for,
        detail=scene.area.detail,
        headroom=max(scene.safety.margin - OVERSHOOT, 0.0),
        options=pipeline.options,
        reachable=reachable,
        clear=clear,
    )
