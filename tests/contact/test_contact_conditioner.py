"""What the conditioner promises: nothing but contact comes out, and no fault of the stream goes unseen."""

import naive_contact as naive
import numpy as np
import pytest

from lwrprobe.contact import UNCONFIRMED, DriftWatch, Payload, WrenchConditioner, WrenchNoise, identify_payload
from lwrprobe.contact.payload import GRAVITY
from lwrprobe.contracts import InputError, Probe, SampleStatus, WrenchSample

RATE = 125.0
STEP = np.repeat([1 / 320, 1 / 64000], 3)


def sample(k, values=(0.0,) * 6, status=0, time=None, sequence=None):
    v = np.asarray(values, dtype=float)
    return WrenchSample(
        k / RATE if time is None else time, v[:3].copy(), v[3:].copy(), k if sequence is None else sequence, status
    )


def noisy(rng, values, count, first=0):
    return [sample(first + k, np.round((values + STEP * rng.normal(size=6)) / STEP) * STEP) for k in range(count)]


@pytest.mark.slow
def test_kernel_agrees_with_its_naive_twin_on_streams_with_every_fault():
    rng = np.random.default_rng(5)
    probe = Probe(mass=0.02, centre_of_mass=np.array([0.001, -0.002, 0.03]))
    for _ in range(20):
        rotation = naive.random_rotation(rng)
        conditioner = WrenchConditioner(
            probe, RATE, payload=Payload(0.02, probe.centre_of_mass, rng.normal(size=6) * 0.1)
        )
        payload = Payload(0.02, probe.centre_of_mass, np.zeros(6)).weight(rotation)
        stream, time, sequence = [], 0.0, 0
        for _ in range(300):
            kind = rng.integers(0, 20)
            raw = np.concatenate([rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.002])
            status = 0
            if kind == 0:
                raw[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf, 1e6])
            elif kind == 1:
                raw[:3] += 5.0 * naive.unit(rng.normal(size=3))
            elif kind == 2:
                raw[rng.integers(6)] = rng.choice([20.0, -0.125, 0.12])
            elif kind == 3:
                status = int(SampleStatus.LATE)
            time_step, sequence_step = 0.008, 1
            if kind == 4:
                sequence_step, time_step = 3, 0.024
            elif kind == 5:
                sequence_step = 0
            elif kind == 6:
                sequence_step, time_step = -2, -0.016
            time, sequence = time + time_step, sequence + sequence_step
            stream.append((time, sequence, status, raw))
        settings = {
            "bias": conditioner.bias,
            "weight": payload,
            "jump": (0.5, 0.5 * probe.sensor_distance),
            "range": np.array([12, 12, 17, 0.12, 0.12, 0.12]) - 1.5 * STEP,
            "huge": 4 * np.array([12, 12, 17, 0.12, 0.12, 0.12]),
        }
        twin = list(naive.condition(settings, stream))
        for (time, sequence, status, raw), (expected, wrench, _) in zip(stream, twin):
            got = conditioner.condition(WrenchSample(time, raw[:3], raw[3:], sequence, status), rotation)
            assert got.status == expected
            np.testing.assert_allclose(np.concatenate([got.force, got.torque]), wrench, atol=1e-12)
            np.testing.assert_allclose(got.world_force, rotation @ wrench[:3], atol=1e-12)
        assert {name: getattr(conditioner.counters, name) for name in twin[-1][2]} == twin[-1][2]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e9])
@pytest.mark.parametrize("axis", range(6))
def test_a_bad_value_is_counted_and_the_last_wrench_held(bad, axis):
    conditioner = WrenchConditioner(Probe(), RATE)
    before = conditioner.condition(sample(0, [0.1, 0, 0.2, 0, 0, 0]), np.eye(3))
    values = np.zeros(6)
    values[axis] = bad
    wrench = conditioner.condition(sample(1, values), np.eye(3))
    assert wrench.status & SampleStatus.INVALID
    assert not wrench.usable
    np.testing.assert_array_equal(wrench.force, before.force)
    assert conditioner.counters.invalid == 1
    assert conditioner.failing == ""
    assert conditioner.condition(sample(2), np.eye(3)).usable


