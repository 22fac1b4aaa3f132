"""Where the reading of a sensor with hysteresis stands, against a play that is driven step by step."""

import numpy as np
import pytest

from lwrprobe.calibration.sensor_play import directions, held_back

HALF = np.array([0.018, 0.018, 0.025, 2e-4, 2e-4, 2e-4])
NOISE = np.full(6, 1e-9)


class Play:
    """The textbook's: the reading follows the load at half a width."""

    def __init__(self, load):
        self.reading = load.copy()

    def take(self, loads):
        out = []
        for load in loads:
            self.reading = np.minimum(np.maximum(self.reading, load - HALF), load + HALF)
            out.append(self.reading.copy())
        return np.array(out)


def driven(seed):
    """Touches between which the probe turns: readings less those before it, weights, loads, and where each rested."""
    random = np.random.default_rng(seed)
    weight = 0.6 * HALF * random.standard_normal(6)
    play, readings, weights, loads, rested = Play(weight), [], [], [], []
    for _ in range(12):
        turned = weight + HALF * random.standard_normal(6)
        before = play.take(np.linspace(weight, turned, 50))[-1]
        weight = turned
        rested.append((before - weight) / HALF)
        peak = HALF * random.choice([0.5, 1.5, 40.0, 80.0], 6) * random.choice([-1.0, 1.0], 6)
        load = np.concatenate([np.linspace(0.0, 1.0, 200), np.linspace(1.0, 0.0, 201)[1:]])[:, None] * peak
        readings.append(play.take(weight + load) - before)
        weights.append(weight)
        loads.append(load)
    return readings, weights, loads, np.array(rested)


@pytest.mark.parametrize("seed", range(5))
def test_what_the_reading_keeps_of_the_touch_before_is_that_of_a_play(seed):
    readings, weights, _, rested = driven(seed)
    found = held_back(readings, weights, HALF)
    # A peak is known as it was read: less than the play of the smallest presses may be missing.
    large = np.abs(rested) > 0.0
    assert np.median(np.abs(found - rested)[large]) < 0.02
    assert np.abs(found - rested).mean() < 0.25


@pytest.mark.parametrize("seed", range(5))
def test_both_together_give_the_load_back(seed):
    readings, weights, loads, _ = driven(seed)
    before, after = [], []
    for reading, load, held in zip(readings, loads, held_back(readings, weights, HALF)):
        pressed = np.abs(load) > 4.0 * HALF
        found = reading + HALF * directions(reading, -held, NOISE) + HALF * held
        before.append(np.abs(reading - load)[pressed])
        after.append(np.abs(found - load)[pressed])
    before, after = np.concatenate(before), np.concatenate(after)
    assert np.median(after) < 0.02 * np.median(before)
    assert after.mean() < 0.2 * before.mean()


def test_an_axis_that_has_not_moved_yet_is_as_it_was_at_the_begin():
    readings = np.zeros((4, 6))
    readings[:, 0] = 0.0, 1.0, 2.0, 1.0
    begin = np.array([0.3, 0.3, -0.4, 0.0, 1.0, -1.0])
    found = directions(readings, begin, NOISE)
    assert found[:, 1:] == pytest.approx(np.tile(begin[1:], (4, 1)))
    assert found[1:, 0].tolist() == [1.0, 1.0, -1.0]


def test_a_sensor_without_hysteresis_holds_nothing_back():
    readings, weights, _, _ = driven(0)
    assert (held_back(readings, weights, np.zeros(6)) == 0.0).all()
