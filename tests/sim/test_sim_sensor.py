"""The sensor's faults are what the options say, no more and no less."""

import numpy as np
import pytest
from gantry_rig import CLEAN, gantry

from lwrprobe.contracts import DriverContext, SampleStatus
from lwrprobe.scene import load_scene
from lwrprobe_sim import SimConfig, SimDriver, sensor_kernels
from lwrprobe_sim.world import World


def stream(seconds, overrides=(), seed=1, tilt=0.0, path=None, **config):
    """Samples of a probe at rest in the air (or on a path), as rows of `sensor_kernels`."""
    world = World(
        load_scene("block", ["truth.profile=ideal", *overrides]), SimConfig(**{**CLEAN, **config}), seed, gantry(tilt)
    )
    world.place(np.array([0.0, 0.0, 0.2]))
    rows = []
    for i in range(round(seconds / world.config.cycle)):
        if path is not None:
            assert world.command(path(i * world.config.cycle)) == 0
        if world.advance():
            rows += world.fetch()
    return np.array(rows)


def forces(rows):
    return rows[:, sensor_kernels.FORCE : sensor_kernels.FORCE + 3]


def torques(rows):
    return rows[:, sensor_kernels.TORQUE : sensor_kernels.TORQUE + 3]


def test_a_faultless_sensor_in_the_air_reads_zero():
    rows = stream(1.0)
    assert not rows[:, 1:7].any()
    assert not rows[:, sensor_kernels.STATUS].any()


def test_noise_is_gaussian_and_white():
    rows = stream(4.0, ["sensor.rate=1000.0"], noise_force=0.003, noise_torque=2e-5)
    assert forces(rows).std(axis=0) == pytest.approx(0.003, rel=0.05)
    assert torques(rows).std(axis=0) == pytest.approx(2e-5, rel=0.05)
    assert forces(rows).mean(axis=0) == pytest.approx(0.0, abs=4 * 0.003 / np.sqrt(len(rows)))
    standard = np.c_[forces(rows) / 0.003, torques(rows) / 2e-5]
    assert np.corrcoef(standard.T) - np.eye(6) == pytest.approx(0.0, abs=0.08)
    following = np.mean(standard[1:] * standard[:-1], axis=0)
    assert following == pytest.approx(0.0, abs=0.08)
    assert np.mean(np.abs(standard) > 2.0) == pytest.approx(0.0455, abs=0.005)


def test_readings_are_whole_counts():
    rows = stream(1.0, noise_force=0.003, noise_torque=2e-5, quantisation=True)
    counts = np.c_[forces(rows) * 320.0, torques(rows) * 64000.0]
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    assert np.unique(np.round(counts[:, 0])).size > 3


@pytest.mark.parametrize("axis", range(6))
def test_every_axis_saturates_at_its_end_and_says_so(axis):
    span = [12.0, 12.0, 17.0, 0.12, 0.12, 0.12]
    load = [0.0] * 6
    load[axis] = 1.01 * span[axis]
    rows = stream(0.1, saturation=True, bias_force=tuple(load[:3]), bias_torque=tuple(load[3:]))
    assert rows[0, 1 + axis] == pytest.approx(span[axis])
    assert int(rows[0, sensor_kernels.STATUS]) & SampleStatus.SATURATED
    load[axis] = 0.99 * span[axis]
    rows = stream(0.1, saturation=True, bias_force=tuple(load[:3]), bias_torque=tuple(load[3:]))
    assert not rows[0, sensor_kernels.STATUS]


def test_drift_is_what_a_minute_brings():
    rows = stream(3.0, drift_force=(0.06, 0.0, -0.6), drift_torque=(0.0, 0.006, 0.0))
    assert rows[-1, 1:7] == pytest.approx(np.array([0.06, 0, -0.6, 0, 0.006, 0]) * rows[-1, 0] / 60.0)


def test_lost_samples_leave_a_gap_that_the_next_one_announces():
    rows = stream(8.0, loss=0.2)
    numbers = rows[:, sensor_kernels.SEQUENCE].astype(int)
    assert 1.0 - len(numbers) / 1000 == pytest.approx(0.2, abs=0.05)
    announced = rows[:, sensor_kernels.STATUS].astype(int) & SampleStatus.LOST_BEFORE != 0
    assert (announced[1:] == (np.diff(numbers) > 1)).all()


def test_bursts_swallow_everything_for_their_length():
    rows = stream(20.0, burst_rate=0.5, burst_length=0.1)
    gaps = np.diff(rows[:, sensor_kernels.TIME])
    assert 2 <= np.sum(gaps > 0.05) <= 25
    assert gaps[gaps > 0.01].min() >= 0.1 - 1e-9


