"""Deflection, zero force, time skew and the probe's self-check: the tip is where it is, and when."""

import naive_contact as naive
import numpy as np
import pytest

from lwrprobe.contact import Deflection, check_probe, make_estimator, time_skew, zero_force_point
from lwrprobe.contracts import InputError, Probe

STICK = np.array([4e-4, 4e-4, 8e-7])  # a printed stick: 2.5e3 N/m across, 1.25e6 along


# Deflection


def test_deflection_is_the_dense_product_for_stick_and_arm():
    rng = np.random.default_rng(0)
    joints = np.full(7, 2e-5)
    deflection = Deflection(Probe(compliance=STICK), joints)
    for _ in range(50):
        rotation, force, jacobian = naive.random_rotation(rng), rng.normal(size=3), rng.normal(size=(6, 7))
        expected = rotation @ np.diag(STICK) @ rotation.T @ force
        expected = expected + jacobian[:3] @ np.diag(joints) @ jacobian[:3].T @ force
        np.testing.assert_allclose(deflection.shift(rotation, force, jacobian), expected, atol=1e-15)
        centre = rng.normal(size=3)
        np.testing.assert_allclose(deflection.centre(centre, rotation, force, jacobian), centre + expected, atol=1e-12)


def test_deflection_takes_any_layout_of_its_inputs_and_a_rigid_probe_costs_nothing():
    pose = np.asfortranarray(np.eye(4))
    force = np.arange(6.0)[::2]
    np.testing.assert_allclose(Deflection(Probe(compliance=STICK)).shift(pose[:3, :3], force), STICK * force)
    nominal = np.ones(3)
    rigid = Deflection(Probe())
    assert rigid.rigid
    assert rigid.centre(nominal, np.eye(3), force) is nominal


def test_give_along_a_direction_is_soft_across_and_stiff_along_the_stick():
    deflection = Deflection(Probe(compliance=STICK))
    rotation = naive.random_rotation(np.random.default_rng(1))
    assert deflection.along(rotation, rotation[:, 0]) == pytest.approx(STICK[0])
    assert deflection.along(rotation, rotation[:, 2]) == pytest.approx(STICK[2])
    oblique = naive.unit(rotation[:, 0] + rotation[:, 2])
    assert deflection.along(rotation, oblique) == pytest.approx(0.5 * (STICK[0] + STICK[2]))


def test_bad_compliances_are_refused():
    for bad in (-1e-4, np.nan):
        with pytest.raises(InputError, match=r"probe.compliance"):
            Deflection(Probe(compliance=np.array([bad, 0.0, 0.0])))
    with pytest.raises(InputError, match="joint_compliance"):
        Deflection(Probe(), [1e-5, -1e-5])
    with pytest.raises(InputError, match="jacobian"):
        Deflection(Probe(), [1e-5] * 7).shift(np.eye(3), np.ones(3))


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_contact_points_with_a_soft_stick_are_within_a_tenth_of_a_millimetre(mu):
    """A block's faces, 1 N, 2.5e3 N/m across: 0.4 mm off uncompensated, <= 0.10 mm median compensated."""
    rng = np.random.default_rng(1)
    probe = Probe(compliance=STICK)
    deflection, down = Deflection(probe), np.diag([1.0, -1.0, -1.0])
    errors, plain = [], []
    for n, along in ((np.array([0, 0, 1.0]), 1), (np.array([0, -1.0, 0]), 2), (np.array([1.0, 0, 0]), 1)):
        direction = np.eye(3)[along]
        estimator = make_estimator("fused", probe)
        for k in range(60):
            force = n - mu * direction
            wrench = naive.contact_wrench(probe, down, [(n, force)], k * 0.008, rng)
            truth = probe.radius * n + direction * 1.6e-4 * k
            nominal = truth - down @ (probe.compliance * (down.T @ force))
            velocity = 0.02 * direction + 3e-4 * rng.normal(size=3)
            centre = deflection.centre(nominal, down, wrench.world_force)
            errors.append(estimator.estimate(wrench, centre, down, velocity).point - (truth - probe.radius * n))
            plain.append(nominal - probe.radius * n - (truth - probe.radius * n))
    assert np.median(np.linalg.norm(errors, axis=1)) <= 1e-4
    assert np.median(np.linalg.norm(plain, axis=1)) > 1.2e-4


