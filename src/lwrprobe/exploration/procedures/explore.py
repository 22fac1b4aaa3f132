"""One exploration from scene to run folder: the function behind `lwrprobe explore`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lwrprobe.contracts import InputError, LwrprobeError, Reconstruction, TouchRecord
from lwrprobe.evaluation.run_folder import RunFolder, read_run
from lwrprobe.evaluation.table_touches import find_table
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import Explorer, Outcome, WatchFunction
from lwrprobe.exploration.loop.jit_warm_up import settled_memory, warm_up
from lwrprobe.exploration.recording.logbook import Logbook, Logged, read_log
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.resume import Resumed
from lwrprobe.exploration.recording.summary import summarise
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.stages.pipeline import Choices, Pipeline, choose, compose, robot_of
from lwrprobe.kinematics import IKResult, IKSolver, IKStatus, Robot, reachable
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import Scene, write_scene

Tell = Callable[[str], None]

BIAS_SECONDS = 0.8


def explore(
    scene: Scene,
    out: Path | None = None,
    *,
    realtime: bool = False,
    watch: WatchFunction | None = None,
    tell: Tell = lambda text: None,
    choices: Choices | None = None,
    confirm: Confirm | None = None,
    earlier: RunFolder | None = None,
) -> dict[str, Any]:
    """Explore a scene and return its summary; with `out`, leave a run folder.

    Parameters
    ----------
    scene : from `lwrprobe.scene.load_scene`
    out : folder for contacts, map, cloud, mesh, picture and summary; None keeps nothing on disk
    realtime : a simulator keeps pace with the wall clock
    watch : called some ten times a second with a `ProgressSnapshot`
    tell : called with a sentence at each new phase
    choices : strategy and reconstructor, None = those that the scene names
    confirm : asks for each of the first motions
    earlier : a run that was cut off, in the folder `out`, which is taken up; see `resume`

    Raises InputError and its kin for a scene that cannot be run; once the arm moves nothing is raised any more: what
    ends the run early stands in the summary's `status` and `reason`.
    """
    begin = perf_counter()
    choices = choices or choose(scene)
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    beyond = unreachable_part(scene, robot, pose, q)
    if beyond:
        tell(beyond)
    recorder = Recorder(out, earlier)
    if out is not None:
        write_scene(scene, out / "scene.toml")
    seconds = {"prepare": perf_counter() - begin}

    tell("loading kernels; the first time they are compiled, which takes about a minute")
    begin = perf_counter()
    devices = Devices.assemble(scene, scene.run.seed, realtime, q)
    pipeline = compose(scene, choices, devices.arm.cycle, devices.sensor.rate)
    for driver in devices.drivers.values():
        pipeline.left_out += getattr(driver, "left_out", [])
    warm_up(scene, choices, devices.arm.cycle, devices.sensor.rate, pose, q)
    explorer = Explorer(scene, pipeline, devices, recorder, watch, confirm)
    log = _logged(pipeline, out, earlier)
    if isinstance(pipeline.strategy, Resumed):
        tell("going through what was done")
        pipeline.place_tip(pose, q)
        pipeline.strategy.recall(explorer.task(), pipeline, recorder)
    elapsed = earlier.duration if earlier is not None else 0.0
    before = len(recorder.contacts)
    with settled_memory(), devices:
        refused = _make_ready(explorer, pose, q, elapsed)
        seconds["compile"] = perf_counter() - begin
        tell("exploring")
        begin = perf_counter()
        outcome = refused or explorer.run(scene.run.time_limit)
    recorder.close()
    if log is not None:
        log.close()
    if pipeline.object_motion is not None and pipeline.object_motion.moved_since is not None:
        recorder.withhold(pipeline.object_motion.moved_since)
    table = _leave_table_out(recorder, scene, pipeline)
    seconds["explore"] = perf_counter() - begin

    tell("reconstructing and comparing")
    begin = perf_counter()
    record = touch_record(recorder, scene, pipeline.voxels)
    record.pitch = getattr(pipeline.options, "step", None)
    surface, lack = _reconstruct(record, pipeline)
    pipeline.left_out += lack
    summary = summarise(scene, pipeline, devices.judge, recorder, outcome, surface, seconds["explore"])
    summary["table_found"] = table
    summary["limits_used"] = explorer.motion_guard.peaks
    summary["devices"] = devices.account()
    summary["resumed"] = {"from_s": round(elapsed, 3), "contacts_before": before} if earlier is not None else None
    if out is not None:
        _write(out, scene, pipeline, recorder, surface, summary)
    seconds["finish"] = perf_counter() - begin
    summary["unreachable_area"] = beyond
    summary["wall_time_s"] = round(sum(seconds.values()), 3)
    summary["wall_time_parts_s"] = {name: round(value, 3) for name, value in seconds.items()}
    recorder.write_json("summary.json", summary)
    if log is not None and outcome.status == "done":
        log.discard()
    if out is not None:
        from lwrprobe.evaluation.run_report import write_report

        tell("writing the report")
        write_report(out, surface)
    return summary


def start_posture(scene: Scene, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Tip pose (4, 4) and joint values (n,) at the start: above the middle of the area's border in -y.

    Raises InputError when the arm cannot reach it.
    """
    from lwrprobe.scene.table import Pose

    pose = Pose(rpy_deg=scene.arm.tip_rpy_deg).matrix()
    low, high = np.array(scene.area.lower), np.array(scene.area.upper)
    pose[:3, 3] = 0.5 * (low[0] + high[0]), low[1], high[2]
    result = _roomiest(robot, pose, scene.arm.start_deg)
    if result.status != IKStatus.CONVERGED:
        place = [round(float(v), 4) for v in pose[:3, 3]]
        raise InputError("area", place, f"a start that the arm reaches (it ends {result.short_by * 1e3:.1f} mm short)")
    return pose, result.q


