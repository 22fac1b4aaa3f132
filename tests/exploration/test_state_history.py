"""The tip of an instant between two states of the arm, against the same worked out with numpy."""

import numpy as np
import pytest

from lwrprobe.exploration.loop.state_history import HISTORY, VELOCITY_SPAN, StateHistory
from lwrprobe.kinematics import Gears, lwr4

ROBOT = lwr4()


def states(count):
    random = np.random.default_rng(3)
    times = 1.0 + np.cumsum(random.uniform(0.5e-3, 2e-3, count))
    return (
        times,
        np.cumsum(random.normal(size=(count, 3)), axis=0),
        0.01 * np.cumsum(random.normal(size=(count, 7)), axis=0),
    )


def naive(times, velocities, joints, time):
    times, velocities, joints = times[-HISTORY:], velocities[-HISTORY:], joints[-HISTORY:]
    q = np.array([np.interp(time, times, column) for column in joints.T])
    known = int(np.searchsorted(times, time, side="right")) - 1
    pose = np.empty((4, 4))
    ROBOT.fk_into(q, pose)
    return pose, velocities[max(known, 0)]


@pytest.mark.parametrize("count", [1, 2, 10, HISTORY, 3 * HISTORY + 5])
def test_pose_and_velocity_are_those_of_the_samples_instant(count):
    times, velocities, joints = states(count)
    recent = StateHistory(ROBOT)
    for time, velocity, q in zip(times, velocities, joints):
        recent.note(time, velocity, q)
    known = times[-HISTORY:]
    for time in [*known, *(0.5 * (known[1:] + known[:-1])), known[0] - 1.0, known[-1] + 1.0]:
        pose, velocity = recent.tip_at(time)
        expected_pose, expected_velocity = naive(times, velocities, joints, time)
        np.testing.assert_allclose(pose, expected_pose, atol=1e-12)
        np.testing.assert_array_equal(velocity, expected_velocity)


def test_the_tip_follows_the_links_and_its_velocity_the_motors():
    times, velocities, joints = states(10)
    sine = np.linspace(-2e-3, 2e-3, 7)
    single, rows = (StateHistory(ROBOT, Gears(320.0, sine, 0.5 * sine, 1e-3)) for _ in range(2))
    for time, velocity, q in zip(times, velocities, joints):
        single.note(time, velocity, q)
    rows.note_rows(times, velocities, joints)
    plain = StateHistory(ROBOT)
    plain.note_rows(times, velocities, joints)
    links = Gears(320.0, sine, 0.5 * sine, 1e-3).links(joints)
    for recent in (single, rows):
        np.testing.assert_allclose(recent.tip_at(times[-1])[0], ROBOT.fk_batch(links[-1:])[0], atol=1e-12)
        np.testing.assert_array_equal(recent.q, links[-1])
        np.testing.assert_array_equal(recent.newest, joints[-1])
        np.testing.assert_array_equal(recent.measured_velocity(times[-1]), plain.measured_velocity(times[-1]))


def test_what_is_handed_out_is_the_callers_own():
    recent = StateHistory(ROBOT)
    velocity = np.ones(3)
    recent.note(0.0, velocity, np.zeros(7))
    velocity[:] = 2.0
    pose, given = recent.tip_at(0.0)
    pose[:], given[:] = 0.0, 5.0
    assert recent.tip_at(0.0)[0][3, 3] == 1.0
    assert recent.tip_at(0.0)[1][0] == 1.0


def test_acceleration_is_that_of_the_last_cycle():
    recent = StateHistory(ROBOT)
    assert recent.acceleration == np.inf
    recent.note(0.0, np.zeros(3), np.zeros(7))
    assert recent.acceleration == np.inf
    recent.note(0.002, np.array([0.0, 0.003, 0.004]), np.zeros(7))
    assert recent.acceleration == pytest.approx(2.5)
    recent.note(0.002, np.zeros(3), np.zeros(7))
    assert recent.acceleration == np.inf


def test_the_measured_velocity_is_the_mean_of_the_measured_joints():
    times, velocities, joints = states(3 * HISTORY)
    recent = StateHistory(ROBOT)
    assert not recent.measured_velocity(0.0).any(), "nothing is known yet"
    for time, velocity, q in zip(times, velocities, joints):
        recent.note(time, velocity, q)
    for time in [times[-20], times[-20] + 3e-4, times[-2], times[-1], times[-1] + 1.0]:
        end = min(time + VELOCITY_SPAN, times[-1])
        places = [naive(times, velocities, joints, t)[0][:3, 3] for t in (end - VELOCITY_SPAN, end)]
        np.testing.assert_allclose(
            recent.measured_velocity(time), (places[1] - places[0]) / VELOCITY_SPAN, atol=1e-9
        )  # fmt: skip


def test_the_velocity_of_a_delayed_arm_is_measured_and_not_commanded():
    """A command that jumps shows in the measured velocity when the joints move, however late that is."""
    recent, bent, pose = StateHistory(ROBOT), np.array([0.0, 0.6, 0.0, -1.2, 0.0, 0.9, 0.0]), np.empty((4, 4))
    for k in range(40):
        q = bent.copy()
        q[0] = 0.1 * max(0, k - 20) * 1e-3
        recent.note(k * 1e-3, np.array([0.0, 0.05 * (k >= 10), 0.0]), q)
    assert recent.tip_at(0.015)[1][1] == 0.05
    assert not recent.measured_velocity(0.015).any()
    ROBOT.fk_into(bent, pose)
    assert np.linalg.norm(recent.measured_velocity(0.034)) == pytest.approx(0.1 * np.linalg.norm(pose[:2, 3]), rel=1e-3)
