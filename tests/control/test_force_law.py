"""The force law against simulated loops: what the formulas say is what happens."""

import math

import numpy as np
import pytest

from lwrprobe.contact import LimitCycle
from lwrprobe.contracts import InputError
from lwrprobe.control import (
    ForceLaw,
    Refusal,
    approach_speed,
    choose_force_law,
    contour_speed,
    peak_force,
    run_on,
)
from lwrprobe.control.force_law import NO_OVERSHOOT

TARGET, LIMIT = 1.0, 5.0


def press(stiffness, damping, samples_late, period, count=4000, target=TARGET, inward=math.inf):
    """Position-controlled tip against a spring wall, force seen `samples_late` samples late: the forces."""
    law = ForceLaw(stiffness, samples_late * period, damping, inward, 0.01, target, LIMIT)
    depth, seen, forces = 0.0, [0.0] * (samples_late + 1), []
    for _ in range(count):
        forces.append(stiffness * max(depth, 0.0))
        seen.append(forces[-1])
        depth -= period * law.normal_velocity(seen[-1 - samples_late])
    return np.array(forces)


@pytest.mark.parametrize(("late", "bound"), [(0, 2.0), (1, 1.0), (2, 0.618), (3, 0.445), (5, 0.285), (10, 0.149)])
def test_the_loop_is_stable_exactly_below_the_known_bound(late, bound):
    """K T / B < 2 sin(pi / (2 (2 d + 1))), for the law as it is used."""
    assert bound == pytest.approx(2 * math.sin(math.pi / (2 * (2 * late + 1))), abs=1e-3)
    period, stiffness = 0.001, 1e4
    calm = press(stiffness, stiffness * period / (0.97 * bound), late, period)
    wild = press(stiffness, stiffness * period / (1.03 * bound), late, period)
    assert np.ptp(calm[-200:]) < 0.02 * TARGET
    assert np.ptp(wild[-200:]) > 0.2 * TARGET


@pytest.mark.parametrize("late", [1, 2, 5, 10])
def test_the_chosen_damping_does_not_overshoot(late):
    period, stiffness = 0.001, 1e4
    law = choose_force_law(stiffness, (late + 0.5) * period, TARGET, LIMIT)
    forces = press(stiffness, law.damping, late, period)
    assert law.stability_number == pytest.approx(NO_OVERSHOOT)
    assert forces.max() <= 1.02 * TARGET
    assert forces[-1] == pytest.approx(TARGET, rel=1e-3)


def approach(stiffness, delay, speed, braking, threshold, step=1e-5):
    """Largest force when the tip runs on for `delay` after the threshold and then brakes."""
    depth, seen_at, time = 0.0, None, 0.0
    step = min(step, 0.02 * threshold / (stiffness * speed))
    peak = 0.0
    while speed > 0.0:
        depth += speed * step
        time += step
        peak = max(peak, stiffness * depth)
        if seen_at is None and stiffness * depth >= threshold:
            seen_at = time
        if seen_at is not None and time > seen_at + delay:
            speed -= braking * step
    return peak


@pytest.mark.parametrize("stiffness", [1e2, 1e3, 1e4, 1e5, 1e6, 1e7])
def test_stiffness_sweep_is_within_the_limit_or_refused_with_the_reason(stiffness):
    """1e2 to 1e7 N/m at 10 ms: the peak force never passes the limit."""
    law = choose_force_law(stiffness, 0.01, TARGET, LIMIT, force_threshold=0.2)
    if isinstance(law, Refusal):
        assert stiffness >= 1e7
        assert "mm/s" in law.reason
        return
    peak = approach(stiffness, 0.01, law.approach_speed, 1.0, 0.2)
    assert peak <= LIMIT
    assert peak == pytest.approx(peak_force(law.approach_speed, stiffness, 0.01, 1.0, 0.2), rel=0.1)


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.005, 0.01, 0.02, 0.05])
def test_latency_sweep_reduces_the_speed_and_meets_the_formula(delay):
    """K 1e5: peak force within 10 % of the formula."""
    law = choose_force_law(1e5, delay, TARGET, LIMIT, force_threshold=0.2)
    assert isinstance(law, ForceLaw)
    peak = approach(1e5, delay, law.approach_speed, 1.0, 0.2)
    assert peak == pytest.approx(peak_force(law.approach_speed, 1e5, delay, 1.0, 0.2), rel=0.1)
    assert peak <= LIMIT


