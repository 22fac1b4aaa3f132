"""Rises of force: one for each touch, from the first sign of a force to its maximum."""

from types import SimpleNamespace

import numpy as np

from lwrprobe.contact import TouchRises


def fed(forces, threshold=0.2):
    rises = TouchRises(threshold)
    for k, force in enumerate(forces):
        wrench = SimpleNamespace(magnitude=force, usable=True, world_force=np.array([0.0, 0.0, force]))
        rises.update(wrench, np.array([0.0, 0.0, -1e-4 * force]), 0.008 * k)
    return rises.found


RISE = list(np.linspace(0.0, 0.8, 12))


def test_a_force_that_goes_on_is_no_new_touch():
    swings = 0.8 + 0.2 * np.sin(np.linspace(0.0, 60.0, 400))
    assert len(fed(RISE + list(swings))) == 1


def test_each_touch_from_free_space_is_one():
    found = fed(3 * [*RISE, *np.full(20, 0.7), 0.01, 0.01])
    assert len(found) == 3
    for rise in found:
        assert np.diff(rise.forces[:, 2]).min() > 0.0
        assert rise.forces[-1, 2] == 0.8
        assert rise.places[-1, 2] == -1e-4 * 0.8


def test_a_knock_of_few_samples_is_none():
    assert fed([0.0, 0.5, 0.9, 0.0, 0.0]) == []
