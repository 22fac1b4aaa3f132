"""What is shown of a run, a bag or a scene: where the arm was, and what was touched when."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.bags.bag_file import STORAGES
from lwrprobe.contracts import LinkShape, TriangleMesh
from lwrprobe.evaluation.run_folder import HIDING_FILE, read_run, read_table, run_mesh
from lwrprobe.evaluation.truth import is_simulated, true_solid
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.kinematics import IKSolver, Robot
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import Cloud, read_cloud
from lwrprobe.scene import Scene, load_scene
from lwrprobe.scene.scene_robot import robot_of
from lwrprobe.scene.solid import Solid

RATE = 25.0
"""Hz of the places that are kept."""


@dataclass(slots=True)
class Playback:
    """Arm, contacts and shapes over time.

    Attributes
    ----------
    scene, robot : with base and tool
    times, joints, tips : (k,) s, (k, n) rad, (k, 4, 4)
    points, normals, contact_times, forces, confidence : of the contacts, by growing time
    truth : the object of a simulation, None where it is not known
    mesh : the result, None where there is none
    voxels : the map, None where there is none
    goals : (g, 4) time s and place m; clearances : (c, 8) time s, distance m, and both ends m
    states : (time s, what the strategy does)
    sigmas : (n,) m, standard deviation of each contact along its normal, NaN where it is not known
    hiding : (h, 3) m, where something about as large as the certificate says could hide; sizes : (h,) m, how large
    """

    scene: Scene
    robot: Robot
    times: np.ndarray
    joints: np.ndarray
    tips: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    contact_times: np.ndarray
    forces: np.ndarray
    confidence: np.ndarray
    truth: TriangleMesh | None = None
    mesh: TriangleMesh | None = None
    voxels: VoxelMap | None = None
    goals: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    clearances: np.ndarray = field(default_factory=lambda: np.empty((0, 8)))
    states: list[tuple[float, str]] = field(default_factory=list)
    sigmas: np.ndarray = field(default_factory=lambda: np.empty(0))
    hiding: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    sizes: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def end(self) -> float:
        """s, of the last thing that is shown."""
        return float(max([0.0, *self.times[-1:], *self.contact_times[-1:]]))

    @property
    def shapes(self) -> list[LinkShape]:
        """The bodies of the arm and of the probe."""
        return [*self.robot.links, *self.scene.probe.as_probe().links]

    def at(self, time: float) -> int:
        """Index of the place at a time [s]."""
        return int(np.clip(np.searchsorted(self.times, time), 0, len(self.times) - 1))

    def touched(self, time: float) -> int:
        """How many contacts there are at a time [s]."""
        return int(np.searchsorted(self.contact_times, time, side="right"))


def playback(source: str | Path) -> Playback:
    """What is to be shown of a run folder, a bag, or a scene by name or file.

    Raises FormatError, SceneError and UnknownNameError for what is none of these.
    """
    path = Path(source)
    if path.is_dir() and (path / "scene.toml").is_file():
        return _of_run(path)
    if path.suffix in STORAGES or path.is_dir():
        return _of_bag(path)
    return of_scene(load_scene(str(source)))


def of_scene(scene: Scene) -> Playback:
    """The arm at its start, and the object where it is known."""
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    none, empty = np.empty(0), np.empty((0, 3))
    truth = _mesh_of(true_solid(scene))
    return Playback(scene, robot, np.zeros(1), q[None], pose[None], empty, empty, none, none, none, truth=truth)


def _of_run(folder: Path) -> Playback:
    run = read_run(folder)
    scene, robot = run.scene, robot_of(run.scene)
    record = run.record
    assert record.normals is not None
    assert record.confidence is not None
    if any((folder / "bag").glob("*.mcap")):
        found = _of_bag(folder)
        times, joints, tips = found.times, found.joints, found.tips
        goals, clearances, states = found.goals, found.clearances, found.states
    else:
        times, joints, tips = _along(scene, robot, run.trace)
        goals, clearances, states = np.empty((0, 4)), np.empty((0, 8)), _states(folder / "states.csv")
    mesh = run_mesh(folder)
    voxels = VoxelMap.read(folder / "map.bt") if (folder / "map.bt").is_file() else None
    hiding = read_cloud(folder / HIDING_FILE) if (folder / HIDING_FILE).is_file() else Cloud(np.empty((0, 3)))
    return Playback(
        scene, robot, times, joints, tips, record.points, record.normals, run.times, run.force, record.confidence,
        _mesh_of(run.true_solid()), mesh, voxels, goals, clearances, states, _sigmas(folder, run.times), hiding.points,
        hiding.scalars.get("size", np.zeros(len(hiding.points))),
    )  # fmt: skip


def _of_bag(path: Path) -> Playback:
    from lwrprobe.bags.bag_file import bag_files, read_bag
    from lwrprobe.bags.messages import cloud_rows
    from lwrprobe.exploration.procedures.replay import recorded_scene
    from lwrprobe.exploration.recording.recording import read_recording
    from lwrprobe.exploration.recording.run_bag import CONTACTS, GOALS, MARKERS, RUN

    recording = read_recording(bag_files(path)[0])
    scene = recorded_scene(recording)
    robot = robot_of(scene)
    rows = recording.run()
    every = max(1, round(recording.rate / RATE))
    rows = rows[::every]
    times, joints = recording.column("time")[rows] - recording.zero, recording.joints[rows]
    clouds: list[np.ndarray] = []
    goals: list[list[float]] = []
    lines: list[list[float]] = []
    begin = None
    for message in read_bag(path):
        if message.topic == RUN and begin is None:
            begin = message.time
        if begin is None:
            continue
        now = 1e-9 * (message.time - begin)
        if message.topic == CONTACTS:
            clouds.append(cloud_rows(message.decode()))
        elif message.topic == GOALS:
            place = message.decode().pose.position
            goals.append([now, place.x, place.y, place.z])
        elif message.topic == MARKERS:
            for marker in message.decode().markers:
                if marker.ns == "clearance" and len(marker.points) == 2:
                    a, b = ([p.x, p.y, p.z] for p in marker.points)
                    lines.append([now, float(np.linalg.norm(np.subtract(a, b))), *a, *b])
    contacts = np.vstack(clouds) if clouds else np.empty((0, 9))
    states = [(time, str(content.get("doing", ""))) for time, content in recording.frames]
    return Playback(
        scene, robot, times, joints, _tips(robot, joints), contacts[:, :3], contacts[:, 3:6], contacts[:, 8],
        contacts[:, 6], contacts[:, 7], _mesh_of(true_solid(scene) if is_simulated(scene) else None),
        goals=np.array(goals).reshape(-1, 4), clearances=np.array(lines).reshape(-1, 8), states=states,
    )  # fmt: skip


def _tips(robot: Robot, joints: np.ndarray) -> np.ndarray:
    return robot.fk_batch(joints) if len(joints) else np.empty((0, 4, 4))


def _along(scene: Scene, robot: Robot, trace: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arm along a recorded path of the sphere, upright as at its start: the path does not say how it leaned."""
    pose, q = start_posture(scene, robot)
    solver = IKSolver(robot)
    rows = trace[:: max(1, round(len(trace) / max(RATE * float(trace[-1, 0]), 1.0)))] if len(trace) else trace
    joints, tips = [q], [pose]
    for row in rows:
        wanted, found = pose.copy(), np.empty(robot.n)
        wanted[:3, 3] = row[1:4]
        solver.track(wanted, joints[-1], found)
        joints.append(found)
        tips.append(wanted)
    return np.concatenate([[0.0], rows[:, 0]]), np.array(joints), np.array(tips)


