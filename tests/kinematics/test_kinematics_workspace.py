"""Reachable and dexterous workspace, and whether an area can be worked in."""

import numpy as np
import pytest
from test_kinematics_tracking import TOOL

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKStatus, dexterity, lwr4, reachable, sample_workspace, ur5e

POINTING_DOWN = np.diag([1.0, -1.0, -1.0])
READY = np.deg2rad([180.0 - 10.0, 30, 0, -90, 0, 60, 0])


def ready(robot):
    """A posture with the tool pointing down in front of the arm, turned to POINTING_DOWN."""
    from lwrprobe.kinematics import IKSolver

    pose = np.eye(4)
    pose[:3, :3] = POINTING_DOWN
    pose[:3, 3] = 0.5, 0.0, 0.1
    result = IKSolver(robot).solve(pose, posture=np.deg2rad([0.0, 40, 0, -90, 0, 50, 0]))
    assert result.converged
    return result.q


def test_samples_stay_within_limits_and_reach():
    robot = lwr4(tool=TOOL)
    space = sample_workspace(robot, 500, seed=3)
    assert space.q.shape == (500, 7)
    assert ((space.q >= robot.lower) & (space.q <= robot.upper)).all()
    assert np.linalg.norm(space.tips[:, :3, 3], axis=1).max() <= 0.79 + 0.25
    np.testing.assert_array_equal(space.tips, sample_workspace(robot, 500, seed=3).tips)
    assert (space.manipulability >= 0.0).all()


def test_dexterity_falls_towards_the_edge():
    share = dexterity(lwr4(tool=TOOL), np.array([[0.4, 0.0, 0.2], [0.9, 0.0, 0.2], [1.2, 0.0, 0.2]]), 16, 2)
    assert share[0] > share[1] > share[2] == 0.0
    assert share[0] >= 0.5


def test_an_area_in_front_of_the_arm_is_reachable():
    robot = lwr4(tool=TOOL)
    grid = np.stack(np.meshgrid([0.45, 0.55], [-0.1, 0.0, 0.1], [0.0, 0.1], indexing="ij"), axis=-1).reshape(-1, 3)
    answer = reachable(robot, grid, POINTING_DOWN, ready(robot))
    assert answer.all
    assert answer.reason == ""
    assert answer.limit_margin.min() == answer.limit_margin[answer.worst] > 0.0
    for position, q in zip(grid, answer.q):
        np.testing.assert_allclose(robot.fk(q).t, position, atol=2e-6)
        np.testing.assert_allclose(robot.fk(q).R, POINTING_DOWN, atol=2e-6)


def test_the_part_out_of_reach_is_named_with_its_distance():
    robot = lwr4(tool=TOOL)
    grid = np.array([[0.5, 0.0, 0.0], [0.74, 0.0, 0.0], [1.0, 0.0, 0.0]])
    answer = reachable(robot, grid, POINTING_DOWN)
    assert answer.mask.tolist() == [True, True, False]
    assert answer.worst == 2
    assert answer.status[2] == IKStatus.UNREACHABLE
    # with the tool down the wrist stands 0.25 m above, and reaches 0.79 m
    assert answer.short_by[2] == pytest.approx(np.hypot(1.0, 0.25) - 0.79, abs=1e-6)
    assert "out of reach" in answer.reason


def test_what_exists_but_not_on_the_straight_way_is_a_jump_or_limit():
    robot = lwr4(tool=TOOL)
    behind = np.array([[0.5, 0.0, 0.1], [-0.5, 0.0, 0.1]])
    assert reachable(robot, behind, POINTING_DOWN).all
    answer = reachable(robot, behind, POINTING_DOWN, ready(robot))
    assert answer.mask.tolist() == [True, False]
    assert answer.reason != ""


def test_arms_without_closed_form_too():
    robot = ur5e()
    answer = reachable(robot, np.array([[0.5, 0.1, 0.2], [3.0, 0.0, 0.2]]), POINTING_DOWN)
    assert answer.mask.tolist() == [True, False]
    assert answer.short_by[1] > 1.5


def test_bad_questions_are_refused_by_name():
    robot = lwr4()
    for positions, rotation, field in (
        (np.zeros(3), POINTING_DOWN, "positions"),
        (np.zeros((0, 3)), POINTING_DOWN, "positions"),
        (np.full((1, 3), np.nan), POINTING_DOWN, "positions"),
        (np.ones((1, 3)), 2.0 * np.eye(3), "rotation"),
        (np.ones((1, 3)), np.diag([1.0, 1.0, -1.0]), "rotation"),
    ):
        with pytest.raises(InputError) as caught:
            reachable(robot, positions, rotation)
        assert caught.value.field == field
