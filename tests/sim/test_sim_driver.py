"""The driver's promises: one clock, refused set points, samples that arrive late and once, the same bytes again."""

import numpy as np
import pytest

from lwrprobe.contracts import Arm, DeviceRefused, Driver, DriverContext, DriverError, GroundTruth, InputError, Sensor
from lwrprobe.scene import load_scene
from lwrprobe_sim import SimConfig, SimDriver

START = (0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0)


def opened(config: SimConfig | None = None, overrides=(), seed=1, scene="block"):
    driver = SimDriver(
        DriverContext(config or SimConfig(start_q=START), load_scene(scene, ["truth.profile=ideal", *overrides]), seed)
    )
    driver.arm().open()
    driver.sensor().open()
    return driver


def test_fills_the_contract():
    driver = opened()
    assert isinstance(driver, Driver)
    assert isinstance(driver.arm(), Arm)
    assert isinstance(driver.sensor(), Sensor)
    assert isinstance(driver.ground_truth(), GroundTruth)


def test_each_read_is_one_cycle():
    arm = opened().arm()
    assert [arm.read().time for _ in range(3)] == pytest.approx([0.001, 0.002, 0.003], abs=1e-15)


def test_holds_still_until_commanded():
    arm = opened().arm()
    state = arm.read()
    assert state.q == pytest.approx(START, abs=1e-15)
    assert not state.qd.any()


def test_lag_closes_by_its_time_constant():
    arm = opened(SimConfig(start_q=START, lag=0.01)).arm()
    goal = np.array(START)
    goal[0] += 0.001
    for _ in range(10):
        arm.command(goal)
        state = arm.read()
    assert goal[0] - state.q[0] == pytest.approx(0.001 * np.exp(-1.0), rel=1e-9)


def test_delay_is_whole_cycles():
    arm = opened(SimConfig(start_q=START, lag=0.0, delay=0.003)).arm()
    goal = np.array(START)
    goal[0] += 0.001
    arm.command(goal)
    moved = [arm.read().q[0] - START[0] for _ in range(5)]
    assert moved == pytest.approx([0.0, 0.0, 0.0, 0.001, 0.001], abs=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [(np.full(7, np.nan), "joint 1"), (np.eye(7)[3] * 0.01, "joint 4 asks for 10 rad/s"), (np.eye(7)[1] * 5, "beyond")],
)
def test_refuses_what_a_controller_would(change, words):
    arm = opened().arm()
    with pytest.raises(DeviceRefused, match=words):
        arm.command(np.array(START) + change)
    assert arm.read().q == pytest.approx(START)


def test_refuses_a_wrong_number_of_joints_and_a_closed_arm():
    arm = opened().arm()
    with pytest.raises(InputError, match="7 joint values"):
        arm.command(np.zeros(6))
    arm.close()
    arm.close()
    with pytest.raises(DriverError, match="not open"):
        arm.read()


def test_refuses_a_start_beyond_the_limits():
    with pytest.raises(DeviceRefused, match="joint limits"):
        opened(SimConfig(start_q=(0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0)))


def test_stop_brakes_to_rest_within_the_deceleration():
    arm = opened(SimConfig(start_q=START, lag=0.0, brake=10.0)).arm()
    q = np.array(START)
    for _ in range(50):
        q[0] += 0.001
        arm.command(q)
        arm.read()
    arm.stop()
    speeds = np.array([arm.read().qd[0] for _ in range(150)])
    assert np.all(np.diff(speeds) >= -10.0 * 0.001 - 1e-9)
    assert speeds[-1] == 0.0


def test_samples_come_at_their_rate_and_after_their_latency():
    driver = opened(SimConfig(start_q=START, latency=0.005, late_share=0.0, loss=0.0))
    seen = []
    for _ in range(100):
        now = driver.arm().read().time
        seen += [(sample.time, now, sample.sequence) for sample in driver.sensor().read()]
    times, arrivals, numbers = np.array(seen).T
    assert times == pytest.approx(0.008 * np.arange(1, len(times) + 1))
    assert arrivals - times == pytest.approx(0.005)
    assert numbers.tolist() == list(range(1, len(times) + 1))


def test_a_fast_sensor_gives_several_samples_a_cycle():
    config = SimConfig(start_q=START, latency=0.0, late_share=0.0, loss=0.0)
    driver = opened(config, ["sensor.rate=4000.0"])
    driver.arm().read()
    assert len(driver.sensor().read()) == 4


def test_the_same_seed_gives_the_same_bytes():
    def run(seed):
        driver = opened(seed=seed)
        values = []
        for _ in range(400):
            driver.arm().read()
            values += [np.r_[s.time, s.force, s.torque, s.status] for s in driver.sensor().read()]
        return np.array(values).tobytes()

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_joint_compliance_is_one_number_or_one_a_joint():
    with pytest.raises(InputError, match="joint_compliance"):
        opened(SimConfig(start_q=START, joint_compliance=(1e-5, 1e-5)))


def test_the_truth_is_told_for_each_sample_and_for_nothing_else():
    config = SimConfig(start_q=START, latency=0.0, late_share=0.0, loss=0.0)
    driver = opened(config, ["sensor.rate=4000.0"])
    for _ in range(2000):
        driver.arm().read()
    truth = driver.ground_truth()
    assert truth.contact_at(8000) is None
    assert truth.contact_at(0) is None
    assert truth.contact_at(10**9) is None
    assert truth.link_collisions == 0
    assert truth.peak_force == 0.0


def test_an_option_that_cannot_be_is_refused():
    for bad in ({"cycle": 0.0}, {"loss": 2.0}, {"lag": float("nan")}, {"static_friction": 0.5}, {"delay": 1.0}):
        with pytest.raises(InputError, match=next(iter(bad))):
            SimConfig(**bad)
