"""The zero at the start of a run, and the stiffness that its first touches tell."""

import numpy as np
import pytest

from lwrprobe.contact import Deflection, TouchIdentification, Wrench, WrenchConditioner, agreed_bias
from lwrprobe.contact.touch_identification import series_compliance
from lwrprobe.contracts import Contact, Probe, WrenchSample

DOWN = np.diag([1.0, -1.0, -1.0])
OFFSET = np.array([0.12, -0.08, 0.25, 1e-3, -2e-3, 5e-4])
SLOWING = 0.06  # s
STICK = np.array([1 / 2.5e3, 1 / 2.5e3, 1 / 1.3e6])


class Place:
    """A probe that touches something until it has been moved away `leaves_after` times."""

    def __init__(self, force, leaves_after, louder=1.0):
        self.force, self.leaves_after, self.retreats = np.array(force), leaves_after, 0
        self.louder, self.rests = louder, 0
        self.random = np.random.default_rng(1)

    def listen(self):
        touch = np.zeros(6)
        if self.retreats < self.leaves_after:
            touch[:3] = self.force / (1 + self.retreats)
            touch[3:] = np.cross([0.0, 0.0, 0.05], touch[:3])
        noise = self.louder * np.repeat([3e-3, 1.6e-5], 3)
        self.rests += 1
        rows = OFFSET + touch + noise * self.random.normal(size=(100, 6))
        return [WrenchSample(k / 125.0, row[:3], row[3:], k) for k, row in enumerate(rows)]

    def retreat(self):
        self.retreats += 1


@pytest.mark.parametrize(("force", "leaves_after"), [((0, 0, 0), 0), ((0, 0, -0.1), 1), ((1.0, 0, -2.0), 3)])
def test_the_bias_is_that_of_free_space_whatever_was_touched_at_first(force, leaves_after):
    place, conditioner = Place(force, leaves_after), WrenchConditioner(Probe(), 125.0)
    found = agreed_bias(conditioner, place.listen, place.retreat, DOWN)
    assert found.outcome.taken
    assert found.touched == (leaves_after > 0)
    assert found.retreats == place.retreats == leaves_after + 1
    np.testing.assert_allclose(conditioner.bias, OFFSET, atol=2e-3)


@pytest.mark.parametrize("seed", range(10))
def test_a_louder_sensor_is_listened_to_for_longer(seed):
    place, conditioner = Place((0, 0, 0), 0, louder=4.0), WrenchConditioner(Probe(), 125.0)
    place.random = np.random.default_rng(seed)
    found = agreed_bias(conditioner, place.listen, place.retreat, DOWN)
    assert found.outcome.taken
    assert found.retreats == 1
    assert 6 <= place.rests <= 8  # 0.25 of one reading's noise take 16^2 / 100 rests at each place
    np.testing.assert_allclose(conditioner.bias[:3], OFFSET[:3], atol=4 * 0.25 * 3.3e-3)


def test_a_touch_that_does_not_end_gives_no_bias():
    place, conditioner = Place((0, 0, -3.0), 99), WrenchConditioner(Probe(), 125.0)
    found = agreed_bias(conditioner, place.listen, place.retreat, DOWN, max_retreats=3)
    assert not found.outcome.taken
    assert found.touched
    assert found.outcome.reason == "touching"


def press(stiffness, normal, damping=0.0, delay=0.0, top=0.8, noise=3e-3, seed=1):
    """Samples of a press that slows down, at 125 Hz: (wrench, pose, contact) each."""
    random = np.random.default_rng(seed)
    normal = np.array(normal, dtype=float)
    series = 1.0 / stiffness + float(np.dot(normal, Deflection(Probe(compliance=STICK)).shift(DOWN, normal)))
    depth = 1.1 * top * series
    times = np.arange(0.0, 0.4, 0.008)

    def travel(t):
        return depth * (1.0 - np.exp(-np.maximum(t, 0.0) / SLOWING))

    for k, t in enumerate(times):
        speed = (travel(t + 1e-5) - travel(t - 1e-5)) / 2e-5
        force = max(travel(t) / series + damping * speed, 0.0) + noise * random.normal()
        pose = np.eye(4)
        pose[:3, :3] = DOWN
        pose[:3, 3] = 0.1 - travel(t - delay) * normal
        world = force * normal
        wrench = Wrench(t, DOWN.T @ world, np.zeros(3), world, k)
        contact = Contact(t, pose[:3, 3], normal, world, pose[:3, 3], 0.9, "") if force > 0.2 else None
        yield wrench, pose, contact


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0)])
@pytest.mark.parametrize(("damping", "delay"), [(0.0, 0.0), (3.0, 0.0), (0.0, 0.004)])
def test_a_soft_object_is_told_from_the_stick(normal, damping, delay):
    touch = TouchIdentification(Deflection(Probe(compliance=STICK)), 0.2)
    assert not touch.settled
    changed = [touch.update(*sample) for sample in press(800.0, normal, damping, delay)]
    assert sum(changed) == 1
    assert touch.settled
    # Force and speed go in step here, so damping and delay cannot be distinguished from stiffness.
    own = Deflection(Probe(compliance=STICK)).along(DOWN, np.array(normal, dtype=float))
    series = (1 / 800.0 + own) * (1.0 + delay / SLOWING)
    seen = 1.0 / (1.0 / series - damping / SLOWING) if damping else series
    assert touch.compliance == pytest.approx(seen - own, rel=0.04)


