"""One exploration from scene to run folder, step by step or in one call."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, Self

from lwrprobe.compiled.pipeline import collector_paused
from lwrprobe.contracts import (
    GroundTruth,
    InputError,
    LeftOut,
    LwrprobeError,
    MissingExtraError,
    Observation,
    Reconstruction,
    StorageError,
    TouchRecord,
)
from lwrprobe.evaluation.run_folder import RunFolder, read_run
from lwrprobe.evaluation.summary import Summary
from lwrprobe.evaluation.table_touches import TablePlane, find_table
from lwrprobe.evaluation.truth import is_world_of
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import Explorer, WatchFunction
from lwrprobe.exploration.loop.jit_warm_up import settled_memory, warm_up
from lwrprobe.exploration.procedures.compile_ahead import NOMINAL_CYCLE, CompileAhead
from lwrprobe.exploration.procedures.start_posture import scene_at_start, unreachable_part
from lwrprobe.exploration.recording.certification import certify
from lwrprobe.exploration.recording.corrections import correct_contacts
from lwrprobe.exploration.recording.error_budget import ErrorBudget
from lwrprobe.exploration.recording.error_sources import recorded_budget
from lwrprobe.exploration.recording.fitted_shapes import fitted_shapes
from lwrprobe.exploration.recording.logbook import Logbook, Logged, read_log
from lwrprobe.exploration.recording.mesh_errors import expect_mesh_errors
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.results import touch_record, write_results
from lwrprobe.exploration.recording.resume import Resumed
from lwrprobe.exploration.recording.run_files import check_own
from lwrprobe.exploration.recording.run_warnings import ANOTHER_WORLD, run_warnings
from lwrprobe.exploration.recording.summary import summarise
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.stages.pipeline import Choices, Pipeline, choose, compose
from lwrprobe.exploration.stages.touch_law import softer_than_along, stiffness_slope
from lwrprobe.host.real_time import LOOP, real_time_priority
from lwrprobe.reconstruction.reconstruct import reconstructed
from lwrprobe.scene import Scene, write_scene

BIAS_SECONDS = 0.8
"""s at rest, over which the sensor's bias is averaged."""


@dataclass(slots=True, frozen=True, kw_only=True)
class RunOptions:
    """How an exploration is carried out, beside what its scene says.

    Attributes
    ----------
    out : folder for contacts, map, cloud, mesh, picture and summary; None keeps nothing on disk
    realtime : a simulator keeps pace with the wall clock
    watch : called some ten times a second with a `ProgressSnapshot`
    message : called with a sentence at each new phase
    choices : strategy and reconstructor, None = those that the scene names
    confirm : asks for each of the first motions
    earlier : a run that was cut off, in the folder `out`, which is resumed; see `resume`
    record : write a bag into the run folder; None = on real devices, where its libraries are installed
    """

    out: Path | None = None
    realtime: bool = False
    watch: WatchFunction | None = None
    message: Callable[[str], None] = lambda text: None
    choices: Choices | None = None
    confirm: Confirm | None = None
    earlier: RunFolder | None = None
    record: bool | None = None


