"""The arm's own links: against what was touched, the table and each other, compared with python-fcl."""

from __future__ import annotations

from itertools import combinations, pairwise

import fcl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import Done, Goal, InputError, Progress
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.stages import pipeline
from lwrprobe.exploration.stages.arm_clearance import ArmClearanceStage
from lwrprobe.kinematics import IKSolver, robot_by_name
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

SCENE = load_scene("block", ['clearance.links="arm"', "truth.profile=ideal"])
PROBE, ROBOT = SCENE.probe.as_probe(), robot_of(SCENE)
READY = start_posture(SCENE, ROBOT)[1]
KEEP, STICK_KEEP = 0.003, 0.0001
FCL = 1e-4
"""m, what python-fcl's own distances may be off."""


def stage(voxels=None, robot=ROBOT):
    voxels = VoxelMap(0.002) if voxels is None else voxels
    return ArmClearanceStage(PROBE, robot, IKSolver(robot), voxels, KEEP, STICK_KEEP, SCENE.table.plane())


def tip(q):
    pose = np.empty((4, 4))
    ROBOT.fk_into(q, pose)
    return pose


def bodies(q):
    """{name: fcl body} of all links at q."""
    frames, placed = ROBOT.link_frames(q), {}
    for link in (*ROBOT.links, *PROBE.links):
        pose = (tip(q) if link.carrier == "tip" else frames[int(link.carrier)]) @ link.pose
        kind = {"box": fcl.Box, "cylinder": fcl.Cylinder, "capsule": fcl.Capsule}[link.kind]
        placed[link.name] = fcl.CollisionObject(kind(*link.size), fcl.Transform(pose[:3, :3], pose[:3, 3]))
    return placed


def between(one, other):
    if fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())


def reserves(q, voxels):
    """Distance above what is to be kept, of every pair that matters."""
    body, names = bodies(q), [link.name for link in ROBOT.links]
    table = fcl.CollisionObject(fcl.Box(9.0, 9.0, 1.0), fcl.Transform(np.array([0.0, 0.0, -0.5])))
    touched = [fcl.CollisionObject(fcl.Box(*[0.002] * 3), fcl.Transform(centre)) for centre in voxels.centres()]
    for one, other in combinations(range(len(names)), 2):
        if other - one >= 3:
            yield between(body[names[one]], body[names[other]]) - KEEP
    for link in PROBE.links:
        for name in names[:-2]:
            yield between(body[link.name], body[name]) - KEEP
    for name, shape in body.items():
        if name != "shoulder":
            keep = STICK_KEEP if name == "stick" else KEEP
            yield from (between(shape, voxel) - keep for voxel in touched)
        if name not in ("shoulder", "stick"):
            yield between(shape, table) - KEEP


def test_the_bodies_hang_together_in_every_posture():
    rng = np.random.default_rng(1)
    for _ in range(50):
        body = bodies(rng.uniform(ROBOT.lower, ROBOT.upper))
        for one, other in pairwise([link.name for link in ROBOT.links]):
            assert between(body[one], body[other]) == 0.0


def test_threats_are_those_that_fcl_finds():
    rng = np.random.default_rng(2)
    voxels = VoxelMap(0.002)
    voxels.insert(rng.uniform((-0.3, -0.3, 0.2), (0.0, 0.3, 0.6), (12, 3)))
    watched, kinds = stage(voxels), {}
    wide = rng.uniform(ROBOT.lower, ROBOT.upper, (250, 7))
    folded = np.clip(READY + rng.normal(0.0, 0.3, (100, 7)), ROBOT.lower, ROBOT.upper)
    folded[:, 5] = rng.uniform(1.6, 2.09, 100)
    for q in np.concatenate([wide, folded]):
        near, smallest = watched.nearest(tip(q), q), min(reserves(q, voxels))
        if smallest < -FCL:
            assert near.threatens
            assert near.distance - near.required == pytest.approx(smallest, abs=FCL)
            kinds[near.against] = kinds.get(near.against, 0) + 1
        elif smallest > FCL:
            assert not near.threatens
            assert near.distance - near.required <= smallest + FCL
    assert kinds["table"] > 20
    assert kinds["forearm_end"] > 5
    assert kinds[""] > 5


