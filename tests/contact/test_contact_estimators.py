"""The estimators: exact without noise, honest about what they cannot tell, as good as their own error says."""

import naive_contact as naive
import numpy as np
import pytest

from lwrprobe.contact import (
    ESTIMATORS,
    REASONS,
    RELIABLE_FROM,
    UNCONFIRMED,
    Settings,
    Wrench,
    WrenchNoise,
    make_estimator,
)
from lwrprobe.contact import fused_kernels as fk
from lwrprobe.contact import kernels as kk
from lwrprobe.contact.estimator import Given, shared_params
from lwrprobe.contracts import Confidence, InputError, Probe, SampleStatus, UnknownNameError

PROBE = Probe(compliance=np.array([4e-4, 4e-4, 1e-6]))
STILL, LEVEL = np.zeros(3), np.eye(3)


def random_contact(rng, mu, magnitude):
    """Normal and force (with friction anywhere in the tangent plane), world."""
    n = naive.unit(rng.normal(size=3))
    t = naive.unit(np.cross(n, rng.normal(size=3)))
    return n, magnitude * naive.unit(n + mu * t)


def given_array(wrench, centre=STILL, rotation=LEVEL, velocity=STILL):
    return Given().fill(wrench, centre, rotation, velocity)


# Exactness


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.6, 1.2])
def test_wrench_axis_is_exact_without_noise_whatever_the_friction(mu):
    rng = np.random.default_rng(0)
    estimator = make_estimator("wrench_axis", PROBE)
    for _ in range(200):
        rotation = naive.random_rotation(rng)
        centre = rng.normal(size=3)
        n, f = random_contact(rng, mu, rng.uniform(0.3, 5.0))
        contact = estimator.estimate(naive.contact_wrench(PROBE, rotation, [(n, f)]), centre, rotation, STILL)
        np.testing.assert_allclose(contact.normal, n, atol=1e-9)
        np.testing.assert_allclose(contact.point, centre - PROBE.radius * n, atol=1e-11)
        np.testing.assert_allclose(contact.force, f, atol=1e-12)
        assert contact.reason in ("", "imprecise")


def test_force_direction_is_the_sources_formula_and_wrong_by_the_friction_angle():
    rng = np.random.default_rng(1)
    estimator = make_estimator("force_direction", PROBE)
    for mu, expected in ((0.0, 0.0), (0.3, 1.452), (0.6, 2.669)):
        n, f = random_contact(rng, mu, 1.0)
        contact = estimator.estimate(naive.contact_wrench(PROBE, np.eye(3), [(n, f)]), STILL, np.eye(3), STILL)
        np.testing.assert_allclose(contact.point, -PROBE.radius * naive.unit(f), atol=1e-12)
        assert 1e3 * np.linalg.norm(contact.point + PROBE.radius * n) == pytest.approx(expected, abs=1e-3)


def test_the_soft_object_is_given_where_it_lies_without_force():
    estimator = make_estimator("wrench_axis", PROBE, Settings(indentation=1e-4))
    n = np.array([0.0, 0.0, 1.0])
    contact = estimator.estimate(naive.contact_wrench(PROBE, np.eye(3), [(n, 2.0 * n)]), STILL, np.eye(3), STILL)
    np.testing.assert_allclose(contact.point, -(PROBE.radius - 2e-4) * n, atol=1e-12)


# Naive twins of the kernels


def test_meet_sphere_agrees_with_walking_along_the_line_of_action():
    rng = np.random.default_rng(2)
    params = shared_params(PROBE, Settings())
    for _ in range(200):
        n, f = random_contact(rng, rng.uniform(0.0, 1.2), rng.uniform(0.2, 5.0))
        given = given_array(naive.contact_wrench(PROBE, np.eye(3), [(n, f)]))
        m, u = np.empty(3), np.empty(3)
        kk.centre_torque(given, params, m)
        kk.meet_sphere(given, m, 0.999, u)
        np.testing.assert_allclose(-u, naive.axis_normal(PROBE, Wrench(0.0, given[:3], given[3:6], f)), atol=1e-9)


