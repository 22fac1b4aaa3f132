"""Looking ahead along paths: singularities, joint limits and branch jumps in mid-contour."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from spatialmath import SE3
from test_kinematics_tracking import TOOL

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import IKSolver, IKStatus, Preference, follow, lwr4, puma560, sensitivity, straight_line

DOWN = np.deg2rad([0.0, 30, 0, -90, 0, 60, 0])


def test_a_straight_line_is_straight_and_turns_evenly():
    start, end = SE3(0.4, 0.1, 0.3) * SE3.RPY(0.1, 0.2, 0.3), SE3(0.5, -0.2, 0.1) * SE3.RPY(-1.0, 0.4, 2.0)
    poses = straight_line(start, end, step=0.01, turn=0.05)
    np.testing.assert_allclose(poses[0], start.A, atol=1e-12)
    np.testing.assert_allclose(poses[-1], end.A, atol=1e-12)
    share = np.linspace(0, 1, len(poses))
    np.testing.assert_allclose(poses[:, :3, 3], start.t + share[:, None] * (end.t - start.t), atol=1e-12)
    reference = Slerp([0, 1], Rotation.from_matrix([start.R, end.R]))(share).as_matrix()
    np.testing.assert_allclose(poses[:, :3, :3], reference, atol=1e-9)
    assert np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() <= 0.01 + 1e-12


@pytest.mark.parametrize("angle", [0.0, 1e-9, np.pi - 1e-9, np.pi])
def test_straight_lines_at_the_ends_of_the_angle(angle):
    start = SE3.RPY(0.3, -0.2, 0.9)
    end = start * SE3.AngleAxis(angle, [0.6, 0.0, 0.8])
    poses = straight_line(start, end)
    turned = Rotation.from_matrix(poses[:, :3, :3])
    assert (turned[1:] * turned[:-1].inv()).magnitude().max() <= 0.02 + 1e-6
    np.testing.assert_allclose(poses[-1], end.A, atol=1e-8)


def test_a_path_in_the_middle_of_the_workspace_is_followed():
    robot = lwr4(tool=TOOL)
    start = robot.fk(DOWN)
    report = follow(robot, straight_line(start, SE3(0.05, -0.05, 0.05) * start), DOWN, seconds=0.05)
    assert report.complete
    assert report.reason == ""
    assert report.reached == len(report.q) == len(report.manipulability) == len(report.limit_margin)
    assert np.abs(np.diff(report.q, axis=0)).max() < 0.1
    assert report.speed_use[0] == 0.0
    assert 0.0 < report.speed_use.max() < 1.0
    for q, pose in zip(report.q, straight_line(start, SE3(0.05, -0.05, 0.05) * start)):
        np.testing.assert_allclose(robot.fk(q).A, pose, atol=2e-6)


def bent(elbow):
    """Joints of an arm that reaches upwards and out, with its elbow bent by an angle."""
    return np.array([0.2, 0.4, 0.1, -elbow, 0.1, 1.0, 0.3])


@pytest.mark.parametrize("elbow", [0.08, 0.2, 0.6, 1.2])
def test_a_joint_is_the_more_sensitive_the_straighter_the_elbow_is(elbow):
    robot = lwr4()
    q = bent(elbow)
    found = sensitivity(IKSolver(robot), robot.fk(q).A, q)
    upper, lower = 0.4, 0.39  # m, links of the arm; law of cosines for the distance between shoulder and wrist
    distance = np.sqrt(upper**2 + lower**2 + 2.0 * upper * lower * np.cos(elbow))
    of_elbow = distance / (upper * lower * np.sin(elbow))
    assert found >= 0.97 * of_elbow, "no joint less than the elbow"
    if elbow < 0.3:
        assert found == pytest.approx(of_elbow, rel=0.1)


def test_at_the_end_of_the_reach_a_joint_is_sensitive_without_limit():
    robot, q = lwr4(), bent(0.01)
    assert sensitivity(IKSolver(robot), robot.fk(q).A, q) == np.inf


def test_outward_beyond_the_straight_arm_stops_there_and_says_so():
    """The elbow straightens: manipulability falls towards zero, the path ends at the reach, joint speeds stay small."""
    robot = lwr4(tool=TOOL)
    start = robot.fk(DOWN)
    report = follow(robot, straight_line(start, SE3(-0.8, 0.0, 0.0) * start, step=0.002), DOWN)
    assert not report.complete
    assert report.status == IKStatus.UNREACHABLE
    assert "m out of reach" in report.reason
    assert np.isfinite(report.q).all()
    assert abs(report.q[-1][3]) < np.deg2rad(10.0)
    assert report.manipulability[-1] < 0.3 * report.manipulability[0]
    assert np.abs(np.diff(report.q, axis=0)).max() < 0.5


def test_through_a_wrist_singularity_without_a_jump():
    """The path aims the wrist through alignment (q6 = 0): it is crossed, and the speeds it takes are reported."""
    robot = lwr4(tool=TOOL)
    start, through = DOWN.copy(), DOWN.copy()
    start[5], through[5] = 0.3, -0.3
    path = straight_line(robot.fk(start), robot.fk(through), step=0.001, turn=0.005)
    report = follow(robot, path, start, seconds=0.01)
    assert report.complete
    assert np.abs(np.diff(report.q, axis=0)).max() < 0.2
    slower = follow(robot, path, start, seconds=0.01 * max(1.0, report.speed_use.max()))
    assert slower.speed_use.max() <= 1.0 + 1e-9


def test_near_a_wrist_singularity_speed_grows_and_is_told():
    robot = puma560()
    start = np.array([0.3, 0.8, -1.8, 0.0, 0.15, 0.0])
    sideways = robot.fk(start).A @ SE3.Rx(0.6).A
    report = follow(robot, straight_line(robot.fk(start), sideways, turn=0.002), start)
    assert report.complete or report.status in (IKStatus.LIMITED, IKStatus.JUMP)
    assert np.isfinite(report.q).all()
    assert np.abs(np.diff(report.q, axis=0)).max() <= 0.5


def test_a_joint_limit_is_named():
    robot = lwr4(tool=TOOL)
    start = robot.fk(DOWN)
    lifted = SE3(start.A) * SE3.Ry(np.deg2rad(120.0))
    report = follow(robot, straight_line(start, lifted, turn=0.005), DOWN)
    other_way = follow(robot, straight_line(start, SE3(start.A) * SE3.Ry(np.deg2rad(-120.0)), turn=0.005), DOWN)
    stopped = [r for r in (report, other_way) if not r.complete]
    assert stopped
    for r in stopped:
        assert r.status == IKStatus.LIMITED
        assert "joint" in r.reason
        assert "limit" in r.reason


def test_a_limit_seen_ahead_is_avoided_in_the_null_space():
    """The same path, with and without the preference to leave limits: with it the margin never gets as small."""
    robot = lwr4(tool=TOOL)
    q0 = np.deg2rad([0.0, 60, 50, -80, 20, 95, 30])
    path = straight_line(robot.fk(q0), SE3(robot.fk(q0).A) * SE3.Ry(-0.6), turn=0.002)
    bold = follow(robot, path, q0, solver=IKSolver(robot, preference=Preference(null_space_step=0.0)))
    wary = follow(robot, path, q0, solver=IKSolver(robot, preference=Preference(zone=0.4, null_space_step=0.005)))
    assert wary.reached >= bold.reached
    assert wary.limit_margin[: bold.reached].min() > bold.limit_margin.min() + 0.05


def test_two_near_branches_are_never_swapped():
    """Along the nearly straight arm both elbow branches are close: the sign of the bend is kept, step for step."""
    robot = lwr4(tool=TOOL)
    q0 = np.deg2rad([20.0, 50, 10, -4, 0, 60, 0])
    start = robot.fk(q0)
    around = np.array([SE3.Rz(angle).A @ start.A for angle in np.linspace(0, 1.5, 200)])
    report = follow(robot, around, q0)
    assert report.complete
    assert (report.q[:, 3] < 0.0).all()
    assert np.abs(np.diff(report.q, axis=0)).max() < 0.1


def test_a_path_that_needs_another_posture_ends_with_a_jump():
    robot = lwr4(tool=TOOL)
    other = np.where(np.arange(7) == 0, 2.8, DOWN)
    report = follow(robot, np.array([robot.fk(DOWN).A, robot.fk(other).A]), DOWN)
    assert report.reached == 1
    assert report.status == IKStatus.JUMP
    assert "jump" in report.reason


def test_bad_paths_are_refused_by_name():
    robot = lwr4()
    path = np.tile(np.eye(4), (5, 1, 1))
    for broken, field in ((np.nan, "poses[3]"), (1.5, "poses[3]")):
        bad = path.copy()
        bad[3, 0, 0] = broken
        with pytest.raises(InputError) as caught:
            follow(robot, bad, DOWN)
        assert caught.value.field == field
    with pytest.raises(InputError, match="poses"):
        follow(robot, np.zeros((0, 4, 4)), DOWN)
    with pytest.raises(InputError, match="q0"):
        follow(robot, path, DOWN[:6])
    with pytest.raises(InputError, match="seconds"):
        follow(robot, np.array([robot.fk(DOWN).A] * 2), DOWN, seconds=0.0)
    with pytest.raises(InputError, match="step"):
        straight_line(np.eye(4), np.eye(4), step=0.0)


def test_a_list_of_se3_is_a_path():
    robot = lwr4(tool=TOOL)
    report = follow(robot, [robot.fk(DOWN), robot.fk(DOWN + 0.01)], DOWN)
    assert report.complete
