"""The closed form of spherical-roll-spherical arms: exact arcs, all branches, and nothing missed."""

import dataclasses

import numpy as np
import pytest
from naive_kinematics import naive_lwr_solutions, pose_error
from test_kinematics_tracking import HARD, TOOL, assert_solved, hard_cases

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKSolver, IKStatus, Robot, iiwa14, lwr4, panda, puma560, ur5e
from lwrprobe.kinematics.spherical import spherical_shape


@pytest.mark.parametrize("model", [lwr4, iiwa14])
def test_cold_starts_always_arrive(model):
    robot = model(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(1), np.empty(7)
    for true, seed in rng.uniform(robot.lower, robot.upper, (3000, 2, 7)):
        pose = robot.fk(true).A
        assert_solved(robot, solver.reach(pose, seed, q), q, pose)


@pytest.mark.slow
@pytest.mark.parametrize("case", HARD)
def test_cold_starts_survive_the_hard_cases(case):
    robot = lwr4(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(2), np.empty(7)
    for true in hard_cases(robot, 500, rng)[case]:
        pose = robot.fk(true).A
        assert_solved(robot, solver.reach(pose, rng.uniform(robot.lower, robot.upper), q), q, pose)


@pytest.mark.slow
def test_branches_are_those_of_the_naive_enumeration():
    """On a fine comb of arm angles, an angle is on an arc exactly where the textbook solution is within limits."""
    robot = lwr4(tool=TOOL)
    solver, rng = IKSolver(robot), np.random.default_rng(3)
    for true in rng.uniform(robot.lower, robot.upper, (10, 7)):
        pose = robot.fk(true).A
        arcs = {branch.signs: branch.arcs for branch in solver.branches(pose)}
        for psi in np.linspace(-np.pi, np.pi, 90, endpoint=False) + 0.001:
            for signs, q in naive_lwr_solutions(robot, pose, psi).items():
                assert pose_error(robot.fk(q).A, pose)[0] < 1e-9, "the naive form itself"
                margin = robot.limit_margin(q)
                if abs(margin) > 1e-6:
                    assert on_arc(arcs.get(signs), psi) == (margin > 0.0)
                if margin > 1e-6:
                    np.testing.assert_allclose(solver.on_branch(pose, signs, psi), q, atol=1e-7)


def on_arc(arcs, psi):
    if arcs is None:
        return False
    start, end = arcs[:, 0], arcs[:, 1]
    return any(((psi + turn >= start) & (psi + turn <= end)).any() for turn in (-2 * np.pi, 0.0, 2 * np.pi))


def test_an_arc_ends_where_a_joint_meets_its_limit():
    robot = lwr4(tool=TOOL)
    solver, rng = IKSolver(robot), np.random.default_rng(4)
    ends = 0
    for true in rng.uniform(robot.lower, robot.upper, (30, 7)):
        pose = robot.fk(true).A
        for branch in solver.branches(pose):
            for arc in branch.arcs[branch.arcs[:, 1] - branch.arcs[:, 0] < 2 * np.pi - 1e-9]:
                for psi in arc:
                    q = solver.on_branch(pose, branch.signs, psi)
                    assert robot.limit_margin(q) == pytest.approx(0.0, abs=1e-7)
                    ends += 1
    assert ends > 200


@pytest.mark.parametrize("width", [1e-2, 1e-5, 1e-8, 0.0])
def test_thin_arcs_are_found(width):
    """Limits drawn so tightly round one solution that no sample of arm angles would hit what is left."""
    rng, q = np.random.default_rng(5), np.empty(7)
    for true in rng.uniform(lwr4().lower, lwr4().upper, (200, 7)):
        robot = dataclasses.replace(lwr4(tool=TOOL), lower=true - width, upper=true + width)
        pose = robot.fk(true).A
        assert_solved(robot, IKSolver(robot).reach(pose, robot.middle, q), q, pose)


@pytest.mark.parametrize("model", [lwr4, iiwa14])
def test_an_arm_is_known_by_its_table_not_its_name(model):
    robot = dataclasses.replace(model(), name="unnamed")
    assert IKSolver(robot).closed_form
    for other in (ur5e, panda, puma560):
        assert not IKSolver(other()).closed_form
    bent = dataclasses.replace(robot, a=np.array([0, 0, 0.05, 0, 0, 0, 0]))
    assert not IKSolver(bent).closed_form
    skew = dataclasses.replace(robot, alpha=robot.alpha + np.array([0, 0.01, 0, 0, 0, 0, 0]))
    assert spherical_shape(skew) is None


def test_every_sign_of_the_twists_either_convention_any_base_and_joint_offset():
    rng, q = np.random.default_rng(6), np.empty(7)
    from spatialmath import SE3

    for _ in range(12):
        twists = 0.5 * np.pi * rng.choice([-1.0, 1.0], 7)
        standard = Robot(
            name="any",
            a=np.append(np.zeros(6), 0.03),
            alpha=twists,
            d=np.array([0.3, 0, 0.42, 0, 0.4, 0, 0.1]),
            theta=rng.uniform(-1, 1, 7),
            lower=-rng.uniform(1.8, 3.0, 7),
            upper=rng.uniform(1.8, 3.0, 7),
            speed=np.ones(7),
            base=SE3.RPY(*rng.uniform(-3, 3, 3)).A,
            tool=TOOL,
        )
        modified = dataclasses.replace(standard, a=np.zeros(7), alpha=np.append(0.3, twists[:6]), convention="modified")
        for robot in (standard, modified):
            solver = IKSolver(robot)
            assert solver.closed_form
            for true in rng.uniform(robot.lower, robot.upper, (40, 7)):
                pose = robot.fk(true).A
                assert_solved(robot, solver.reach(pose, robot.middle, q), q, pose)
                assert solver.solve(pose).iterations == 0, "the closed form alone"
                signs = tuple(np.where(np.sin(true + robot.theta)[[3, 1, 5]] < 0, -1, 1))
                assert signs in {branch.signs for branch in solver.branches(pose)}


def test_joints_that_turn_more_than_once_count_from_the_seed():
    robot = dataclasses.replace(iiwa14(tool=TOOL), lower=np.full(7, -3 * np.pi), upper=np.full(7, 3 * np.pi))
    solver, rng, q = IKSolver(robot), np.random.default_rng(7), np.empty(7)
    endless = dataclasses.replace(robot, lower=np.full(7, -np.inf), upper=np.full(7, np.inf))
    for seed in rng.uniform(-8, 8, (100, 7)):
        pose = robot.fk(seed).A
        for arm in (solver, IKSolver(endless)):
            assert arm.reach(pose, seed, q) == IKStatus.CONVERGED
            assert np.abs(q - seed).max() <= np.pi + 1e-9


def test_out_of_reach_is_told_with_the_exact_distance():
    robot = lwr4(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(8), np.empty(7)
    for true in rng.uniform(robot.lower, robot.upper, (200, 7)):
        true[3] = 0.0
        nearest = robot.fk(true).A
        wrist = robot.link_frames(true)[-1][:3, 3]
        pose = nearest.copy()
        pose[:3, 3] += 0.05 * wrist / np.linalg.norm(wrist)
        assert solver.reach(pose, rng.uniform(robot.lower, robot.upper), q) == IKStatus.UNREACHABLE
        np.testing.assert_allclose(robot.fk(q).A, nearest, atol=1e-6)
        result = solver.solve(pose)
        assert result.status == IKStatus.UNREACHABLE
        assert result.short_by == pytest.approx(0.05, abs=1e-9)


def test_too_near_for_the_elbow_is_limited_with_the_exact_distance():
    robot = lwr4()
    folded = np.deg2rad([10.0, 20, 30, 120, 50, 60, 70])
    pose = robot.fk(folded).A.copy()
    pose[:3, 3] *= 1.0 - 0.02 / np.linalg.norm(pose[:3, 3])
    result = IKSolver(robot).solve(pose)
    assert result.status == IKStatus.LIMITED
    assert result.short_by == pytest.approx(0.02, abs=1e-9)
    assert result.rotation_error < 1e-9


def test_arms_without_the_closed_form_say_so():
    with pytest.raises(InputError, match="spherical"):
        IKSolver(ur5e()).branches(np.eye(4))