def touched(stiffnesses, normal=(0, 0, 1), noise=3e-3, first_seed=1):
    """What touches of these stiffnesses, one after the other, are fitted to."""
    touch = TouchIdentification(Deflection(Probe(compliance=STICK)), 0.2)
    for k, stiffness in enumerate(stiffnesses):
        for wrench, pose, contact in press(stiffness, normal, noise=noise, seed=first_seed + k):
            wrench.time += k
            touch.update(wrench, pose, contact)
        off = Wrench(k + 0.9, np.zeros(3), np.zeros(3), np.zeros(3), 999)
        touch.update(off, np.eye(4), None)
    return touch


@pytest.mark.parametrize("wrong", [300.0, 2500.0])
def test_one_wrong_touch_among_several_counts_for_nothing(wrong):
    touch = touched([800.0, wrong, 800.0])
    assert touch.fitted == 3
    assert touch.agreed == 2
    assert touch.certain
    assert touch.compliance == pytest.approx(1 / 800.0, rel=0.05)


def test_touches_that_contradict_one_another_are_not_certain():
    assert not touched([800.0, 300.0]).certain
    assert not touched([300.0, 600.0, 1200.0, 2400.0]).certain


@pytest.mark.parametrize("noise", [3e-3, 9e-3])
def test_a_correction_errs_by_no_more_than_its_uncertainty_says(noise):
    errors = []
    for seed in range(20):
        touch = touched([600.0, 600.0, 600.0], noise=noise, first_seed=1 + 3 * seed)
        assert touch.certain
        errors.append(abs(touch.compliance - 1 / 600.0) / touch.sigma)
    assert np.mean(np.array(errors) < 2.0) >= 0.95


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0)])
def test_a_stiff_object_is_left_alone(normal):
    touch = TouchIdentification(Deflection(Probe(compliance=STICK)), 0.2)
    for sample in press(1e5, normal):
        touch.update(*sample)
    assert touch.settled
    assert touch.compliance == 0.0


def test_sliding_on_with_a_wrong_normal_is_not_taken_for_sinking_in():
    """A normal that is 0.3 rad off sees a slide of 20 mm/s as 6 mm/s into the surface."""
    tilted = np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    found = []
    for normal_error in (0.3, 0.0):
        touch = TouchIdentification(Deflection(Probe(compliance=STICK)), 0.2, normal_error)
        for wrench, pose, contact in press(1e5, (0, 0, 1)):
            pose[0, 3] -= 0.02 * wrench.time
            if contact is not None:
                contact.normal = tilted
            touch.update(wrench, pose, contact)
        found.append(touch.compliance)
    assert found[0] == 0.0
    assert found[1] > 1e-4


def test_a_press_that_tells_nothing_is_none():
    t = np.arange(10) * 0.008
    assert series_compliance(t[:3], t[:3], t[:3]) is None
    assert series_compliance(t, np.zeros(10), np.ones(10)) is None
    assert series_compliance(np.zeros(10), t, t) is None
    assert series_compliance(t, t, np.full(10, 2.0)) is None
    assert series_compliance(t, t / 500.0, t)[0] == pytest.approx(1 / 500.0)  # even: speed and offset are one
    depths = 1e-3 * t**2
    assert series_compliance(t, depths, 500.0 * depths)[0] == pytest.approx(1 / 500.0)


@pytest.mark.parametrize("tilt", [-0.1, 0.0, 0.1])
def test_a_sphere_that_slides_on_while_it_sinks_in_does_not_mislead(tilt):
    """Pressed first, then slid along: a wrong normal turns the slide into way."""
    t = np.arange(0.0, 0.24, 0.008)
    force = 0.1 + 0.9 * (1.0 - np.exp(-t / 0.08))
    aside = 0.02 * np.maximum(t - 0.04, 0.0)
    depths = force / 700.0 - tilt * aside + 5e-6 * np.random.default_rng(2).normal(size=len(t))
    held_against = series_compliance(t, depths, force, aside, 0.04)[0]
    assert held_against == pytest.approx(1 / 700.0, rel=0.12)
    if tilt:
        assert abs(series_compliance(t, depths, force)[0] * 700.0 - 1.0) > 2.0 * abs(held_against * 700.0 - 1.0)
