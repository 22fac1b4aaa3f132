"""Silence, saturation, overlarge force and torque, and the way back."""

import numpy as np
import pytest

from lwrprobe.contracts import SafetyStop, SampleStatus
from lwrprobe.exploration.safety.force_guard import ForceGuard
from lwrprobe.exploration.safety.retreat import Retreat
from lwrprobe.exploration.safety.silence_guard import SensorLost, SilenceGuard


def run_silent(guard, cycle, status=None):
    """Cycles until it stops, with a sample of that status each cycle, or none."""
    for n in range(1, 1000):
        if status is not None:
            guard.update(int(status))
        try:
            guard.check(n * cycle)
        except SensorLost:
            return n
    return None


@pytest.mark.parametrize("cycle", [0.001, 0.01])
@pytest.mark.parametrize(
    "status", [None, SampleStatus.FROZEN, SampleStatus.LATE, SampleStatus.INVALID, SampleStatus.BRIDGE_LOW]
)
def test_silence_is_no_usable_sample_whatever_else_comes(cycle, status):
    stopped = run_silent(SilenceGuard(0.1, cycle, 0.008), cycle, status)
    assert stopped == pytest.approx(0.1 / cycle, abs=3)


def test_usable_samples_keep_it_going():
    assert run_silent(SilenceGuard(0.1, 0.01, 0.008), 0.01, SampleStatus.LOST_BEFORE) is None


def test_a_standstill_of_the_whole_rig_is_no_silence_but_the_next_cycles_are():
    guard = SilenceGuard(0.1, 0.01, 0.008)
    guard.check(1.0)
    guard.check(1.8)
    for n in range(1, 9):
        guard.check(1.8 + 0.01 * n)
    guard.check(1.885)
    guard.check(1.89)
    assert guard.silent == pytest.approx(0.1)
    with pytest.raises(SensorLost, match="no usable wrench sample"):
        guard.check(1.9)


def test_saturation_in_a_row():
    guard = SilenceGuard(0.1, 0.01, 0.008)
    for _ in range(5):
        guard.update(SampleStatus.SATURATED)
        guard.update(SampleStatus.SATURATED)
        guard.update(0)
    guard.update(SampleStatus.SATURATED)
    guard.update(SampleStatus.SATURATED)
    with pytest.raises(SensorLost, match="end of its range"):
        guard.update(SampleStatus.SATURATED)


@pytest.mark.parametrize("rate", [125.0, 1000.0, 7000.0])
def test_a_quick_sensor_may_be_at_its_end_for_as_long_as_a_slow_one(rate):
    """A blow that lasts a few milliseconds is over before any arm yields."""
    guard = SilenceGuard(0.1, 0.001, 1.0 / rate)
    for _ in range(int(0.015 * rate)):
        guard.update(SampleStatus.SATURATED)
    guard.update(0)
    for _ in range(int(0.0199 * rate)):
        guard.update(SampleStatus.SATURATED)
    with pytest.raises(SensorLost, match="end of its range"):
        guard.update(SampleStatus.SATURATED)


def test_torque_yields_as_force_does():
    guard = ForceGuard(3.0, 0.8, 0.04, np.full(3, 0.09))
    force, torque = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.05, 0.0])
    assert guard.check(0.0, force, torque) is None
    command = guard.check(0.1, force, 2.0 * torque)
    assert command.velocity == pytest.approx([0.04, 0.0, 0.0])
    assert command.reason == "torque limit"
    assert guard.check(0.2, 0.5 * force, torque) is None
    guard.check(0.3, force, 2.0 * torque)
    with pytest.raises(SafetyStop, match="stays above"):
        guard.check(1.4, force, 2.0 * torque)