@pytest.mark.parametrize("seed", range(3))
def test_a_swing_of_the_joints_is_refused_where_it_would_meet_something_on_the_way(seed):
    """Judged at many places on the way, without any bound."""
    rng, empty = np.random.default_rng(seed), VoxelMap(0.002)
    verdicts = {True: 0, False: 0}
    for _ in range(12):
        begin, end = (np.clip(READY + rng.normal(0.0, 0.6, 7), ROBOT.lower, ROBOT.upper) for _ in range(2))
        if min(reserves(begin, empty)) < 0.0:
            continue
        smallest = min(min(reserves(begin + t * (end - begin), empty)) for t in np.linspace(0.0, 1.0, 25))
        refused = bool(stage().objection_to_swing(begin, end))
        if smallest < -0.0015:
            assert refused
        elif smallest > 0.0:
            assert not refused
        verdicts[refused] += 1
    assert verdicts[False] > 0


def leaning(degrees, place):
    pose = tip(READY)
    pose[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix() @ pose[:3, :3]
    pose[:3, 3] = place
    return pose


def test_a_way_to_the_table_is_refused_with_its_reason_and_the_way_back_is_not():
    watched, q, begin = stage(), READY, tip(READY)
    upright = begin.copy()
    upright[:3, 3] += (0.02, 0.0, -0.1)
    assert watched.objection(begin, upright, q) == ""
    low = leaning(-80.0, (0.0, 0.0, 0.012))
    for _ in range(2):  # what was refused is not remembered as agreed to
        assert "of the table" in watched.objection(begin, low, q)
    assert watched.objection(begin, upright, q) == ""
    at_table = leaning(-75.0, (0.0, 0.0, 0.012))
    held = IKSolver(ROBOT).solve(at_table, q).q
    assert watched.nearest(at_table, held).against == "table"
    assert watched.objection(at_table, begin, held) == ""


def test_what_was_touched_is_kept_clear_of_by_the_forearm_too():
    voxels = VoxelMap(0.002)
    elbow = ROBOT.link_frames(READY)[4][:3, 3]
    watched, begin = stage(voxels), tip(READY)
    aside = begin.copy()
    aside[1, 3] += 0.15
    assert watched.clear([begin, aside], READY)
    voxels.insert_point(np.add(elbow, (0.1, 0.12, -0.05)))
    assert not watched.clear([begin, aside], READY)
    beyond = begin.copy()
    beyond[0, 3] += 2.0
    assert not watched.clear([begin, beyond], READY)  # out of reach


def test_a_robot_without_known_links_is_refused():
    with pytest.raises(InputError, match="ur5e"):
        stage(robot=robot_by_name("ur5e"))


class Leaning:
    """A strategy that insists on a pose whose path leads to the table, and reports the answer."""

    line_spacing = None
    trace = ()

    class Config:
        pass

    def start(self, task):
        self.goal = np.eye(4)
        self.goal[:3, :3] = Rotation.from_euler("y", -80, degrees=True).as_matrix() @ task.orientation
        self.goal[:3, 3] = 0.0, 0.0, 0.012

    def step(self, seen):
        return Done(seen.blocked) if seen.blocked else Goal(self.goal, 0.05)

    def progress(self):
        return Progress("leaning")


@pytest.mark.slow
def test_a_run_refuses_the_goal_before_the_arm_moves(monkeypatch, tmp_path):
    loaded = pipeline.load
    monkeypatch.setattr(pipeline, "load", lambda role, *rest: Leaning if role == "strategy" else loaded(role, *rest))
    monkeypatch.setattr(pipeline, "configure", lambda config, options, name: None)
    summary = explore(load_scene("empty", ['clearance.links="arm"', "truth.profile=ideal"]), out=tmp_path / "run")
    assert "would come within" in summary["reason"]
    assert "of the table" in summary["reason"]
    assert summary["path_length_m"] < 1e-4
    assert not [item for item in summary["left_out"] if item["stage"] == "arm links"]