def test_three_bad_values_in_a_row_are_a_failure_and_one_good_one_ends_it():
    conditioner = WrenchConditioner(Probe(), RATE)
    for k in range(3):
        assert conditioner.failing == ""
        conditioner.condition(sample(k, [np.nan] * 6), np.eye(3))
    assert "3 invalid" in conditioner.failing
    conditioner.condition(sample(3), np.eye(3))
    assert conditioner.failing == ""


def test_what_is_no_array_at_all_counts_as_invalid():
    conditioner = WrenchConditioner(Probe(), RATE)
    wrench = conditioner.condition(WrenchSample(0.0, np.zeros(2), np.zeros(3), 0), np.eye(3))
    assert wrench.status & SampleStatus.INVALID
    assert np.isfinite(wrench.force).all()


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_every_axis_saturates(axis, sign):
    probe = Probe()
    ends = np.concatenate([probe.force_range, probe.torque_range])
    values = np.zeros(6)
    values[axis] = sign * ends[axis]
    conditioner = WrenchConditioner(probe, RATE)
    assert conditioner.condition(sample(0, values), np.eye(3)).status & SampleStatus.SATURATED
    values[axis] *= 0.98
    assert not conditioner.condition(sample(1, values), np.eye(3)).status & SampleStatus.SATURATED


def test_torque_saturates_before_force_sideways():
    """2 N across at 60 mm is all that 0.12 N m allows."""
    probe = Probe(sensor_distance=0.06)
    conditioner = WrenchConditioner(probe, RATE)
    wrench = naive.contact_wrench(probe, np.eye(3), [(np.array([1.0, 0, 0]), np.array([2.0, 0, 0]))])
    got = conditioner.condition(sample(0, np.concatenate([wrench.force, wrench.torque])), np.eye(3))
    assert got.status & SampleStatus.SATURATED


def test_single_spikes_are_never_confirmed_and_are_counted():
    rng = np.random.default_rng(0)
    conditioner = WrenchConditioner(Probe(), RATE)
    confirmed = []
    spikes = 0
    for k in range(2000):
        values = STEP * rng.normal(size=6)
        if k % 50 == 25:
            values[rng.integers(3)] += rng.choice([-5.0, 5.0])
            spikes += 1
        wrench = conditioner.condition(sample(k, values), np.eye(3))
        if wrench.usable:
            confirmed.append(wrench.magnitude)
    assert max(confirmed) < 0.05
    assert conditioner.counters.spikes == spikes == 40


def test_a_real_jump_is_confirmed_one_sample_later_and_a_ramp_is_not_held_up():
    conditioner = WrenchConditioner(Probe(), RATE)
    conditioner.condition(sample(0), np.eye(3))
    first = conditioner.condition(sample(1, [0, 0, 3.0, 0, 0, 0]), np.eye(3))
    second = conditioner.condition(sample(2, [0, 0, 3.1, 0, 0, 0]), np.eye(3))
    assert first.status & UNCONFIRMED
    assert first.force[2] == pytest.approx(3.0)  # guards see it at once
    assert second.usable
    ramp = [conditioner.condition(sample(3 + k, [0, 0, 3.1 + k, 0, 0, 0]), np.eye(3)).usable for k in range(1, 8)]
    assert sum(not good for good in ramp) <= 4  # every second sample at most
    assert conditioner.counters.spikes == 0


def test_frozen_stream_is_seen_by_sequence_by_time_and_by_values():
    rng = np.random.default_rng(1)
    conditioner = WrenchConditioner(Probe(), RATE)
    conditioner.take_bias(noisy(rng, np.zeros(6), 50), np.eye(3))
    conditioner.condition(sample(0, STEP), np.eye(3))
    assert conditioner.condition(sample(1, STEP, sequence=0), np.eye(3)).status & SampleStatus.FROZEN
    assert conditioner.condition(sample(1, STEP, time=0.0), np.eye(3)).status & SampleStatus.FROZEN
    statuses = [conditioner.condition(sample(k, STEP), np.eye(3)).status for k in range(1, 60)]
    assert statuses[5] == 0
    assert statuses[-1] & SampleStatus.FROZEN
    assert "the same reading" in conditioner.failing
    conditioner.condition(sample(60, 2 * STEP), np.eye(3))
    assert conditioner.failing == ""


