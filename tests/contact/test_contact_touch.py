"""Deflection, zero force, time skew and the probe's self-check: the tip is where it is, and when."""

import naive_contact as naive
import numpy as np
import pytest

from lwrprobe.contact import Deflection, make_estimator, zero_force_point
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