def _roomiest(robot: Robot, pose: np.ndarray, start_deg: tuple[float, ...] | None) -> IKResult:
    """The solution farthest from the joint limits among those from a fixed set of seeds, or the one asked for."""
    solver = IKSolver(robot)
    if start_deg is not None:
        return solver.solve(pose, np.radians(start_deg))
    random = np.random.default_rng(0)
    seeds = [np.zeros(robot.n), *random.uniform(0.6 * robot.lower, 0.6 * robot.upper, (24, robot.n))]
    found = [solver.solve(pose, seed) for seed in seeds]
    solved = [result for result in found if result.status == IKStatus.CONVERGED]
    if not solved:
        return min(found, key=lambda result: result.short_by)
    return max(solved, key=lambda result: robot.limit_margin(result.q))


def unreachable_part(scene: Scene, robot: Robot, pose: np.ndarray, q: np.ndarray) -> str:
    """A sentence naming the part of the area that the arm cannot get to with the probe held as wanted, or nothing."""
    low, high = scene.area.lower, scene.area.upper
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, (7, 5, 2))]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    found = reachable(robot, places, pose[:3, :3], q)
    if found.mask.all():
        return ""
    lost = places[~found.mask]
    bounds = ", ".join(f"{axis} {a:.3f} to {b:.3f} m" for axis, a, b in zip("xyz", lost.min(axis=0), lost.max(axis=0)))
    return f"out of reach: {len(lost)} of {len(places)} places of the area, within {bounds} ({found.reason})"


def touch_record(recorder: Recorder, scene: Scene, voxels: VoxelMap) -> TouchRecord:
    """What a reconstructor is given: contacts, or the map's voxels, and the way on which nothing was touched."""
    trace = recorder.trace()
    free = trace[trace[:, 5] == 0.0, 1:4] if len(trace) else np.empty((0, 3))
    if scene.reconstruction.points == "voxels":
        return TouchRecord(
            points=voxels.centres(),
            free_path=free,
            probe_radius=scene.probe.radius,
            table=scene.table.height if scene.table.present else None,
            lowest=scene.area.lower[2],
            resolution=voxels.resolution,
        )
    return TouchRecord(
        points=recorder.points(),
        normals=recorder.normals(),
        trust=np.array([c.trust for c in recorder.contacts]),
        times=np.array([c.time for c in recorder.contacts]),
        free_path=free,
        probe_radius=scene.probe.radius,
        table=scene.table.height if scene.table.present else None,
        lowest=scene.area.lower[2],
    )


