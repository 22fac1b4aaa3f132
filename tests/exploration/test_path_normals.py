"""Normals turned towards the path: where the path shows the surface, and nowhere else."""

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.path_normals import SHARE, turn_to_path
from lwrprobe.exploration.recording.recorder import Recorder

RADIUS, BEND = 0.005, 0.03
"""m, of the sphere, and of the path of its centre over a cylinder."""
WRONG = 0.02
"""rad."""


def over_a_cylinder(wrong, step=7e-5, period=0.008):
    """Contacts of a path over a cylinder along y, whose normals are turned along the path, and the true normals."""
    recorder, angles = Recorder(None), np.arange(-0.5, 0.5, step / BEND)
    true = np.column_stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)])
    for k, (angle, normal) in enumerate(zip(angles + wrong, true)):
        seen, centre = np.array([np.sin(angle), 0.0, np.cos(angle)]), BEND * normal
        recorder.contact(Contact(k * period, centre - RADIUS * seen, seen, 0.8 * seen, centre, 0.9), k)
    return recorder, true


def angle(recorder, true):
    """(n,) rad."""
    return np.linalg.norm(recorder.normals() - true, axis=1)


def test_a_bent_path_shows_the_normals_but_at_its_ends():
    recorder, true = over_a_cylinder(WRONG)
    turned = turn_to_path(recorder, RADIUS)
    assert angle(recorder, true)[turned] == pytest.approx((1.0 - SHARE) * WRONG, rel=0.01)
    assert angle(recorder, true)[~turned] == pytest.approx(WRONG, rel=0.01)
    assert 0 < (~turned).sum() < 20
    assert not turned[[0, -1]].any()
    for contact, normal in zip(recorder.contacts, true):
        assert contact.point + RADIUS * contact.normal == pytest.approx(BEND * normal, abs=1e-12), "about the centre"


def test_right_normals_stay():
    recorder, true = over_a_cylinder(0.0)
    assert turn_to_path(recorder, RADIUS).any()
    assert angle(recorder, true).max() < 1e-6


def test_what_is_aside_of_the_path_stays():
    recorder, _ = over_a_cylinder(0.0)
    aside = [contact.normal + np.array([0.0, WRONG, 0.0]) for contact in recorder.contacts]
    for contact, normal in zip(recorder.contacts, aside):
        contact.normal[:] = normal / np.linalg.norm(normal)
    before = recorder.normals()
    turn_to_path(recorder, RADIUS)
    assert recorder.normals() == pytest.approx(before, abs=1e-6)


@pytest.mark.parametrize(("wrong", "period"), [(0.2, 0.008), (WRONG, 0.1)], ids=["corner", "no path between them"])
def test_without_a_path_that_is_tangent_nothing_is_turned(wrong, period):
    recorder, true = over_a_cylinder(wrong, period=period)
    assert not turn_to_path(recorder, RADIUS).any()
    assert angle(recorder, true) == pytest.approx(2.0 * np.sin(0.5 * wrong), rel=1e-6)


def test_a_sphere_at_rest_has_no_path():
    recorder, rng = Recorder(None), np.random.default_rng(1)
    normal = np.array([0.0, 0.0, 1.0])
    for k in range(2000):
        centre = 2e-6 * rng.standard_normal(3)
        recorder.contact(Contact(0.008 * k, centre - RADIUS * normal, normal, normal, centre, 0.9), k)
    assert not turn_to_path(recorder, RADIUS).any()


def test_no_contacts_are_none():
    assert turn_to_path(Recorder(None), RADIUS).shape == (0,)
