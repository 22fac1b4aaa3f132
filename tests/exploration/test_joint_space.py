"""The tip moved by straight lines in joint space: limits, speeds, velocities, and what cannot be reached."""

import numpy as np
import pytest

from lwrprobe.exploration.loop.joint_space import JointSpaceTip
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.kinematics import IKSolver, IKStatus, lwr4
from lwrprobe.scene import load_scene
from lwrprobe.trajectory import CartesianLimits, bow

pytestmark = pytest.mark.slow

LIMITS = CartesianLimits(0.1, 4.0, 1000.0, 0.5, 3.0, 50.0)
START = np.radians([20.0, 40.0, 5.0, 80.0, -10.0, 60.0, 15.0])


def tip_at_rest(cycle=1e-3):
    robot = lwr4()
    tip = JointSpaceTip(cycle, robot, IKSolver(robot), LIMITS)
    tip.reset(START)
    return robot, tip


def moved(pose, displacement, turn=0.0):
    out = pose.copy()
    out[:3, 3] += displacement
    c, s = np.cos(turn), np.sin(turn)
    out[:3, :3] = pose[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return out


def way_of(tip, ticks):
    """(k, 3) places, (k,) speeds and (k, n) joints of the steps until it arrives, or of all `ticks`."""
    places, speeds, joints = [tip.pose[:3, 3].copy()], [], [tip.q.copy()]
    for _ in range(ticks):
        tip.step()
        places.append(tip.pose[:3, 3].copy())
        speeds.append(np.linalg.norm(tip.velocity))
        joints.append(tip.q.copy())
        if tip.arrived:
            break
    return np.array(places), np.array(speeds), np.array(joints)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_goal_is_met_along_a_straight_line_in_joint_space_at_the_speed_asked_for(turn):
    robot, tip = tip_at_rest()
    goal = moved(tip.pose, (0.05, -0.08, 0.06), turn)
    assert tip.set_goal(goal, 0.06) == IKStatus.CONVERGED
    places, speeds, joints = way_of(tip, 20_000)
    assert tip.arrived
    assert np.abs(tip.pose - goal).max() < 2e-6
    line = joints[-1] - joints[0]
    shares = (joints - joints[0]) @ line / (line @ line)
    assert np.abs(joints - joints[0] - shares[:, None] * line).max() < 1e-9
    assert speeds.max() <= 0.06 * 1.01
    if turn == 0.0:
        assert speeds.max() >= 0.05
    assert (np.abs(np.diff(joints, axis=0)) <= robot.speed * tip.cycle * (1.0 + 1e-9)).all()
    # the way bows as `bow` foretells: it is no straight line in space
    expected = bow(robot, joints[0], joints[-1]).distance
    across = places - places[0]
    direction = (places[-1] - places[0]) / np.linalg.norm(places[-1] - places[0])
    across -= (across @ direction)[:, None] * direction
    assert np.linalg.norm(across, axis=1).max() == pytest.approx(expected, rel=0.01)


def test_velocity_is_the_derivative_of_the_place():
    _, tip = tip_at_rest(1e-4)
    tip.set_goal(moved(tip.pose, (0.0, 0.03, 0.0)), 0.05)
    for _ in range(3000):
        tip.step()
    before, velocity_before = tip.pose[:3, 3].copy(), tip.velocity.copy()
    tip.step()
    assert np.linalg.norm(velocity_before) > 0.03
    assert (tip.pose[:3, 3] - before) / tip.cycle == pytest.approx(0.5 * (velocity_before + tip.velocity), abs=1e-5)


def test_a_velocity_command_repeated_keeps_its_speed_and_stops_by_itself_after_the_last_call():
    _, tip = tip_at_rest()
    velocity = np.array((0.012, 0.016, 0.0))
    rotation = tip.pose[:3, :3].copy()
    speeds = []
    for _ in range(125):
        tip.set_velocity(velocity, 0.05)
        for _ in range(8):
            tip.step()
        speeds.append(tip.velocity.copy())
    assert np.abs(np.array(speeds[20:]) - velocity).max() < 0.02 * 0.02
    assert np.abs(tip.pose[:3, :3] - rotation).max() < 1e-4
    last = tip.pose[:3, 3].copy()
    way_of(tip, 200)
    assert np.linalg.norm(tip.velocity) == 0.0
    assert not tip.arrived  # a command has no goal
    assert np.linalg.norm(tip.pose[:3, 3] - last) == pytest.approx(0.02 * 0.05, rel=0.3)


def test_a_long_velocity_command_goes_on_for_as_long_as_it_holds():
    _, tip = tip_at_rest()
    start = tip.pose[:3, 3].copy()
    tip.set_velocity(np.array((0.0, 0.02, 0.0)), 1.0)
    way_of(tip, 1500)
    assert tip.pose[:3, 3] - start == pytest.approx((0.0, 0.02, 0.0), abs=0.002)
    assert np.linalg.norm(tip.velocity) == 0.0


def test_a_velocity_command_turns_towards_its_pose_no_faster_than_allowed():
    _, tip = tip_at_rest()
    wanted = moved(tip.pose, (0.0, 0.0, 0.0), 0.3)
    angles = []
    for _ in range(1200):
        tip.set_velocity(np.array((0.005, 0.0, 0.0)), 0.05, wanted)
        tip.step()
        angles.append(np.arccos(np.clip(0.5 * (np.trace(tip.pose[:3, :3].T @ wanted[:3, :3]) - 1.0), -1.0, 1.0)))
    assert angles[-1] < 1e-3
    assert np.max(-np.diff(angles)) <= LIMITS.turn_rate * tip.cycle * 1.05


def test_changes_between_goals_and_velocities_keep_the_joints_limits():
    robot, tip = tip_at_rest()
    rng = np.random.default_rng(3)
    home = tip.pose.copy()
    joints = [tip.q.copy()] * 3
    for _ in range(60):
        if rng.random() < 0.5:
            tip.set_goal(moved(home, 0.05 * rng.normal(size=3)), float(rng.choice((0.1, 0.02))))
        elif rng.random() < 0.8:
            tip.set_velocity(0.03 * rng.normal(size=3), 0.05)
        else:
            tip.stop()
        for _ in range(int(rng.integers(1, 120))):
            tip.step()
            joints.append(tip.q.copy())
    q = np.array(joints)
    assert (np.abs(np.diff(q, axis=0)) <= robot.speed * tip.cycle * (1.0 + 1e-9)).all()
    bound = LIMITS.acceleration / robot.length
    assert np.abs(np.diff(q, 2, axis=0)).max() <= bound * tip.cycle**2 * (1.0 + 1e-6)


def test_what_is_out_of_reach_is_told_and_nothing_moves():
    _, tip = tip_at_rest()
    before = tip.q.copy()
    far = moved(tip.pose, (2.0, 0.0, 0.0))
    assert tip.ik_status(far) != IKStatus.CONVERGED
    assert tip.set_goal(far, 0.1) != IKStatus.CONVERGED
    for _ in range(10):
        tip.step()
    assert np.array_equal(tip.q, before)


def test_exploring_in_joint_space_feels_the_same_object():
    small = [
        "truth.profile=ideal",
        "run.seed=11",
        "area.lower=[-0.012, -0.045, 0.006]",
        "area.upper=[0.012, 0.045, 0.058]",
    ]
    summary = explore(load_scene("cylinder_vertical", [*small, "motion.mode=joint"]))
    assert summary["status"] == "done"
    assert summary["link_collisions"] == 0
    assert summary["peak_force_n"] <= 3.0
    assert summary["contact_error_mm"]["median"] <= 0.3
    assert "governor" in {left["stage"] for left in summary["left_out"]}