def resume(folder: Path, **given: Any) -> dict[str, Any]:
    """Take up a run that was cut off, in its own folder, and return its summary; options as those of `explore`.

    Raises FormatError for a folder that has nothing to take up.
    """
    earlier = read_run(folder)
    return explore(earlier.scene, folder, earlier=earlier, **given)


def _logged(pipeline: Pipeline, out: Path | None, earlier: RunFolder | None) -> Logbook | None:
    """Put the log before the pipeline's strategy, and the strategy's past, where there is one."""
    if out is None:
        return None
    if earlier is None:
        log = Logbook(out)
        pipeline.strategy = Logged(pipeline.strategy, log)
        return log
    past = read_log(out, 0.5 * earlier.scene.contact.threshold)
    log = Logbook(out, keep=past.last + 2)  # the task's row, and those up to the last one shown
    pipeline.strategy = Resumed(pipeline.strategy, log, past)
    return log


def _make_ready(explorer: Explorer, pose: np.ndarray, q: np.ndarray, elapsed: float) -> Outcome | None:
    """Arm at its start, bias taken, strategy started; the outcome when that is refused."""
    try:
        explorer.take_place(pose, q)
        explorer.take_bias(BIAS_SECONDS)
        explorer.start(elapsed)
    except LwrprobeError as error:
        explorer.come_to_rest(error)
        return explorer.outcome("ended early", str(error))
    return None


def _leave_table_out(recorder: Recorder, scene: Scene, pipeline: Pipeline) -> dict[str, Any] | None:
    """Where the table was touched, that is no part of the object; for the summary, None where it was not."""
    if not scene.table.present:
        return None
    points, normals = recorder.points(), recorder.normals()
    table = find_table(points, normals, pipeline.area, scene.probe.radius, scene.table.height)
    if table is None:
        return None
    touched = table.touched(points, normals)
    recorder.leave_out(touched)
    return table.as_dict(int(touched.sum()))


def _reconstruct(record: TouchRecord, pipeline: Pipeline) -> tuple[Reconstruction | None, list[dict[str, str]]]:
    if len(record.points) == 0:
        return None, [{"stage": "reconstruction", "why": "no contact"}]
    try:
        return pipeline.reconstructor.reconstruct(record), []
    except LwrprobeError as error:
        return None, [{"stage": "reconstruction", "why": str(error)}]


def _write(
    out: Path,
    scene: Scene,
    pipeline: Pipeline,
    recorder: Recorder,
    surface: Reconstruction | None,
    summary: dict[str, Any],
) -> None:
    from lwrprobe.contracts import TriangleMesh
    from lwrprobe.evaluation.preview import draw_preview
    from lwrprobe.mapping.clouds import Cloud, write_cloud
    from lwrprobe.reconstruction.meshes import write_mesh

    force = np.array([c.magnitude for c in recorder.contacts])
    trust = np.array([c.trust for c in recorder.contacts])
    write_cloud(out / "contacts.ply", Cloud(recorder.points(), recorder.normals(), {"force": force, "trust": trust}))
    write_cloud(out / "cloud.pcd", Cloud(pipeline.voxels.centres()))
    pipeline.voxels.write(out / "map.bt")
    mesh = surface.mesh if surface is not None else TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    write_mesh(out / "mesh.stl", mesh)
    truth = scene.solid().mesh() if scene.objects and summary["link_collisions"] is not None else None
    facts = [f"{summary['contacts']} contacts", f"{summary['sim_time_s']:.0f} s"]
    if summary["mesh_error_mm"] is not None:
        facts.append(f"mesh error {summary['mesh_error_mm']['mean']:.2f} mm")
    title = f"{scene.title or scene.name}: {scene.strategy.name}"
    draw_preview(out / "preview.png", title, recorder.points(), surface.mesh if surface else None, truth, facts)
