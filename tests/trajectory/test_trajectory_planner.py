"""The guard: whatever happens to the planner, the motion stays inside its limits and comes to rest."""

from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest
import ruckig
from naive_trajectory import Watch, pose

from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, JointTrajectory, TrajectoryStatus
from lwrprobe.trajectory.planner import ALONE, TOGETHER, Planner
from lwrprobe.trajectory.profile_kernels import (
    BRAKES,
    DURATION,
    FACTS,
    LAST,
    LINES,
    MAX_JERK,
    MAX_RATE,
    MAX_SECOND,
    MOVES,
    RATE,
    ROW,
    SECOND,
    TARGET,
    TO_POSITION,
    common_units,
    hand_over,
    load,
    natural_units,
)

LIMITS = CartesianLimits(0.25, 2.0, 40.0, 1.0, 5.0, 100.0)


@contextmanager
def failing_planner(fails, how):
    """Within it every planner fails on chosen calls, in a chosen way."""
    solve, calls = Planner.solve, count(1)

    def failing(planner, request, brakes):
        solved = solve(planner, request, brakes)
        if not fails(next(calls)):
            return solved
        if how == "refuses":
            return False
        planner.pieces *= 1.001 if how == "wrong" else np.nan
        return True

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Planner, "solve", failing)
        yield


@pytest.mark.parametrize("how", ["refuses", "wrong", "nan"])
def test_a_planner_that_fails_for_good_ends_in_a_jerk_limited_stop(how):
    rng = np.random.default_rng(8)
    for _ in range(12):
        watch = Watch(CartesianTrajectory(1e-3, LIMITS))
        tip = watch.tip
        tip.set_goal(pose(*rng.uniform(-0.2, 0.2, 3), rng.normal(size=3)), 0.25)
        for _ in range(rng.integers(0, 400)):
            watch.step()
        tip.set_goal(pose(*rng.uniform(-0.2, 0.2, 3), rng.normal(size=3)), 0.25)
        for _ in range(rng.integers(0, 200)):
            watch.step()
        moving = tip.velocity.any()
        with failing_planner(lambda call: True, how):
            status = tip.set_goal(pose(*rng.uniform(-0.2, 0.2, 3)), 0.25)
            for _ in range(1000):
                status = watch.step()
        assert status == TrajectoryStatus.RESCUED
        assert not tip.velocity.any()
        assert not tip.arrived
        assert tip.failures >= 3 or not moving


def test_a_planner_that_fails_now_and_then_delays_the_goal_and_no_more():
    rng = np.random.default_rng(9)
    watch = Watch(CartesianTrajectory(1e-3, LIMITS))
    tip = watch.tip
    with failing_planner(lambda call: rng.random() < 0.3, "refuses"):
        for _ in range(40):
            goal = pose(*rng.uniform(-0.1, 0.1, 3), 0.3 * rng.normal(size=3))
            tip.set_goal(goal, 0.25)
            for _ in range(rng.integers(0, 100)):
                watch.step()
        for _ in range(3):
            tip.set_goal(goal, 0.25)
            for _ in range(2000):
                watch.step()
    assert tip.arrived
    assert np.abs(tip.pose - goal).max() < 1e-15
    assert tip.failures > 0


def test_joints_come_to_rest_inside_their_limits_without_a_planner():
    rng = np.random.default_rng(10)
    n = 7
    arm = JointTrajectory(1e-3, -2.0 * np.ones(n), 2.0 * np.ones(n), np.ones(n), 5.0 * np.ones(n), 100.0 * np.ones(n))
    arm.set_goal(rng.uniform(-1.0, 1.0, n))
    for _ in range(300):
        arm.step()
    with failing_planner(lambda call: True, "refuses"):
        assert arm.set_goal(np.zeros(n)) in (TrajectoryStatus.YIELDING, TrajectoryStatus.RESCUED)
        last = arm.qdd.copy()
        for _ in range(600):
            status = arm.step()
            assert (np.abs(arm.qd) <= 1.0 + 1e-9).all()
            assert (np.abs(arm.qdd) <= 5.0 + 1e-9).all()
            assert (np.abs(arm.qdd - last) <= 0.1 * (1.0 + 1e-9)).all()
            last = arm.qdd.copy()
    assert status == TrajectoryStatus.RESCUED
    assert not arm.qd.any()
    assert not arm.arrived