class Exploration:
    """One exploration: prepared when it is made, explored inside its `with` block, evaluated by `finish`.

    Iterating over it advances sample by sample, each the observation that the strategy was shown; when the strategy is
    done, or anything ends the run early, there are no more. The arm moves only while it is iterated over.

    Parameters
    ----------
    scene : from `lwrprobe.scene.load_scene`
    options : None = the defaults

    Attributes
    ----------
    pipeline : map, strategy and the stages between them
    explorer : the loop; its `outcome` says how the run ended
    recorder : contacts and path so far
    surface : the mesh, None before `finish` and where there is none
    budget : how far each contact may be off, likewise

    Raises InputError and its kin for a scene that cannot be run; where the `with` block begins, DriverError for devices
    that do not open, and InputError or StorageError for a folder that cannot be written to. An earlier run in the
    folder is removed after the devices have opened. What ends the run early after that stands in the summary's
    `status` and `reason`.
    """

    def __init__(self, scene: Scene, options: RunOptions | None = None) -> None:
        self._stated = scene
        self._options = options or RunOptions()
        self.out, self._message, self._earlier = self._options.out, self._options.message, self._options.earlier
        self._ahead = CompileAhead.where_it_pays(scene)
        try:
            with collector_paused():
                self._prepare()
        except BaseException:
            self._end_ahead()
            raise
        self._stack = ExitStack()
        self._observations: Generator[Observation, None, None] | None = None
        self._began = perf_counter()
        self.surface: Reconstruction | None = None
        self.budget: ErrorBudget | None = None
        self._summary: Summary | None = None

    def _prepare(self) -> None:
        begin = perf_counter()
        scene, robot, pose, q = scene_at_start(self._stated)
        self.scene, self._start = scene, (pose, q)
        out, message, earlier = self.out, self._message, self._earlier
        options, record = self._options, self._options.record
        choices = options.choices or choose(scene)
        if record:
            _check_recording(out)
        self._beyond = unreachable_part(scene, robot, pose, q)
        if self._beyond:
            message(self._beyond)
        if out is not None and earlier is None:
            check_own(out)
        self.recorder = Recorder(out, earlier)
        self._seconds = {"prepare": perf_counter() - begin}

        message("loading kernels; the first time they are compiled, which takes up to a minute")
        begin = perf_counter()
        if self._ahead is not None:  # it begins with the simulator: what does not need that comes first here
            warm_up(scene, choices, NOMINAL_CYCLE, scene.sensor.rate, pose, q)
        self._devices = Devices.assemble(self._stated, scene.run.seed, options.realtime, q)
        if self._devices.ground_truth is None:
            _refuse_what_needs_a_simulator(scene)
        arm, sensor = self._devices.arm, self._devices.sensor
        self.pipeline = compose(scene, choices, arm.cycle, sensor.rate)
        self.pipeline.left_out += self._devices.left_out
        self.pipeline.force.speeds.expect(pose[:3, 3], stiffness_slope(robot, q), softer_than_along(scene, robot, q))
        warm_up(scene, choices, arm.cycle, sensor.rate, pose, q)
        if record is None:
            record = out is not None and self._devices.ground_truth is None and self._can_record()
        if record:
            assert out is not None
            from lwrprobe.bags.recover import recover_bag
            from lwrprobe.exploration.recording.run_bag import RunBag

            if earlier is not None and (out / "bag").is_dir():
                recover_bag(out)
            self.recorder.bag = RunBag(out, robot, sensor, arm.cycle, scene.probe.radius)
        self._log: Logbook | None = None
        if earlier is not None:
            self._log = _taken_up(self.pipeline, earlier)
        self.explorer = Explorer(
            scene, self.pipeline, self._devices, self.recorder, options.watch, options.confirm, message
        )
        if isinstance(self.pipeline.strategy, Resumed):
            message("going through what was done")
            self.pipeline.place_tip(pose, q)
            self.pipeline.strategy.recall(self.explorer.task(), self.pipeline, self.recorder)
        self._contacts_before = len(self.recorder.contacts)
        self._seconds["compile"] = perf_counter() - begin

    @property
    def truth(self) -> GroundTruth[Scene] | None:
        """What a simulator knows; None on real devices."""
        return self._devices.ground_truth

    def __enter__(self) -> Self:
        begin = perf_counter()
        with ExitStack() as stack:
            stack.enter_context(settled_memory())
            stack.enter_context(self._devices)
            if self._devices.ground_truth is None:
                stack.enter_context(real_time_priority(LOOP))
            with collector_paused():
                self._begin_recording()
                self._make_ready()
            self._stack = stack.pop_all()
        self._seconds["compile"] += perf_counter() - begin
        self._message("exploring")
        self._began = perf_counter()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is not None:
            self._end_ahead()
        self.close()

    def __iter__(self) -> Iterator[Observation]:
        return iter(()) if self._observations is None else self._observations

    def interrupt(self) -> None:
        """End the run as Ctrl-C does within a cycle; for one that fell between two of them, into the caller's loop."""
        if self._observations is not None:
            with suppress(StopIteration, KeyboardInterrupt):  # the second from one that has not begun
                self._observations.throw(KeyboardInterrupt)
        if self.explorer.outcome is None:
            self.explorer.end("ended early", "interrupted")

    def close(self) -> None:
        """Bring the arm to rest, release the devices and close the streams; may be called more than once."""
        if "explore" in self._seconds:
            return
        try:
            if self._observations is not None:
                self._observations.close()
            if self.explorer.outcome is None:
                self.explorer.end("ended early", "stopped by the caller")
        finally:
            self._stack.close()
            self._close_recording()
            if self._log is not None:
                self._log.close()
            self._seconds["explore"] = perf_counter() - self._began

    def finish(self) -> Summary:
        """End the run where it is still going on, make the mesh, compare it with the truth and write the files."""
        if self._summary is not None:
            return self._summary
        self.close()
        try:
            if self._ahead is not None and self._ahead.running:
                self._message("waiting for kernels that are being compiled")
                self._ahead.wait()
            with collector_paused():
                self._summary = self._evaluate()
        finally:
            self._end_ahead()
        return self._summary

    def _begin_recording(self) -> None:
        """Open the run folder. An earlier run that is there is lost by it: the devices have answered by now."""
        self.recorder.open()
        if self.out is None:
            return
        write_scene(self._stated, self.out / "scene.toml")
        if self.recorder.bag is not None:
            self.recorder.bag.open()
        if self._log is None:
            self._log = Logbook(self.out)
            self.pipeline.strategy = Logged(self.pipeline.strategy, self._log)

    def _can_record(self) -> bool:
        """Whether the libraries for a bag are there; else the run says that it goes without one."""
        try:
            _check_recording(self.out)
        except MissingExtraError as error:
            self.pipeline.left_out.append(LeftOut(stage="bag", why=str(error)))
            return False
        return True

    def _close_recording(self) -> None:
        """Close streams and bag; where the disk is full even for that, the outcome says so."""
        outcome = self.explorer.outcome
        try:
            if self.recorder.bag is not None and outcome is not None:
                self.recorder.bag.close(self.pipeline.voxels, f"{outcome.status}: {outcome.reason}")
        except StorageError as error:
            if outcome is not None and outcome.status == "done":
                outcome.status, outcome.reason = "ended early", str(error)
        self.recorder.close()

    def _evaluate(self) -> Summary:
        try:
            return self._evaluated()
        except OSError as error:
            raise StorageError(self.out, error) from None

    def _evaluated(self) -> Summary:
        scene, pipeline, recorder, outcome = self.scene, self.pipeline, self.recorder, self.explorer.outcome
        assert outcome is not None
        begin = perf_counter()
        if pipeline.object_motion is not None and pipeline.object_motion.moved_since is not None:
            recorder.withhold(pipeline.object_motion.moved_since)
        table = leave_table_out(recorder, scene, pipeline)
        self._seconds["explore"] += perf_counter() - begin

        self._message("reconstructing and comparing")
        begin = perf_counter()
        corrections = correct_contacts(recorder, scene, pipeline, self._start[1])
        self.record = touch_record(recorder, scene, pipeline.voxels, pipeline.line_spacing)
        self.surface, lack = reconstruct_surface(self.record, pipeline, scene.reconstruction.method)
        pipeline.left_out += lack
        self.budget = budget = recorded_budget(scene, pipeline, recorder, corrections)
        certified = certify(recorder, pipeline.area, pipeline.probe, pipeline.line_spacing, outcome.time)
        truth, seconds = self._devices.ground_truth, self._seconds["explore"]
        summary = summarise(scene, pipeline, truth, recorder, outcome, self.surface, seconds, budget, certified)
        if budget is not None:
            table_height = 1e-3 * scene.uncertainty.sigma("table_height_mm")
            summary.fits = fitted_shapes(budget, self.record, table_height)
            if self.surface is not None:
                summary.expected_mesh_error_mm = expect_mesh_errors(budget, self.surface, self.record.lowest)
        summary.table_found = table
        for name, report in corrections.report().items():
            setattr(summary, name, report)
        summary.limits_used = self.explorer.arm.guard.peaks
        summary.devices = self._devices.counters()
        if self._earlier is not None:
            summary.resumed = {"from_s": round(self._elapsed, 3), "contacts_before": self._contacts_before}
        if self.out is not None:
            if not (self.out / "contacts.csv").is_file():
                self.recorder.write_again()
                write_scene(scene, self.out / "scene.toml")
            write_results(self.out, scene, pipeline, recorder, self.surface, summary)
            if budget is not None:
                budget.write(self.out / "contact_errors.csv", [c.time for c in recorder.contacts])
            if certified is not None:
                certified.write(self.out)
        self._seconds["finish"] = perf_counter() - begin
        summary.unreachable_area = self._beyond
        summary.warnings = [*run_warnings(summary, scene.contact.limit), *outcome.missed]
        if truth is not None and not is_world_of(truth.scene, self._stated):
            summary.warnings.append(ANOTHER_WORLD)
        summary.wall_time_s = round(sum(self._seconds.values()), 3)
        summary.wall_time_parts_s = {name: round(value, 3) for name, value in self._seconds.items()}
        if self.out is not None:
            summary.write(self.out / "summary.json")
            if self._log is not None and outcome.status == "done":
                self._log.discard()
            from lwrprobe.evaluation.run_report import write_report

            self._message("writing the report")
            write_report(self.out, self.surface)
        return summary

    def _end_ahead(self) -> None:
        if self._ahead is not None:
            self._ahead.close()

    @property
    def _elapsed(self) -> float:
        """s of the run before it was resumed."""
        return self._earlier.duration if self._earlier is not None else 0.0

    def _make_ready(self) -> None:
        """Arm at its start, bias taken, strategy started; where that is refused the run has ended."""
        explorer = self.explorer
        try:
            explorer.start_up.take_place(*self._start)
            explorer.start_up.take_bias(BIAS_SECONDS)
            explorer.begin(self._elapsed)
        except LwrprobeError as error:
            explorer.end("ended early", str(error), error)
            return
        self._observations = explorer.observations(self.scene.run.time_limit)