def test_values_may_stand_still_when_the_sensor_has_no_noise():
    conditioner = WrenchConditioner(Probe(), RATE)
    conditioner.take_bias([sample(k) for k in range(20)], np.eye(3))
    assert all(conditioner.condition(sample(k), np.eye(3)).usable for k in range(200))


def test_lost_reordered_and_late_samples_are_told_apart():
    conditioner = WrenchConditioner(Probe(), RATE)
    conditioner.condition(sample(0), np.eye(3))
    assert conditioner.condition(sample(4), np.eye(3)).status == SampleStatus.LOST_BEFORE
    assert conditioner.condition(sample(2), np.eye(3)).status == SampleStatus.LATE
    assert conditioner.condition(sample(5, status=int(SampleStatus.LATE)), np.eye(3)).status == SampleStatus.LATE
    counters = conditioner.counters
    assert (counters.lost, counters.reordered, counters.late) == (3, 1, 1)
    assert conditioner.age(1.0) == pytest.approx(1.0 - 5 / RATE)


def test_sequence_may_wrap_at_32_bits():
    conditioner = WrenchConditioner(Probe(), RATE)
    conditioner.condition(sample(0, sequence=2**32 - 1), np.eye(3))
    assert conditioner.condition(sample(1, sequence=0), np.eye(3)).status == 0
    assert conditioner.condition(sample(2, sequence=2), np.eye(3)).status == SampleStatus.LOST_BEFORE


@pytest.mark.parametrize("cutoff", [5.0, 20.0, 50.0])
def test_the_filters_delay_is_the_stated_one(cutoff):
    conditioner = WrenchConditioner(Probe(), RATE, cutoff=cutoff, jump=100.0)
    slope = 0.5
    for k in range(400):
        wrench = conditioner.condition(sample(k, [0, 0, slope * k / RATE, 0, 0, 0]), np.eye(3))
    lag = 399 / RATE - wrench.force[2] / slope
    assert lag == pytest.approx(conditioner.delay, rel=1e-6)
    assert WrenchConditioner(Probe(), RATE).delay == 0.0


def test_bias_is_taken_at_rest_in_free_space():
    rng = np.random.default_rng(2)
    bias = np.array([0.12, -0.08, 0.25, 0.001, -0.002, 0.0005])
    probe = Probe(mass=0.01, centre_of_mass=np.array([0.0, 0.0, 0.03]))
    rotation = naive.random_rotation(rng)
    weight = Payload.of(probe).weight(rotation)
    conditioner = WrenchConditioner(probe, RATE)
    outcome = conditioner.take_bias(noisy(rng, bias + weight, 100), rotation)
    assert outcome.taken
    assert outcome.reason == ""
    np.testing.assert_allclose(conditioner.bias, bias, atol=0.4 * STEP.max())
    assert np.all(outcome.noise < 2.5 * STEP)


def test_bias_is_refused_when_touching_moving_or_saturated():
    rng = np.random.default_rng(4)
    probe = Probe()
    conditioner = WrenchConditioner(probe, RATE)
    n = naive.unit([0.3, -0.2, -1.0])
    touch = naive.contact_wrench(probe, np.eye(3), [(n, 0.8 * n + 0.2 * np.cross(n, [1, 0, 0]))])
    values = np.concatenate([touch.force, touch.torque])
    assert conditioner.take_bias(noisy(rng, values, 50), np.eye(3)).reason == "touching"
    moving = [sample(k, [0, 0, 0.002 * k, 0, 0, 0]) for k in range(50)]
    assert conditioner.take_bias(moving, np.eye(3)).reason == "not still"
    assert conditioner.take_bias([sample(0)], np.eye(3)).reason == "too few samples"
    assert (
        conditioner.take_bias([sample(k, [12.0, 0, 0, 0, 0, 0]) for k in range(9)], np.eye(3)).reason == "bad samples"
    )
    assert conditioner.take_bias([sample(k, [np.nan] * 6) for k in range(9)], np.eye(3)).reason == "bad samples"
    np.testing.assert_array_equal(conditioner.bias, np.zeros(6))