def test_covariances_agree_with_the_scatter_of_many_noisy_samples():
    """Expected error of the normal against the real one: within 15 % over random contacts."""
    rng = np.random.default_rng(3)
    probe = Probe()
    noise = WrenchNoise(0.002, 1e-5)
    estimator = make_estimator(
        "wrench_axis", probe, Settings(noise=noise, lever_error=0.0, zero_error=0.0, trusted_error=1.0)
    )
    params = shared_params(probe, Settings(noise=noise, lever_error=0.0, zero_error=0.0, trusted_error=1.0))
    for _ in range(8):
        n, f = random_contact(rng, 0.3, 2.0)
        true = naive.contact_wrench(probe, np.eye(3), [(n, f)])
        out = np.empty(kk.OUTPUT)
        kk.wrench_axis(given_array(true), params, out)
        errors = []
        for _ in range(600):
            wrench = Wrench(0.0, true.force + 0.002 * rng.normal(size=3), true.torque + 1e-5 * rng.normal(size=3), f)
            errors.append(np.linalg.norm(estimator.estimate(wrench, STILL, np.eye(3), STILL).normal - n))
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(out[kk.O_SIGMA], rel=0.15)


def test_torque_covariance_is_the_dense_product():
    rng = np.random.default_rng(4)
    params = shared_params(PROBE, Settings())
    for _ in range(50):
        f, u = rng.normal(size=3), naive.unit(rng.normal(size=3))
        given = given_array(Wrench(0.0, f, np.zeros(3), f))
        cov = np.empty((3, 3))
        kk.torque_covariance(given, u, params, cov)
        p = naive.cross_matrix(naive.lever(PROBE, f) + PROBE.radius * u)
        fx = naive.cross_matrix(f)
        dense = (
            params[kk.P_TORQUE_NOISE] ** 2 * np.eye(3)
            + params[kk.P_FORCE_NOISE] ** 2 * p @ p.T
            + params[kk.P_LEVER_ERROR] ** 2 * fx @ fx.T
        ) / PROBE.radius**2
        np.testing.assert_allclose(cov, dense, rtol=1e-10, atol=1e-14)


@pytest.mark.slow
def test_axis_information_and_its_helpers_are_the_dense_products():
    rng = np.random.default_rng(5)
    for _ in range(50):
        a = rng.normal(size=(3, 3))
        cov, f, u = a @ a.T + 0.1 * np.eye(3), rng.normal(size=3), naive.unit(rng.normal(size=3))
        inverse = np.linalg.inv(cov)
        np.testing.assert_allclose(kk.invert(cov), inverse[np.triu_indices(3)], rtol=1e-8)
        info = np.empty((3, 3))
        kk.axis_information(given_array(Wrench(0.0, f, f, f)), u, cov, info)
        p, fx = np.eye(3) - np.outer(u, u), naive.cross_matrix(f)
        np.testing.assert_allclose(info, p @ fx.T @ inverse @ fx @ p, atol=1e-8)
        eigen = np.linalg.eigvalsh(info)
        assert kk.tangent_spread(info, u) == pytest.approx(np.sqrt((1 / eigen[1:]).sum()), rel=1e-6)
        m = rng.normal(size=3)
        best = m - cov @ f * (f @ m) / (f @ cov @ f)
        kk.consistent_torque(given_array(Wrench(0.0, f, f, f)), cov, m)
        np.testing.assert_allclose(m, best, atol=1e-10)


def test_smallest_direction_is_the_eigenvector():
    rng = np.random.default_rng(6)
    for _ in range(100):
        n = naive.unit(rng.normal(size=3))
        a = rng.normal(size=(3, 3)) @ (np.eye(3) - np.outer(n, n)) + 0.01 * rng.normal(size=(3, 3))
        total = a.T @ a * 10.0 ** rng.uniform(-3, 6)
        vectors = np.linalg.eigh(total)[1]
        start = n.copy()
        fk.smallest_direction(total, start)
        assert naive.angle(start, vectors[:, 0] * np.sign(vectors[:, 0] @ start)) < 0.01


