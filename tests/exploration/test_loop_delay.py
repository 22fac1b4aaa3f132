"""Delay of arm and sensor, from the motions of the start-up."""

import numpy as np
import pytest
from scipy.signal import lfilter

from lwrprobe.exploration.loop.loop_delay import LoopDelay
from lwrprobe.exploration.stages.pipeline import reaction_delay
from lwrprobe.scene import load_scene

CYCLE = 0.001


def measured(dead, lag, moves=(0.01,), noise=0.0, age=0.004):
    """Smooth motions from rest to rest, followed after whole cycles and a first-order lag."""
    delay, random = LoopDelay(), np.random.default_rng(3)
    at = np.zeros(3)
    for length in moves:
        step = np.sin(np.linspace(0.0, np.pi, 80)) ** 2
        way = np.concatenate([np.zeros(20), np.cumsum(step) / step.sum(), np.ones(400)])[:, None]
        sent = at + way * length * np.array([1.0, -0.4, 0.0])
        share = np.exp(-CYCLE / lag) if lag else 0.0
        seen = at + lfilter([1.0 - share], [1.0, -share], sent - at, axis=0)
        seen = np.concatenate([np.repeat(seen[:1], dead, axis=0), seen[: len(seen) - dead]])
        for k, (wanted, is_now) in enumerate(zip(sent, seen + noise * random.standard_normal(seen.shape))):
            delay.note(k * CYCLE, wanted, is_now)
        delay.rest()
        at = sent[-1]
    for _ in range(9):
        delay.note_age(age)
    return delay


@pytest.mark.parametrize(("dead", "lag"), [(0, 0.0), (1, 0.0), (10, 0.0), (0, 0.02), (7, 0.005)])
@pytest.mark.parametrize("moves", [(0.01,), (0.01, -0.01), (0.002, 0.003)])
def test_dead_time_and_time_constant_add_up(dead, lag, moves):
    # A discrete lag with share exp(-T / lag) delays by share / (1 - share) cycles.
    share = np.exp(-CYCLE / lag) if lag else 0.0
    expected = CYCLE * (dead + share / (1.0 - share))
    assert measured(dead, lag, moves).arm == pytest.approx(expected, abs=2e-5)


def test_noise_of_the_encoders_is_averaged():
    assert measured(10, 0.002, noise=1e-6).arm == pytest.approx(0.0115, abs=2e-4)


def test_without_a_motion_nothing_is_known():
    assert measured(10, 0.0, moves=()).arm is None
    assert LoopDelay().sensor is None


def test_a_loop_that_is_slower_than_stated_counts_as_measured_and_a_faster_one_as_stated():
    scene = load_scene("block")
    stated = reaction_delay(scene, CYCLE, 0.004, 125.0)
    assert reaction_delay(scene, CYCLE, 0.004, 125.0, measured(1, 0.0)) == stated
    assert reaction_delay(scene, CYCLE, 0.004, 125.0, LoopDelay()) == stated
    late = reaction_delay(scene, CYCLE, 0.004, 125.0, measured(11, 0.0, age=0.014))
    assert late == pytest.approx(stated + 0.02, abs=1e-4)
    waits = reaction_delay(scene, CYCLE, 0.004, 125.0, measured(1, 0.0), arm_delay=0.01)
    assert waits == pytest.approx(stated + 0.01), "an arm that follows a cycle later than the next one"
    own = load_scene("block", ["contact.delay=0.05"])
    assert reaction_delay(own, CYCLE, 0.004, 125.0, measured(11, 0.0)) == 0.05
