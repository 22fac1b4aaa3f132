"""When a tip that follows a surface counts as stuck."""

import numpy as np

from lwrprobe.contracts import Observation, VelocityCommand
from lwrprobe_strategies.outcomes import Jammed
from lwrprobe_strategies.skills import reapproach
from lwrprobe_strategies.supervisor import JAM_LIMIT, JAM_TIME, Supervisor
from lwrprobe_strategies.tip import Tip
from strategy_task import DOWN, task

PERIOD = 0.008


def jams(times, speed=0.0, turns_at=np.inf, commanded=0.01):
    """Whether a tip that goes on at a speed [m/s] of its own samples, and back from a time on, jams at any time.

    `commanded` m/s is asked of it.
    """
    tip = Tip(task())
    supervisor = Supervisor(tip)
    tip.trace.begin(reapproach)
    found = []
    for k, time in enumerate(times):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = DOWN, (0.0, speed * min(PERIOD * k, 2.0 * turns_at - PERIOD * k), 0.02)
        seen = Observation(time, pose, np.zeros(3), np.zeros(3))
        tip.observe(seen)
        found.append(isinstance(supervisor.interruption(seen), Jammed))
        supervisor.note(VelocityCommand(np.array([0.0, commanded, 0.0])))
    return any(found)


def test_a_tip_that_does_not_come_on_for_a_while_is_stuck():
    assert jams(np.arange(0.0, JAM_TIME + 0.1, PERIOD))
    assert not jams(np.arange(0.0, JAM_TIME - 0.1, PERIOD))
    assert not jams(np.arange(0.0, 2.0 * JAM_TIME, PERIOD), speed=0.005)


def test_a_tip_that_went_there_and_came_back_is_not_stuck():
    assert not jams(np.arange(0.0, JAM_TIME + 0.5, PERIOD), speed=0.003, turns_at=0.5 * JAM_TIME)


def test_the_time_in_which_nothing_was_shown_does_not_count():
    before = np.arange(0.0, 1.0, PERIOD)
    assert not jams(np.concatenate([before, before + 1.0 + JAM_TIME]))


def test_a_tip_that_is_to_move_slowly_has_more_time():
    """Down a wall a late loop allows 0.65 mm/s: walls had been given up for that, in contact and on the way."""
    slow = 0.00065
    assert not jams(np.arange(0.0, 8.0 * JAM_TIME, PERIOD), speed=slow, commanded=slow)
    assert jams(np.arange(0.0, 4.0 * JAM_TIME, PERIOD), commanded=slow)
    assert not jams(np.arange(0.0, JAM_LIMIT - 0.1, PERIOD), commanded=0.0)
    assert jams(np.arange(0.0, JAM_LIMIT + 0.1, PERIOD), commanded=0.0)
