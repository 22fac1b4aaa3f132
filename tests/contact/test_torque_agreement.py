"""Disagreement of torque and force, learnt while the sphere slides."""

import naive_torque
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lwrprobe.contact import TorqueAgreement, Wrench, torque_kernels
from lwrprobe.contracts import Probe

PROBE = Probe(radius=0.005, sensor_distance=0.05)
EXPECTED = np.array([4.5e-4, 4.5e-4, 8e-5])
ZERO = 3e-4


def wrong(scale, seed=5):
    """(3, 3) m, errors of torque over force."""
    return scale * EXPECTED * np.random.default_rng(seed).standard_normal((3, 3))


def slid(matrix, seconds=60.0, friction=0.3, seed=2, agreement=None, rate=125.0):
    """A sphere that slides over faces of a box with friction, under a zero that wanders."""
    random = np.random.default_rng(seed)
    watch = agreement or TorqueAgreement(PROBE, EXPECTED, ZERO, 0.02, rate)
    zero, normal, path = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(int(rate * seconds)):
        if k % int(2 * rate) == 0:
            zero = ZERO * random.standard_normal(3) / 2.0
            normal = np.eye(3)[random.integers(3)] * random.choice([-1.0, 1.0])
            path = np.cross(normal, random.standard_normal(3))
            path /= np.linalg.norm(path)
        force = 0.8 * (normal - friction * path) + 0.003 * random.standard_normal(3)
        point = np.array([0.0, 0.0, 0.05]) - 0.005 * normal
        torque = np.cross(point, force) + matrix @ force + zero
        watch.learn(Wrench(k / rate, force, torque, force, k, 0), np.eye(3), 0.02 * path)
    return watch


def test_a_slow_sensor_shows_it_as_well():
    matrix, force = wrong(1.0), np.array([0.0, 1.0, 0.0])
    left, _ = slid(matrix, rate=10.0).corrected(Wrench(0.0, force, matrix @ force, force, 0, 0))
    assert np.abs(left.torque).max() < 0.5 * np.abs(matrix @ force).max()


@pytest.mark.parametrize("behind", [0.012, 0.018, 0.030])
def test_a_stick_that_slides_over_an_edge_teaches_nothing(behind):
    watch = TorqueAgreement(PROBE, EXPECTED, ZERO, 0.02)
    force = np.array([-0.01, 0.70, 0.21])  # friction up the stick, on the way down
    point = np.array([0.0, -PROBE.stick_radius, 0.05 - behind])
    for k in range(250):
        wrench = Wrench(k / 125.0, force, np.cross(point, force), force, k, 0)
        watch.learn(wrench, np.eye(3), np.array([0.0, 0.0, -0.005]))
    assert watch.surprise == 1.0
    assert watch.disagreement == 0.0


def test_what_agrees_is_left_alone():
    watch = slid(np.zeros((3, 3)))
    assert watch.surprise == 1.0
    assert watch.disagreement < 0.005
    force = np.array([0.3, -0.2, 1.0])
    wrench = Wrench(0.0, force, np.array([0.01, 0.02, 0.0]), force, 0, 0)
    assert np.abs(watch.corrected(wrench)[0].torque - wrench.torque).max() < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5, 10))
def test_an_expected_error_is_found_within_its_standard_deviation(seed):
    matrix = wrong(1.0, seed)
    watch = slid(matrix, seed=seed)
    for force in np.eye(3):
        wrench = Wrench(0.0, force, matrix @ force, force, 0, 0)
        left, error = watch.corrected(wrench)
        assert np.abs(left.torque).max() < 3.5 * error
        assert error < EXPECTED[np.argmax(force)]


def test_an_error_far_beyond_the_expected_is_found_said_and_weighted_down_at_once():
    matrix = wrong(8.0)
    force = np.array([0.8, 0.0, 0.0])
    early = slid(matrix, seconds=0.6)
    _, error = early.corrected(Wrench(0.0, force, np.zeros(3), force, 0, 0))
    assert error > 1.5 * EXPECTED[0] or early.disagreement > 0.02
    late = slid(matrix)
    assert late.surprise > 2.0
    assert late.disagreement == pytest.approx(np.sqrt((matrix**2).sum(axis=0)).max() / 0.05, rel=0.25)


@pytest.mark.parametrize(("share", "doubted"), [(0.02, False), (0.1, True)])
def test_a_sensor_stated_as_bad_is_doubted_where_it_is_bad(share, doubted):
    """Expected or not: touches before the error was learnt have wrong normals, and must not tell of the object."""
    lever = PROBE.sensor_distance
    stated = TorqueAgreement(PROBE, np.full(3, share * lever), ZERO, 0.02)
    watch = slid(share * lever * np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), agreement=stated)
    assert watch.surprise == 1.0
    assert (watch.doubt > 0.0) is doubted


def test_a_probe_that_sticks_or_lands_teaches_nothing():
    watch = TorqueAgreement(PROBE, EXPECTED, ZERO, 0.02)
    matrix = wrong(5.0)
    for k in range(500):
        force = np.array([0.0, 0.1, 0.8]) * (1.0 + 0.3 * (k % 2))
        watch.learn(Wrench(k / 125.0, force, matrix @ force, force, k, 0), np.eye(3), np.array([0.0, -0.02, 0.0]))
        watch.learn(Wrench(k / 125.0 + 1e-3, force, matrix @ force, force, k, 0), np.eye(3), np.zeros(3))
    assert watch.disagreement == 0.0


@given(st.integers(0, 2**32 - 1))
def test_kernels_agree_with_their_textbook_form(seed):
    random = np.random.default_rng(seed)
    half = random.standard_normal((3, 3))
    covariance, matrix = 1e-7 * half @ half.T, 1e-3 * random.standard_normal((3, 3))
    turn = np.eye(4)
    turn[:3, :3], _ = np.linalg.qr(random.standard_normal((3, 3)))
    rotation = turn[:3, :3]
    path = random.standard_normal(3)
    path /= np.linalg.norm(path)
    force = random.uniform(0.1, 2.0) * (np.cross(path, random.standard_normal(3)) - random.uniform(0.0, 1.0) * path)
    torque, velocity = 0.05 * random.standard_normal(3), random.uniform(0.001, 0.05) * rotation @ path
    out = np.empty(3)
    error = torque_kernels.correct(matrix, covariance, 1.5, force, torque, out)
    expected, sigma = naive_torque.correct(matrix, covariance, 1.5, force, torque)
    assert np.allclose(out, expected, rtol=0.0, atol=1e-15)
    assert error == pytest.approx(sigma, rel=1e-9)

    params = np.array([0.005, 0.05, 1e-4, 1e-4, 1e-6, ZERO, 0.02, 0.05])
    state = np.array([1.0, np.linalg.norm(force) * random.uniform(0.85, 1.15), 0.02, 1.0])
    information, sums = random.standard_normal((4, 4)), random.standard_normal((4, 3))
    time = 1.0 + random.uniform(-0.01, 0.06)
    given_values = (matrix, covariance, time, force, torque, rotation, velocity)
    wanted = naive_torque.learn(params, state, information, sums, *given_values)
    used = torque_kernels.learn(params, state, information, sums, *given_values)
    assert used == wanted[0]
    for found, value in zip((state, information, sums), wanted[1:]):
        assert np.allclose(found, value, rtol=1e-9, atol=1e-12)