def test_way_back_leads_off_the_surface_and_back_where_it_came_from():
    way = Retreat(0.002)
    descent = np.array([[0.0, 0.0, 0.02 - 0.0005 * k] for k in range(41)])
    for tip in descent:
        way.note(tip, None)
    up = np.array([0.0, 0.0, 1.0])
    slide = np.array([[0.0002 * k, 0.0, 0.0] for k in range(51)])
    for tip in slide:
        way.note(tip, up)
    places = way.places(slide[-1], 0.03)
    assert places[0] == pytest.approx([0.01, 0.0, 0.002])
    path = np.vstack([slide[-1:], places])
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(0.002 + 0.03, abs=0.002)
    sliding = [p for p in places if p[0] > 0.0005]
    assert all(p[2] == pytest.approx(0.002) for p in sliding)
    assert np.linalg.norm(np.diff(path[1:], axis=0), axis=1).max() < 0.005
    assert places[-1][2] > 0.01
    assert places[-1][0] == pytest.approx(0.0)


def test_who_has_gone_back_and_goes_back_once_more_does_not_touch_again():
    """A sensor that stayed silent after the retreat had led the sphere back to the wall that it had left."""
    way, wall = Retreat(0.002), np.array([0.0, -1.0, 0.0])
    for y in np.arange(0.0, 0.05, 0.0005):
        way.note(np.array([0.0, y, 0.006]), None)
    for z in np.arange(0.006, 0.012, 0.0005):
        way.note(np.array([0.0, 0.05, z]), wall)
    back = way.places(np.array([0.0, 0.05, 0.0115]), 0.02)
    assert way.gone
    farther = np.array(way.places(back[-1], 0.02))
    assert (np.diff(np.vstack([back[-1:], farther])[:, 1]) <= 1e-9).all()
    assert farther[-1] == pytest.approx(back[-1] - [0.0, 0.02, 0.0])
    way.note(np.array([0.0, 0.05, 0.0115]), wall)
    assert not way.gone
    assert way.places(np.array([0.0, 0.05, 0.0115]), 0.02)[0] == pytest.approx([0.0, 0.048, 0.0115])


def test_way_back_of_free_motion_is_its_own_way():
    way = Retreat(0.002)
    for k in range(100):
        way.note(np.array([0.0, 0.001 * k, 0.05]), None)
    places = way.places(np.array([0.0, 0.0995, 0.05]), 0.02)
    assert np.abs(np.array(places)[:, [0, 2]] - [0.0, 0.05]).max() < 1e-12
    assert places[-1][1] == pytest.approx(0.0795)
    assert way.places(np.zeros(3), 0.0) == []


def test_a_spike_is_not_yielded_to_and_a_confirmed_overload_is():
    guard = ForceGuard(3.0, 0.8, 0.04)
    pull = np.array([0.0, 0.0, -4.2])
    held = guard.check(0.0, pull, np.zeros(3), confirmed=False)
    assert not held.velocity.any(), "yielding to a pull that is none would push"
    assert guard.interventions == 0
    assert guard.check(0.008, np.array([0.0, 0.0, 0.9]), np.zeros(3)) is None
    push = np.array([0.0, 0.0, 4.2])
    assert not guard.check(0.016, push, np.zeros(3), confirmed=False).velocity.any()
    assert guard.check(0.024, push, np.zeros(3)).velocity == pytest.approx([0.0, 0.0, 0.04])
    assert guard.interventions == 1


@pytest.mark.parametrize(
    ("force", "down"),
    [((1.8, 0.0, -0.6), 0.0), ((1.8, 0.0, 0.6), -0.3162), ((0.3, 0.0, -1.8), 0.9864)],
    ids=["off a wall", "off a slope", "off a ceiling"],
)
def test_a_torque_that_is_too_large_is_not_released_down_the_stick(force, down):
    """At 40 mm/s along the force on a wall, which leant down by 20 degrees, the sphere had met a step with 7 N."""
    guard, axis = ForceGuard(3.0, 0.8, 0.04, np.full(3, 0.09)), np.array([0.0, 0.0, -1.0])
    motion = guard.check(1.0, np.array(force), np.array([0.0, 0.1, 0.0]), True, axis)
    assert motion.velocity @ axis == pytest.approx(0.04 * down, abs=1e-5)
    assert motion.velocity[0] == pytest.approx(0.04 * force[0] / np.linalg.norm(force))
