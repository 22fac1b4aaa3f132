"""Each kernel against its textbook form."""

import numpy as np
import pytest
from naive_trajectory import angular_motion, motion_at, pose
from scipy.spatial.transform import Rotation

from lwrprobe.trajectory import cartesian_kernels as tip
from lwrprobe.trajectory import profile_kernels as profile
from lwrprobe.trajectory import rotation_kernels as rotation

RNG = np.random.default_rng(5)


def random_row():
    plan = np.zeros(profile.ROW)
    plan[: profile.PIECES] = RNG.uniform(0.0, 0.3, profile.PIECES) * (RNG.random(profile.PIECES) < 0.7)
    plan[profile.JERK : profile.JERK + profile.PIECES] = RNG.uniform(-5.0, 5.0, profile.PIECES)
    velocity, acceleration = RNG.normal(size=2)
    profile.integrate_row(plan, 0, velocity, acceleration)
    return plan, velocity, acceleration


def test_a_row_is_the_integral_of_its_jerks():
    for _ in range(30):
        plan, velocity, acceleration = random_row()
        durations, jerks = plan[: profile.PIECES], plan[profile.JERK : profile.JERK + profile.PIECES]
        for time in RNG.uniform(0.0, plan[profile.LAST] * 1.2, 10):
            found = profile.evaluate_row(plan, 0, time)
            wanted = motion_at(durations, jerks, velocity, acceleration, time)
            if time < plan[profile.LAST]:
                assert found == pytest.approx(wanted, abs=1e-12)


def test_the_extent_of_a_row_is_that_of_its_samples():
    for _ in range(50):
        plan, _, _ = random_row()
        samples = [profile.evaluate_row(plan, 0, t)[0] for t in np.linspace(0.0, plan[profile.LAST], 4001)]
        low, high = profile.extent(plan, 0)
        assert low <= min(samples) + 1e-15
        assert high >= max(samples) - 1e-15
        assert (low, high) == pytest.approx((min(samples), max(samples)), abs=1e-5)


def test_the_peak_speed_of_a_row_is_that_of_its_samples():
    for _ in range(50):
        plan, _, _ = random_row()
        speeds = [abs(profile.evaluate_row(plan, 0, t)[1]) for t in np.linspace(0.0, plan[profile.LAST], 4001)]
        assert profile.peak_speed(plan, 0) == pytest.approx(max(speeds), abs=1e-5)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.0499, 0.0501, 1.0, 3.0, np.pi - 1e-9])
def test_rotation_vectors_agree_with_scipy(size):
    for _ in range(20):
        r = RNG.normal(size=3)
        r *= size / np.linalg.norm(r)
        start = Rotation.random(random_state=RNG).as_matrix()
        end = np.eye(4)
        rotation.rotate_from(r, start, end)
        assert np.abs(end[:3, :3] - Rotation.from_rotvec(r).as_matrix() @ start).max() < 1e-15 * 8
        back = np.zeros(3)
        rotation.rotation_between(start, end, back)
        assert np.abs(back - r).max() < 1e-14 * max(1.0, size) * 4


def test_half_a_turn_has_an_axis():
    for axis in np.vstack((np.eye(3), RNG.normal(size=(20, 3)))):
        axis = axis / np.linalg.norm(axis)
        r, end = np.zeros(3), Rotation.from_rotvec(np.pi * axis).as_matrix()
        rotation.rotation_between(np.eye(3), end, r)
        assert np.linalg.norm(r) == pytest.approx(np.pi, abs=1e-12)
        assert abs(r @ axis) == pytest.approx(np.pi, abs=1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.0499, 0.0501, 1.0, 3.0])
def test_angular_motion_is_that_of_the_rotations(size):
    for _ in range(10):
        r, rate, second = RNG.normal(size=(3, 3))
        r *= size / np.linalg.norm(r)
        found = np.zeros(6)
        rotation.angular_motion(np.array((r, rate, second)), found)
        omega, alpha = angular_motion(r, rate, second)
        assert np.abs(found[:3] - omega).max() < 1e-6
        assert np.abs(found[3:] - alpha).max() < 1e-4


def test_a_nearly_orthonormal_matrix_is_put_right():
    for _ in range(20):
        exact = Rotation.random(random_state=RNG).as_matrix()
        found = exact + RNG.uniform(-1e-7, 1e-7, (3, 3))
        rotation.orthonormalise(found)
        assert np.abs(found.T @ found - np.eye(3)).max() < 1e-12
        assert np.abs(found - exact).max() < 2e-7


@pytest.mark.parametrize(
    "bad",
    [
        np.full((4, 4), np.nan),
        np.full((4, 4), np.inf),
        np.zeros((4, 4)),
        np.diag((1.0, 1.0, -1.0, 1.0)),
        np.diag((1.001, 1.0, 1.0, 1.0)),
        pose(x=np.nan),
        pose(y=np.inf),
        pose(z=1e7),
        pose() + 1e-3 * np.eye(4)[3],
    ],
)
def test_what_is_no_pose_is_not_accepted(bad):
    assert not tip.accept_pose(np.ascontiguousarray(bad), np.zeros(tip.AIM_SIZE))
    assert tip.accept_pose(pose(1.0, -2.0, 3.0, (0.1, 2.0, -1.0)), np.zeros(tip.AIM_SIZE))


def test_frames_are_orthonormal_and_their_first_axis_is_along_the_way():
    for _ in range(200):
        way = RNG.normal(size=(3, 3)) * 10.0 ** RNG.uniform(-16, 0, (3, 1)) * RNG.integers(0, 2, (3, 1))
        if RNG.random() < 0.3:
            way[1] = way[0] * RNG.normal()
        frame = np.zeros((3, 3))
        tip.align(way, True, 1.0, 1.0, frame)
        assert np.abs(frame.T @ frame - np.eye(3)).max() < 1e-14
        assert np.linalg.det(frame) > 0.0
        if np.linalg.norm(way[0]) > profile.NEAR:
            assert frame[:, 0] @ way[0] == pytest.approx(np.linalg.norm(way[0]), rel=1e-14)


def test_shares_of_a_limit_stay_inside_the_ball():
    for share in tip.SHARES:
        for moves in ((1, 1, 0), (1, 0, 1), (1, 1, 1)):
            request = np.zeros((profile.LINES, 6))
            request[profile.MOVES, :3] = moves
            assert tip.share_box(request, 0, share, 2.0, 40.0)
            moving = request[profile.MOVES, :3] != 0.0
            assert np.linalg.norm(request[profile.MAX_SECOND, :3][moving]) <= 2.0 * (1.0 + 1e-15)
            assert np.linalg.norm(request[profile.MAX_JERK, :3][moving]) <= 40.0 * (1.0 + 1e-15)
            assert tip.share_out(request, 0, 0.25)
            assert np.linalg.norm(request[profile.MAX_RATE, :3][moving]) <= 0.25 * (1.0 + 1e-15)
