"""The fast path: tracking by damped least squares, near singularities, at joint limits, without a jump."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_kinematics import allocations, pose_error

from lwrprobe.kinematics import (
    IKSolver,
    IKStatus,
    Preference,
    Robot,
    dls_kernels,
    ik_kernels,
    lwr4,
    panda,
    preference_kernels,
    puma560,
    ur5e,
)

TOOL = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.25], [0, 0, 0, 1]])


def hard_cases(robot, count, rng):
    """Joint values at and around the singularities and limits of a spherical-roll-spherical arm."""

    def free():
        return rng.uniform(robot.lower, robot.upper, (count, robot.n))

    def fixed(**joints):
        qs = free()
        for name, value in joints.items():
            qs[:, int(name[1]) - 1] = value
        return qs

    one_at_limit = free()
    joint = rng.integers(0, robot.n, count)
    ends = np.where(rng.random(count) < 0.5, robot.lower[joint], robot.upper[joint])
    one_at_limit[np.arange(count), joint] = ends
    quarter = rng.choice([-0.5 * np.pi, 0.5 * np.pi], count)
    return {
        "q4=0": fixed(q4=0.0),
        "q4=1e-6": fixed(q4=1e-6),
        "q6=0": fixed(q6=0.0),
        "q2=0": fixed(q2=0.0),
        "q2=q4=q6=0": fixed(q2=0.0, q4=0.0, q6=0.0),
        "q3=+-90, q6=0": fixed(q3=quarter, q6=0.0),
        "one at its limit": one_at_limit,
        "all at limits": np.where(rng.random((count, robot.n)) < 0.5, robot.lower, robot.upper),
    }


HARD = list(hard_cases(lwr4(), 1, np.random.default_rng(0)))


def assert_solved(robot, status, q, pose):
    assert status == IKStatus.CONVERGED
    position, rotation = pose_error(robot.fk(q).A, pose)
    assert position <= 1e-6
    assert rotation <= 1.01e-6
    assert robot.within_limits(q)


@pytest.mark.parametrize("model", [lwr4, ur5e, panda, puma560])
def test_tracking_from_nearby_always_arrives_without_a_jump(model):
    robot = model(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(1), np.empty(robot.n)
    for true in rng.uniform(robot.lower, robot.upper, (500, robot.n)):
        seed = np.clip(true + rng.uniform(-0.05, 0.05, robot.n), robot.lower, robot.upper)
        pose = robot.fk(true).A
        assert_solved(robot, solver.track(pose, seed, q), q, pose)
        assert np.abs(q - seed).max() <= 0.5


@pytest.mark.parametrize("case", HARD)
def test_tracking_survives_the_hard_cases(case):
    robot = lwr4(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(2), np.empty(7)
    for true in hard_cases(robot, 300, rng)[case]:
        seed = np.clip(true + rng.uniform(-0.05, 0.05, 7), robot.lower, robot.upper)
        pose = robot.fk(true).A
        assert_solved(robot, solver.track(pose, seed, q), q, pose)
        assert np.abs(q - seed).max() <= 0.5


def test_a_goal_equal_to_the_present_pose_moves_nothing():
    robot = lwr4(tool=TOOL)
    seed, q = np.deg2rad([10.0, 30, 0, -90, 0, 60, 0]), np.empty(7)
    assert IKSolver(robot).track(robot.fk(seed).A, seed, q) == IKStatus.CONVERGED
    np.testing.assert_allclose(q, seed, atol=1e-9)


def test_tracking_allocates_nothing():
    robot = lwr4(tool=TOOL)
    solver, seed, q = IKSolver(robot), np.deg2rad([10.0, 30, 0, -90, 0, 60, 0]), np.empty(7)
    pose, beyond = robot.fk(seed + 0.01).A, robot.fk(seed).A
    beyond[0, 3] += 2.0
    solver.track(pose, seed, q)
    before = allocations()
    for _ in range(100):
        solver.track(pose, seed, q), solver.track(beyond, seed, q), solver.reach(pose, -seed, q)
    # not even a handle an array argument, which numba takes where views are counted
    assert allocations() - before == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_no_number_in_gives_invalid_and_the_seed_back(bad):
    robot = lwr4()
    solver, seed, q = IKSolver(robot), np.full(7, 0.3), np.empty(7)
    for i, j in np.ndindex(3, 4):
        pose = robot.fk(seed).A.copy()
        pose[i, j] = bad
        assert solver.track(pose, seed, q) == IKStatus.INVALID
        np.testing.assert_array_equal(q, seed)
    assert solver.track(robot.fk(seed).A, np.where(np.arange(7) == 3, bad, seed), q) == IKStatus.INVALID


@pytest.mark.parametrize("turn", [1.1 * np.eye(3), np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), np.ones((3, 3))])
def test_what_is_no_rotation_is_invalid(turn):
    robot = lwr4()
    solver, seed, q = IKSolver(robot), np.full(7, 0.3), np.empty(7)
    pose = robot.fk(seed).A.copy()
    pose[:3, :3] = pose[:3, :3] @ turn
    for ask in (solver.track, solver.reach):
        assert ask(pose, seed, q) == IKStatus.INVALID
        np.testing.assert_array_equal(q, seed)


def test_beyond_reach_gives_the_nearest_pose_and_says_unreachable():
    robot = lwr4(tool=TOOL)
    solver, q = IKSolver(robot), np.empty(7)
    seed = np.deg2rad([10.0, 40, 0, -5, 0, 60, 0])
    straight = np.deg2rad([10.0, 40, 0, 0, 0, 60, 0])
    pose = robot.fk(straight).A.copy()
    wrist = robot.link_frames(straight)[-1][:3, 3]
    pose[:3, 3] += 0.05 * wrist / np.linalg.norm(wrist)
    assert solver.track(pose, seed, q) == IKStatus.UNREACHABLE
    short, turned = pose_error(robot.fk(q).A, pose)
    assert short == pytest.approx(0.05, abs=1e-6)
    assert turned < 1e-6


def test_a_jump_is_reported_and_never_taken():
    robot = lwr4(tool=TOOL)
    solver, rng, q = IKSolver(robot), np.random.default_rng(4), np.empty(7)
    seen = set()
    for _ in range(300):
        pose, seed = robot.fk(rng.uniform(robot.lower, robot.upper)).A, rng.uniform(robot.lower, robot.upper)
        seen.add(solver.track(pose, seed, q))
        assert np.abs(q - seed).max() <= 0.5 + 1e-12
        assert robot.within_limits(q)
    assert IKStatus.JUMP in seen
    assert IKStatus.UNREACHABLE not in seen


def test_equal_joint_limits_hold_a_joint_still():
    from dataclasses import replace

    robot = lwr4(tool=TOOL)
    robot = replace(
        robot, lower=np.where(np.arange(7) == 2, 0.4, robot.lower), upper=np.where(np.arange(7) == 2, 0.4, robot.upper)
    )
    solver, rng, q = IKSolver(robot), np.random.default_rng(5), np.empty(7)
    for true in rng.uniform(robot.lower, robot.upper, (100, 7)):
        pose = robot.fk(true).A
        seed = np.clip(true + rng.uniform(-0.05, 0.05, 7), robot.lower, robot.upper)
        assert_solved(robot, solver.track(pose, seed, q), q, pose)
        assert_solved(robot, solver.reach(pose, -seed, q), q, pose)
        assert q[2] == 0.4


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e3])
def test_arms_of_any_size(scale):
    arm = lwr4()
    tool = TOOL.copy()
    tool[2, 3] *= scale
    robot = Robot("scaled", arm.a, arm.alpha, scale * arm.d, arm.theta, arm.lower, arm.upper, arm.speed, tool=tool)
    solver, rng, q = IKSolver(robot, tolerance=1e-6 * scale), np.random.default_rng(6), np.empty(7)
    for true in rng.uniform(robot.lower, robot.upper, (100, 7)):
        pose = robot.fk(true).A
        assert solver.track(pose, np.clip(true + 0.03, robot.lower, robot.upper), q) == IKStatus.CONVERGED
        assert pose_error(robot.fk(q).A, pose)[0] <= 1e-6 * scale
        assert solver.reach(pose, -true, q) == IKStatus.CONVERGED
        assert pose_error(robot.fk(q).A, pose)[0] <= 1e-6 * scale


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e3])
def test_a_gantry_with_a_wrist(scale):
    """Three sliding and three turning joints."""
    quarter = 0.5 * np.pi
    robot = Robot(
        name="gantry",
        a=np.zeros(6),
        alpha=np.array([quarter, quarter, 0.0, -quarter, quarter, 0.0]),
        d=scale * np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.1]),
        theta=np.array([0.0, quarter, 0.0, 0.0, 0.0, 0.0]),
        lower=np.array([-scale, -scale, -scale, -3.0, -2.0, -3.0]),
        upper=np.array([scale, scale, scale, 3.0, 2.0, 3.0]),
        speed=np.ones(6),
        prismatic=np.array([True, True, True, False, False, False]),
    )
    solver, rng, q = IKSolver(robot, tolerance=1e-6 * scale), np.random.default_rng(7), np.empty(6)
    for true in rng.uniform(robot.lower, robot.upper, (100, 6)):
        pose = robot.fk(true).A
        assert solver.reach(pose, np.zeros(6), q) == IKStatus.CONVERGED
        assert pose_error(robot.fk(q).A, pose)[0] <= 1e-6 * scale
        assert robot.within_limits(q)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=14, max_size=14))
def test_limits_and_jump_bound_hold_for_any_goal_and_seed(shares):
    robot = lwr4(tool=TOOL)
    span = robot.upper - robot.lower
    goal, seed = robot.lower + span * shares[:7], robot.lower + span * shares[7:]
    q = np.empty(7)
    status = IKSolver(robot).track(robot.fk(goal).A, seed, q)
    assert robot.within_limits(q)
    assert np.abs(q - seed).max() <= 0.5 + 1e-12
    if status == IKStatus.CONVERGED:
        assert_solved(robot, status, q, robot.fk(goal).A)


def test_preference_moves_the_elbow_and_never_the_tip():
    robot = lwr4(tool=TOOL)
    posture = np.deg2rad([0.0, 30, 40, -90, 0, 60, 0])
    seed = np.deg2rad([20.0, 30, 0, -90, 0, 60, 0])
    pose = robot.fk(seed).A
    solver = IKSolver(robot, preference=Preference(posture, near_posture=1.0, null_space_step=0.01))
    q, ways = seed.copy(), []
    for _ in range(300):
        assert_solved(robot, solver.track(pose, q.copy(), q), q, pose)
        ways.append(np.linalg.norm(q - posture))
    assert ways[-1] < 0.8 * np.linalg.norm(seed - posture)
    assert ways[-1] - min(ways) < 1e-3


def test_preference_leaves_a_limit_and_a_singularity():
    robot = lwr4(tool=TOOL)
    at_limit = np.deg2rad([0.0, 119.5, 60, -90, 40, 60, 0])
    solver, q = IKSolver(robot, preference=Preference(null_space_step=0.01)), at_limit.copy()
    pose = robot.fk(q).A
    for _ in range(100):
        assert_solved(robot, solver.track(pose, q.copy(), q), q, pose)
    assert robot.limit_margin(q) > 0.1
    near_singular = np.deg2rad([0.0, 40, 10, -60, 20, 2, 0])
    solver = IKSolver(robot, preference=Preference(off_singularity=1.0, null_space_step=0.01))
    pose, q = robot.fk(near_singular).A, near_singular.copy()
    measures = [robot.manipulability(q)]
    for _ in range(200):
        assert_solved(robot, solver.track(pose, q.copy(), q), q, pose)
        measures.append(robot.manipulability(q))
    assert np.diff(measures).min() > -1e-9
    assert measures[-1] > 1.05 * measures[0]


def test_pace_bounds_what_a_preference_moves():
    robot = lwr4(tool=TOOL)
    seed, q = np.deg2rad([20.0, 30, 0, -90, 0, 60, 0]), np.empty(7)
    solver = IKSolver(robot, preference=Preference(-seed, near_posture=100.0, null_space_step=1e-3))
    assert solver.track(robot.fk(seed).A, seed, q) == IKStatus.CONVERGED
    assert 0.5e-3 < np.abs(q - seed).max() < 1.1e-3


def naive_weights(robot, zone, q):
    share = np.minimum(np.minimum(q - robot.lower, robot.upper - q) / zone, 1.0).clip(0.0, 1.0)
    return np.maximum(3.0 * share**2 - 2.0 * share**3, 1e-3)


def test_weights_beside_the_limits_are_those_of_the_plain_formula():
    robot = lwr4(tool=TOOL)
    solver, rng = IKSolver(robot, preference=Preference(zone=0.3)), np.random.default_rng(4)
    places, work = solver.table[robot.n + ik_kernels.PLACES :], np.ones((dls_kernels.SCRATCH, robot.n))
    for q in rng.uniform(robot.lower, robot.upper, (200, robot.n)):
        work[dls_kernels.WEIGHT] = 1.0
        preference_kernels.ease(robot.chain, places, q, work)
        np.testing.assert_allclose(work[dls_kernels.WEIGHT], naive_weights(robot, 0.3, q), atol=1e-12)


def test_a_joint_slows_down_before_its_limit_and_the_others_take_over():
    """A free motion towards the end of joint 1's range: it had gone on into the limit and stood still in one cycle."""
    robot, cycle = lwr4(tool=TOOL), 0.002
    solver = IKSolver(robot, preference=Preference(null_space_step=8e-5))
    q = np.array([2.80, 0.5357, -2.834, 1.952, -0.543, -0.484, 0.495])
    pose, rows = robot.fk(q).A, [q]
    for _ in range(1500):
        pose[1, 3] += 0.07 * cycle * min(1.0, len(rows) / 100)
        rows.append(np.empty(robot.n))
        assert solver.track(pose, rows[-2], rows[-1]) == IKStatus.CONVERGED
    joints = np.array(rows)
    assert joints[:, 0].max() > robot.upper[0] - 0.15
    assert np.abs(np.diff(joints, 2, axis=0)).max() / cycle**2 < 10.0


