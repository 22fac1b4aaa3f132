"""What no real arm may be asked is refused before anything is opened or moved."""

import pytest

from lwrprobe.contracts import InputError
from lwrprobe.exploration.procedures.explore import Exploration
from lwrprobe.scene import load_scene


@pytest.mark.parametrize("setting", ["area.search_for=0.04", "run.until.certified=1.0", "run.until.accurate=0.3"])
def test_what_needs_a_simulator_is_refused_with_a_real_arm(setting):
    devices = ['arm.driver="fri"', 'sensor.driver="ati"']
    with pytest.raises(InputError, match=setting.partition("=")[0]):
        Exploration(load_scene("block", [*devices, setting]))
