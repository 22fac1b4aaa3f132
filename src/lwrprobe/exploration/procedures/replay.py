"""Recorded sensor data through the pipeline again: contacts, map and decisions, without arm and sensor.

The tip goes where it was recorded to go. The strategy is shown what the pipeline makes of the samples, and its answers
are noted but move nothing. With the settings of the recorded run all its decisions come out the same, bit by bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, cast

import numpy as np

from lwrprobe.contact import agreed_bias
from lwrprobe.contracts import (
    Contact,
    Done,
    FormatError,
    InputError,
    LwrprobeError,
    Motion,
    PluginError,
    SafetyStop,
    Task,
    WrenchSample,
)
from lwrprobe.contracts.plugins import failed
from lwrprobe.evaluation.summary import Summary
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.explorer import STAGES, Outcome, make_task
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.loop.paused_strategy import PausedStrategy
from lwrprobe.exploration.loop.run_record import RunRecord
from lwrprobe.exploration.loop.sample_step import SampleStep
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.loop.state_history import StateHistory
from lwrprobe.exploration.procedures.explore import leave_table_out, reconstruct_surface
from lwrprobe.exploration.procedures.start_posture import scene_at_start
from lwrprobe.exploration.recording.corrections import correct_contacts
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.recording import Pause, Recording
from lwrprobe.exploration.recording.results import touch_record, write_results
from lwrprobe.exploration.recording.run_files import check_apart, check_own
from lwrprobe.exploration.recording.run_warnings import run_warnings
from lwrprobe.exploration.recording.summary import summarise
from lwrprobe.exploration.safety.reaction import ReactionExcess
from lwrprobe.exploration.safety.silence_guard import SilenceGuard
from lwrprobe.exploration.stages.pipeline import Pipeline, choose, compose, reaction_delay
from lwrprobe.exploration.stages.touch_law import softer_than_along, stiffness_slope
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene, load_scene, write_scene


class RecordedHistory:
    """Takes the place of `StateHistory`: where the arm was at the sample that is shown."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        self._recording, self._states = recording, StateHistory(robot)
        self._poses = recording.poses
        self._row = 0
        self.acceleration = 0.0
        self._velocities: np.ndarray | None = None
        if not recording.own:
            tips = (
                recording.poses if recording.poses is not None else np.array([robot.fk(q).A for q in recording.joints])
            )
            times, places = recording.column("time"), tips[:, :3, 3]
            self._poses = tips
            self._velocities = np.gradient(places, times, axis=0)
            gained = np.gradient(self._velocities, times, axis=0)
            self._accelerations = np.linalg.norm(gained, axis=1)

    @property
    def q(self) -> np.ndarray:
        """(n,) rad, of the sample that is shown."""
        return self._states.q

    def show(self, k: int) -> None:
        """Sample k comes next."""
        row = self._recording.rows[k]
        self._row = k
        if self._velocities is None:
            self._states.note(float(row[1]), row[14:17].copy(), self._recording.joints[k].copy())
            self.acceleration = float(row[11])
        else:
            self.acceleration = float(self._accelerations[k])
            if self._recording.poses is None:
                self._states.q[:] = self._recording.joints[k]

    def measured_velocity(self, time: float) -> np.ndarray:
        """(3,) m/s of the tip at the sample that is shown."""
        if self._velocities is None:
            return self._recording.rows[self._row, 17:20].copy()
        return self._velocities[self._row].copy()

    def tip_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Tip pose (4, 4) and velocity (3,) m/s at the sample that is shown."""
        if self._velocities is None:
            return self._states.tip_at(time)
        assert self._poses is not None
        return self._poses[self._row].copy(), self._velocities[self._row].copy()


class RecordedArm:
    """Takes the place of `ArmMotion` for the steps that only ask where the arm is."""

    def __init__(self, recording: Recording, robot: Robot) -> None:
        self._recording = recording
        self.history = RecordedHistory(recording, robot)
        self.time, self.q, self.blocked = 0.0, np.zeros(robot.n), ""
        self.cycle = recording.cycle
        self.excess = ReactionExcess(self.cycle, recording.latency, 1.0 / recording.rate)

    def show(self, k: int, tip: RecordedTip) -> None:
        """Sample k comes next; `tip` gets its place."""
        row = self._recording.rows[k]
        self.history.show(k)
        self.time = float(row[10])
        self.blocked = self._recording.words[int(row[13])]
        tip.arrived = bool(row[12])
        tip.pose, _ = self.history.tip_at(float(row[1]))
        self.q[:] = self.history.q


class RecordedTip:
    """Takes the generator's place: where the tip is, and whether it had arrived."""

    def __init__(self, pose: np.ndarray) -> None:
        self.pose, self.arrived = pose, False