def test_late_samples_hold_up_those_behind_but_never_swap():
    driver = SimDriver(
        DriverContext(
            SimConfig(**{**CLEAN, "latency": 0.003, "late_share": 0.3, "late_by": 0.03, "late_limit": 0.02}),
            load_scene("block", ["truth.profile=ideal"]),
            5,
        )
    )
    driver.arm().open()
    waits, numbers, late = [], [], []
    for _ in range(4000):
        now = driver.arm().read().time
        for sample in driver.sensor().read():
            waits.append(now - sample.time)
            numbers.append(sample.sequence)
            late.append(bool(sample.status & SampleStatus.LATE))
    assert numbers == sorted(set(numbers))
    assert min(waits) == pytest.approx(0.003, abs=1e-9)
    assert max(waits) <= 0.034 + 1e-9
    assert np.mean(late) == pytest.approx(0.3 * 13.0 / 30.0, abs=0.05)
    assert all(wait > 0.02 for wait, flag in zip(waits, late) if flag)


def test_a_frozen_stream_repeats_its_last_record():
    rows = stream(1.0, noise_force=0.003, freeze_at=0.5, freeze_for=0.2)
    frozen = rows[(rows[:, sensor_kernels.TIME] > 0.48) & (rows[:, sensor_kernels.TIME] < 0.5)]
    same = np.all(rows[:, :8] == frozen[-1, :8], axis=1)
    assert same.sum() == 26  # itself and a fifth of a second at 125 Hz
    assert rows[-1, sensor_kernels.TIME] == pytest.approx(1.0)


def test_spikes_and_garbage_come_as_often_as_asked_and_alone():
    rows = stream(40.0, spike_rate=2.0, spike_force=5.0, garbage_rate=1.0)
    spiked = np.nan_to_num(np.abs(forces(rows))).max(axis=1) > 4.0
    assert spiked.sum() == pytest.approx(80, abs=30)
    broken = np.isnan(forces(rows)).any(axis=1)
    assert broken.sum() == pytest.approx(40, abs=20)
    assert np.sum(spiked[1:] & spiked[:-1]) < 10


def test_a_skewed_clock_shifts_the_stamps_alone():
    plain, skewed = stream(0.2, noise_force=0.003), stream(0.2, noise_force=0.003, clock_skew=0.007)
    assert skewed[:, 0] - plain[:, 0] == pytest.approx(0.007)
    assert (skewed[:, 1:8] == plain[:, 1:8]).all()


@pytest.mark.parametrize("tilt", [0.0, 0.7, -1.2])
def test_the_tips_weight_turns_with_the_sensor(tilt):
    rows = stream(0.1, ["probe.mass=0.01"], tilt=tilt, gravity=(0.0, 0.0, -9.81))
    frame = gantry(tilt).fk(np.zeros(3)).R
    weight = frame.T @ [0.0, 0.0, -9.81 * 0.01]
    assert forces(rows)[0] == pytest.approx(weight, abs=1e-12)
    assert torques(rows)[0] == pytest.approx(np.cross([0.0, 0.0, 0.03], weight), abs=1e-12)


def test_the_tips_inertia_is_felt_against_its_acceleration():
    rows = stream(1.0, ["probe.mass=0.01"], inertia=True, path=lambda t: np.array([0.02 * np.sin(6.0 * t), 0.0, 0.2]))
    expected = 0.01 * 36.0 * 0.02 * np.sin(6.0 * rows[:, 0])
    assert forces(rows)[5:, 0] == pytest.approx(expected[5:], abs=2e-4)


def test_tare_takes_the_present_mean_away():
    driver = SimDriver(
        DriverContext(
            SimConfig(latency=0.0, late_share=0.0, drift_force=(0.0, 0.0, 0.0)),
            load_scene("block", ["truth.profile=ideal"]),
            5,
        )
    )
    arm, sensor = driver.arm(), driver.sensor()
    arm.open()
    for _ in range(200):
        arm.read()
    assert abs(sensor.read()[-1].force[0]) > 0.1
    sensor.tare()
    for _ in range(400):
        arm.read()
    after = sensor.read()
    assert np.mean([s.force for s in after], axis=0) == pytest.approx(0.0, abs=0.004)
    assert np.mean([s.torque for s in after], axis=0) == pytest.approx(0.0, abs=4e-5)


def test_what_nobody_fetches_is_lost_from_the_old_end():
    world = World(load_scene("block", ["truth.profile=ideal"]), SimConfig(**CLEAN), 1, gantry())
    for _ in range(4000):
        world.advance()
    rows = np.array(world.fetch())
    assert len(rows) == 256
    assert rows[-1, sensor_kernels.TIME] == pytest.approx(4.0)


def test_uniform_numbers_are_uniform_for_neighbouring_seeds_and_streams():
    draws = np.array(
        [[[sensor_kernels.uniform(s, k, n) for n in range(400)] for k in range(4)] for s in range(4)]
    ).reshape(16, -1)
    assert draws.mean(axis=1) == pytest.approx(0.5, abs=0.06)
    assert np.abs(np.corrcoef(draws) - np.eye(16)).max() < 0.2