@pytest.mark.parametrize("stiffness", [1e2, 1e3, 1e4, 1e5])
def test_a_touch_is_extrapolated_to_zero_force(stiffness):
    """Also on foam (1e2 N/m), where 1 N is an indentation of 10 mm."""
    rng = np.random.default_rng(3)
    x = np.linspace(-0.2, 1.0, 120) / stiffness
    f = np.maximum(stiffness * (x - 0.1 / stiffness), 0.0) + 0.003 * rng.normal(size=x.size)
    fit = zero_force_point(0.5 + x, f)
    assert fit.stiffness == pytest.approx(stiffness, rel=0.03)
    assert abs(fit.zero - 0.5 - 0.1 / stiffness) < 0.01 / stiffness
    assert abs(fit.zero - 0.5 - 0.1 / stiffness) < 5 * fit.zero_sigma
    assert not fit.hertzian


def test_hertz_contact_behind_a_stick_is_recognised():
    """Foam under a 5 mm sphere: 1 N indents 0.155 mm; a straight line would miss the zero by tens of micrometres."""
    rng = np.random.default_rng(4)
    f = np.linspace(0.06, 2.0, 200)
    x = 0.02 + f / 2.5e3 + 0.155e-3 * f ** (2 / 3) + 0.003 / 2.5e3 * rng.normal(size=f.size)
    fit = zero_force_point(x, f)
    assert fit.hertzian
    assert abs(fit.zero - 0.02) < 1e-5
    assert fit.stiffness == pytest.approx(1 / (1 / 2.5e3 + 2 / 3 * 0.155e-3 * 2.0 ** (-1 / 3)), rel=0.03)


@pytest.mark.parametrize(
    ("x", "f"),
    [
        (np.zeros(10), np.zeros(10)),
        (np.arange(10.0), np.full(10, 1.0)),
        (np.arange(10.0), -np.arange(10.0)),
        (np.arange(10.0), 2.0 - 0.1 * np.arange(10.0)),
        (np.arange(10.0), np.full(10, np.nan)),
        (np.arange(9.0), np.arange(10.0)),
        (np.arange(3.0), np.arange(3.0)),
    ],
)
def test_what_is_no_touch_is_refused(x, f):
    with pytest.raises(InputError):
        zero_force_point(x, f)


# Time skew


