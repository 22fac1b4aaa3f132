"""The last look at a set point: against a naive twin, and each limit in turn."""

import re

import numpy as np
import pytest

from lwrprobe.contracts import ArmState, ArmStatus
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.safety.motion_guard import MotionGuard, MotionStop, table_plane
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

CYCLE = 0.002


@pytest.fixture(scope="module")
def scene():
    return load_scene("empty")


@pytest.fixture(scope="module")
def robot(scene):
    return robot_of(scene)


@pytest.fixture(scope="module")
def start(scene, robot):
    return start_posture(scene, robot)[1]


@pytest.fixture
def guard(scene, robot):
    return MotionGuard(robot, CYCLE, scene.safety, table_plane(scene))


def send(guard, path):
    """Follow a path (m, n) with an arm that is where it is sent; how many set points passed, and the sentence."""
    for i, q in enumerate(path):
        try:
            guard.check(np.ascontiguousarray(q))
        except MotionStop as stop:
            return i, str(stop)
        guard.watch(ArmState(i * CYCLE, q, np.zeros_like(q)))
    return len(path), ""


def swing(start, joint, size, steps, seconds):
    """Smooth in all derivatives that matter: a swing of one joint there and back, from rest."""
    t = np.arange(steps) * CYCLE / seconds
    path = np.repeat(start[None], steps, axis=0)
    path[:, joint] += size * np.where(t < 1.0, (1.0 - np.cos(2.0 * np.pi * t)) ** 2, 0.0)
    return path


def naive_shares(path, robot, safety):
    """Largest |velocity|, |acceleration|, |jerk| and tip speed over their limits, by differences of the whole path."""
    path = np.vstack([path[:1], path[:1], path[:1], path])
    tip = robot.fk_batch(path)[:, :3, 3]
    v = np.diff(path, axis=0) / CYCLE
    a = np.diff(v, axis=0) / CYCLE
    j = np.diff(a, axis=0) / CYCLE
    return (
        (np.abs(v) / robot.speed).max(),
        np.abs(a).max() / safety.joint_acceleration,
        np.abs(j).max() / safety.joint_jerk,
        np.linalg.norm(np.diff(tip, axis=0), axis=1).max() / CYCLE / safety.tip_speed,
    )


@pytest.mark.parametrize("joint", range(7))
def test_good_motion_passes_and_its_peaks_are_those_of_the_naive_twin(guard, scene, robot, start, joint):
    path = swing(start, joint, 0.01, 600, 1.0)
    assert send(guard, path) == (600, "")
    wanted = naive_shares(path, robot, scene.safety)
    assert list(guard.peaks.values()) == pytest.approx(wanted, rel=1e-3, abs=1e-4)
    assert max(wanted) < 1.0


def faster(seconds):
    def path(start, robot):
        return swing(start, 6, 0.3, 200, seconds)

    return path


def leap(start, robot):
    path = swing(start, 2, 0.005, 100, 1.0)
    path[50:] += 0.002
    return path


def beyond(start, robot):
    path = np.repeat(start[None], 30, axis=0)
    path[:, 6] = robot.upper[6] - 1e-4 + 1e-5 * np.arange(30)
    return path


def not_a_number(start, robot):
    path = np.repeat(start[None], 30, axis=0)
    path[20, 3] = np.nan
    return path


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (faster(0.2), "accelerate|move at"),
        (leap, "accelerate"),
        (beyond, "beyond its limit"),
        (not_a_number, "joint 4 is nan"),
    ],
)
def test_each_joint_limit_stops_before_it_is_broken(guard, scene, robot, start, make, words):
    path = make(start, robot)
    passed, sentence = send(guard, path)
    assert 0 < passed < len(path)
    assert "was not sent" in sentence
    assert re.search(words, sentence)
    good = path[:passed]
    assert max(naive_shares(good, robot, scene.safety)) <= 1.0 + 1e-6
    assert (good <= robot.upper + 1e-9).all()


def test_jerk_alone_is_seen(scene, robot, start):
    tight = scene.safety.model_copy(update={"joint_jerk": 5.0})
    path = swing(start, 6, 0.01, 600, 1.0)
    passed, sentence = send(MotionGuard(robot, CYCLE, tight, None), path)
    assert "would jerk" in sentence
    assert passed < 600


def test_tip_speed_table_and_room(scene, robot, start):
    path = swing(start, 1, -0.02, 900, 1.6)
    assert (
        "the tip would move"
        in send(MotionGuard(robot, CYCLE, scene.safety.model_copy(update={"tip_speed": 0.02}), None), path)[1]
    )
    plane = table_plane(scene)
    tip = robot.fk(start).A[:3, 3]
    plane[3] = tip[2] - 0.01
    assert "over the table" in send(MotionGuard(robot, CYCLE, scene.safety, plane), path)[1]
    confined = MotionGuard(robot, CYCLE, scene.safety, None)
    confined.confine(tip - 0.01, tip + 0.01)
    passed, sentence = send(confined, path)
    assert "leave its area" in sentence
    inside = robot.fk_batch(path[:passed])[:, :3, 3]
    assert np.abs(inside - tip).max() <= 0.01


def test_from_outside_the_room_the_way_leads_back_only(scene, robot, start):
    path = swing(start, 1, -0.02, 900, 1.6)
    half = path[400:]
    out = robot.fk(half[0]).A[:3, 3]
    home = robot.fk(start).A[:3, 3]
    low, high = home - 1e-3, home + 1e-3
    assert np.abs(out - home).max() > 0.01
    guard = MotionGuard(robot, CYCLE, scene.safety, None)
    assert send(guard, np.repeat(half[:1], 3, axis=0)) == (3, "")
    guard.confine(low, high)
    passed, sentence = send(guard, half)
    assert passed == len(half), sentence


def test_arm_that_does_not_follow_or_says_so_stops(guard, start):
    assert send(guard, np.repeat(start[None], 20, axis=0))[0] == 20
    away = start.copy()
    away[4] += 0.2
    guard.watch(ArmState(20 * CYCLE, away, np.zeros(7)))
    with pytest.raises(MotionStop, match=r"joint 5 is 0\.200 rad away"):
        guard.check(start)
    for status in (ArmStatus.NOT_COMMANDING, ArmStatus.POWER_OFF, ArmStatus.FAULT):
        with pytest.raises(MotionStop, match=status.name):
            guard.watch(ArmState(21 * CYCLE, start, np.zeros(7), int(status)))
    guard.watch(ArmState(1.0, start, np.zeros(7), int(ArmStatus.LATE)))
    with pytest.raises(MotionStop, match=r"no state of the arm for 2\.000 s"):
        guard.watch(ArmState(3.0, start, np.zeros(7)))
