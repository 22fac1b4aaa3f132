"""What the arm is asked before a motion is planned: whether it reaches, and follows acceleration and jerk."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from spatialmath import SE3

from lwrprobe.contracts import VelocityCommand
from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.kinematics import IKSolver, IKStatus, lwr4
from lwrprobe.scene import load_scene

BENT = np.array([0.2, 0.4, 0.1, -0.9, 0.1, 1.0, 0.3])


def request(sensitivity, q=BENT):
    """One for an arm with a bent elbow, and where its tip is (4, 4)."""
    robot = lwr4()
    here = robot.fk(q).A
    pipeline: Any = SimpleNamespace(
        robot=robot, solver=IKSolver(robot), trajectory=SimpleNamespace(pose=here), sensitivity=sensitivity
    )
    arm: Any = SimpleNamespace(q=q)
    return MotionRequest(pipeline, arm), here


def outward(here, distance):
    """The pose with the wrist, where the tip is, `distance` m farther from the shoulder, where the arm's base is."""
    found = here.copy()
    found[:3, 3] += distance * here[:3, 3] / np.linalg.norm(here[:3, 3])
    return found


def length(elbow):
    """m from shoulder to wrist with the elbow bent by so much."""
    return np.sqrt(0.4**2 + 0.39**2 + 2.0 * 0.4 * 0.39 * np.cos(elbow))


@pytest.mark.parametrize(("elbow", "reached"), [(0.5, True), (0.4, True), (0.25, False), (0.05, False)])
def test_a_place_where_the_elbow_could_not_follow_acceleration_and_jerk_of_the_tip_is_out_of_reach(elbow, reached):
    scene = load_scene("block")
    limit = compose(scene, choose(scene), 0.001, 125.0).sensitivity
    assert limit * scene.motion.acceleration < scene.safety.joint_acceleration
    assert limit * scene.motion.jerk < scene.safety.joint_jerk
    near, here = request(limit)
    there = outward(here, length(elbow) - length(0.9))
    assert near.reachable([there]) == reached
    assert near.reachable([here, there]) == reached, "all along the path"
    assert request(np.inf)[0].reachable([there]), "the arm can be there"


def held(elbow, limit, tool=None):
    """A request of an arm with its elbow bent by so much; its pipeline; the arm; and what the generator was told."""
    q = BENT.copy()
    q[3] = -elbow
    robot = lwr4(tool)
    solver, told = IKSolver(robot), []
    trajectory = SimpleNamespace(
        pose=robot.fk(q).A,
        velocity=np.zeros(3),
        angular_velocity=np.zeros(3),
        stop=lambda: told.append("stop"),
        set_velocity=lambda *asked: told.append("go"),
    )
    pipeline: Any = SimpleNamespace(
        robot=robot, solver=solver, trajectory=trajectory, sensitivity=limit, clearance=None, ik_status=solver.track
    )
    arm: Any = SimpleNamespace(q=q, blocked="")
    return MotionRequest(pipeline, arm), pipeline, arm, told


def outwards(pipeline):
    """(3,) m/s, away from the shoulder: one millimetre in the time that is looked ahead."""
    place = pipeline.trajectory.pose[:3, 3]
    return 0.01 * place / np.linalg.norm(place)


def moving(elbow, limit, way):
    """What blocks the arm, with its elbow bent by so much, on the way of a velocity command outwards (+1) or back."""
    asked, pipeline, arm, told = held(elbow, limit)
    velocity = way * outwards(pipeline)
    for _ in range(3):  # it may be asked again and again
        asked.adopt(VelocityCommand(velocity))
    blocked = arm.blocked
    asked.adopt(VelocityCommand(-0.3 * velocity))
    return blocked, told


@pytest.mark.parametrize("turn", [0.0, 0.05])
def test_where_the_tip_turns_in_its_place_it_is_asked_anew(turn):
    scene = load_scene("block")
    asked, pipeline, arm, told = held(0.16, np.inf)
    asked.adopt(VelocityCommand(outwards(pipeline)))
    pipeline.sensitivity = compose(scene, choose(scene), 0.001, 125.0).sensitivity
    pose = pipeline.trajectory.pose.copy()
    pose[:3, :3] = pose[:3, :3] @ [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0, 0, 1]]
    found = np.empty_like(arm.q)
    assert pipeline.solver.track(pose, arm.q, found) == IKStatus.CONVERGED
    pipeline.trajectory.pose, arm.q = pose, found
    asked.adopt(VelocityCommand(outwards(pipeline)))
    assert told == ["go", "stop" if turn else "go"]


