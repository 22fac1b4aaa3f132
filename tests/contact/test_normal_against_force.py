"""A surface only pushes: no estimate of a normal is left against the force that it comes from."""

import numpy as np
import pytest

from lwrprobe.contact import kernels as k


def delivered(normal, force, sigma=0.05):
    given, params, out = np.zeros(64), np.zeros(64), np.zeros(k.OUTPUT)
    params[k.P_RADIUS], params[k.P_TRUSTED_ERROR] = 2.5e-3, 0.1
    given[k.I_CENTRE : k.I_CENTRE + 3] = 0.1, 0.2, 0.3
    out[k.O_FORCE : k.O_FORCE + 3] = force
    reason = k.deliver_world(given, np.array(normal), sigma, params, out)
    return reason, out


def test_a_normal_against_the_force_is_replaced_by_the_forces_direction_and_enters_no_map():
    force = np.array([-0.17, -0.04, 0.10])
    reason, out = delivered([0.59, 0.16, -0.79], force)
    along = force / np.linalg.norm(force)
    assert out[k.O_NORMAL : k.O_NORMAL + 3] == pytest.approx(along)
    assert out[k.O_POINT : k.O_POINT + 3] == pytest.approx(np.array([0.1, 0.2, 0.3]) - 2.5e-3 * along)
    assert reason == k.IMPRECISE
    assert 0.1 < out[k.O_CONFIDENCE] < 0.5, "neither for the map nor for a stick that touches"


def test_a_normal_that_friction_explains_stays():
    normal = np.array([0.6, 0.0, 0.8])
    reason, out = delivered(normal, [0.2, 0.0, 0.9])
    assert reason == k.GOOD
    assert out[k.O_NORMAL : k.O_NORMAL + 3] == pytest.approx(normal)
    assert out[k.O_SIGMA] == 0.05
