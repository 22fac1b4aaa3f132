"""What the arm is asked before a motion is planned: whether it reaches, and follows acceleration and jerk."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.kinematics import IKSolver, lwr4
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