def _sigmas(folder: Path, times: np.ndarray) -> np.ndarray:
    """(n,) m of the contacts at these times; the table lacks those that are no part of the object."""
    if not (folder / "contact_errors.csv").is_file():
        return np.full(len(times), np.nan)
    rows = read_table(folder / "contact_errors.csv", ("time", "sigma_random_mm", "sigma_mm"))
    known = {round(time, 6): 1e-3 * sigma for time, _, sigma in rows.tolist()}
    return np.array([known.get(round(time, 6), np.nan) for time in times.tolist()])


def _states(path: Path) -> list[tuple[float, str]]:
    if not path.is_file():
        return []
    found = []
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        for row in csv.DictReader(file):
            try:
                found.append((float(row["time"]), row["next"] or ""))
            except (TypeError, ValueError, KeyError):  # of a run that was killed
                continue
    return found


def _mesh_of(solid: Solid | None) -> TriangleMesh | None:
    return None if solid is None else solid.mesh()


def posed(robot: Robot, joints: np.ndarray, tip: np.ndarray, shapes: Sequence[LinkShape]) -> list[np.ndarray]:
    """Poses (4, 4) of bodies in the world, for joint values (n,) and a tip pose (4, 4)."""
    frames = robot.link_frames(joints)
    return [(tip if shape.carrier == "tip" else frames[int(shape.carrier)]) @ shape.pose for shape in shapes]


def body(shape: LinkShape) -> TriangleMesh:
    """The surface of a body in its own frame."""
    import trimesh

    made: Any
    if shape.kind == "box":
        made = trimesh.creation.box(shape.size)
    elif shape.kind == "capsule":
        made = trimesh.creation.capsule(height=shape.size[1], radius=shape.size[0], count=[16, 16])
        made.apply_translation(-made.bounds.mean(axis=0))
    else:
        made = trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=24)
    return TriangleMesh(np.asarray(made.vertices, dtype=np.float64), np.asarray(made.faces, dtype=np.int64))
