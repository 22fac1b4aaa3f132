"""The public solver: checked input, certified output, every kind of arm."""

import numpy as np
import pytest
from naive_kinematics import pose_error
from spatialmath import SE3
from test_kinematics_chain import random_chain
from test_kinematics_tracking import TOOL

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKSolver, IKStatus, Preference, Robot, lwr4, panda, puma560, ur5e

Q = np.deg2rad([10.0, 30, -20, -90, 15, 60, 40])


@pytest.mark.parametrize("model", [lwr4, ur5e, panda, puma560])
def test_solutions_are_certified(model):
    robot = model(tool=TOOL)
    solver, rng = IKSolver(robot), np.random.default_rng(1)
    for true, start in rng.uniform(robot.lower, robot.upper, (60, 2, robot.n)):
        pose = robot.fk(true)
        for result in (solver.solve(pose), solver.solve(pose, q0=start), solver.solve(pose, q0=true + 0.0)):
            assert result.converged
            assert robot.within_limits(result.q)
            position, rotation = pose_error(robot.fk(result.q).A, pose.A)
            assert position == pytest.approx(result.position_error, abs=1e-12)
            assert rotation == pytest.approx(result.rotation_error, abs=1e-9)
            assert position <= 1e-6
            assert rotation <= 1.01e-6
            assert result.short_by == 0.0
        np.testing.assert_allclose(result.q, true, atol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_chains_nobody_would_build(seed):
    rng = np.random.default_rng(seed)
    robot = random_chain(rng, 6 + seed % 3, ("standard", "modified")[seed % 2])
    solver = IKSolver(robot)
    for true in rng.uniform(robot.lower, robot.upper, (30, robot.n)):
        result = solver.solve(robot.fk(true))
        assert result.converged
        assert robot.within_limits(result.q)


def test_few_joints_reach_what_they_can():
    """Three joints in a plane: what they reach is found, what they do not is reported."""
    arm = Robot(
        name="planar",
        a=np.array([0.5, 0.4, 0.2]),
        alpha=np.zeros(3),
        d=np.zeros(3),
        theta=np.zeros(3),
        lower=np.full(3, -2.5),
        upper=np.full(3, 2.5),
        speed=np.ones(3),
    )
    solver = IKSolver(arm)
    for true in np.random.default_rng(2).uniform(-2.5, 2.5, (50, 3)):
        assert solver.solve(arm.fk(true)).converged
    beyond = SE3(1.3, 0.0, 0.0)
    result = solver.solve(beyond)
    assert result.status == IKStatus.UNREACHABLE
    assert result.short_by == pytest.approx(0.2, abs=1e-6)
    above = solver.solve(SE3(0.6, 0.0, 0.1))
    assert not above.converged
    assert above.short_by == pytest.approx(0.1, abs=1e-6)


def test_out_of_reach_of_an_arm_without_closed_form():
    robot = puma560()
    straight = robot.fk(np.array([0.3, 0.5, -0.5 * np.pi + 0.047, 0.1, 0.4, 0.2])).A
    far = straight.copy()
    far[:3, 3] += 1.0 * (straight[:3, 3] - [0.0, 0.0, 0.6718])
    result = IKSolver(robot).solve(far)
    assert result.status in (IKStatus.UNREACHABLE, IKStatus.LIMITED)
    assert 0.3 < result.short_by < np.linalg.norm(far[:3, 3] - straight[:3, 3]) + 1e-6
    assert result.rotation_error < 1e-6


@pytest.mark.slow
def test_a_start_leads_to_the_solution_next_to_it():
    robot = lwr4(tool=TOOL)
    solver = IKSolver(robot)
    result = solver.solve(robot.fk(Q), q0=Q + 0.1)
    assert np.abs(result.q - Q).max() < 0.2
    assert result.branch == (-1, 1, 1)


@pytest.mark.slow
def test_a_posture_is_approached_along_the_null_space():
    robot = lwr4(tool=TOOL)
    solver, rng = IKSolver(robot), np.random.default_rng(3)
    for _ in range(20):
        posture = rng.uniform(robot.lower, robot.upper)
        pose = robot.fk(Q)
        plain, near = solver.solve(pose, q0=Q), solver.solve(pose, q0=Q, posture=posture)
        assert near.converged
        assert robot.within_limits(near.q)
        assert np.linalg.norm(near.q - posture) <= np.linalg.norm(plain.q - posture) + 1e-9
        assert no_better_neighbour(robot, solver, pose, near, posture)


def no_better_neighbour(robot, solver, pose, near, posture):
    """Along the arc of the same branch, both ways, the distance to the posture grows."""
    best = np.linalg.norm(near.q - posture)
    for branch in solver.branches(pose):
        if branch.signs == near.branch:
            for arc in branch.arcs:
                for psi in np.linspace(*arc, 2000):
                    q = solver.on_branch(pose, branch.signs, psi)
                    if q is not None and np.abs(q - near.q).max() < 0.02:
                        best = min(best, np.linalg.norm(q - posture))
    return best > np.linalg.norm(near.q - posture) - 1e-5


BROKEN = {
    "NaN": np.where(np.eye(4) == 1, np.nan, 0.0),
    "infinite": np.where(np.arange(16).reshape(4, 4) == 3, np.inf, np.eye(4)),
    "scaled": np.diag([1.1, 1.1, 1.1, 1.0]),
    "left-handed": np.diag([1.0, 1.0, -1.0, 1.0]),
    "sheared": np.eye(4) + 0.01 * np.eye(4, k=1),
    "too small": np.eye(3),
    "last row": np.diag([1.0, 1.0, 1.0, 2.0]),
    "words": [["a"] * 4] * 4,
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_no_pose_is_one_error_that_names_it(kind):
    with pytest.raises(InputError) as caught:
        IKSolver(lwr4()).solve(BROKEN[kind])
    assert caught.value.field == "pose"


@pytest.mark.parametrize("bad", [np.zeros(6), np.zeros(8), np.full(7, np.nan), np.full(7, np.inf)])
def test_joint_values_that_are_none_are_one_error_that_names_them(bad):
    solver, pose = IKSolver(lwr4()), lwr4().fk(Q)
    for name in ("q0", "posture"):
        with pytest.raises(InputError) as caught:
            solver.solve(pose, **{name: bad})
        assert caught.value.field == name


@pytest.mark.parametrize("name", ["tolerance", "rotation_tolerance", "max_jump", "damping", "iterations", "restarts"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_settings_that_make_no_solver_are_refused(name, value):
    with pytest.raises(InputError) as caught:
        IKSolver(lwr4(), **{name: value})
    assert caught.value.field == name


def test_preferences_that_make_no_sense_are_refused():
    with pytest.raises(InputError):
        Preference(off_limits=-1.0)
    with pytest.raises(InputError):
        IKSolver(lwr4(), preference=Preference(np.zeros(6)))
    with pytest.raises(InputError):
        IKSolver(ur5e(), preference=Preference(off_singularity=1.0))


def test_a_rotation_rounded_to_seven_digits_still_converges():
    robot = lwr4(tool=TOOL)
    pose = robot.fk(Q).A.round(7)
    assert IKSolver(robot, tolerance=1e-9, rotation_tolerance=1e-9).solve(pose).converged


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 1e-12])
def test_any_tolerance_is_kept(tolerance):
    robot = ur5e(tool=TOOL)
    solver = IKSolver(robot, tolerance=tolerance, rotation_tolerance=tolerance)
    for true in np.random.default_rng(4).uniform(-3, 3, (50, 6)):
        result = solver.solve(robot.fk(true))
        assert result.converged
        assert max(result.position_error, result.rotation_error) <= tolerance


def test_equal_questions_have_equal_answers():
    robot = panda(tool=TOOL)
    pose = robot.fk(robot.middle + 0.2)
    first, second = IKSolver(robot).solve(pose), IKSolver(robot)
    second.solve(robot.fk(robot.middle))
    np.testing.assert_array_equal(first.q, second.solve(pose).q)
