"""Touching one place again and again: figures against what was put in."""

import numpy as np
import pytest

from lwrprobe.contracts import InputError, SafetyStop
from lwrprobe.exploration.procedures.repeat import Plan, Touch, repeat, statistics
from lwrprobe.scene import load_scene


def test_statistics_against_the_naive():
    random = np.random.default_rng(5)
    touches = [Touch(v, x, (y, 0.0), 0.3) for v in (0.002, 0.004) for x, y in 1e-4 * random.normal(size=(20, 2))]
    touches += [Touch(0.008, 0.001 + x, (0.0, 0.0), 0.3) for x in 1e-5 * np.arange(3)]
    slow, middle, fast = statistics(touches)
    first = np.array([t.place for t in touches[:20]])
    assert slow["bias_mm"] == pytest.approx(0.0, abs=1e-12)
    assert slow["sigma_mm"] == pytest.approx(1e3 * np.std(first, ddof=1))
    assert slow["range_mm"] == pytest.approx(1e3 * (first.max() - first.min()))
    assert middle["touches"] == 20
    assert fast["bias_mm"] == pytest.approx(1e3 * (0.00101 - first.mean()))
    assert fast["range_mm"] == pytest.approx(0.02)
    assert slow["sigma_across_mm"] == pytest.approx(1e3 * np.std([t.aside[0] for t in touches[:20]], ddof=1))


@pytest.mark.slow
def test_top_of_the_block_repeats():
    plan = Plan(above=np.array([0.0, 0.0, 0.056]), count=3)
    found = repeat(load_scene("block", ["truth.profile=ideal"]), plan)
    rows = found["speeds"]
    assert [row["touches"] for row in rows] == [3, 3, 3]
    assert max(abs(row["bias_mm"]) for row in rows) < 0.1
    assert max(row["sigma_mm"] for row in rows) < 0.05
    assert found["summary"]["peak_force_n"] <= 3.0
    assert found["summary"]["link_collisions"] == 0


def test_bad_plans_are_named():
    with pytest.raises(InputError, match="direction"):
        Plan(direction=[0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="count"):
        Plan(count=1)
    for reach in (0.0, -0.01, np.nan, np.inf):
        with pytest.raises(InputError, match="reach"):
            Plan(reach=reach)
    with pytest.raises(InputError, match="positive speeds"):
        Plan(speeds=(0.001, -1.0))
    with pytest.raises(InputError, match="the force limit would be passed"):
        repeat(load_scene("block", ["truth.profile=ideal"]), Plan(speeds=(0.5,)))


@pytest.mark.slow
def test_nothing_there_is_said():
    plan = Plan(above=np.array([0.0, 0.0, 0.09]), reach=0.01, speeds=(0.001,), count=2)
    with pytest.raises(SafetyStop, match="nothing was touched within 10 mm"):
        repeat(load_scene("empty"), plan)