def one_axis(target, rate, second, max_rate, max_second, max_jerk):
    request = np.zeros((LINES, 1))
    request[[TARGET, RATE, SECOND, MAX_RATE, MAX_SECOND, MAX_JERK, MOVES], 0] = (
        target,
        rate,
        second,
        max_rate,
        max_second,
        max_jerk,
        TO_POSITION,
    )
    return request


@pytest.mark.slow
@pytest.mark.parametrize("units", [common_units, natural_units])
def test_plans_end_on_their_target_over_the_whole_range_of_validity(units):
    rng = np.random.default_rng(3)
    planner = Planner([ALONE], [False])
    request, handed, facts, plan = np.zeros((LINES, 1)), np.zeros((7, 1)), np.zeros(FACTS), np.zeros(ROW)
    refused = 0
    for _ in range(3000):
        v = 10.0 ** rng.uniform(-3, 1)
        a = v * 10.0 ** rng.uniform(-1, 3)
        j = a * 10.0 ** rng.uniform(-1, 3)
        small = 0.0 if rng.random() < 0.3 else 10.0 ** rng.uniform(-9, 0)
        start = small * rng.uniform(-0.5, 0.5) * min(a, np.sqrt(v * j))
        request[:] = one_axis(
            rng.normal() * 10.0 ** rng.uniform(-9, 1), small * rng.uniform(-0.5, 0.5) * v, start, v, a, j
        )
        units(request)
        hand_over(request, facts, handed)
        good = planner.solve(handed, facts[BRAKES] != 0.0) and load(plan, request, facts, planner.pieces)
        refused += not good
        if good:
            # `load` only takes what ends within 1e-11 of the target and inside the limits
            assert plan[LAST] == facts[DURATION] > 0.0
    # In common units some of the smallest moves are refused (Ruckig's tolerance); natural units leave none.
    assert refused <= (60 if units is common_units else 0)


def test_without_the_dead_band_ruckig_fails_at_the_target_and_with_it_nothing_does():
    otg, given, trajectory = ruckig.Ruckig(7), ruckig.InputParameter(7), ruckig.Trajectory(7)
    rng = np.random.default_rng(1)
    given.max_velocity, given.max_acceleration, given.max_jerk = [1.0] * 7, [5.0] * 7, [100.0] * 7
    arm = JointTrajectory(1e-3, -3.0 * np.ones(7), 3.0 * np.ones(7), np.ones(7), 5.0 * np.ones(7), 100.0 * np.ones(7))
    bare = 0
    for _ in range(300):
        q = rng.uniform(-1.0, 1.0, 7)
        hair = q + 2e-16 * rng.integers(-2, 3, 7)
        given.current_position, given.target_position = q.tolist(), hair.tolist()
        given.current_velocity = (1e-13 * rng.normal(size=7)).tolist()
        try:
            otg.calculate(given, trajectory)
        except Exception:
            bare += 1
        arm.reset(q, 1e-13 * rng.normal(size=7))
        arm.set_goal(hair)
        for _ in range(3):
            arm.step()
        assert arm.arrived
        assert np.array_equal(arm.q, hair)
    assert bare > 0, "Ruckig no longer fails here: the dead-band may go"
    assert arm.failures == 0


def test_a_planner_says_no_instead_of_raising():
    planner = Planner([TOGETHER] * 2, [False] * 2)
    request = np.ones((7, 2))
    assert planner.solve(request, True)
    request[MAX_JERK] = -1.0
    assert not planner.solve(request, True)
    request = np.full((7, 2), np.nan)
    assert not planner.solve(request, True)
    request = np.ones((7, 2))
    request[TARGET] = 1e6  # longer than Ruckig's longest duration
    assert not planner.solve(request, True)