def test_speeds_fall_with_stiffness_and_delay():
    speeds = [approach_speed(11.8, k, 0.01, 1.0) for k in (1e2, 2.5e3, 1e4, 1e5, 1e6, 1e7)]
    np.testing.assert_allclose(1e3 * np.array(speeds), [476, 88, 40, 8.3, 1.1, 0.12], rtol=0.05)
    assert speeds == sorted(speeds, reverse=True)
    contours = [contour_speed(k, 0.01, 1.0, 5.0, math.e * k * 0.01) for k in (1e3, 1e4, 1e5)]
    assert contours == sorted(contours, reverse=True)
    with_impact = choose_force_law(1e6, 0.0005, TARGET, LIMIT, tip_mass=0.1)
    assert with_impact.approach_speed <= 0.8 * LIMIT / math.sqrt(1e6 * 0.1) + 1e-12


@pytest.mark.parametrize("mass", [0.5, 4.3, 16.0])
@pytest.mark.parametrize("contact", [2.5e3, 1e5, 1.3e6])
def test_a_driven_mass_presses_with_what_the_run_on_says(mass, contact):
    """Twin: m x'' + (k_a + k_c) x = k_a v t, integrated; the force of the contact stays below K v (t + run-on)."""
    arm, speed, step = 2e4, 0.01, 2e-6
    series = arm * contact / (arm + contact)
    place, rate, excess = 0.0, speed, 0.0
    for k in range(int(4.0 * math.sqrt(mass / (arm + contact)) / step)):
        rate += step * (arm * speed * k * step - (arm + contact) * place) / mass
        place += step * rate
        excess = max(excess, contact * place - series * speed * k * step)
    assert excess == pytest.approx(series * speed * run_on(mass, series, arm), rel=0.01)
    assert run_on(mass, series, arm) <= math.sqrt(mass * contact) / series  # a free mass at the same speed presses more
    assert run_on(mass, contact) == pytest.approx(math.sqrt(mass / contact))


def test_a_heavy_arm_touches_a_hard_surface_slowly_and_a_soft_stick_as_fast_as_before():
    stiff, soft = 1.0 / (5e-5 + 7.7e-7), 1.0 / (5e-5 + 4e-4)
    light, heavy = (choose_force_law(stiff, 0.0156, TARGET, LIMIT, tip_mass=m, arm_stiffness=2.2e4) for m in (0.0, 4.3))
    assert heavy.approach_speed < 0.5 * light.approach_speed
    assert heavy.damping == light.damping
    light, heavy = (choose_force_law(soft, 0.0156, TARGET, LIMIT, tip_mass=m, arm_stiffness=2.2e4) for m in (0.0, 4.3))
    assert heavy.approach_speed > 0.85 * light.approach_speed
    assert run_on(4.3, stiff, math.inf) == 0.0


def test_a_given_damping_is_judged_by_its_stability_number():
    k_tau = 1e4 * 0.01
    assert choose_force_law(1e4, 0.01, TARGET, LIMIT, damping=3.0 * k_tau).warnings == ()
    assert "overshoots" in choose_force_law(1e4, 0.01, TARGET, LIMIT, damping=1.5 * k_tau).warnings[0]
    refused = choose_force_law(1e4, 0.01, TARGET, LIMIT, damping=0.8 * k_tau)
    assert isinstance(refused, Refusal)
    assert refused.stability_number == pytest.approx(1.25)
    assert "stability number" in refused.reason


