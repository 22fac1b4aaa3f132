"""How fast the sensor's zero drifts: found from the zeros that were taken, and followed between them."""

import numpy as np
import pytest

from lwrprobe.contact import DriftRate, DriftWatch, WrenchConditioner
from lwrprobe.contact.drift_rate import CHANGING, MEMORY
from lwrprobe.contracts import InputError, Probe, WrenchSample

STATED, WANDER = 0.05 / 60.0, (0.006, 2.8e-5)  # N/s; N and N·m
DOWN, ASIDE = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.6, -0.8])
RATE = np.array([0.1, -0.05, 0.15, 0.0, 2e-4, 0.0]) / 60.0


def noise(random):
    return random.normal(size=6) * np.repeat(WANDER, 3)


def test_the_rate_is_found_from_a_few_zeros():
    random, drift = np.random.default_rng(1), DriftRate(STATED, *WANDER)
    assert (drift.value == 0.0).all()
    assert drift.unknown == 1.0
    for time in np.arange(0.0, 150.0, 25.0):
        drift.add(time, RATE * time + noise(random), DOWN)
    off = (drift.value - RATE) / np.repeat(WANDER, 3) * np.repeat(WANDER[0], 6)
    assert np.abs(off[:3]).max() < 0.02 / 60.0
    assert CHANGING <= drift.unknown < 0.6


def test_it_is_the_slope_of_the_ridge_regression():
    times, zeros = np.array([0.0, 20.0, 70.0, 90.0]), np.array([0.0, 0.03, 0.12, 0.15])
    drift = DriftRate(STATED, *WANDER)
    for time, zero in zip(times, zeros):
        drift.add(time, np.array([0.0, 0.0, zero, 0.0, 0.0, 0.0]), DOWN)
    design = np.vstack([times - times.mean(), [WANDER[0] / STATED, 0.0, 0.0, 0.0]]).T
    naive = np.linalg.lstsq(
        np.append(design[:, 0], WANDER[0] / STATED)[:, None], np.append(zeros - zeros.mean(), 0.0), rcond=None
    )[0]
    assert drift.value[2] == pytest.approx(naive[0])


def test_a_zero_that_only_wanders_has_no_rate():
    random, shown = np.random.default_rng(2), 0
    for _ in range(200):
        drift = DriftRate(STATED, *WANDER)
        for time in np.arange(0.0, 100.0, 20.0):
            drift.add(time, noise(random), DOWN)
        shown += int((drift.value[:3] != 0.0).any())
    assert shown < 40
    assert drift.unknown < 1.0


def test_a_stick_that_is_turned_moves_the_zero_and_is_no_drift():
    drift = DriftRate(STATED, *WANDER)
    for time in np.arange(0.0, 100.0, 20.0):
        drift.add(time, RATE * time, DOWN)
    before = drift.value
    drift.add(101.0, RATE * 101.0 + 0.05, ASIDE)
    drift.add(120.0, RATE * 120.0 + 0.05, ASIDE)
    assert drift.value[:3] == pytest.approx(before[:3], rel=0.2)


def test_zeros_of_long_ago_are_forgotten():
    drift = DriftRate(STATED, *WANDER)
    for time in np.arange(0.0, 3.0 * MEMORY, 25.0):
        drift.add(time, RATE * min(time, MEMORY), DOWN)
    assert np.abs(drift.value[:3]).max() < 0.1 * np.abs(RATE[:3]).max()


def test_a_sensor_that_does_not_drift_by_its_data_sheet_is_left_alone():
    drift = DriftRate(0.0, *WANDER)
    for time in (0.0, 10.0, 20.0):
        drift.add(time, RATE * time, DOWN)
    assert (drift.value == 0.0).all()
    assert drift.unknown == 1.0


@pytest.mark.parametrize(("name", "at"), [("stated", 0), ("force", 1), ("torque", 2)])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_bad_figures_are_refused_by_name(name, at, value):
    figures = [STATED, *WANDER]
    figures[at] = value
    with pytest.raises(InputError, match=rf"drift_rate\.{name}"):
        DriftRate(*figures)


@pytest.mark.parametrize("known", [True, False])
def test_in_a_long_contact_the_zero_goes_on_as_it_drifted(known):
    """Five zeros in two minutes, then a minute in contact: 0.15 N/min had turned the normal by 10 degrees."""
    conditioner = WrenchConditioner(Probe(), 125.0)
    watch = DriftWatch(conditioner, drift=DriftRate(STATED, *WANDER) if known else None)
    random, off = np.random.default_rng(3), np.zeros(3)
    for k in range(180 * 25):
        time = k / 25.0
        values = RATE * time + random.normal(size=6) * np.repeat([3e-3, 1.6e-5], 3)
        pressed = time > 121.0
        values[2] += 0.8 * pressed
        wrench = conditioner.condition(WrenchSample(time, values[:3], values[3:], k), np.eye(3))
        watch.observe(wrench, time % 25.0 < 4.0 and not pressed, np.zeros(3))
        if watch.ready:
            watch.rezero()
        off = RATE[:3] * time - conditioner.bias[:3]
    assert len(watch.changes) > 4
    assert (np.abs(off).max() < 0.03) == known


def test_a_clock_that_is_set_moves_no_zero():
    conditioner = WrenchConditioner(Probe(), 125.0)
    conditioner.set_drift(RATE)
    for k, time in enumerate([0.0, 0.008, 86_400.0, 86_400.008, 86_400.016]):
        conditioner.condition(WrenchSample(time, np.zeros(3), np.zeros(3), k), np.eye(3))
    assert conditioner.bias == pytest.approx(0.016 * RATE, rel=1e-3)


def test_bad_rates_are_refused_by_name():
    for rate in ([0.0, 0.0, 0.0], [np.nan, *[0.0] * 5]):
        with pytest.raises(InputError, match=r"bias\.drift"):
            WrenchConditioner(Probe(), 125.0).set_drift(np.array(rate))