def test_fading_the_memory_is_adding_a_variance_in_the_tangent_plane():
    rng = np.random.default_rng(7)
    for _ in range(50):
        n = naive.unit(rng.normal(size=3))
        p = np.eye(3) - np.outer(n, n)
        a = rng.normal(size=(3, 3))
        info = p @ a @ a.T @ p
        q = rng.uniform(0.0, 2.0)
        state = np.zeros(fk.STATE)
        state[fk.S_NORMAL : fk.S_NORMAL + 3], state[fk.S_INFO : fk.S_INFO + 9] = n, info.ravel()
        fk.spread(state, q)
        dense = np.linalg.pinv(np.linalg.pinv(info, rcond=1e-10) + q * p, rcond=1e-10)
        np.testing.assert_allclose(state[fk.S_INFO : fk.S_INFO + 9].reshape(3, 3), dense, atol=1e-7)


def test_chi_squared_and_projection_are_the_dense_forms():
    rng = np.random.default_rng(8)
    for _ in range(50):
        a = rng.normal(size=(3, 3))
        info, d, v = a @ a.T + 0.1 * np.eye(3), rng.normal(size=3), naive.unit(rng.normal(size=3))
        dense = d @ np.linalg.inv(np.linalg.inv(2.5 * info) + 0.3 * np.outer(v, v)) @ d
        assert fk.chi_squared(d, info, 2.5, v, 0.3) == pytest.approx(dense, rel=1e-9)
        p = np.eye(3) - np.outer(v, v)
        projected = info.copy()
        kk.project(projected, v)
        np.testing.assert_allclose(projected, p @ info @ p, atol=1e-10)


def test_slip_is_the_velocity_of_the_contact_point_also_while_the_probe_turns():
    rng = np.random.default_rng(9)
    for _ in range(20):
        n, v, w = naive.unit(rng.normal(size=3)), 0.02 * rng.normal(size=3), 0.5 * rng.normal(size=3)
        first = naive.random_rotation(rng)
        k, angle = naive.cross_matrix(naive.unit(w)), np.linalg.norm(w) * 0.008
        second = (np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k) @ first
        state = np.zeros(fk.STATE)
        state[fk.S_BEGUN], state[fk.S_TIME], state[fk.S_ROTATION : fk.S_ROTATION + 9] = 1.0, 1.0, first.ravel()
        wrench = Wrench(1.008, np.ones(3), np.ones(3), np.ones(3))
        slip = np.empty(3)
        speed = fk.slip_velocity(
            given_array(wrench, rotation=second, velocity=v), state, n, shared_params(PROBE, Settings()), slip
        )
        expected = v + np.cross(w, -PROBE.radius * n)
        np.testing.assert_allclose(speed * slip, expected, atol=1e-6)


