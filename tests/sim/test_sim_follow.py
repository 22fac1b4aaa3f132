"""Several set points in one call: the same as one by one, and no further than to the next sample."""

import numpy as np
import pytest

from lwrprobe.contracts import DeviceRefused, DriverContext, InputError, SteppedArm
from lwrprobe.scene import load_scene
from lwrprobe_sim import SimConfig, SimDriver

START = (0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0)
FAULTS = {"latency": 0.0123, "late_share": 0.3, "late_by": 0.02, "loss": 0.1, "encoder_noise": 1e-5}


def opened(rate=125.0, realtime=False, **config):
    config = SimConfig(start_q=START, **config)
    driver = SimDriver(
        DriverContext(config, load_scene("block", ["truth.profile=ideal", f"sensor.rate={rate}"]), 3, realtime)
    )
    driver.arm().open()
    driver.sensor().open()
    return driver.arm(), driver.sensor(), driver._world


def swing(count):
    """Set points (count, 7): two joints swing, well inside their limits."""
    rows = np.tile(START, (count, 1))
    rows[:, 0] += 0.02 * (1.0 - np.cos(0.02 * np.arange(1, count + 1)))
    rows[:, 3] += 0.01 * (1.0 - np.cos(0.03 * np.arange(1, count + 1)))
    return rows


def test_it_says_that_it_can():
    assert isinstance(opened()[0], SteppedArm)


@pytest.mark.parametrize("config", [{}, {"lag": 0.0, "encoder_noise": 1e-5}, FAULTS])
def test_many_at_once_are_the_same_as_one_by_one(config):
    arm, _, world = opened(**config)
    other, _, twin = opened(**config)
    rows = swing(200)
    times, joints = np.empty(200), np.empty((200, 7))
    assert arm.step_many(rows, times, joints, 0.1) == (200, 0)
    states = []
    for row in rows:
        other.command(row)
        states.append(other.read())
    assert times.tolist() == [state.time for state in states]
    assert (joints == [state.q for state in states]).all()
    assert world.state.tobytes() == twin.state.tobytes()
    assert world.counts.tolist() == twin.counts.tolist()


@pytest.mark.parametrize(("rate", "config"), [(125.0, {}), (1000.0, {}), (90.0, FAULTS), (7.0, {"latency": 0.0})])
def test_no_sample_comes_while_none_is_due_and_one_comes_then(rate, config):
    arm, sensor, _ = opened(rate, **config)
    surely = config is not FAULTS  # what is lost never comes
    came = 0
    for _ in range(60):
        silent = arm.cycles_until_sample(500)
        for _ in range(silent):
            arm.read()
            assert sensor.read() == []
        arm.read()
        samples = sensor.read()
        came += len(samples)
        assert samples or not surely
    assert came > 30
    assert arm.cycles_until_sample(0) == 0


def test_cycles_are_not_foreseen_while_a_sample_waits():
    arm, sensor, _ = opened()
    for _ in range(40):
        arm.read()
    assert arm.cycles_until_sample(100) == 0
    sensor.read()
    assert arm.cycles_until_sample(100) > 0


def test_what_is_refused_ends_it_with_the_rows_before_carried_out():
    arm, _, world = opened()
    rows, times, joints = swing(10), np.zeros(10), np.empty((10, 7))
    rows[6, 2] += 1.0
    with pytest.raises(DeviceRefused, match="joint 3"):
        arm.step_many(rows, times, joints, 0.1)
    assert times[5] == pytest.approx(0.006)
    assert not times[6:].any()
    assert world.counts[0] == 6


def test_a_joint_that_is_not_where_it_was_sent_ends_it():
    arm, _, _ = opened(lag=0.05)
    rows, times, joints = swing(50), np.empty(50), np.empty((50, 7))
    done, status = arm.step_many(rows, times, joints, 1e-3)
    assert (0 < done < 50, status) == (True, 0)
    away = np.abs(joints[:done] - rows[:done]).max(axis=1)
    assert (away[:-1] <= 1e-3).all()
    assert away[-1] > 1e-3


def test_with_the_wall_clock_it_goes_cycle_by_cycle():
    assert opened(realtime=True)[0].cycles_until_sample(100) == 0


def test_wrong_shapes_are_refused():
    arm, _, _ = opened()
    with pytest.raises(InputError, match="rows"):
        arm.step_many(np.zeros((3, 6)), np.zeros(3), np.zeros((3, 7)), 0.1)
    with pytest.raises(InputError, match="joints"):
        arm.step_many(swing(3), np.zeros(3), np.zeros((2, 7)), 0.1)