def test_a_few_spikes_and_bad_values_do_not_spoil_the_bias():
    rng = np.random.default_rng(4)
    bias = np.array([0.1, -0.2, 0.3, 0.001, 0.002, 0.003])
    samples = noisy(rng, bias, 60)
    samples[7].force[1] += 5.0
    samples[30].force[2] = np.nan
    samples[44].torque[0] = 0.12
    conditioner = WrenchConditioner(Probe(), RATE)
    assert conditioner.take_bias(samples, np.eye(3)).taken
    np.testing.assert_allclose(conditioner.bias, bias, atol=0.5 * STEP[0])
    for k in range(0, 60, 4):
        samples[k].force[0] = np.nan
    assert conditioner.take_bias(samples, np.eye(3)).reason == "bad samples"


def test_a_touch_hidden_by_an_offset_shows_when_the_bias_is_taken_again_after_a_retreat():
    rng = np.random.default_rng(4)
    probe, offset = Probe(), np.array([0.12, -0.08, 0.25, 0.001, -0.002, 0.0005])
    n = np.array([0.0, 0.0, -1.0])
    touch = naive.contact_wrench(probe, np.eye(3), [(n, 0.4 * n)])
    touching = noisy(rng, offset + np.concatenate([touch.force, touch.torque]), 60)
    conditioner = WrenchConditioner(probe, RATE)
    first = conditioner.take_bias(touching, np.eye(3))
    again = conditioner.take_bias(noisy(rng, offset, 60), np.eye(3), expected=first.bias)
    assert again.reason == "touching"
    assert np.linalg.norm(again.change[:3]) == pytest.approx(0.4, abs=0.01)


def test_a_noisier_sensor_is_still_when_its_noise_is_stated():
    rng = np.random.default_rng(4)
    loud = [sample(k, 10 * STEP * rng.normal(size=6)) for k in range(50)]
    assert WrenchConditioner(Probe(), RATE).take_bias(loud, np.eye(3)).reason == "not still"
    noise = WrenchNoise(10 * STEP[0], 10 * STEP[3])
    assert WrenchConditioner(Probe(), RATE, noise=noise).take_bias(loud, np.eye(3)).taken


@pytest.mark.parametrize("seed", range(5))
def test_a_louder_sensor_is_still_and_a_vibrating_one_of_the_same_spread_is_not(seed):
    rng = np.random.default_rng(seed)
    loud = 6 * STEP * rng.normal(size=(100, 6))
    assert WrenchConditioner(Probe(), RATE).take_bias([sample(k, row) for k, row in enumerate(loud)], np.eye(3)).taken
    swing = 6 * np.sqrt(2.0) * STEP * np.sin(2 * np.pi * 3.0 * np.arange(100) / RATE + seed)[:, None]
    rows = swing + STEP * rng.normal(size=(100, 6))
    moving = WrenchConditioner(Probe(), RATE).take_bias([sample(k, row) for k, row in enumerate(rows)], np.eye(3))
    assert moving.reason == "not still"


def test_the_error_of_a_mean_falls_with_the_root_of_the_samples():
    rng = np.random.default_rng(4)
    conditioner = WrenchConditioner(Probe(), RATE)
    errors = [conditioner.mean_error(noisy(rng, np.zeros(6), n)) for n in (100, 400)]
    assert errors[0] == pytest.approx(0.1, rel=0.25)
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.25)
    assert conditioner.mean_error([sample(0)]) == np.inf


def test_bias_against_an_expected_one_is_refused_beyond_the_touch_force():
    rng = np.random.default_rng(4)
    conditioner = WrenchConditioner(Probe(), RATE)
    before = np.array([0.1, 0.0, 0.2, 0, 0, 0])
    assert conditioner.take_bias(noisy(rng, before, 30), np.eye(3), expected=before).taken
    after = before + np.array([0, 0, 0.3, 0, 0, 0])
    assert conditioner.take_bias(noisy(rng, after, 30), np.eye(3), expected=before).reason == "touching"