@pytest.mark.slow
def test_learning_the_zero_is_a_dense_kalman_step():
    rng = np.random.default_rng(14)
    params = np.zeros(fk.PARAMS)
    params[: kk.P_OWN] = shared_params(PROBE, Settings())
    params[fk.P_MIN_SPEED] = 1e-3
    params[[fk.P_ZERO_ACROSS, fk.P_ZERO_ALONG]] = across, along = 0.04, 0.02
    used = []
    for scale in 30 * (0.7, 1.5):
        rotation, v, f = naive.random_rotation(rng), 0.02 * naive.unit(rng.normal(size=3)), rng.normal(size=3)
        a, b = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
        prior, white, first = 0.01 * a @ a.T, 0.01 * b @ b.T, 0.1 * rng.normal(size=3)
        world = rotation @ f
        n = naive.unit(world - (world @ naive.unit(v)) * naive.unit(v))
        spread = prior + white + 1e-6 * (f @ f) / (v @ v) * np.eye(3)
        raw = np.cross(-rotation.T @ n, f) + first + scale * np.linalg.cholesky(spread) @ rng.normal(size=3) * 2.0
        state, out, m, cov = np.zeros(fk.STATE), np.zeros(kk.OUTPUT), np.zeros(3), white.copy()
        state[fk.S_OFFSET : fk.S_OFFSET + 3], state[fk.S_OFFSET_COV : fk.S_OFFSET_COV + 9] = first, prior.ravel()
        state[fk.S_STREAK], state[fk.S_SPEED_VAR] = 10.0, 1e-6
        out[kk.O_FORCE : kk.O_FORCE + 3] = rotation @ f
        share = fk.add_offset(state, raw, m, cov)
        np.testing.assert_allclose(m, raw - first, atol=1e-15)
        assert share == pytest.approx(np.trace(prior) / np.trace(prior + white))
        fk.learn_offset(given_array(Wrench(0.0, f, f, f), STILL, rotation, v), params, state, raw, cov, out)
        seen = raw - np.cross(-rotation.T @ n, f) - first
        gain = prior @ np.linalg.inv(spread)
        found = first + gain @ seen
        # One in a thousand of what noise and the wandering of the zero explain is farther off.
        likely = seen @ np.linalg.solve(spread, seen) <= 16.3
        likely = likely and found @ (found / [across, across, along]) <= 16.3
        used.append(likely)
        if not likely:
            gain, found = np.zeros((3, 3)), first
        np.testing.assert_allclose(state[fk.S_OFFSET : fk.S_OFFSET + 3], found, atol=1e-9)
        learnt = state[fk.S_OFFSET_COV : fk.S_OFFSET_COV + 9].reshape(3, 3)
        np.testing.assert_allclose(learnt, prior - gain @ prior, atol=1e-10)
    assert 10 < sum(used) < 50


@pytest.mark.parametrize("mu", [0.3, 0.5])
def test_a_sphere_that_bounces_while_it_slips_keeps_its_normal(mu):
    """Four samples on the surface, three off it: the force changes all the time, the slip goes on at 15 mm/s.

    Before that one sample contradicts the sliding, so that nothing is remembered, and the torque tells little.
    """
    rng = np.random.default_rng(3)
    estimator = make_estimator("fused", PROBE)
    estimator.set_noise(WrenchNoise(0.01, 6e-5))
    n, v, dt = np.array([0.0, 0.0, 1.0]), np.array([0.015, 0.0, 0.0]), 0.008
    presses = [0.8] * 60 + 8 * [0.0, 0.0, 0.0, 0.45, 1.05, 0.75, 0.4]
    errors, before = [], 0.0
    for k, press in enumerate(presses):
        if press:
            drag = -mu if k == 59 else mu
            force = press * (n - drag * naive.unit(v))
            wrench = naive.contact_wrench(PROBE, np.eye(3), [(n, force)], time=k * dt, rng=rng, counts=3.0)
            leaving = np.array([0.0, 0.0, -1e-5 * (press - before) / dt])  # 1e5 N/m
            contact = estimator.estimate(wrench, k * dt * v, np.eye(3), v + leaving)
            errors.append(naive.angle(contact.normal, n))
        before = press
    assert max(errors[60:]) < 0.25 * np.degrees(np.arctan(mu))


def test_a_noise_that_is_told_later_counts_from_then_on():
    loud = WrenchNoise(0.01, 6e-5)
    n = naive.unit([0.2, 0.1, 1.0])
    wrench = naive.contact_wrench(PROBE, np.eye(3), [(n, 0.8 * n)])
    for name in ("wrench_axis", "fused"):
        told = make_estimator(name, PROBE)
        told.set_noise(loud)
        made = make_estimator(name, PROBE, Settings(noise=loud))
        usual = make_estimator(name, PROBE)
        scores = [e.estimate(wrench, STILL, np.eye(3), STILL).confidence_score for e in (told, made, usual)]
        assert scores[0] == scores[1] < scores[2]