def explore(scene: Scene, out: Path | None = None, **given: Any) -> dict[str, Any]:
    """Explore a scene from start to end and return the content of its `summary.json`; arguments as of `RunOptions`."""
    with Exploration(scene, RunOptions(out=out, **given)) as exploration:
        try:
            for _ in exploration:
                pass
        except KeyboardInterrupt:
            exploration.interrupt()
    return exploration.finish().as_dict()


def resume(folder: Path, **given: Any) -> dict[str, Any]:
    """Take up a run that was cut off, in its own folder; returns and takes what `explore` does.

    Raises FormatError for a folder that has nothing to take up.
    """
    earlier = read_run(folder, corrected=False)
    return explore(earlier.scene, folder, earlier=earlier, **given)


def _check_recording(out: Path | None) -> None:
    """Raise MissingExtraError without the libraries for a bag, InputError without a folder for it."""
    from lwrprobe.bags.messages import require

    if out is None:
        raise InputError("record", True, "a run folder to record into")
    require("recording a bag")


def _taken_up(pipeline: Pipeline, earlier: RunFolder) -> Logbook:
    """Put the log of a run that was cut off before the pipeline's strategy, and the strategy's past."""
    past = read_log(earlier.folder, 0.5 * earlier.scene.contact.threshold)
    log = Logbook(earlier.folder, keep=past.last + 2)  # the task's row, and those up to the last one shown
    pipeline.strategy = Resumed(pipeline.strategy, log, past)
    return log