def test_payload_is_identified_from_a_few_poses():
    rng = np.random.default_rng(6)
    truth = Payload(0.034, np.array([0.002, -0.001, 0.031]), np.array([0.3, -0.2, 0.9, 0.004, 0.003, -0.002]))
    rotations = [naive.random_rotation(rng) for _ in range(8)]
    samples, turns = [], []
    for i, rotation in enumerate(rotations):
        samples += noisy(rng, truth.bias + truth.weight(rotation), 25, 25 * i)
        turns += [rotation] * 25
    found = identify_payload(samples, turns)
    assert found.mass == pytest.approx(truth.mass, abs=1e-4)
    np.testing.assert_allclose(found.com, truth.com, atol=2e-4)
    np.testing.assert_allclose(found.bias[:3], truth.bias[:3], atol=1e-3)
    np.testing.assert_allclose(found.bias[3:], truth.bias[3:], atol=1e-5)
    assert np.all(found.residual < 1.5 * STEP)


def test_gravity_is_gone_after_a_45_degree_turn_with_a_10_gram_tip():
    """Uncompensated: 2 m g sin(22.5 deg) = 75 mN; allowed: 15 mN, identified with the sensor's noise."""
    rng = np.random.default_rng(7)
    truth = Payload(0.01, np.array([0.0, 0.0, 0.035]), np.array([0.1, 0.2, -0.1, 0.001, 0, 0]))
    tilt = [np.eye(3), *(turn(axis, a) for axis in (0, 1) for a in (-0.6, 0.6))]
    samples = [s for r in tilt for s in noisy(rng, truth.bias + truth.weight(r), 20)]
    found = identify_payload(samples, [r for r in tilt for _ in range(20)])
    probe = Probe()
    rotation = turn(0, np.pi / 4)
    compensated = WrenchConditioner(probe, RATE, payload=found)
    plain = WrenchConditioner(probe, RATE)
    plain.take_bias(noisy(rng, truth.bias + truth.weight(np.eye(3)), 50), np.eye(3))
    readings = noisy(rng, truth.bias + truth.weight(rotation), 200)
    residual = np.mean([compensated.condition(s, rotation).force for s in readings], axis=0)
    uncompensated = np.mean([plain.condition(s, rotation).force for s in readings], axis=0)
    assert np.linalg.norm(residual) < 0.005
    assert np.linalg.norm(uncompensated) == pytest.approx(0.01 * GRAVITY * 2 * np.sin(np.pi / 8), abs=0.005)


def turn(axis, a):
    i, j = (axis + 1) % 3, (axis + 2) % 3
    r = np.eye(3)
    r[i, i] = r[j, j] = np.cos(a)
    r[j, i], r[i, j] = np.sin(a), -np.sin(a)
    return r


@pytest.mark.parametrize(
    "rotations",
    [
        [np.eye(3)] * 5,
        [turn(2, a) for a in (0.0, 1.0, 2.0, 3.0)],  # about the vertical: gravity stays
        [turn(0, a) for a in (0.0, 0.4, 0.8)],  # about one axis only
        [np.eye(3), turn(0, 1.0)],
    ],
)
def test_payload_from_poses_that_do_not_tell_is_refused(rotations):
    truth = Payload(0.01, np.zeros(3), np.zeros(6))
    samples = [sample(k, truth.weight(r)) for k, r in enumerate(rotations)]
    with pytest.raises(InputError):
        identify_payload(samples, rotations)


