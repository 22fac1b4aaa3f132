"""Where the stick is touched, from the wrench alone."""

import numpy as np
import pytest

from lwrprobe.contact import Wrench, stick_contact
from lwrprobe.contracts import Probe

PROBE = Probe()
DOWN = np.diag([1.0, -1.0, -1.0])


def wrench(point, force):
    """That of one force on the probe at a point of the sensor frame."""
    force, point = np.array(force), np.array(point)
    return Wrench(0.0, force, np.cross(point, force), force)


@pytest.mark.parametrize("behind", [0.006, 0.02, 0.045])
@pytest.mark.parametrize("direction", [0.0, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("slip", [0.0, 0.3, -0.3])
def test_the_point_on_the_stick_is_found_with_and_without_friction_along_it(behind, direction, slip):
    out = np.array([np.cos(direction), np.sin(direction), 0.0])
    touched = -PROBE.stick_radius * out + [0.0, 0.0, PROBE.sensor_distance - behind]
    centre = np.array([0.01, 0.02, 0.03])
    found = stick_contact(wrench(touched, 0.7 * out + [0.0, 0.0, 0.7 * slip]), centre, DOWN, PROBE)
    expected = centre + DOWN @ (touched - [0.0, 0.0, PROBE.sensor_distance])
    assert found == pytest.approx(expected, abs=1e-9)
    assert found[2] > centre[2], "the stick stands above the sphere"


@pytest.mark.parametrize(
    ("point", "force"),
    [
        ([0.0, 0.0, 0.055], [0.0, 0.0, -1.0]),
        ([-0.005, 0.0, 0.05], [1.0, 0.0, 0.0]),
        ([-0.002, 0.0, -0.01], [1.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ],
)
def test_a_force_on_the_sphere_or_behind_the_sensor_is_none_of_the_stick(point, force):
    assert stick_contact(wrench(point, force), np.zeros(3), DOWN, PROBE) is None
