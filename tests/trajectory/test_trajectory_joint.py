"""Joint-space moves: inside all limits, position limits too, straight from rest, exact at the end."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lwrprobe.contracts import InputError
from lwrprobe.trajectory import JointTrajectory, TrajectoryStatus

UPPER = np.radians([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0])
SPEED = np.radians([110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0])
ACCELERATION, JERK = 5.0 * SPEED, 80.0 * SPEED


def arm_at_rest(cycle=1e-3):
    return JointTrajectory(cycle, -UPPER, UPPER, SPEED, ACCELERATION, JERK)


def step(arm, elapsed=None):
    """One step, held to all limits within rounding."""
    before = arm.qdd.copy()
    status = arm.step(elapsed)
    h = arm.cycle if elapsed is None else elapsed
    assert (np.abs(arm.q) <= UPPER + 1e-9).all()
    assert (np.abs(arm.qd) <= SPEED * (1.0 + 1e-9)).all()
    assert (np.abs(arm.qdd) <= ACCELERATION * (1.0 + 1e-9)).all()
    assert (np.abs(arm.qdd - before) <= JERK * h * (1.0 + 1e-9)).all()
    return status


@pytest.mark.slow
def run(arm, ticks):
    for _ in range(ticks):
        if arm.arrived:
            return
        step(arm)
    raise AssertionError(f"not there after {ticks} ticks, status {arm.status}")


def test_a_move_from_rest_is_straight_in_joint_space_and_ends_exactly():
    arm = arm_at_rest()
    goal = 0.5 * UPPER * np.array([1.0, -1.0, 0.3, 0.8, -0.2, 0.0, 1.0])
    assert arm.set_goal(goal) == TrajectoryStatus.MOVING
    while not arm.arrived:
        step(arm)
        share = arm.q @ goal / (goal @ goal)
        assert np.abs(arm.q - share * goal).max() < 1e-12
    assert np.array_equal(arm.q, goal)
    assert not arm.qd.any()


joints = st.tuples(*[st.one_of(st.floats(-1.0, 1.0), st.sampled_from([-1.0, 1.0]))] * 7)


@settings(max_examples=60, deadline=None)
@given(
    actions=st.lists(
        st.tuples(st.one_of(joints, st.just("stop"), st.floats(0.1, 1.0)), st.integers(0, 300)), min_size=1, max_size=12
    ),
    cycle=st.sampled_from([1e-3, 4e-3, 0.02]),
)
@pytest.mark.slow
def test_limits_hold_at_every_tick_of_any_sequence_and_the_last_goal_is_reached_exactly(actions, cycle):
    arm = arm_at_rest(cycle)
    for action, ticks in actions:
        if action == "stop":
            arm.stop()
        elif isinstance(action, float):
            arm.scale(action)
        else:
            arm.set_goal(UPPER * action)
        for _ in range(ticks):
            step(arm)
    arm.scale(1.0)
    goal = np.linspace(-0.5, 0.5, 7)
    arm.set_goal(goal)
    run(arm, int(10.0 / cycle))
    assert np.array_equal(arm.q, goal)
    assert arm.failures == 0


def test_a_stop_while_turning_back_at_a_position_limit_does_not_pass_it():
    for wait in range(1, 400, 7):
        arm = JointTrajectory(1e-3, [-1.0], [1.0], [1.5], [6.0], [60.0])
        arm.reset([0.0])
        arm.set_goal([1.0])
        for _ in range(500):  # full speed towards the limit
            arm.step()
        arm.set_goal([-1.0])  # the plan swings as near to the limit as it must
        for _ in range(wait):
            arm.step()
            assert arm.q[0] <= 1.0 + 1e-9
        arm.stop()
        last = arm.qdd[0]
        while arm.status == TrajectoryStatus.STOPPING:
            arm.step()
            assert arm.q[0] <= 1.0 + 1e-9
            assert abs(arm.qdd[0] - last) <= 0.06 * (1.0 + 1e-9)
            last = arm.qdd[0]
        assert arm.status == TrajectoryStatus.RESTING


def test_scaled_joints_say_that_they_are_too_fast_until_they_are_not():
    arm = arm_at_rest()
    arm.set_goal(0.9 * UPPER)
    for _ in range(500):
        step(arm)
    assert arm.scale(0.2) == TrajectoryStatus.TOO_FAST
    for _ in range(500):
        status = step(arm)
        assert (status == TrajectoryStatus.TOO_FAST) == bool((np.abs(arm.qd) > 0.2 * SPEED * (1.0 + 1e-9)).any())
    arm.scale(1.0)
    run(arm, 3000)


def test_a_start_in_motion_comes_to_rest():
    arm = arm_at_rest()
    arm.reset(np.zeros(7), 0.5 * SPEED)
    assert arm.status == TrajectoryStatus.STOPPING
    for _ in range(600):
        step(arm)
    assert arm.status == TrajectoryStatus.RESTING
    assert not arm.qd.any()


def test_a_zero_length_move_returns_at_once():
    arm = arm_at_rest()
    arm.reset(0.3 * UPPER)
    assert arm.set_goal(0.3 * UPPER) == TrajectoryStatus.RESTING
    assert arm.arrived


def test_joints_whose_limits_are_equal_stay():
    arm = JointTrajectory(1e-3, [0.5, -1.0], [0.5, 1.0], [1.0, 1.0], [5.0, 5.0], [50.0, 50.0])
    assert arm.q[0] == 0.5
    arm.set_goal([0.5, 0.7])
    while not arm.arrived:
        arm.step()
        assert arm.q[0] == 0.5


@pytest.mark.parametrize(
    "bad", [[0.0] * 6, [0.0] * 8, [], np.full(7, np.nan), [[0.0] * 7], 1.01 * UPPER, np.full(7, np.inf)]
)
def test_joint_values_that_are_none_are_refused_and_the_motion_goes_on(bad):
    arm = arm_at_rest()
    arm.set_goal(0.1 * UPPER)
    arm.step()
    for call in (lambda: arm.set_goal(bad), lambda: arm.reset(bad)):
        with pytest.raises(InputError, match="q"):
            call()
    run(arm, 2000)
    assert np.array_equal(arm.q, 0.1 * UPPER)


@pytest.mark.parametrize(
    "change",
    [
        {"cycle": 0.0},
        {"lower": UPPER, "upper": -UPPER},
        {"speed": 0.0 * SPEED},
        {"jerk": JERK[:3]},
        {"acceleration": np.full(7, np.nan)},
        {"upper": []},
    ],
)
def test_limits_that_are_none_are_refused(change):
    good = {"cycle": 1e-3, "lower": -UPPER, "upper": UPPER, "speed": SPEED, "acceleration": ACCELERATION, "jerk": JERK}
    with pytest.raises(InputError):
        JointTrajectory(**(good | change))


def test_a_goal_can_bring_its_own_share_of_the_speeds():
    arm = arm_at_rest()
    arm.set_goal(0.5 * UPPER, 0.3)
    fastest = np.zeros(7)
    while not arm.arrived:
        step(arm)
        fastest = np.maximum(fastest, np.abs(arm.qd) / SPEED)
    assert fastest.max() == pytest.approx(0.3, abs=1e-6)
    arm.set_goal(-0.5 * UPPER)  # and it stays, until another is given
    while not arm.arrived:
        step(arm)
        assert (np.abs(arm.qd) <= 0.3 * SPEED * (1.0 + 1e-9)).all()
    for factor in (0.0, -0.1, 1.1, float("nan")):
        with pytest.raises(InputError, match="factor"):
            arm.set_goal(0.1 * UPPER, factor)
    assert arm.arrived
