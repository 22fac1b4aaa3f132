"""The arm weighs what hangs on the sensor."""

import numpy as np
import pytest

from lwrprobe.contracts import InputError
from lwrprobe.exploration.procedures.weigh import weigh
from lwrprobe.scene import load_scene


def test_mass_and_centre_are_found_from_the_bare_readings():
    real = load_scene(
        "block", ["truth.profile=ideal", "probe.mass=0.03", "probe.centre_of_mass=[0.001, -0.002, 0.035]"]
    )
    result = weigh(real)
    assert result.found.mass == pytest.approx(0.03, abs=2e-4)
    np.testing.assert_allclose(result.found.com, (0.001, -0.002, 0.035), atol=2e-4)
    np.testing.assert_allclose(result.found.bias[:3], (0.12, -0.08, 0.25), atol=5e-3)
    again = load_scene("block", result.settings()).probe
    assert again.mass == pytest.approx(0.03, abs=2e-4)


def test_a_start_with_no_room_to_lean_is_refused():
    far = ["truth.profile=ideal", "area.lower=[0.1, -0.05, 0.006]", "area.upper=[0.2, 0.05, 0.058]"]
    with pytest.raises(InputError, match="lean"):
        weigh(load_scene("block", far))