def test_the_noise_of_readings_at_rest_counts_where_it_is_more_than_is_stated():
    stated = WrenchNoise.of(PROBE)
    silent = WrenchNoise.mean_of(np.zeros(6))
    assert stated.or_louder(silent) == stated
    loud = WrenchNoise.mean_of(np.array([0.01, 0.02, 0.02, 0.0, 0.0, 0.0]))
    assert loud.force == pytest.approx(np.sqrt(3e-4))
    assert stated.or_louder(loud) == WrenchNoise(loud.force, stated.torque)


def test_noise_is_compared_with_noise_in_force_and_in_torque():
    stated = WrenchNoise(0.002, 1e-5)
    assert WrenchNoise(0.006, 1e-5).over(stated) == pytest.approx(3.0)
    assert WrenchNoise(0.001, 2e-5).over(stated) == pytest.approx(2.0)
    assert WrenchNoise(0.0, 0.0).over(WrenchNoise(0.0, 0.0)) == 1.0
    assert WrenchNoise(0.001, 0.0).over(WrenchNoise(0.0, 0.0)) == np.inf


# What is not to be trusted


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_reason_is_given_and_none_is_trusted(name):
    estimator = make_estimator(name, PROBE)
    n = np.array([0.0, 0.0, 1.0])

    def reason(wrench):
        contact = estimator.estimate(wrench, STILL, np.eye(3), STILL)
        assert np.isfinite(contact.point).all()
        assert np.isfinite(contact.force).all()
        assert np.linalg.norm(contact.normal) == pytest.approx(1.0 if contact.force.any() else 0.0)
        assert (contact.confidence_score >= RELIABLE_FROM) == (contact.reason == "")
        return contact.reason

    good = naive.contact_wrench(PROBE, np.eye(3), [(n, 2.0 * n)])
    assert reason(good) == ""
    assert reason(Wrench(0.0, 0.01 * n, np.zeros(3), n)) == "near-zero force"
    assert reason(Wrench(0.0, np.zeros(3), np.zeros(3), n)) == "near-zero force"
    for status, expected in (
        (SampleStatus.SATURATED, "saturated axis"),
        (SampleStatus.LATE, "stale"),
        (SampleStatus.FROZEN, "stale"),
        (SampleStatus.INVALID, "invalid"),
        (SampleStatus.BRIDGE_LOW, "invalid"),
        (UNCONFIRMED, "unconfirmed jump"),
        (SampleStatus.LOST_BEFORE | SampleStatus.LOW_BATTERY, ""),
    ):
        assert reason(Wrench(0.0, good.force, good.torque, n, 0, int(status))) == expected
    assert reason(Wrench(0.0, np.array([np.nan, 0, 1.0]), good.torque, n)) == "invalid"
    # the stick touches 20 mm behind the sphere's centre
    stick = np.cross([0.002, 0.0, PROBE.sensor_distance - 0.02], [-2.0, 0, 0])
    aside = Wrench(0.0, np.array([-2.0, 0, 0]), stick, n)
    assert reason(aside) == "axis misses the sphere"
    contact = estimator.estimate(aside, STILL, np.eye(3), STILL)
    assert contact.confidence is Confidence.NONE
    assert np.array_equal(contact.normal, [-1.0, 0.0, 0.0])  # the direction of the force, and not what friction allows
    assert set(REASONS) >= {"", "imprecise", "ambiguous normal"}


@pytest.mark.parametrize("height", [0.006, 0.008, 0.012, 0.02, 0.04])
def test_a_stick_contact_is_never_taken_for_the_sphere(height):
    """Force across the stick at any height from just above the sphere, friction 0.3, nano17 noise, 0.5 N."""
    rng = np.random.default_rng(10)
    estimator = make_estimator("wrench_axis", PROBE)
    trusted = 0
    for _ in range(100):
        a, tilt = rng.uniform(0, 2 * np.pi), rng.uniform(-0.29, 0.29)
        away = np.array([np.cos(a), np.sin(a), 0.0])
        force = 0.5 * (away * np.cos(tilt) + np.array([0, 0, np.sin(tilt)]))
        place = naive.lever(PROBE, force) - np.array([0, 0, height]) - PROBE.stick_radius * away
        step = np.repeat([PROBE.force_resolution, PROBE.torque_resolution], 3)
        values = np.concatenate([force, np.cross(place, force)]) + step * rng.normal(size=6)
        contact = estimator.estimate(Wrench(0.0, values[:3], values[3:], force), STILL, np.eye(3), STILL)
        trusted += contact.confidence_score >= RELIABLE_FROM
    assert trusted <= (3 if height <= 0.006 else 0)