def scan(delay, rate=125.0, speed=0.02, noise=0.003, friction=0.2, seed=5):
    """Back and forth over a bump; the force is stamped `delay` late."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 1 / rate)

    def place(time):
        phase = (time * speed / 0.04) % 2.0
        return 0.04 * np.where(phase < 1.0, phase, 2.0 - phase)

    def force(time):
        way = np.sign(place(time + 1e-4) - place(time - 1e-4))
        return 1.0 + 0.4 * np.exp(-(((place(time) - 0.02) / 0.005) ** 2)) + friction * way

    return place(t), force(t - delay) + noise * rng.normal(size=t.size), t


@pytest.mark.parametrize(
    "delay", [0.005, *(pytest.param(d, marks=pytest.mark.slow) for d in (-0.02, 0.0, 0.012, 0.02))]
)
def test_time_skew_is_found_by_a_back_and_forth_scan(delay):
    x, f, t = scan(delay)
    found = time_skew(x, f, t)
    assert abs(found.delay - delay) < 1e-3
    assert found.sigma < 1e-3
    direction = naive.unit([1.0, 2.0, -0.5])
    assert abs(time_skew(np.outer(x, direction), f, t).delay - delay) < 1e-3


def test_scans_that_cannot_tell_are_refused():
    x, f, t = scan(0.01)
    with pytest.raises(InputError, match="forces"):
        time_skew(x, 1.0 + 0.003 * np.random.default_rng(0).normal(size=t.size), t)
    with pytest.raises(InputError, match="positions"):
        time_skew(t * 0.02, f, t)
    with pytest.raises(InputError, match="times"):
        time_skew(x, f, t[::-1])
    with pytest.raises(InputError, match="times"):
        time_skew(x[:50], f[:50], t[:50])
    with pytest.raises(InputError, match="positions"):
        time_skew(np.where(t < 0.1, np.nan, x), f, t)


# Self-check on a reference sphere


def reference_touches(probe, offset, radius, count=40, seed=6, noise=1.0):
    """Touches all over the upper half of a 25 mm sphere with a probe that is not as it is described."""
    rng = np.random.default_rng(seed)
    real = Probe(radius=radius, sensor_distance=probe.sensor_distance, compliance=probe.compliance)
    place = np.array([0.5, 0.1, 0.2])
    centres, turns, forces, torques = [], [], [], []
    for _ in range(count):
        n = naive.unit(np.abs(rng.normal(size=3)) * [1, 1, 1.5] * rng.choice([-1, 1], size=3) * [1, 1, 0] + [0, 0, 0.8])
        tilt = rng.normal(size=3) * 0.2
        rotation = np.linalg.qr(np.diag([1.0, -1.0, -1.0]) + naive.cross_matrix(tilt))[0]
        rotation = rotation * np.sign(np.diag(rotation) * [1, -1, -1])
        force = rotation.T @ naive.unit(n + 0.15 * rng.normal(size=3)) * 1.5
        arm = naive.lever(real, force) + offset - radius * (rotation.T @ n)
        values = np.concatenate([force, np.cross(arm, force)])
        values += noise * np.repeat([1 / 320, 1 / 64000], 3) * rng.normal(size=6)
        centres.append(place + (0.025 + radius) * n - rotation @ offset + noise * 1e-5 * rng.normal(size=3))
        turns.append(rotation)
        forces.append(values[:3])
        torques.append(values[3:])
    return np.array(centres), np.array(turns), np.array(forces), np.array(torques)


@pytest.mark.parametrize(
    ("offset", "radius"),
    [((0, 0, 0), 0.005), ((0.001, 0, 0), 0.005), ((0, 0, 0), 0.0052), ((-0.0005, 0.0008, 0.001), 0.0048)],
)
def test_a_bent_stick_and_a_wrong_radius_are_told(offset, radius):
    probe = Probe(compliance=STICK)
    found = check_probe(probe, *reference_touches(probe, np.array(offset, dtype=float), radius), 0.025)
    assert found.radius_error == pytest.approx(radius - 0.005, abs=3e-5)
    np.testing.assert_allclose(found.offset, offset, atol=1e-4)
    assert found.residual < 3e-5


def test_the_check_is_exact_without_noise():
    probe = Probe()
    offset = np.array([0.001, -0.0004, 0.0006])
    found = check_probe(probe, *reference_touches(probe, offset, 0.0052, noise=0.0), 0.025)
    np.testing.assert_allclose(found.offset, offset, atol=1e-8)
    assert found.radius == pytest.approx(0.0052, abs=1e-8)
    np.testing.assert_allclose(found.reference, [0.5, 0.1, 0.2], atol=1e-8)


def test_touches_on_one_side_only_are_refused():
    probe = Probe()
    centres, turns, forces, torques = reference_touches(probe, np.zeros(3), 0.005)
    with pytest.raises(InputError, match="centres"):
        check_probe(probe, centres[:4], turns[:4], forces[:4], torques[:4], 0.025)
    with pytest.raises(InputError, match="centres"):
        check_probe(probe, centres, turns, np.einsum("nji,j->ni", turns, [0, 0, 1.0]), torques, 0.025)
    with pytest.raises(InputError, match="reference_radius"):
        check_probe(probe, centres, turns, forces, torques, -1.0)