class RecordedRequest(MotionRequest):
    """Notes motions and has none of them carried out; gives the recorded answers where it is asked to."""

    def __init__(self, pipeline: Pipeline, arm: RecordedArm, answers: Sequence[bool] | None) -> None:
        super().__init__(pipeline, cast(ArmMotion, arm))
        self._answers = iter(answers) if answers is not None else None

    def adopt(self, motion: Motion, urgent: bool = False) -> None:
        """Note it."""
        self.current = motion

    def reachable(self, poses: Sequence[np.ndarray]) -> bool:
        """As recorded, or for the arm as it stands now."""
        return super().reachable(poses) if self._answers is None else self._next()

    def clear(self, poses: Sequence[np.ndarray]) -> bool:
        """As recorded, or for the arm as it stands now."""
        return super().clear(poses) if self._answers is None else self._next()

    def _next(self) -> bool:
        assert self._answers is not None
        answer = next(self._answers, None)
        if answer is None:
            raise PluginError("the strategy asks more than it did while it was recorded: it is another version")
        return answer


def recorded_scene(recording: Recording, scene: Scene | None = None, overrides: Sequence[str] = ()) -> Scene:
    """The scene of a recording with `key=value` overrides; `scene` is for one that contains none.

    Raises InputError without a scene, and what `load_scene` raises.
    """
    if scene is not None:
        return load_scene(scene, overrides)
    beside = recording.path.parent.parent / "scene.toml"
    if recording.own and beside.is_file():  # mesh files are found from there
        return load_scene(beside, overrides)
    if not recording.scene:
        raise InputError("--scene", None, "a scene: this bag does not contain the one it was recorded in")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        file.write_text(recording.scene, encoding="utf-8")
        return load_scene(file, overrides)