def test_confidence_falls_with_the_force_and_says_imprecise():
    rng = np.random.default_rng(11)
    estimator = make_estimator("wrench_axis", Probe())
    n = naive.unit([0.2, 0.1, 1.0])
    confidence = []
    for force in (0.1, 0.3, 1.0, 3.0):
        contact = estimator.estimate(
            naive.contact_wrench(Probe(), np.eye(3), [(n, force * n)], rng=rng), STILL, np.eye(3), STILL
        )
        confidence.append(contact.confidence_score)
    assert confidence == sorted(confidence)
    assert confidence[0] < RELIABLE_FROM < confidence[2]


def test_unknown_names_and_bad_settings_are_refused():
    with pytest.raises(UnknownNameError, match="did you mean 'wrench_axis'"):
        make_estimator("wrench_axes", PROBE)
    for field in (
        "near_zero",
        "max_friction",
        "trusted_error",
        "lever_error",
        "zero_time",
        "lag",
        "indentation",
        "speed_noise",
    ):
        with pytest.raises(InputError, match=f"contact.{field}"):
            Settings(**{field: -1.0})
    with pytest.raises(InputError, match=r"noise.force"):
        WrenchNoise(np.nan, 0.0)
    with pytest.raises(InputError, match="probe"):
        make_estimator("wrench_axis", Probe(radius=0.0))


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_centre_that_is_not_finite_is_an_invalid_sample(name, bad, axis):
    estimator = make_estimator(name, PROBE)
    n = naive.unit([0.2, 0.1, 1.0])
    centre = STILL.copy()
    centre[axis] = bad
    contact = estimator.estimate(naive.contact_wrench(PROBE, np.eye(3), [(n, n)]), centre, np.eye(3), STILL)
    assert (contact.reason, contact.confidence_score) == ("invalid", 0.0)
    assert np.array_equal(contact.point, np.zeros(3))
    assert np.allclose(contact.normal, n)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_no_input_makes_nan_or_an_exception(name):
    rng = np.random.default_rng(12)
    estimator = make_estimator(name, Probe())
    for k in range(400):
        scale = 10.0 ** rng.uniform(-12, 9, size=6)
        values = rng.normal(size=6) * scale
        if k % 7 == 0:
            values[rng.integers(6)] = rng.choice([0.0, np.nan, np.inf])
        wrench = Wrench(rng.normal(), values[:3], values[3:], values[:3])
        rotation = naive.random_rotation(rng)
        contact = estimator.estimate(
            wrench, rng.normal(size=3), rotation, rng.normal(size=3) * rng.choice([0, 1e-9, 1])
        )
        assert np.isfinite(contact.point).all()
        assert np.isfinite(contact.normal).all()
        assert np.isfinite(contact.force).all()
        assert 0.0 <= contact.confidence_score <= 1.0


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_sensor_without_noise_is_no_special_case(name):
    probe = Probe(force_resolution=0.0, torque_resolution=0.0)
    estimator = make_estimator(name, probe, Settings(lever_error=0.0, zero_error=0.0))
    n = naive.unit([0.1, -0.3, 1.0])
    contact = estimator.estimate(naive.contact_wrench(probe, np.eye(3), [(n, n)]), STILL, np.eye(3), STILL)
    np.testing.assert_allclose(contact.normal, n, atol=1e-6)
    assert contact.confidence_score >= RELIABLE_FROM
