"""Normals turned towards the path: where the path shows the surface, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.path_normals import CHORD, CORNER, LARGEST, NEAR, SHARE, PathTurn, turn_to_path
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


def replaced(recorder):
    """Another recorder with the same contacts."""
    other = Recorder(None)
    other.contacts = list(recorder.contacts)
    return other


def angle(recorder, true):
    """(n,) rad."""
    return np.linalg.norm(recorder.normals() - true, axis=1)


@pytest.mark.parametrize("wrong", [0.005, WRONG, 0.2], ids=["slight", "noise", "a bad sensor"])
def test_a_bent_path_shows_the_normals_but_at_its_ends(wrong):
    recorder, true = over_a_cylinder(wrong)
    share = turn_to_path(recorder, RADIUS).share
    turned = share > 0.0
    assert (share[turned] >= SHARE).all()
    assert angle(recorder, true)[turned] == pytest.approx((1.0 - share[turned]) * wrong, rel=0.03, abs=1e-5)
    assert angle(recorder, true)[~turned] == pytest.approx(wrong, rel=0.01)
    assert 0 < (~turned).sum() < 20
    assert not turned[[0, -1]].any()
    for contact, normal in zip(recorder.contacts, true):
        assert contact.point + RADIUS * contact.normal == pytest.approx(BEND * normal, abs=1e-12), "about the centre"


def test_the_more_a_normal_is_off_the_more_it_is_the_normal_that_is_wrong():
    shares = [np.median(turn_to_path(over_a_cylinder(wrong)[0], RADIUS).share) for wrong in (0.005, WRONG, 0.2)]
    assert shares[0] == SHARE
    assert shares[0] < shares[1] < shares[2]
    assert shares[2] > 0.99


def test_touches_that_are_not_trusted_belong_to_the_path():
    recorder, true = over_a_cylinder(0.2)
    ends = [*recorder.contacts[:8], *recorder.contacts[-8:]]
    del recorder.contacts[:8], recorder.contacts[-8:]
    alone = turn_to_path(replaced(recorder), RADIUS).share
    for contact in ends:
        recorder.touch(contact, RADIUS)
    assert alone[[0, -1]] == pytest.approx(0.0)
    assert (turn_to_path(recorder, RADIUS).share > 0.9).all()
    assert angle(recorder, true[8:-8]).max() < 0.02


@pytest.mark.parametrize(("step", "known"), [(0.5 * NEAR, True), (2.0 * NEAR, False)], ids=["near", "far"])
def test_a_swing_off_the_surface_does_not_end_the_path(step, known):
    recorder, _ = over_a_cylinder(0.2)
    angles = np.array([np.arctan2(contact.centre[0], contact.centre[2]) for contact in recorder.contacts])
    gone = np.abs(angles) < 0.5 * step / BEND
    behind = int(np.flatnonzero(gone)[-1]) + 1
    recorder.leave_out(gone)
    recorder.contacts = [
        replace(contact, time=contact.time + (0.1 if angle > 0.0 else 0.0))
        for contact, angle in zip(recorder.contacts, angles[~gone])
    ]
    assert (turn_to_path(recorder, RADIUS).share[behind - gone.sum()] > 0.0) == known


def test_a_doubtful_normal_is_drawn_into_the_plane_of_force_and_path():
    recorder, true = over_a_cylinder(0.0)
    aside, friction = np.array([0.0, 0.1, 0.0]), 0.4
    tangents = np.cross([0.0, 1.0, 0.0], true)
    off = true + aside
    off /= np.linalg.norm(off, axis=1, keepdims=True)
    for confidence, left in ((0.999, 0.1), (0.6, 0.02)):
        recorder.contacts = [
            replace(
                c, normal=wrong, point=c.centre - RADIUS * wrong, force=n - friction * t, confidence_score=confidence
            )
            for c, n, t, wrong in zip(recorder.contacts, true, tangents, off)
        ]
        turned = turn_to_path(recorder, RADIUS).share > 0.0
        assert turned.any()
        found = angle(recorder, true)[turned]
        assert (found > 0.9 * left).all() if confidence > 0.9 else (found < left).all()


def test_right_normals_stay():
    recorder, true = over_a_cylinder(0.0)
    assert turn_to_path(recorder, RADIUS).share.any()
    assert angle(recorder, true).max() < 1e-6


def test_what_is_aside_of_the_path_stays_where_the_normal_is_certain():
    recorder, _ = over_a_cylinder(0.0)
    recorder.contacts = [replace(contact, confidence_score=1.0) for contact in recorder.contacts]
    aside = [contact.normal + np.array([0.0, WRONG, 0.0]) for contact in recorder.contacts]
    for contact, normal in zip(recorder.contacts, aside):
        contact.normal[:] = normal / np.linalg.norm(normal)
    before = recorder.normals()
    turn_to_path(recorder, RADIUS)
    assert recorder.normals() == pytest.approx(before, abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "period"), [(0.7, 0.008), (WRONG, 0.3)], ids=["another direction", "no path between them"]
)
def test_without_a_path_that_is_tangent_nothing_is_turned(wrong, period):
    recorder, true = over_a_cylinder(wrong, period=period)
    assert not turn_to_path(recorder, RADIUS).share.any()
    assert angle(recorder, true) == pytest.approx(2.0 * np.sin(0.5 * wrong), rel=1e-6)


def test_a_sphere_at_rest_has_no_path():
    recorder, rng = Recorder(None), np.random.default_rng(1)
    normal = np.array([0.0, 0.0, 1.0])
    for k in range(2000):
        centre = 2e-6 * rng.standard_normal(3)
        recorder.contact(Contact(0.008 * k, centre - RADIUS * normal, normal, normal, centre, 0.9), k)
    assert not turn_to_path(recorder, RADIUS).share.any()


def test_where_the_sphere_is_pressed_in_and_let_go_its_normals_stay():
    """On an edge the path to a press and none after it had turned right normals by 2.5 degrees."""
    angles = np.concatenate([np.arange(-0.5, 0.0, 0.01), np.linspace(0.0, 0.02, 120), np.arange(0.03, 0.5, 0.01)])
    depths = np.zeros(len(angles))
    depths[50:170] = 5e-5 * np.sin(np.arange(120) / 5.0)
    true = np.column_stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)])
    recorder = Recorder(None)
    for k, (normal, depth) in enumerate(zip(true, depths)):
        centre = (RADIUS - depth) * normal  # around an edge
        recorder.contact(Contact(0.008 * k, centre - RADIUS * normal, normal, 0.8 * normal, centre, 0.5), k)
    share = turn_to_path(recorder, RADIUS).share
    assert angle(recorder, true)[50:170].max() < 0.002
    assert share[20:35].min() >= SHARE, "before it the path is known"


def test_no_contacts_are_none():
    none = turn_to_path(Recorder(None), RADIUS)
    assert none.share.shape == none.left(*np.empty((2, 0))).shape == (0,)


def test_right_normals_beside_an_inner_corner_are_turned_by_less_than_a_corner():
    recorder, step = Recorder(None), 7e-5
    for k in range(200):
        floor = k < 100
        normal = np.array([0.0, 0.0, 1.0] if floor else [-1.0, 0.0, 0.0])
        centre = step * np.array([min(k, 100), 0.0, max(k - 100, 0)])
        recorder.contact(Contact(0.008 * k, centre - RADIUS * normal, normal, normal, centre, 0.9), k)
    before = recorder.normals()
    turned = turn_to_path(recorder, RADIUS)
    assert (np.abs(turned.off[turned.share == 0.0]) > CORNER).any()
    assert np.linalg.norm(recorder.normals() - before, axis=1).max() < SHARE * CORNER


def test_a_normal_is_no_surer_than_it_agrees_with_its_path():
    off = np.array([0.01, -0.2, -0.2, np.nan, 2.0])
    found = PathTurn(np.array([SHARE, SHARE, 0.0, 0.0, 0.0]), off)
    left = found.left(np.full(5, 0.03), np.zeros(5))
    assert left[0] == pytest.approx(np.hypot((1.0 - SHARE) * 0.03, SHARE * CHORD))
    assert left[1] == pytest.approx(np.hypot((1.0 - SHARE) * 0.2, SHARE * CHORD))
    assert left[2] == 0.2
    assert left[3] == pytest.approx(np.sqrt(np.mean([0.01**2, 0.2**2, 0.2**2, LARGEST**2]))), "as the others"
    assert left[4] == LARGEST
    assert PathTurn(np.zeros(2), np.full(2, np.nan)).left(*np.full((2, 2), 0.03)) == pytest.approx(0.03)