def test_the_law_presses_slowly_and_yields_at_once():
    law = choose_force_law(1e4, 0.01, TARGET, LIMIT)
    assert law.normal_velocity(TARGET) == 0.0
    assert law.normal_velocity(0.0) >= -law.approach_speed
    assert law.normal_velocity(20.0) == pytest.approx(19.0 / law.damping)  # yielding is never clipped


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("force.stiffness", {"stiffness": 0.0}),
        ("force.stiffness", {"stiffness": math.nan}),
        ("force.delay", {"delay": -0.1}),
        ("force.delay", {"delay": math.inf}),
        ("force.limit", {"force_limit": 0.5}),
        ("force.limit", {"force_threshold": 2.0}),
        ("force.braking", {"braking": 0.0}),
        ("force.damping", {"damping": -1.0}),
    ],
)
def test_bad_numbers_are_refused_by_name(field, change):
    given = {"stiffness": 1e4, "delay": 0.01, "force_target": TARGET, "force_limit": LIMIT} | change
    with pytest.raises(InputError, match=field):
        choose_force_law(**given)


# Limit cycles


def test_an_unstable_loop_is_seen_and_backing_off_calms_it():
    period, late, stiffness = 0.001, 5, 1e4
    watch = LimitCycle(TARGET, (late + 0.5) * period, period)
    damping = stiffness * period / (1.5 * 0.285)  # half as much again as is stable
    depth, seen, forces = 0.0, [0.0] * (late + 1), []
    for k in range(6000):
        forces.append(stiffness * max(depth, 0.0))
        seen.append(forces[-1])
        scale = watch.update(k * period, seen[-1 - late]) if k > 100 else 1.0
        law = ForceLaw(stiffness, late * period, damping / scale, 0.02, 0.01, TARGET, LIMIT)
        depth -= period * law.normal_velocity(seen[-1 - late])
    assert watch.detections >= 1
    assert np.ptp(forces[50:150]) > 0.5 * TARGET
    quiet = [np.ptp(forces[k : k + 100]) for k in range(500, 6000, 100)]
    assert np.median(quiet) < 0.3 * TARGET


def test_a_swing_that_takes_the_sphere_off_the_surface_is_one_and_a_last_lift_is_none():
    watch, delay, period = LimitCycle(TARGET, 0.03, 0.008, band=0.5 * TARGET), 0.03, 0.2
    for k in range(250):
        force = 1.5 * math.sin(2.0 * math.pi * 0.008 * k / period)
        watch.update(0.008 * k, TARGET + force) if TARGET + force > 0.0 else watch.lose(0.008 * k)
    assert watch.scale < 1.0
    once = LimitCycle(TARGET, delay, 0.008, band=0.5 * TARGET)
    for k in range(250):
        once.update(0.008 * k, 1.6 * TARGET) if k % 60 < 30 else once.lose(0.008 * k)
    assert once.detections == 0, "touched and left, again and again"


def test_noise_bumps_and_one_overshoot_are_no_limit_cycle():
    rng = np.random.default_rng(0)
    watch = LimitCycle(TARGET, 0.01, 0.008)
    for k in range(5000):
        force = TARGET + 0.02 * rng.normal() + 0.3 * math.sin(2 * math.pi * 0.008 * k / 0.5)  # a surface with waves
        assert watch.update(0.008 * k, force) == 1.0
    assert watch.detections == 0
    stable = press(1e4, 1e4 * 0.001 / (0.7 * 0.285), 5, 0.001)  # overshoots, then settles
    settled = LimitCycle(TARGET, 0.0055, 0.001)
    for k, force in enumerate(stable):
        settled.update(0.001 * k, force)
    assert settled.detections <= 1


def test_calm_takes_the_backing_off_back_and_losing_contact_starts_anew():
    watch = LimitCycle(TARGET, 0.01, 0.002)
    for k in range(20):
        watch.update(0.01 * k, TARGET + (0.5 if k % 2 else -0.5))
    low = watch.scale
    assert low < 1.0
    watch.reset()
    assert watch.scale == low
    scales = [watch.update(0.2 + 0.002 * k, TARGET) for k in range(1000)]
    assert scales[0] == low
    assert scales[-1] == 1.0
    with pytest.raises(InputError, match=r"limit_cycle.target"):
        LimitCycle(0.0, 0.01, 0.001)