def leave_table_out(recorder: Recorder, scene: Scene, pipeline: Pipeline) -> dict[str, Any] | None:
    """Where the table was touched, that is no part of the object; for the summary, None where it was not."""
    stated = scene.table.plane()
    if stated is None:
        return None
    points, normals = recorder.points(), recorder.normals()
    table = find_table(points, normals, pipeline.area, scene.probe.radius, TablePlane(stated[:3], stated[3]))
    if table is None:
        return None
    touched = table.touched(points, normals)
    recorder.leave_out(touched)
    return table.as_dict(int(touched.sum()))


def reconstruct_surface(
    record: TouchRecord, pipeline: Pipeline, method: str
) -> tuple[Reconstruction | None, list[LeftOut]]:
    """The mesh of a run's contacts by the scene's `method`, or why there is none."""
    if len(record.points) == 0:
        return None, [{"stage": "reconstruction", "why": "no contact"}]
    try:
        surface = reconstructed(pipeline.reconstructor, record, method)
        why = surface.report.get("instead_of_contact_surface")
        return surface, [{"stage": "contact_surface", "why": why}] if why else []
    except LwrprobeError as error:
        return None, [{"stage": "reconstruction", "why": str(error)}]


def _refuse_what_needs_a_simulator(scene: Scene) -> None:
    """InputError for what no real arm may be asked."""
    for rule in ("certified", "accurate"):
        wanted = getattr(scene.run.until, rule)
        if wanted is not None:
            raise InputError(f"run.until.{rule}", wanted, "nothing with a real arm, whose cycles do not wait for it")
    if scene.area.search_for is not None:
        # Around an object that overhangs, the body behind the stick may press without being sensed.
        raise InputError(
            "area.search_for", scene.area.search_for, "nothing with a real arm: the area around the object"
        )