def test_drift_is_followed_in_free_space_and_makes_no_phantom_contact():
    """0.05 N/min for ten minutes, re-zeroed in free space: never near the contact threshold."""
    rng = np.random.default_rng(8)
    conditioner = WrenchConditioner(Probe(), RATE)
    watch = DriftWatch(conditioner)
    worst = 0.0
    for k in range(int(600 * 12.5)):
        time = k / 12.5
        values = np.array([0.0, 0.0, 0.05 * time / 60.0, 0, 0, 0]) + STEP * rng.normal(size=6)
        wrench = conditioner.condition(sample(k, values, time=time), np.eye(3))
        watch.observe(wrench, True, np.zeros(3))
        worst = max(worst, wrench.magnitude)
        if k % 400 == 399:
            change = watch.rezero()
            assert change is not None
            assert change.rate < 0.1
    assert worst < 0.06
    assert len(watch.changes) == 18
    assert sum(c.change[2] for c in watch.changes) == pytest.approx(0.5, abs=0.05)


def test_a_soft_contact_is_not_taken_for_drift():
    conditioner = WrenchConditioner(Probe(), RATE)
    watch = DriftWatch(conditioner, guard=0.1)
    for k in range(250):
        watch.observe(conditioner.condition(sample(k, [0, 0, 0.04 * (k > 100), 0, 0, 0]), np.eye(3)), True, np.zeros(3))
    assert watch.rezero() is None  # 0.7 N/min
    assert watch.suspicious
    np.testing.assert_array_equal(conditioner.bias, np.zeros(6))
    watch.observe(conditioner.condition(sample(251), np.eye(3)), False, np.zeros(3))
    assert not watch.ready


@pytest.mark.parametrize(
    ("velocity", "moved"),
    [((0.02, 0.0, 0.0), True), ((-0.02, 0.0, 0.0), False), ((0.0, 0.1, 0.0), False), ((0.01, 0.1, 0.0), True)],
)
def test_a_force_that_pushes_the_probe_along_is_the_zero(velocity, moved):
    """0.3 N along x after minutes of contact: a surface at rest would not follow a probe that goes along its force."""
    conditioner = WrenchConditioner(Probe(), RATE)
    watch = DriftWatch(conditioner)
    rng, way = np.random.default_rng(1), np.array(velocity) / RATE
    watch.observe(conditioner.condition(sample(-200 * RATE, np.zeros(6)), np.eye(3)), True, np.zeros(3))
    for k in range(int(3 * RATE)):
        values = np.array([0.3, 0.0, 0.0, 0, 0, 0]) + STEP * rng.normal(size=6)
        watch.observe(conditioner.condition(sample(k, values), np.eye(3)), True, k * way)
    assert watch.ready == moved
    change = watch.rezero()
    assert (change is not None) == moved
    if moved:
        assert conditioner.bias[:3] == pytest.approx([0.3, 0.0, 0.0], abs=0.005)


def test_two_touches_alike_with_free_space_between_them_are_no_zero():
    conditioner = WrenchConditioner(Probe(), RATE)
    watch = DriftWatch(conditioner)
    for k in range(int(4 * RATE)):
        free = RATE <= k < 2 * RATE  # 20 mm along the force, then the next surface
        values, place = [0.0 if free else 0.3, 0, 0, 0, 0, 0], 0.02 * min(max(k / RATE - 1.0, 0.0), 1.0)
        watch.observe(conditioner.condition(sample(k, values), np.eye(3)), True, np.array([place, 0.0, 0.0]))
        if not free:
            assert not watch.ready
    np.testing.assert_array_equal(conditioner.bias, np.zeros(6))


def test_every_move_of_the_zero_is_counted_on_the_wrench():
    conditioner = WrenchConditioner(Probe(), RATE)
    before = conditioner.condition(sample(0), np.eye(3)).zeroing
    conditioner.shift_bias(np.zeros(6))
    conditioner.take_bias([sample(k) for k in range(1, 9)], np.eye(3))
    assert conditioner.condition(sample(9), np.eye(3)).zeroing == before + 2


def test_bad_settings_are_refused_by_name():
    for name, value in (("rate", 0.0), ("rate", np.nan), ("jump", -1.0), ("cutoff", 0.0)):
        with pytest.raises(InputError, match=f"conditioner.{name}"):
            WrenchConditioner(Probe(), **{"rate": RATE, name: value})
    with pytest.raises(InputError, match=r"bias.change"):
        WrenchConditioner(Probe(), RATE).shift_bias(np.zeros(3))