def test_a_free_motion_comes_to_rest_between_two_limits_without_a_jerk():
    """Joints 1 and 6 both near an end, each of which moves away only towards the other's: joint 3 swung to and fro."""
    robot, cycle = lwr4(tool=TOOL), 0.001
    solver = IKSolver(robot, preference=Preference(null_space_step=2e-5))
    q = np.array([2.93491, 1.47878, 1.38658, -0.80837, 1.79741, -2.02386, 0.59312])
    pose, rows = robot.fk(q).A, [q]
    for _ in range(300):
        pose[2, 3] -= 0.00416 * cycle * min(1.0, len(rows) / 100)
        rows.append(np.empty(robot.n))
        assert solver.track(pose, rows[-2], rows[-1]) == IKStatus.CONVERGED
    joints = np.array(rows)
    assert np.abs(joints[-1] - q).max() > 1e-4
    assert np.abs(np.diff(joints, 3, axis=0)).max() / cycle**3 < 8000.0


def test_where_the_null_space_bends_sharply_no_joint_swings_from_cycle_to_cycle():
    """Joints 3 and 5 turned about axes nearly in line: a run was stopped as joint 3 swung by more in each cycle."""
    robot, cycle = lwr4(tool=TOOL), 0.001
    solver = IKSolver(robot, preference=Preference(null_space_step=2e-5))
    q = np.array([-0.2947585, -1.7023477, 1.7853083, 0.4470033, 1.5709223, 1.9045069, -2.9611581])
    pose, rows = robot.fk(q).A, [q]
    for _ in range(1000):
        pose[2, 3] -= 0.00612 * cycle
        rows.append(np.empty(robot.n))
        assert solver.track(pose, rows[-2], rows[-1]) == IKStatus.CONVERGED
    assert np.abs(np.diff(np.array(rows)[500:], 3, axis=0)).max() / cycle**3 < 3000.0
