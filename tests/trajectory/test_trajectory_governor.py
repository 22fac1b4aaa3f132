"""The tip slows down before the joints would have to be too fast, and the bow of a joint-space move is measured."""

import numpy as np
import pytest
from naive_trajectory import Watch, pose
from scipy.spatial.transform import Rotation
from scipy.special import erf

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKSolver, lwr4
from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, SpeedGovernor, bow

LIMITS = CartesianLimits(0.25, 2.0, 40.0, 1.5, 10.0, 200.0)
# starts with the wrist or the elbow nearly stretched, and moves that pass near that singularity
HARD = [
    (np.radians([-85.0, -38.0, 61.0, 12.0, -83.0, -5.0, -4.0]), (-0.05, 0.19, 0.01), (-0.1, -0.1, -0.2)),
    (np.radians([35.0, 17.0, 58.0, -3.0, -96.0, 2.0, 73.0]), (0.02, -0.03, -0.2), (0.2, -0.5, 0.2)),
    (np.radians([-9.0, -44.0, -7.0, -15.0, 92.0, -8.0, 79.0]), (0.01, 0.05, -0.19), (1.0, -0.2, 0.1)),
]


def follow(q, displacement, turn, governed):
    robot = lwr4()
    solver = IKSolver(robot)
    tip = CartesianTrajectory(1e-3, LIMITS)
    start = np.empty((4, 4))
    robot.fk_into(q, start)
    tip.reset(start)
    goal = start.copy()
    goal[:3, 3] += displacement
    goal[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ goal[:3, :3]
    governor = SpeedGovernor(tip, solver.track_all, robot.speed)
    watch, out, largest = Watch(tip), np.empty(7), 0.0
    tip.set_goal(goal, 0.25)
    while not tip.arrived:
        watch.step()
        assert solver.track(tip.pose, q, out) == 0
        largest = max(largest, float((np.abs(out - q) / robot.speed).max()) / tip.cycle)
        q = out.copy()
        if governed:
            governor.watch(q)
    assert np.abs(tip.pose - goal).max() < 1e-14
    return largest


@pytest.mark.parametrize(("q", "displacement", "turn"), HARD)
def test_near_a_singularity_the_joints_keep_their_speed_limits(q, displacement, turn):
    assert follow(q, displacement, turn, governed=False) > 4.0
    assert follow(q, displacement, turn, governed=True) < 1.0


def driven(tip, governor, joint):
    """Step the tip to its goal under a governor: the values (k,) of a `joint` that depends on the tip's x alone."""
    asked = []
    while not tip.arrived:
        tip.step()
        asked.append(joint(tip.pose[0, 3]))
        governor.watch(np.array(asked[-1:]))
    return asked


@pytest.mark.parametrize(("acceleration", "kept"), [(np.inf, False), (30.0, True)])
def test_where_a_joint_turns_round_on_the_path_the_tip_is_slow_enough_for_its_acceleration(acceleration, kept):
    """A joint that goes 0.08 rad there and back within 40 mm: at 0.25 m/s it turns round with 50 rad/s^2."""
    tip = CartesianTrajectory(1e-3, LIMITS)

    def joint(x):
        return 0.08 * np.exp(-0.5 * ((x - 0.1) / 0.01) ** 2)

    def track_all(poses, seed, out):
        out[:] = joint(poses[:, :1, 3])
        return len(poses)

    governor = SpeedGovernor(tip, track_all, np.array([1e3]), acceleration)
    tip.set_goal(pose(0.2), 0.25)
    asked = driven(tip, governor, joint)
    turns = np.abs(np.diff(asked, 2)).max() / tip.cycle**2
    assert (turns < 30.0) == kept
    assert len(asked) < 2500


def test_a_joint_path_with_a_kink_is_passed_slowly_enough():
    """Where another joint comes to the end of its range: within one cycle the rest change their speeds."""
    tip = CartesianTrajectory(8e-3, LIMITS)

    def joint(x):
        return 12.5 * np.maximum(x - 0.1, 0.0)

    def track_all(poses, seed, out):
        out[:] = joint(poses[:, :1, 3])
        return len(poses)

    governor = SpeedGovernor(tip, track_all, np.array([1e3]), 60.0)
    tip.set_goal(pose(0.2), 0.05)
    asked = driven(tip, governor, joint)
    assert np.abs(np.diff(asked, 2)).max() / tip.cycle**2 < 60.0
    assert len(asked) < 1500


def test_near_a_singularity_the_tip_changes_its_speed_where_the_joints_can_follow():
    """A joint that goes up to 45 rad for each m of the tip: 2 m/s^2 of the tip are 90 rad/s^2 of it."""
    tip = CartesianTrajectory(1e-3, CartesianLimits(0.25, 2.0, 3000.0, 1.5, 10.0, 200.0))

    def joint(x):
        return 5.0 * x + 40.0 * 0.04 * np.sqrt(np.pi) / 2.0 * erf((x - 0.15) / 0.04)

    def track_all(poses, seed, out):
        out[:] = joint(poses[:, :1, 3])
        return len(poses)

    governor = SpeedGovernor(tip, track_all, np.array([1.9]), 60.0)
    tip.set_goal(pose(0.3), 0.25)
    asked = driven(tip, governor, joint)
    assert np.abs(np.diff(asked)).max() < 1.9 * tip.cycle
    accelerations = np.diff(asked, 2) / tip.cycle**2
    assert accelerations.max() < 60.0, "speeding up"
    assert accelerations.min() > -60.0, "slowing down"
    assert tip.factor == 1.0, "it has sped up again behind that place"
    assert len(asked) < 6000


def test_a_governed_tip_that_rests_is_not_slowed_any_more():
    tip = CartesianTrajectory(1e-3, LIMITS)
    tip.scale(0.1)
    SpeedGovernor(tip, lambda poses, seed, out: len(poses), np.ones(7)).watch(np.zeros(7))
    assert tip.factor == 1.0


def test_what_is_ahead_and_cannot_be_reached_is_said():
    tip = CartesianTrajectory(1e-3, LIMITS)

    def track_all(poses, seed, out):
        out[:] = 0.0
        return int(np.argmax([*(poses[:, 0, 3] > 0.02), True]))

    governor = SpeedGovernor(tip, track_all, np.ones(7))
    tip.set_goal(pose(0.2), 0.25)
    for _ in range(60):
        tip.step()
        governor.watch(np.zeros(7))
    assert 0.0 < governor.blocked_in < 0.3


@pytest.mark.parametrize("change", [{"highest": 1.0}, {"lowest": 0.9}, {"every": 0}, {"samples": 2}, {"slowest": 0.0}])
def test_a_band_that_is_none_is_refused(change):
    with pytest.raises(InputError):
        SpeedGovernor(CartesianTrajectory(1e-3, LIMITS), lambda poses, seed, out: len(poses), np.ones(7), **change)


class Planar:
    """Two links of 1 m in the plane."""

    def fk_into(self, q, out):
        a, b = q[0], q[0] + q[1]
        out[:] = pose(np.cos(a) + np.cos(b), np.sin(a) + np.sin(b), 0.0, (0.0, 0.0, b))


def test_the_bow_of_an_arc_is_its_sagitta():
    # one joint turns: the tip goes round a circle of 2 m
    found = bow(Planar(), np.array([0.0, 0.0]), np.array([1.0, 0.0]))
    assert found.distance == pytest.approx(2.0 * (1.0 - np.cos(0.5)), rel=1e-9)
    assert found.at == pytest.approx(0.5, abs=1e-9)
    assert found.length == pytest.approx(4.0 * np.sin(0.5))
    assert found.turn == pytest.approx(0.0, abs=1e-7)


def test_the_bow_is_that_of_a_fine_sampling():
    rng = np.random.default_rng(4)
    robot = lwr4()
    for _ in range(5):
        start, end = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (2, 7))
        found, out = bow(robot, start, end, samples=101), np.empty((4, 4))
        points = []
        for share in np.linspace(0.0, 1.0, 5001):
            robot.fk_into(start + share * (end - start), out)
            points.append(out[:3, 3].copy())
        points = np.array(points)
        line = points[-1] - points[0]
        along = np.clip((points - points[0]) @ line / (line @ line), 0.0, 1.0)
        wanted = np.linalg.norm(points - points[0] - along[:, None] * line, axis=1).max()
        assert found.distance == pytest.approx(wanted, rel=1e-4)


def test_no_way_has_no_bow_and_bad_joints_are_refused():
    found = bow(Planar(), np.array([0.3, 0.2]), np.array([0.3, 0.2]))
    assert found.distance == 0.0
    for start, end in (([0.0], [0.0, 1.0]), ([np.nan, 0.0], [0.0, 0.0])):
        with pytest.raises(InputError):
            bow(Planar(), np.array(start), np.array(end))
    with pytest.raises(InputError):
        bow(Planar(), np.zeros(2), np.ones(2), samples=2)
