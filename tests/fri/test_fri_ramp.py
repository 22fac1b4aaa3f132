"""The ramp between runner and wire: unchanged when the runner keeps the limits, within them in any case."""

import numpy as np
import pytest

from lwrprobe_fri.ramp import Ramp

CYCLE = 0.01
SPEED, ACCELERATION = [2.0] * 7, [10.0] * 7


def ramp_at(position):
    ramp = Ramp(SPEED, ACCELERATION)
    ramp.rest_at(position)
    return ramp


def drive(ramp, targets):
    """Positions on the wire for a stream of set points; None = the runner is late."""
    path, last = [list(ramp.position)], np.array(ramp.position)
    for target in targets:
        if target is None:
            path.append(list(ramp.brake(CYCLE)))
            continue
        velocity = (np.array(target) - last) / CYCLE
        path.append(list(ramp.follow(target, velocity, CYCLE)))
        last = np.array(target)
    return np.array(path)


def assert_within_limits(path):
    speed = np.diff(path, axis=0) / CYCLE
    change = np.diff(np.vstack([np.zeros(7), speed]), axis=0) / CYCLE
    assert np.abs(speed).max() <= SPEED[0] + 1e-9
    assert np.abs(change).max() <= ACCELERATION[0] + 1e-6


def test_stream_within_limits_passes_unchanged():
    time = np.arange(400) * CYCLE
    targets = 0.3 * (1 - np.cos(2 * time))[:, None] * np.ones(7)
    path = drive(ramp_at([0.0] * 7), targets.tolist())
    assert np.abs(path[1:] - targets).max() < 1e-12


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.1, -0.05])
def test_jump_is_caught_up_with_and_not_overshot(step):
    path = drive(ramp_at([0.0] * 7), [[step] * 7] * 600)
    assert_within_limits(path)
    assert path[-1] == pytest.approx([step] * 7, abs=1e-9)
    assert np.abs(path).max() <= abs(step) + 2 * ACCELERATION[0] * CYCLE**2


def test_late_runner_brakes_along_the_path():
    velocity = np.array([0.5, -0.25, 0.1, 0.0, 0.4, -0.05, 0.2])
    targets = [(k * CYCLE * np.minimum(1, k / 30) * velocity).tolist() for k in range(1, 60)]
    path = drive(ramp_at([0.0] * 7), targets + [None] * 60)
    assert_within_limits(path)
    braked = path[60:] - path[59]
    assert not np.diff(path[-5:], axis=0).any()
    far = np.linalg.norm(braked[-1])
    assert far == pytest.approx(abs(braked[-1] @ velocity) / np.linalg.norm(velocity), rel=1e-9)


def test_random_late_and_jumping_streams_stay_within_limits():
    random = np.random.default_rng(8)
    for _ in range(30):
        targets = np.cumsum(random.uniform(-0.05, 0.05, (200, 7)), axis=0).tolist()
        stream = [None if random.random() < 0.2 else target for target in targets]
        assert_within_limits(drive(ramp_at([0.0] * 7), stream))


def test_runner_that_was_late_for_one_cycle_is_rejoined():
    targets = [[0.002 * k] * 7 for k in range(1, 200)]
    stream = [*targets[:50], None, *targets[50:]]
    path = drive(ramp_at([0.0] * 7), stream)
    assert path[-1] == pytest.approx(targets[-1], abs=1e-9)
    steps = np.diff(path[:, 0])
    assert (steps >= 0.0).all()
    assert steps.max() <= 1.25 * 0.002 + 1e-12, "what was late is not made up for in one step"
