"""The presses of a calibration: how many the time allows, and how hard the sensor lets them be."""

from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contracts import InputError
from lwrprobe_strategies.planning.sphere_touches import sphere_touches
from lwrprobe_strategies.reference_sphere import ReferenceSphere, _Options
from strategy_task import DOWN, task

LEANS = tuple((0.4, side, 0.0) for side in np.arange(16.0) * 0.39)


def pressed(seconds, **given):
    """Which presses of the plan were made, where each takes some seconds."""
    options = _Options(leans=LEANS, **given)
    plan, made = sphere_touches(DOWN, options.leans, options.touches), []
    strategy = ReferenceSphere.__new__(ReferenceSphere)
    strategy.tip, strategy.task = SimpleNamespace(seen=SimpleNamespace(time=40.0)), SimpleNamespace(options=options)
    strategy._count, strategy._begun = 0, 0.0

    def press(touch):
        made.append(next(k for k, one in enumerate(plan) if one is touch))
        strategy.tip.seen.time += seconds
        yield

    strategy._press = press
    for _ in strategy._press_all(plan):
        pass
    return made, len(plan)


def test_a_quick_loop_makes_all_presses():
    made, planned = pressed(2.5)
    assert made == list(range(planned))


@pytest.mark.parametrize("seconds", [3.3, 3.8, 4.4, 5.1, 6.0, 7.5, 9.0])
def test_a_slow_loop_makes_fewer_of_what_tells_least_and_keeps_to_the_time(seconds):
    made, planned = pressed(seconds)
    assert len(made) * seconds < 275.0 - 2.0 * 40.0 + 4.0 * seconds
    kinds = np.bincount([k % 4 for k in made], minlength=4)
    across, between, along = kinds[[0, 2]], kinds[1], kinds[3]
    assert across.min() >= along >= between
    assert between >= 0.15 * across.max(), "of each kind some"
    assert along >= 0.3 * across.max()
    orientations = np.bincount([k // 4 for k in made], minlength=planned // 4)
    assert orientations.min() >= 1


def test_a_press_across_the_stick_stays_below_the_torque_at_which_the_guard_lets_go():
    strategy = ReferenceSphere.__new__(ReferenceSphere)
    given = task()
    strategy.task = SimpleNamespace(options=_Options(torque=0.096), probe=given.probe)
    strategy.tip = SimpleNamespace(rotation=DOWN)
    assert 0.05 * strategy._readable(np.array([0.0, 1.0, 0.0])) == pytest.approx(0.9 * 0.096)
    assert strategy._readable(np.array([0.6, 0.6, 0.53])) > 1.95, "each axis has its own"
    assert strategy._readable(np.array([0.0, 0.0, 1.0])) > 1e3, "along the stick no torque acts"


def test_each_press_knows_how_much_of_the_approach_speed_its_orientation_allows():
    shares = (1.0, 0.5)
    plan = sphere_touches(DOWN, LEANS[:2], 4, shares)
    assert [touch.speed_share for touch in plan] == [1.0] * 4 + [0.5] * 4
    with pytest.raises(InputError, match="speed_shares"):
        _Options(leans=LEANS, speed_shares=shares)
    with pytest.raises(InputError, match="speed_shares"):
        _Options(leans=LEANS[:2], speed_shares=(1.0, 0.0))