@pytest.mark.parametrize(("way", "blocked"), [(1.0, False), (-1.0, True)])
def test_a_turn_about_the_tip_is_stopped_where_it_stretches_the_arm(way, blocked):
    """It had gone on through a stretched posture, and the way back from there was refused."""
    scene = load_scene("block")
    limit = compose(scene, choose(scene), 0.001, 125.0).sensitivity
    asked, pipeline, arm, told = held(0.3, limit, SE3(0.0, 0.0, 0.25))
    wrist = lwr4().fk(arm.q).A[:3, 3]
    axis = np.cross(pipeline.trajectory.pose[:3, 3] - wrist, wrist)  # about it the wrist turns towards the shoulder
    pipeline.trajectory.angular_velocity = way * 0.2 * axis / np.linalg.norm(axis)
    asked.adopt(VelocityCommand(np.zeros(3), pose=pipeline.trajectory.pose))
    assert bool(arm.blocked) == blocked
    assert told == ["stop" if blocked else "go"]


def test_no_motion_leads_on_to_where_the_elbow_could_not_follow_a_stop_and_every_one_leads_back():
    """A path that nothing had planned had led there, and ended the run with a set point that must not be sent."""
    scene = load_scene("block")
    limit = compose(scene, choose(scene), 0.001, 125.0).sensitivity
    assert 1.1 * limit * scene.motion.jerk < scene.safety.joint_jerk
    for elbow, blocked in ((0.5, False), (0.36, False), (0.28, True), (0.16, True)):
        why, told = moving(elbow, limit, 1.0)
        assert bool(why) == blocked
        assert told == (["stop"] * 3 if blocked else ["go"] * 3) + ["go"]
        assert moving(elbow, limit, -1.0)[0] == ""
    assert moving(0.16, np.inf, 1.0)[0] == "", "the arm can be there"


def test_an_arm_that_is_stretched_may_plan_a_path_back():
    scene, q = load_scene("block"), BENT.copy()
    q[3] = -0.2
    near, here = request(compose(scene, choose(scene), 0.001, 125.0).sensitivity, q)
    assert near.reachable([outward(here, -0.05)])
    assert not near.reachable([outward(here, 0.003)])


@pytest.mark.parametrize(("short_of_limit", "reached"), [(0.03, True), (0.005, False)])
def test_a_planned_path_keeps_off_the_ends_of_the_joints_ranges(short_of_limit, reached):
    """A path that grazes an end is beyond it for a moment between two poses at which it is looked at."""
    near, here = request(np.inf)
    end = lwr4().upper[3]
    assert near.reachable([outward(here, length(end - short_of_limit) - length(0.9))]) == reached


def test_an_arm_that_is_at_the_end_of_a_range_may_leave_it():
    end = lwr4().upper[3]
    near, here = request(np.inf, np.array([0.2, 0.4, 0.1, 0.003 - end, 0.1, 1.0, 0.3]))
    assert near.reachable([outward(here, 0.05)])
    assert not near.reachable([outward(here, -0.0008)])


@pytest.mark.parametrize("speed", [2e-4, 6.5e-4, 3e-3])
def test_the_joints_of_a_tip_that_creeps_move_in_every_cycle(speed):
    """Within a tolerance of 1 um they had rested in every second one: 57 krad/s^3 on a line that ended a run."""
    scene, cycle = load_scene("block"), 1e-3
    pipeline = compose(scene, choose(scene), cycle, 125.0)
    q = BENT.copy()
    q[3] = -0.33
    pose, rows = pipeline.robot.fk(q).A, []
    for _ in range(50):
        pose[:3, 3] += speed * cycle * np.array([0.0, 0.0, -1.0])
        following = np.empty_like(q)
        assert pipeline.solver.track(pose, q, following) == IKStatus.CONVERGED
        rows.append(q := following)
    steps = np.diff(rows, axis=0)
    assert np.abs(steps).max(axis=1).min() > 0.9 * np.abs(steps).max()
    assert np.abs(np.diff(rows, n=3, axis=0)).max() / cycle**3 < 0.01 * scene.safety.joint_jerk
