"""Compliance of arm and object along the stick, from changes of force and depth."""

import numpy as np
import pytest

from lwrprobe.contact import Deflection, PressCompliance, Wrench
from lwrprobe.contracts import Contact, Probe

DOWN = np.diag([1.0, -1.0, -1.0])
UP = np.array([0.0, 0.0, 1.0])
AXIAL = 8e-7


def pressed(compliance, noise=0.003, slide=0.0, wrong=0.0, samples=600, seed=1, normal=UP, rate=125.0):
    """A sphere that is pressed up and down while it slides along y, the normal wrong by an angle."""
    random = np.random.default_rng(seed)
    watch = PressCompliance(Deflection(Probe(compliance=np.array([4e-4, 4e-4, AXIAL]))), rate)
    shown = np.array([0.0, np.sin(wrong), np.cos(wrong)]) if wrong else normal
    for k in range(samples):
        time = k / rate
        size = 1.0 + 0.5 * np.sin(0.32 * rate * time)
        force = size * normal + noise * random.standard_normal(3)
        pose = np.eye(4)
        pose[:3, :3] = DOWN
        pose[:3, 3] = [0.0, slide * time, 0.0] - (compliance + AXIAL) * size * normal
        contact = Contact(time, pose[:3, 3], shown, force, pose[:3, 3], 0.9)
        watch.update(Wrench(time, DOWN.T @ force, np.zeros(3), force, k, 0), pose, contact)
    return watch


@pytest.mark.parametrize("compliance", [3e-5, 5e-5, 2e-4])
@pytest.mark.parametrize("wrong", [0.0, 0.01])
def test_the_slope_is_the_compliance_whatever_slides(compliance, wrong):
    watch = pressed(compliance, slide=0.01, wrong=wrong)
    assert watch.batches >= 10
    assert watch.value == pytest.approx(compliance, rel=0.15)
    assert abs(watch.value - compliance) < 3.0 * watch.sigma


def test_a_slow_sensor_shows_it_as_well():
    watch = pressed(5e-5, rate=20.0)
    assert watch.batches >= 10
    assert watch.value == pytest.approx(5e-5, rel=0.15)


def test_one_batch_says_nothing_certain():
    watch = pressed(5e-5, samples=14)
    assert watch.batches == 1
    assert watch.value > 0.0
    assert watch.sigma == float("inf")


def test_depth_without_force_is_no_compliance():
    assert pressed(5e-5, slide=0.2, wrong=0.1, seed=2).batches < 3 * pressed(5e-5).batches / 4


def test_across_the_stick_nothing_is_learnt():
    assert pressed(5e-5, normal=np.array([0.0, 1.0, 0.0])).batches == 0


def test_batches_on_a_slope_where_the_normal_is_wrong_do_not_make_the_surface_stiff():
    """Beside the stick's axis a wrong normal takes more off the slope than arm and object have."""
    watch = PressCompliance(Deflection(Probe(compliance=np.array([4e-4, 4e-4, AXIAL]))), 125.0)
    random, time = np.random.default_rng(3), 0.0
    for batch in range(12):
        tilt = 0.36 if batch % 2 else 0.05
        normal = np.array([0.0, np.sin(tilt), np.cos(tilt)])
        shown = np.array([0.0, np.sin(tilt + 0.06), np.cos(tilt + 0.06)])
        give = 3e-5 * normal + watch._bend.shift(DOWN, normal)
        for k in range(11):
            time += 1.0 / 125.0
            size = 1.0 + 0.3 * (k % 2)
            force = size * normal + 0.003 * random.standard_normal(3)
            pose = np.eye(4)
            pose[:3, :3] = DOWN
            pose[:3, 3] = -give * size
            contact = Contact(time, pose[:3, 3], shown, force, pose[:3, 3], 0.9)
            watch.update(Wrench(time, DOWN.T @ force, np.zeros(3), force, k, 0), pose, contact)
        time += 1.0
    assert watch.batches >= 8
    assert watch.value == pytest.approx(3e-5, rel=0.3)
    assert abs(watch.value - 3e-5) < 2.0 * watch.sigma


@pytest.mark.parametrize("friction", [0.4, -0.4])
@pytest.mark.parametrize("tilt", [0.1, 0.3])
def test_friction_on_a_slope_bends_the_stick_and_not_the_surface(tilt, friction):
    """Down a slope friction holds against what bends the stick, up a slope it adds to it."""
    bend = Deflection(Probe(compliance=np.array([4e-4, 4e-4, AXIAL])))
    watch, random = PressCompliance(bend, 125.0), np.random.default_rng(4)
    normal, tangent = np.array([0.0, np.sin(tilt), np.cos(tilt)]), np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    for k in range(600):
        size = 1.0 + 0.5 * np.sin(0.32 * k)
        load = size * (normal + friction * tangent)
        force = load + 0.003 * random.standard_normal(3)
        pose = np.eye(4)
        pose[:3, :3] = DOWN
        pose[:3, 3] = 4e-5 * k * tangent - 5e-5 * size * normal - bend.shift(DOWN, load)
        contact = Contact(k / 125.0, pose[:3, 3], normal, force, pose[:3, 3], 0.9)
        watch.update(Wrench(k / 125.0, DOWN.T @ force, np.zeros(3), force, k, 0), pose, contact)
    assert watch.batches >= 10
    assert watch.value == pytest.approx(5e-5, rel=0.15)


def test_a_median_below_zero_is_no_rigid_surface():
    watch = pressed(5e-5)
    watch._slopes = [2e-5, -2e-5, 1e-5, -3e-5, -1e-6]
    watch._sigmas = [1e-5] * 5
    assert 0.3 * watch.sigma < watch.value < watch.sigma