class Replay:
    """One passage of a recording through a pipeline.

    Parameters
    ----------
    recording : with the joints of the scene's robot
    scene : its settings hold, also where they differ from those of the recorded run
    out : run folder, None keeps nothing on disk
    same : the settings are those of the recorded run, so the recorded answers to the strategy's questions hold

    Raises InputError and its kin for settings that cannot be run, FormatError for a recording of another robot.
    """

    def __init__(self, recording: Recording, scene: Scene, out: Path | None = None, same: bool = True) -> None:
        if out is not None:
            check_apart("out", out, [recording.path])
            check_own(out)
        stated = scene
        scene, _, *self._start = scene_at_start(stated)
        self.scene, self._recording, self._out, self._same = scene, recording, out, same
        pipeline = self.pipeline = compose(scene, choose(scene), recording.cycle, recording.rate)
        joints = recording.joints.shape[1]
        if recording.poses is None and joints != pipeline.robot.n:
            raise FormatError(f"{recording.path}: {joints} joints; {pipeline.robot.name} has {pipeline.robot.n}")
        self.recorder = Recorder(out)
        self._stated = stated
        self._arm = RecordedArm(recording, pipeline.robot)
        self._clock = StageClock(STAGES)
        self._record = RunRecord(scene, pipeline, self.recorder)
        known = recording.answers if same and recording.own else None
        self._request = RecordedRequest(pipeline, self._arm, known)
        silence = SilenceGuard(np.inf, recording.cycle, 1.0 / recording.rate)
        parts = LoopParts(
            scene, pipeline, cast(ArmMotion, self._arm), self._request, self.recorder, self._record, self._clock,
            silence, None,
        )  # fmt: skip
        self._sample = SampleStep(parts)
        self._sample.zero_time = recording.zero
        self._paused = PausedStrategy(parts, self._sample)
        self.outcome: Outcome | None = None

    def run(self) -> Outcome:
        """From the first sample to the last, or to where the pipeline ends the run."""
        begin = perf_counter()
        status, reason = "ended early", "the recording ends here"
        last = 0.0
        self.recorder.open()
        if self._out is not None:
            write_scene(self._stated, self._out / "scene.toml")
        try:
            tip = self._begin()
            self._clock.reset()
            pauses = deque(self._recording.interruptions)
            for k in self._recording.sequel():
                while pauses and pauses[0].row <= k:
                    self._pass(pauses.popleft())
                self._arm.show(int(k), tip)
                self._clock.start()
                if not self._recording.shown(int(k)):
                    self._paused.watch(self._recording.sample(int(k)))
                    continue
                last = self._sample.process(self._recording.sample(int(k))).time
                if isinstance(self._request.current, Done):
                    done = self._request.current
                    status, reason = "done" if done.complete else "ended early", done.reason
                    break
        except (SafetyStop, PluginError) as error:
            reason = str(error)
        finally:
            if self.pipeline.sweep is not None:
                self.pipeline.sweep.leave()
            self.recorder.close()
        self.seconds = perf_counter() - begin
        record = self._record
        self.outcome = Outcome(
            status=status, reason=reason, time=last, touches=record.touches, path=record.path,
            contact_path=record.contact_path, peak_force=record.peak_force, peak_bound=record.peak_bound, late_by=0.0,
            interruptions=[], gaps=0, range_used=record.range_used, cycle_us=self._clock.cycle_median(),
            guard_interventions=self._sample.force_guard.interventions, slowed_cycles=0, stages=self._clock.table(),
            counters=self.pipeline.conditioner.counters,
        )  # fmt: skip
        return self.outcome

    def _pass(self, pause: Pause) -> None:
        """What the run did in an interruption, done again."""
        if pause.rest:
            rest = range(pause.row - pause.rest, pause.row)
            self._paused.check_zero([self._recording.sample(k) for k in rest], pause.since, pause.rotation)
        else:
            self._paused.resume(pause.pause)

    def finish(self) -> Summary:
        """Mesh, summary and report as of an exploration without a known truth."""
        outcome = self.outcome or self.run()
        scene, pipeline, recorder, out = self.scene, self.pipeline, self.recorder, self._out
        if pipeline.object_motion is not None and pipeline.object_motion.moved_since is not None:
            recorder.withhold(pipeline.object_motion.moved_since)
        table = leave_table_out(recorder, scene, pipeline)
        corrections = correct_contacts(recorder, scene, pipeline, self._start[1])
        surface, lack = reconstruct_surface(
            touch_record(recorder, scene, pipeline.voxels, pipeline.line_spacing), pipeline, scene.reconstruction.method
        )
        pipeline.left_out += [*lack, {"stage": "truth", "why": "a recording is replayed"}]
        summary = summarise(scene, pipeline, None, recorder, outcome, surface, self.seconds)
        summary.table_found = table
        for name, report in corrections.report().items():
            setattr(summary, name, report)
        summary.warnings = run_warnings(summary, scene.contact.limit)
        summary.wall_time_s, summary.wall_time_parts_s = round(self.seconds, 3), {"explore": round(self.seconds, 3)}
        if out is not None:
            write_results(out, scene, pipeline, recorder, surface, summary)
            summary.write(out / "summary.json")
            from lwrprobe.evaluation.run_report import write_report

            write_report(out, surface)
        return summary

    @property
    def contacts(self) -> list[Contact]:
        """Those that were accepted."""
        return self.recorder.contacts

    def _begin(self) -> RecordedTip:
        """The sensor's bias from the recorded pauses; then the strategy takes over."""
        recording, pipeline, scene = self._recording, self.pipeline, self.scene
        run = recording.run()
        if not len(run):
            raise SafetyStop("the recording ends before the run begins")
        tip = RecordedTip(np.eye(4))
        self._arm.show(int(run[0]), tip)
        if recording.start is not None:
            tip.pose = recording.start.copy()
        pipeline.trajectory = cast(Any, tip)
        self._take_bias(tip.pose[:3, :3].copy())
        pose, q = self._start
        slope, softer = stiffness_slope(pipeline.robot, q), softer_than_along(scene, pipeline.robot, q)
        pipeline.force.speeds.expect(pose[:3, 3], slope, softer)
        task = self._task()
        pipeline.force.begin(task.delay, tip_mass=task.arm_mass)
        try:
            pipeline.strategy.start(task)
            pipeline.ask_line_spacing()
        except LwrprobeError:
            raise
        except Exception as error:
            raise failed("strategy", scene.strategy.name, error) from error
        return tip

    def _task(self) -> Task:
        """With the delay that the recorded run had found, unless the settings state another one."""
        recording = self._recording
        delay = recording.delay
        if delay is None or not (self._same or self.scene.contact.delay is None):
            delay = reaction_delay(self.scene, recording.cycle, recording.latency, recording.rate)
        ask = self._request
        return make_task(self.scene, self.pipeline, delay, ask.reachable, ask.clear, recording.arm_mass)

    def _take_bias(self, rotation: np.ndarray) -> None:
        conditioner, pauses = self.pipeline.conditioner, self._recording.pauses()
        batches = [[self._recording.sample(k) for k in pause] for pause in pauses]
        if len(batches) == 1:
            outcome = conditioner.take_bias(batches[0], rotation)
        else:
            left = iter(batches)

            def listen() -> list[WrenchSample]:
                return next(left, [])

            outcome = agreed_bias(conditioner, listen, lambda: None, rotation).outcome
        if not outcome.taken:
            raise SafetyStop(f"the bias cannot be taken from the recording: {outcome.reason}")
        self.pipeline.adopt_noise(outcome.noise)
