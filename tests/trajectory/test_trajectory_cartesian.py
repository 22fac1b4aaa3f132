"""The Cartesian generator keeps its promises: straight, inside the limits at every tick, exact at the end."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_trajectory import Watch, pose
from scipy.spatial.transform import Rotation

from lwrprobe.contracts import InputError
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, TrajectoryStatus

LIMITS = CartesianLimits(0.25, 2.0, 40.0, 1.0, 5.0, 100.0)


def tip_at_rest(cycle=1e-3, limits=LIMITS):
    return CartesianTrajectory(cycle, limits)


def run(watch, ticks, until=lambda tip: tip.arrived):
    for n in range(ticks):
        if until(watch.tip):
            return n
        watch.step()
    raise AssertionError(f"not there after {ticks} ticks, status {watch.tip.status}")


@pytest.mark.parametrize("speed", [0.25, 0.2, 0.01])
def test_a_move_from_rest_is_straight_and_slerp_straight_in_one_phase_and_ends_exactly(speed):
    tip = tip_at_rest()
    displacement, turn = np.array((0.1, 0.05, -0.02)), np.array((0.3, -0.5, 0.2))
    goal = pose(*displacement, turn)
    assert tip.set_goal(goal, speed) == TrajectoryStatus.MOVING
    watch = Watch(tip)
    while not tip.arrived:
        watch.step()
        x = tip.pose[:3, 3]
        r = Rotation.from_matrix(tip.pose[:3, :3]).as_rotvec()
        share = x @ displacement / (displacement @ displacement)
        assert np.abs(x - share * displacement).max() < 1e-15
        assert np.abs(r - share * turn).max() < 1e-12
        assert np.linalg.norm(tip.velocity) <= speed * (1.0 + 1e-12)
    assert np.abs(tip.pose - goal).max() < 1e-15
    assert not tip.velocity.any()
    assert not tip.angular_velocity.any()


def test_a_straight_move_uses_its_limits_in_full():
    tip = tip_at_rest()
    watch = Watch(tip)
    tip.set_goal(pose(0.3, 0.2, -0.1), 0.25)
    run(watch, 3000)
    assert watch.worst[[0, 1, 4]] == pytest.approx([1.0, 1.0, 1.0], abs=1e-9)
    tip.set_goal(pose(0.3, 0.2, -0.1, (0.9, -1.2, 0.4)), 0.25)
    run(watch, 3000)
    assert watch.worst[[2, 3, 5]] == pytest.approx([1.0, 1.0, 1.0], abs=1e-9)


actions = st.lists(
    st.one_of(
        st.tuples(
            st.just("goal"),
            st.tuples(*[st.floats(-0.15, 0.15)] * 3),
            st.tuples(*[st.floats(-1.5, 1.5)] * 3),
            st.sampled_from([0.25, 0.1, 0.02, 5.0]),
            st.integers(0, 200),
        ),
        st.tuples(
            st.just("velocity"),
            st.tuples(*[st.floats(-0.2, 0.2)] * 3),
            st.one_of(st.none(), st.tuples(*[st.floats(-1.5, 1.5)] * 3)),
            st.floats(1e-3, 0.1),
            st.integers(0, 200),
        ),
        st.tuples(st.just("stop"), st.integers(0, 100)),
        st.tuples(st.just("scale"), st.floats(0.05, 1.0), st.integers(0, 50)),
    ),
    min_size=1,
    max_size=12,
)


def act(watch, action):
    tip = watch.tip
    if action[0] == "goal":
        tip.set_goal(pose(*action[1], action[2]), action[3])
    elif action[0] == "velocity":
        tip.set_velocity(np.array(action[1]), action[3], None if action[2] is None else pose(turn=action[2]))
    elif action[0] == "stop":
        tip.stop()
    else:
        tip.scale(action[1])
    for _ in range(action[-1]):
        watch.step()


@settings(max_examples=40, deadline=None)
@given(actions=actions, cycle=st.sampled_from([1e-3, 4e-3, 0.02]))
@pytest.mark.slow
def test_limits_hold_at_every_tick_of_any_sequence_and_the_last_goal_is_reached_exactly(actions, cycle):
    watch = Watch(tip_at_rest(cycle))
    for action in actions:
        act(watch, action)
    goal = pose(0.05, -0.08, 0.02, (0.4, 0.1, -0.7))
    watch.tip.scale(1.0)
    watch.tip.set_goal(goal, 0.25)
    run(watch, int(8.0 / cycle))
    assert np.abs(watch.tip.pose - goal).max() < 1e-15
    assert watch.tip.failures == 0


@settings(max_examples=30, deadline=None)
@given(
    limits=st.tuples(*[st.floats(-4.0, 1.0), st.floats(-1.0, 3.0), st.floats(-1.0, 3.0)] * 2),
    cycle=st.floats(1e-4, 0.02),
    seed=st.integers(0, 2**31),
)
def test_limits_hold_over_many_decades_and_irregular_cycles(limits, cycle, seed):
    speed, accel, jerk = np.cumsum(limits[:3])
    rate, turn_accel, turn_jerk = np.cumsum(limits[3:])
    bounds = CartesianLimits(*(10.0 ** np.array((speed, accel, jerk, rate, turn_accel, turn_jerk))))
    rng = np.random.default_rng(seed)
    watch = Watch(tip_at_rest(cycle, bounds), tolerance=1e-8)
    tip = watch.tip
    length = max(bounds.speed**2 / bounds.acceleration, bounds.speed * bounds.acceleration / bounds.jerk)
    for _ in range(8):
        goal = pose(*(tip.pose[:3, 3] + rng.normal(size=3) * length), rng.normal(size=3) * 0.3)
        tip.set_goal(goal, bounds.speed * rng.uniform(0.1, 1.0))
        for _ in range(rng.integers(0, 40)):
            watch.step(cycle * rng.uniform(0.2, 3.0))
    assert tip.failures == 0


@pytest.mark.parametrize("cycle", [1e-4, 1e-3, 0.02, "irregular"])
def test_any_cycle_keeps_the_limits_and_ends_on_the_goal(cycle):
    rng = np.random.default_rng(34)
    irregular = cycle == "irregular"
    watch = Watch(tip_at_rest(1e-3 if irregular else cycle))
    goals = [pose(0.05, 0.02, 0.0, (0.1, 0.3, 0.0)), pose(0.05, 0.04, 0.01, (0.0, 0.1, -0.2)), pose(0.0, 0.0, 0.02)]
    for goal in goals:
        watch.tip.set_goal(goal, 0.25)
        elapsed = 0.0
        while elapsed < 0.2 or (goal is goals[-1] and not watch.tip.arrived):
            h = 10.0 ** rng.uniform(-4.0, np.log10(0.02)) if irregular else watch.tip.cycle
            watch.step(h)
            elapsed += h
            assert elapsed < 3.0
    assert np.abs(watch.tip.pose - goals[-1]).max() < 1e-15


def test_a_goal_that_changes_at_every_tick_is_followed():
    tip = tip_at_rest()
    watch = Watch(tip)
    lag = []
    for n in range(3000):
        angle = 1.5e-3 * n
        goal = pose(0.05 * np.sin(angle), 0.05 - 0.05 * np.cos(angle), turn=(0.0, 0.0, 0.2 * angle))
        tip.set_goal(goal, 0.25)
        watch.step()
        lag.append(np.linalg.norm(tip.pose[:3, 3] - goal[:3, 3]))
    assert max(lag[1000:]) < 0.01
    run(watch, 1000)
    assert np.abs(tip.pose - goal).max() < 1e-15
    assert tip.failures == 0


def test_the_same_goal_at_every_tick_changes_nothing():
    once, again = tip_at_rest(), tip_at_rest()
    goal = pose(0.1, 0.02, 0.0, (0.2, 0.3, 0.0))
    once.set_goal(goal, 0.2)
    for _ in range(900):
        again.set_goal(goal, 0.2)
        once.step()
        again.step()
        assert np.array_equal(once.pose, again.pose)
    assert again.arrived


def test_a_goal_that_moves_by_a_hair_at_every_tick_is_reached_as_fast_as_one_that_stays():
    once, watch = tip_at_rest(), Watch(tip_at_rest())
    goal = pose(0.1, 0.02, 0.0, (0.2, 0.3, 0.0))
    once.set_goal(goal, 0.2)
    ticks = 0
    while not once.arrived:
        once.step()
        watch.tip.set_goal(goal + 1e-9 * (ticks % 2) * np.eye(4, k=3), 0.2)
        watch.step()
        ticks += 1
    assert np.abs(watch.tip.pose - goal).max() < 1e-6


def test_a_reversed_goal_turns_back_without_leaving_the_line():
    tip = tip_at_rest()
    watch = Watch(tip)
    tip.set_goal(pose(0.2, 0.1, 0.0), 0.25)
    for _ in range(400):
        watch.step()
    tip.set_goal(pose(), 0.25)
    along = np.array((2.0, 1.0, 0.0)) / np.sqrt(5.0)
    while not tip.arrived:
        watch.step()
        x = tip.pose[:3, 3]
        assert np.abs(x - along * (x @ along)).max() < 1e-12
    assert np.abs(tip.pose - np.eye(4)).max() < 1e-15


def test_a_zero_length_move_returns_at_once():
    tip = tip_at_rest()
    goal = pose(0.3, -0.2, 0.5, (1.0, 2.0, -0.5))
    tip.reset(goal)
    assert tip.set_goal(goal, 0.1) == TrajectoryStatus.RESTING
    assert tip.arrived
    tip.set_goal(goal + 1e-13 * np.eye(4, k=3), 0.1)
    assert tip.arrived


@pytest.mark.parametrize("magnitude", 10.0 ** np.arange(-16, -5))
def test_goals_a_hair_away_are_reached_at_rest_and_from_motion(magnitude):
    rng = np.random.default_rng(11)
    watch = Watch(tip_at_rest())
    tip = watch.tip
    for n in range(20):
        goal = tip.pose.copy()
        goal[:3, 3] += rng.normal(size=3) * magnitude
        goal[:3, :3] = Rotation.from_rotvec(rng.normal(size=3) * magnitude).as_matrix() @ goal[:3, :3]
        tip.set_goal(goal, 0.1)
        for _ in range(n % 4):
            watch.step()
    run(watch, 200)
    assert np.abs(tip.pose - goal).max() < 2e-12  # the dead-band, where the goal is nearer than that at once
    assert tip.failures == 0


@pytest.mark.parametrize("angle", [0.0, 2.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0])
def test_a_corner_is_faster_than_stop_and_go_and_ends_straight(angle):
    def turn_at_full_speed(stop_first):
        watch = Watch(tip_at_rest())
        tip = watch.tip
        tip.set_goal(pose(0.2), 0.25)
        while tip.pose[0, 3] < 0.1:
            watch.step()
        direction = np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0))
        goal = pose(*(tip.pose[:3, 3] + 0.1 * direction))
        ticks = 0
        if stop_first:
            tip.stop()
            ticks += run(watch, 1000, lambda tip: tip.status == TrajectoryStatus.RESTING)
        tip.set_goal(goal, 0.25)
        velocities = []
        while not tip.arrived:
            watch.step()
            velocities.append(tip.velocity.copy())
        last = velocities[-60]
        left = goal[:3, 3] - tip.pose[:3, 3]
        assert not left.any()
        return ticks + len(velocities), velocities, last

    through, velocities, _ = turn_at_full_speed(False)
    stop_and_go, _, _ = turn_at_full_speed(True)
    assert through < stop_and_go
    ends = np.array(velocities[-50:-1])
    directions = ends / np.linalg.norm(ends, axis=1)[:, None]
    assert np.abs(directions - directions[0]).max() < 1e-6


def test_a_lower_speed_in_motion_says_so_and_is_reached_inside_the_limits():
    watch = Watch(tip_at_rest())
    tip = watch.tip
    tip.set_goal(pose(0.3), 0.25)
    for _ in range(300):
        watch.step()
    assert tip.set_goal(pose(0.3), 0.05) == TrajectoryStatus.TOO_FAST
    for _ in range(300):
        status = watch.step()
        assert (status == TrajectoryStatus.TOO_FAST) == (np.linalg.norm(tip.velocity) > 0.05 * (1.0 + 1e-9))
    assert status == TrajectoryStatus.MOVING
    assert np.linalg.norm(tip.velocity) == pytest.approx(0.05)


def test_scaling_slows_down_and_speeds_up_on_the_line():
    watch = Watch(tip_at_rest())
    tip = watch.tip
    tip.set_goal(pose(0.2, 0.1, 0.0, (0.1, 0.2, 0.3)), 0.2)
    for n in range(3000):
        if n == 200:
            tip.scale(0.3)
        if n == 500:
            assert np.linalg.norm(tip.velocity) == pytest.approx(0.06)
            tip.scale(1.0)
        watch.step()
        x = tip.pose[:3, 3]
        assert np.linalg.norm(np.cross(x, (2.0, 1.0, 0.0))) < 1e-12
    assert tip.arrived


def test_a_velocity_command_is_kept_and_stops_by_itself():
    watch = Watch(tip_at_rest())
    tip = watch.tip
    for _ in range(400):
        tip.set_velocity(np.array((0.03, -0.04, 0.0)), 0.05)
        watch.step()
    assert tip.velocity == pytest.approx([0.03, -0.04, 0.0], abs=1e-12)
    assert tip.status == TrajectoryStatus.TRACKING_VELOCITY
    for _ in range(48):
        watch.step()
    assert np.linalg.norm(tip.velocity) == pytest.approx(0.05)
    ticks = run(watch, 200, lambda tip: tip.status == TrajectoryStatus.RESTING)
    assert ticks < 120
    assert not tip.arrived


def test_a_velocity_command_turns_to_its_orientation_meanwhile():
    watch = Watch(tip_at_rest())
    tip = watch.tip
    wanted = pose(turn=(0.2, -0.3, 0.1))
    for _ in range(1500):
        tip.set_velocity(np.array((0.01, 0.02, 0.0)), 0.05, wanted)
        watch.step()
    assert np.abs(tip.pose[:3, :3] - wanted[:3, :3]).max() < 1e-11
    assert tip.velocity == pytest.approx([0.01, 0.02, 0.0], abs=1e-12)


def test_a_velocity_command_whose_direction_turns_at_every_tick_is_followed_at_speed():
    watch = Watch(tip_at_rest())
    tip = watch.tip
    for n in range(3000):
        wanted = 0.25 * np.array((np.cos(2e-3 * n), np.sin(2e-3 * n), 0.0))
        tip.set_velocity(wanted, 0.05)
        watch.step()
        if n > 500:
            assert np.linalg.norm(tip.velocity - wanted) < 0.02


def test_a_velocity_command_above_the_limit_is_shortened():
    watch = Watch(tip_at_rest())
    watch.tip.set_velocity(np.array((3.0, 4.0, 0.0)), 1.0)
    for _ in range(600):
        watch.step()
    assert watch.tip.velocity == pytest.approx([0.15, 0.2, 0.0], abs=1e-12)


def test_a_stop_at_any_tick_takes_no_longer_than_two_ramps():
    for ticks in range(0, 800, 61):
        watch = Watch(tip_at_rest())
        watch.tip.set_goal(pose(0.1, 0.05, 0.0, (0.5, 0.0, 0.0)), 0.25)
        for _ in range(ticks):
            watch.step()
        arrived = watch.tip.arrived
        watch.tip.stop()
        assert run(watch, 450, lambda tip: tip.status == TrajectoryStatus.RESTING) < 450
        assert watch.tip.arrived == arrived


@pytest.mark.parametrize(("speed", "length"), [(1e-6, 1.0), (1e-9, 1.0), (0.1, 1e5), (1e-6, 1e-9)])
def test_very_long_and_very_short_moves_end_exactly(speed, length):
    tip = tip_at_rest()
    goal = pose(length, length / 3.0)
    tip.set_goal(goal, speed)
    expected = np.hypot(length, length / 3.0) / speed
    elapsed = 0.0
    while not tip.arrived and elapsed < 2.0 * expected + 1.0:
        tip.step(expected / 1000.0)
        elapsed += expected / 1000.0
        assert np.linalg.norm(tip.velocity) <= speed * (1.0 + 1e-9)
    assert tip.arrived
    assert np.abs(tip.pose - goal).max() == 0.0
    assert elapsed == pytest.approx(expected, rel=0.01, abs=0.3 if length < 1.0 else 0.0)


@pytest.mark.slow
def test_orthonormality_does_not_drift_over_many_plans():
    tip = tip_at_rest(0.02)
    rng = np.random.default_rng(2)
    for _ in range(20000):
        tip.set_goal(pose(turn=rng.normal(size=3)), 0.1)
        tip.step()
    assert np.abs(tip.pose[:3, :3].T @ tip.pose[:3, :3] - np.eye(3)).max() < 5e-15


def test_no_time_passes_for_an_elapsed_time_that_is_none():
    tip = tip_at_rest()
    tip.set_goal(pose(0.1), 0.2)
    tip.step(0.1)
    before = tip.pose.copy()
    for elapsed in (0.0, -1.0, np.nan, np.inf):
        tip.step(elapsed)
        assert np.array_equal(tip.pose, before)


def test_the_preview_is_what_comes():
    tip = tip_at_rest()
    tip.set_goal(pose(0.1, 0.1, 0.0, (0.3, 0.0, 0.2)), 0.2)
    for _ in range(50):
        tip.step()
    poses, speed_ratio = np.empty((11, 4, 4)), np.empty(11)
    tip.preview(0.1, poses, speed_ratio)
    assert np.array_equal(poses[0], tip.pose)
    for expected, share in zip(poses[1:], speed_ratio[1:]):
        for _ in range(10):
            tip.step()
        assert np.abs(tip.pose - expected).max() < 1e-12
        assert share == pytest.approx(
            max(np.linalg.norm(tip.velocity) / 0.2, np.linalg.norm(tip.angular_velocity) / LIMITS.turn_rate)
        )


@pytest.mark.parametrize(
    "bad", [np.full((4, 4), np.nan), np.eye(3), [1.0, 2.0], np.diag((1.0, 1.0, -1.0, 1.0)), 2.0 * np.eye(4), pose(1e7)]
)
def test_a_pose_that_is_none_is_refused_and_the_motion_goes_on(bad):
    tip = tip_at_rest()
    tip.set_goal(pose(0.1), 0.1)
    tip.step()
    for call in (
        lambda: tip.set_goal(bad, 0.1),
        lambda: tip.set_velocity(np.zeros(3), 0.1, bad),
        lambda: tip.reset(bad),
    ):
        with pytest.raises(InputError, match="pose"):
            call()
    run(Watch(tip), 2000)
    assert np.array_equal(tip.pose, pose(0.1))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_a_bound_that_is_none_is_refused(bad):
    tip = tip_at_rest()
    for call in (
        lambda: tip.set_goal(np.eye(4), bad),
        lambda: tip.set_goal(np.eye(4), 0.1, bad),
        lambda: tip.scale(bad),
        lambda: tip.set_velocity(np.array((bad, bad, 0.0)) if bad != -1.0 else np.zeros(2), 0.1 if bad else bad),
        lambda: CartesianTrajectory(bad, LIMITS),
        lambda: CartesianLimits(bad, 1.0, 1.0, 1.0, 1.0, 1.0),
    ):
        with pytest.raises(InputError):
            call()


@pytest.mark.slow
def test_poses_of_any_memory_layout_and_se3_are_accepted():
    from spatialmath import SE3

    tip = tip_at_rest()
    goal = pose(0.01, 0.02, 0.03, (0.1, 0.2, 0.3))
    for given_pose in (np.asfortranarray(goal), goal.tolist(), SE3(goal), np.stack([goal, goal], axis=2)[:, :, 0]):
        tip.reset(np.eye(4))
        tip.set_goal(given_pose, 0.25)
        run(Watch(tip), 2000)
        assert np.abs(tip.pose - goal).max() < 1e-15
