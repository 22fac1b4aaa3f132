"""What would be driven, without a device."""

import pytest

from lwrprobe.exploration.procedures.dry_run import dry_run
from lwrprobe.scene import load_scene

SMALL = ["area.lower=[-0.006, -0.045, 0.006]", "area.upper=[0.006, 0.045, 0.058]", "strategy.step=0.012"]
REAL = ['arm.driver="fri"', 'sensor.driver="ati"', "run.time_limit=20.0"]


def by_name(found):
    return {reading.name: reading for reading in found.readings}


@pytest.mark.slow
def test_real_scene_is_driven_in_the_simulator_at_the_arms_own_cycle():
    found = dry_run(load_scene("empty", [*SMALL, *REAL, "run.time_limit=600.0"]))
    lines = by_name(found)
    assert found.summary["status"] == "done"
    assert found.good, [r.value for r in found.readings if not r.good]
    assert {"fri", "ati"}.isdisjoint(found.summary["devices"])
    assert 0.0 < max(found.summary["limits_used"].values()) < 1.0
    assert "10.0 ms" not in lines["stability number"].value, "sensor and arm both delay"
    assert lines["stability number"].detail["S"] == pytest.approx(0.368, abs=0.001)


def test_what_is_wrong_is_marked():
    found = dry_run(load_scene("empty", [*SMALL, *REAL, "safety.tip_speed=0.01", "area.upper=[0.006, 0.5, 0.058]"]))
    lines = by_name(found)
    assert not found.good
    assert not lines["run"].good
    assert "the tip would move at" in lines["run"].value
