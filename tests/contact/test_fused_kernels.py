"""Each kernel of the fused estimator against its textbook form, on random and on extreme samples and memories."""

import naive_contact
import naive_fused as naive
import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from lwrprobe.contact import Settings, fused_kernels, kernels
from lwrprobe.contact.estimator import shared_params
from lwrprobe.contracts import Probe

PROBE = Probe(compliance=(2e-5, 3e-5, 1e-6))
SEEDS = range(24)
PARAMS = shared_params(PROBE, Settings(indentation=2e-5), fused_kernels.PARAMS)
for _at, _value in {
    fused_kernels.P_SPEED_NOISE: 5e-4, fused_kernels.P_SLIP_ANGLE: 0.003, fused_kernels.P_MIN_SPEED: 2e-3,
    fused_kernels.P_HIDDEN_COMPLIANCE: 1e-4, fused_kernels.P_MEMORY: 0.25, fused_kernels.P_WALL_CLEARANCE: 1.5e-4,
    fused_kernels.P_ZERO_TIME: 20.0, fused_kernels.P_LAG: 0.04,
}.items():  # fmt: skip
    PARAMS[_at] = _value
P = naive.unpack(PARAMS, naive.PARAMS)


def rotation_about(vector):
    size = np.linalg.norm(vector)
    axis = naive_contact.cross_matrix(vector / size)
    return np.eye(3) + np.sin(size) * axis + (1.0 - np.cos(size)) * axis @ axis


def information(rng, normal, low=1.0, high=5.0):
    """Positive definite across the normal, 10^low to 10^high 1/rad²."""
    basis = naive.tangent_basis(normal)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    return basis @ turn @ np.diag(10.0 ** rng.uniform(low, high, 2)) @ turn.T @ basis.T


class Case:
    """One sample on a surface with friction, and a memory of the surface that may fit it or not.

    The kernel works on the arrays, the textbook form on the records; `check_memory` compares what both leave.
    """

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        self.normal = n = naive_contact.unit(rng.normal(size=3))
        speed = rng.choice([0.0, 1e-3, 0.02])
        velocity = speed * naive.tangent_basis(n) @ naive_contact.unit(rng.normal(size=2))
        force = 10.0 ** rng.uniform(-1.0, 1.0) * (n - rng.uniform(0.0, 0.7) * velocity / max(speed, 1e-9))
        rotation = naive_contact.random_rotation(rng)
        wrench = naive_contact.contact_wrench(PROBE, rotation, [(n, force)], rng=rng)
        dt = rng.choice([1e-3, 0.008, 0.1])
        self.row = naive.pack(
            naive.SimpleNamespace(
                force=wrench.force, torque=wrench.torque, centre=0.1 * rng.normal(size=3),
                velocity=velocity + 3e-4 * rng.normal(size=3), rotation=rotation, status=0.0, time=10.0, zeroing=0.0,
            ),
            naive.GIVEN,
            kernels.INPUT,
        )  # fmt: skip
        self.given = naive.unpack(self.row, naive.GIVEN)
        self.force = self.given.rotation @ self.given.force
        self.memory = s = naive.unpack(np.zeros(fused_kernels.STATE), naive.MEMORY)
        s.begun, s.time, s.force = float(rng.random() < 0.9), 10.0 - dt, wrench_size(force) * rng.choice([1.0, 0.5])
        s.centre = self.given.centre - dt * velocity * rng.choice([1.0, 0.1])
        s.normal = naive_contact.unit(n + rng.choice([1e-3, 0.3]) * rng.normal(size=3))
        s.info = information(rng, s.normal)
        s.friction, s.friction_var = rng.uniform(0.0, 0.8), 10.0 ** rng.uniform(-5.0, -1.0)
        s.rotation = rotation_about(1e-3 * rng.normal(size=3)) @ rotation
        s.mismatch, s.turn = 0.02 * rng.normal(size=3), 60.0 * rng.normal(size=3)
        s.ambiguous, s.anchor = float(rng.random() < 0.3), self.given.centre + 1.5e-4 * rng.normal(size=3)
        s.wall, s.before = naive_contact.unit(rng.normal(size=3)), naive_contact.unit(n + 0.1 * rng.normal(size=3))
        s.path, s.streak = rng.uniform(0.0, 0.1), float(rng.integers(0, 12))
        s.otherwise = s.path - rng.choice([0.0, 5e-4, 2e-3])
        s.wall = s.wall if rng.random() < 0.5 else n
        s.offset = 0.02 * rng.normal(size=3)
        root = rng.normal(size=(3, 3))
        s.offset_cov = rng.choice([0.0, 1e-4]) * root @ root.T
        s.offset_time, s.zeroing = 10.0 - rng.choice([dt, 30.0, 500.0]), rng.choice([0.0, 0.0, 1.0])
        s.velocity, s.speed_var = velocity + 1e-3 * rng.normal(size=3), 10.0 ** rng.uniform(-8.0, -5.0)
        s.turn_way, s.ring_time = rng.uniform(0.0, 1e-3), 10.0 - rng.choice([dt, 0.0, -1.0])
        s.head = float(rng.integers(0, 40))
        for row in s.ring:
            row[:] = [s.path - rng.uniform(0.0, 2e-3), *naive_contact.unit(n + 0.1 * rng.normal(size=3)), 0.01]
        s.axis = rng.uniform() / naive.tangent_spread(s.info, s.normal) ** 2
        s.slip = naive_contact.unit(velocity + 0.3 * speed * rng.normal(size=3) + 1e-9)
        s.load = self.given.force[:2] + rng.choice([0.0, 0.01, 0.3]) * rng.normal(size=2)
        s.lag, s.lag_learnt = rng.uniform(-0.02, 0.02, (2, 2))
        self.state = naive.pack(s, naive.MEMORY, fused_kernels.STATE)
        self.total = rng.choice([1.0, 100.0]) * information(rng, n, 2.0, 4.0)
        self.cov = np.cov(rng.normal(size=(3, 12))) * 1e-3
        raw = (wrench.torque - np.cross(naive.lever(self.given, P), wrench.force)) / PROBE.radius
        self.m = naive.consistent_torque(self.given, self.cov, raw)
        self.out = np.zeros(kernels.OUTPUT)
        self.out[kernels.O_FORCE : kernels.O_FORCE + 3] = self.force

    def check_memory(self):
        after = naive.unpack(self.state, naive.MEMORY)
        for name in naive.MEMORY:
            close(getattr(after, name), getattr(self.memory, name), name)


def wrench_size(force):
    return float(np.linalg.norm(force))


def close(one, other, name="", share=1e-7):
    one, other = np.asarray(one), np.asarray(other)
    scale = max(np.abs(other).max(initial=0.0), 1e-12)
    np.testing.assert_allclose(one, other, rtol=0.0, atol=share * scale, err_msg=name)


@pytest.fixture(params=SEEDS)
def case(request):
    return Case(request.param)


def test_every_kernel_of_the_file_has_a_comparison_here():
    own = {
        name
        for name, made in vars(fused_kernels).items()
        if getattr(made, "__module__", "") == fused_kernels.__name__ and callable(made)
    }
    with open(__file__) as file:
        text = file.read()
    assert len(own) > 20
    assert {name for name in own if f"fused_kernels.{name}(" not in text} == set()


# --- algebra


def test_add_square(case):
    a, expected = case.rng.normal(size=3), case.total.copy()
    fused_kernels.add_square(case.total, *a, 3.0)
    close(case.total, expected + 3.0 * np.outer(a, a))


def test_to_world(case):
    normal, total = np.empty(3), np.empty((3, 3))
    fused_kernels.to_world(case.row, case.normal, case.cov, normal, total)
    expected = naive.to_world(case.given, case.normal, case.cov)
    close(normal, expected[0])
    close(total, expected[1])


def test_chi_squared(case):
    d, v = 0.1 * case.rng.normal(size=3), naive_contact.unit(case.rng.normal(size=3))
    for variance in (0.0, 1e-4, 1.0):
        for info in (case.total, case.total + 50.0 * np.eye(3)):
            found = fused_kernels.chi_squared(d, info, 2.0, v, variance)
            assert found == pytest.approx(naive.chi_squared(d, info, 2.0, v, variance), rel=1e-6)
        whole = np.linalg.inv(2.0 * info) + variance * np.outer(v, v)
        assert found == pytest.approx(d @ np.linalg.inv(whole) @ d, rel=1e-6)


def test_smallest_direction(case):
    start = naive_contact.unit(case.normal + 0.3 * case.rng.normal(size=3))
    for total in (case.total, case.total + np.eye(3), np.eye(3)):
        found = start.copy()
        fused_kernels.smallest_direction(total, found)
        close(found, naive.smallest_direction(total, start))
    found = start.copy()
    fused_kernels.smallest_direction(case.total + 1e-3 * np.eye(3), found)
    close(found, naive.eigen_direction(case.total + 1e-3 * np.eye(3), start))
    zero = start.copy()
    fused_kernels.smallest_direction(np.diag([1.0, 0.0, 0.0]), zero)  # of rank one: nothing is known
    close(zero, start)


def test_spread(case):
    for variance in (0.0, 1e-6, 1e-2, 10.0):
        s, state = naive.unpack(case.state, naive.MEMORY), case.state.copy()
        fused_kernels.spread(state, variance)
        naive.spread_memory(s, variance)
        after = naive.unpack(state, naive.MEMORY)
        close(after.info, s.info)
        close(after.axis, s.axis)
    state[fused_kernels.S_INFO : fused_kernels.S_INFO + 9] = 0.0
    fused_kernels.spread(state, 1.0)
    assert not state[fused_kernels.S_INFO : fused_kernels.S_INFO + 9].any()


# --- the drift of the sensor's zero


def test_age_offset(case):
    fused_kernels.age_offset(case.row, PARAMS, case.state)
    naive.age_offset(case.given, P, case.memory)
    case.check_memory()


@pytest.mark.parametrize("width", [0.0, 0.04])
def test_turn_load(case, width):
    params = PARAMS.copy()
    params[fused_kernels.P_LAG] = width
    fused_kernels.turn_load(case.row, params, case.state)
    naive.turn_load(case.given, naive.unpack(params, naive.PARAMS), case.memory)
    case.check_memory()


def test_loosen_offset(case):
    share = case.rng.random()
    fused_kernels.loosen_offset(PARAMS, case.state, share)
    naive.loosen_offset(P, case.memory, share)
    case.check_memory()


def test_add_offset(case):
    raw, m, cov = case.rng.normal(size=3), np.empty(3), case.cov.copy()
    share = fused_kernels.add_offset(case.state, raw, m, cov)
    expected = naive.add_offset(case.memory, raw, case.cov)
    for found, wanted in zip((m, cov, share), expected, strict=True):
        close(found, wanted)
    assert fused_kernels.add_offset(np.zeros(fused_kernels.STATE), raw, m, np.zeros((3, 3))) == 0.0


def test_common_share(case):
    for common in (0.0, 0.4, 1.0):
        close(fused_kernels.common_share(PARAMS, case.total, common), naive.common_share(P, case.total, common))


def test_shared_error_is_what_common_errors_add_to_a_mean(case):
    axis, common, count = 10.0 ** case.rng.uniform(-2.0, 0.0), case.rng.random(), int(case.rng.integers(1, 50))
    known = count / axis**2
    found = fused_kernels.shared_error(axis, axis / np.sqrt(count), known, common)
    close(found, naive.shared_error(axis, axis / np.sqrt(count), known, common))
    together = axis * np.sqrt(common + (1.0 - common) / count)
    close(np.hypot(axis / np.sqrt(count), found), together)
    assert fused_kernels.shared_error(axis, axis, 0.5 / axis**2, common) == 0.0, "no more than one of them"


def test_doubt_memory(case):
    for axis, common in ((0.02, 0.9), (0.3, 0.5), (0.1, 0.0)):
        fused_kernels.doubt_memory(case.state, axis, common)
        naive.doubt_memory(case.memory, axis, common)
        case.check_memory()


def test_learn_offset(case):
    raw = 0.1 * case.rng.normal(size=3)
    cov = case.cov + case.memory.offset_cov
    fused_kernels.learn_offset(case.row, PARAMS, case.state, raw, cov, case.out)
    naive.learn_offset(case.given, P, case.memory, raw, cov, case.force)
    case.check_memory()


def test_no_wander_of_the_zero_explains_the_torque_of_another_contact(case):
    case.row[kernels.I_VELOCITY : kernels.I_VELOCITY + 3] = 0.02 * np.cross(case.force, case.rng.normal(size=3))
    case.state[fused_kernels.S_STREAK], case.state[fused_kernels.S_OFFSET : fused_kernels.S_OFFSET + 3] = 10.0, 0.0
    prior = naive.first_offset_cov(P)
    case.state[fused_kernels.S_OFFSET_COV : fused_kernels.S_OFFSET_COV + 9] = prior.ravel()
    raw = case.rng.normal(size=3)
    for _ in range(100):
        cov = case.cov + case.state[fused_kernels.S_OFFSET_COV : fused_kernels.S_OFFSET_COV + 9].reshape(3, 3)
        fused_kernels.learn_offset(case.row, PARAMS, case.state, raw, cov, case.out)
    offset = case.state[fused_kernels.S_OFFSET : fused_kernels.S_OFFSET + 3]
    assert offset @ np.linalg.inv(prior) @ offset <= 16.3


def test_wanders_so_far(case):
    cov, prior = case.cov + case.memory.offset_cov, naive.first_offset_cov(P)
    size = np.sqrt(np.trace(case.cov + prior))
    for share in (0.0, 1.0, 3.0, 10.0):
        offset = share * size * case.normal
        found = fused_kernels.wanders_so_far(PARAMS, case.state, cov, offset)
        assert found == naive.wanders_so_far(P, case.memory, cov, offset)
        assert found or share >= 3.0
        assert not found or share <= 3.0


def test_contact_torque(case):
    close(fused_kernels.contact_torque(case.row, case.normal), naive.contact_torque(case.given, case.normal))


def test_inverse_with(case):
    i, j = np.triu_indices(3)
    for variance in (0.0, 1e-4, 1.0):
        found = fused_kernels.inverse_with(case.cov, variance)
        close(found, naive.inverse_with(case.cov, variance)[i, j])
        d = case.rng.normal(size=3)
        close(fused_kernels.squared_errors(d, found), d @ naive.inverse_with(case.cov, variance) @ d)


# --- from sample to sample


def test_advance(case):
    case.row[kernels.I_TIME] = case.given.time = case.rng.choice([10.0, 10.0, 9.0, 20.0, case.memory.time])
    travel = fused_kernels.advance(case.row, PARAMS, case.state)
    assert travel == pytest.approx(naive.advance(case.given, P, case.memory), rel=1e-9)
    case.check_memory()


def test_advance_forgets_the_surface_after_a_leap(case):
    case.row[kernels.I_CENTRE] += 2.0 * PROBE.radius
    case.state[fused_kernels.S_BEGUN] = 1.0
    assert fused_kernels.advance(case.row, PARAMS, case.state) == 0.0
    assert case.state[fused_kernels.S_BEGUN] == 0.0


def test_watch_velocity(case):
    fused_kernels.watch_velocity(case.row, PARAMS, case.state)
    naive.watch_velocity(case.given, P, case.memory)
    case.check_memory()


def test_predict(case):
    travel = case.rng.uniform(0.0, 1e-3)
    fused_kernels.predict(case.state, travel)
    naive.predict(case.memory, travel)
    case.check_memory()


def test_learn_turn(case):
    for sigma in (1e-4, 0.05, np.pi):
        fused_kernels.learn_turn(case.state, case.normal, sigma, 2e-4, PROBE.radius)
        naive.learn_turn(case.memory, case.normal, sigma, 2e-4, PROBE.radius)
    case.check_memory()
    assert wrench_size(case.memory.turn) * PROBE.radius <= max(1.0, 250 * PROBE.radius)


# --- sliding and friction


def test_sliding_normal(case):
    n = np.empty(3)
    found = fused_kernels.sliding_normal(case.row, case.out, wrench_size(case.given.velocity), n)
    expected = naive.sliding_normal(case.force, case.given.velocity)
    close(n, expected[0])
    close(found, expected[1:])


def test_slip_velocity(case):
    slip = np.empty(3)
    speed = fused_kernels.slip_velocity(case.row, case.state, case.normal, PARAMS, slip)
    expected = naive.slip_velocity(case.given, case.memory, case.normal, P)
    close(slip, expected[0])
    assert speed == pytest.approx(expected[1], rel=1e-9)


@pytest.mark.parametrize("noise", [3e-4, 5e-3])
def test_sliding_agrees(case, noise):
    speed = wrench_size(case.given.velocity)
    found = fused_kernels.sliding_agrees(
        case.row, PARAMS, case.state, case.m, case.cov, case.normal, case.total, case.out, speed, noise, 0.1
    )
    assert found == naive.sliding_agrees(
        case.given, P, case.memory, case.m, case.cov, case.normal, case.total, case.force, speed, noise, 0.1
    )
    case.check_memory()


def test_add_sliding(case):
    slip, total, travel = np.empty(3), case.total.copy(), wrench_size(case.given.centre - case.memory.centre)
    known = case.m, case.cov, case.normal
    found = fused_kernels.add_sliding(case.row, PARAMS, case.state, *known, total, case.out, slip, travel, 0.1)
    expected = naive.add_sliding(case.given, P, case.memory, *known, case.total, case.force, travel, 0.1)
    for one, other in zip((found, total, slip), expected, strict=True):
        close(one, other)
    case.check_memory()


def test_random_samples_take_every_branch_of_sliding():
    outcomes = []
    for seed in SEEDS:
        case = Case(seed)
        travel = wrench_size(case.given.centre - case.memory.centre)
        known = case.m, case.cov, case.normal
        motion, _, _ = naive.add_sliding(case.given, P, case.memory, *known, case.total, case.force, travel, 0.1)
        outcomes.append((motion, case.memory.streak > 0.0, bool(case.memory.info.any())))
    rests, slips, slides = fused_kernels.RESTS, fused_kernels.SLIPS, fused_kernels.SLIDES
    assert {(slides, True, True), (rests, False, False), (rests, False, True), (slips, True, True)} <= set(outcomes)


def test_forget_normal(case):
    fused_kernels.forget_normal(case.state)
    case.memory.info, case.memory.axis = np.zeros((3, 3)), 0.0
    case.check_memory()


@pytest.mark.parametrize("sliding", [False, True])
def test_add_friction(case, sliding):
    slip = naive_contact.unit(case.rng.normal(size=3))
    for mu, variance in ((0.0, 0.09), (0.4, 1e-4), (3.0, 0.0)):
        total = case.total.copy()
        fused_kernels.add_friction(case.row, PARAMS, mu, variance, sliding, slip, total, case.out)
        close(total, naive.add_friction(case.given, P, mu, variance, sliding, slip, case.total, case.force))


def test_learn_friction(case):
    slip = naive_contact.unit(case.rng.normal(size=3))
    for normal in (case.normal, -case.normal, slip):
        fused_kernels.learn_friction(PARAMS, case.state, normal, case.total, slip, case.out)
        naive.learn_friction(P, case.memory, normal, case.total, slip, case.force)
        case.check_memory()


# --- the memory of the surface


def test_add_memory(case):
    total = case.total + 1e-3 * np.eye(3)
    expected = naive.add_memory(case.memory, case.normal, total)
    fused_kernels.add_memory(case.state, case.normal, total)
    close(total, expected)


def test_remember(case):
    total = case.total + np.eye(3)
    expected = naive.remember(case.given, P, case.memory, case.normal, total.copy(), 2e-4)
    fused_kernels.remember(case.row, PARAMS, case.state, case.normal, total, 2e-4)
    close(total, expected)
    case.check_memory()


def test_find_jump(case):
    for turn in (0.01, 0.5, 2.0):
        normal = rotation_about(turn * naive.tangent_basis(case.normal)[:, 0]) @ case.normal
        fused_kernels.find_jump(case.row, PARAMS, case.state, normal, 0.01)
        naive.find_jump(case.given, P, case.memory, normal, 0.01)
        case.check_memory()


def test_ambiguous(case):
    for turn in (0.01, 1.0, 0.01):
        normal = rotation_about(turn * naive.tangent_basis(case.normal)[:, 0]) @ case.normal
        found = fused_kernels.ambiguous(case.row, PARAMS, case.state, normal, 0.01)
        assert found == naive.ambiguous(case.given, P, case.memory, normal, 0.01)
        case.check_memory()
        case.row[kernels.I_TIME] = case.given.time = case.given.time + 0.008
        case.given.centre = case.given.centre + 2e-4
        case.row[kernels.I_CENTRE : kernels.I_CENTRE + 3] = case.given.centre


# --- whole samples


def one_sample(row, state):
    """One step of the kernel and of the textbook form, from the same memory."""
    out, memory = np.empty(kernels.OUTPUT), naive.unpack(state, naive.MEMORY)
    reason = fused_kernels.fused(row, PARAMS, state, out)
    expected, wanted = naive.fused(naive.unpack(row, naive.GIVEN), P, memory)
    assert reason == expected
    close(out[:9], wanted[:9], "contact", 1e-6)
    close(out[9:], wanted[9:], "confidence and error", 1e-5)
    after = naive.unpack(state, naive.MEMORY)
    for name in naive.MEMORY:
        close(getattr(after, name), getattr(memory, name), name, 1e-5)
    return reason


def test_one_random_sample(case):
    one_sample(case.row, case.state)


def over_a_corner(rng, mu, count=70):
    """Along a floor, stuck for a while, against a wall, and up that wall."""
    corner, step, floor, wall = np.array([0.0, -PROBE.radius, PROBE.radius]), 1.6e-4, np.eye(3)[2], -np.eye(3)[1]
    for i in range(count):
        yield corner - step * (count - i) * np.eye(3)[1], 0.02 * np.eye(3)[1], [(floor, floor + mu * wall)]
    for i in range(count):
        push = min(1.0, 0.05 * i)
        yield corner, 1e-3 * rng.normal(size=3), [(floor, floor + (1.0 - push) * mu * wall), (wall, push * wall)]
    for i in range(count):
        yield corner + step * i * floor, 0.02 * floor, [(wall, wall - mu * floor)]


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.6])
def test_a_sequence_with_all_that_happens_to_a_sphere(mu):
    rng = np.random.default_rng(3)
    state, reasons, rotation = np.zeros(fused_kernels.STATE), [], np.diag([1.0, -1.0, -1.0])
    state[fused_kernels.S_FRICTION], state[fused_kernels.S_FRICTION_VAR] = 0.3, 0.09
    for i, (centre, velocity, contacts) in enumerate(over_a_corner(rng, mu)):
        rotation = rotation_about(1e-3 * rng.normal(size=3)) @ rotation
        wrench = naive_contact.contact_wrench(PROBE, rotation, contacts, 0.008 * i, rng)
        given = naive.SimpleNamespace(
            force=wrench.force, torque=wrench.torque, centre=centre, velocity=velocity + 3e-4 * rng.normal(size=3),
            rotation=rotation, status=0.0, time=wrench.time, zeroing=float(i > 100),
        )  # fmt: skip
        reasons.append(one_sample(naive.pack(given, naive.GIVEN, kernels.INPUT), state))
    assert {kernels.GOOD, kernels.AMBIGUOUS} <= set(reasons)
    assert state[fused_kernels.S_FRICTION_VAR] < 0.01  # friction was learnt on the way


EXTREME = st.sampled_from([0.0, -0.0, 1e-12, -1e-5, 0.05, 1.0, -30.0, 1e4, np.nan, np.inf, -np.inf])


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@drawn(
    force=st.lists(EXTREME, min_size=3, max_size=3),
    torque=st.lists(EXTREME, min_size=3, max_size=3),
    velocity=st.lists(EXTREME, min_size=3, max_size=3),
    time=st.sampled_from([0.0, 9.99, 10.0, 10.001, 1e9]),
    status=st.sampled_from([0, 1, 2, 4, 8, 16, 64, 1 << 16]),
    seed=st.integers(0, 20),
)
def test_extreme_samples_give_the_same_reason_and_finite_numbers(force, torque, velocity, time, status, seed):
    case = Case(seed)
    row, out, memory = case.row, np.full(kernels.OUTPUT, np.nan), naive.unpack(case.state, naive.MEMORY)
    row[kernels.I_FORCE : kernels.I_FORCE + 3], row[kernels.I_TORQUE : kernels.I_TORQUE + 3] = force, torque
    row[kernels.I_VELOCITY : kernels.I_VELOCITY + 3] = velocity
    row[kernels.I_TIME], row[kernels.I_STATUS] = time, status
    reason = fused_kernels.fused(row, PARAMS, case.state, out)
    with np.errstate(all="ignore"):
        expected, wanted = naive.fused(naive.unpack(row, naive.GIVEN), P, memory)
    assert reason == expected
    assert np.isfinite(out).all()
    assert np.isfinite(case.state).all()
    assert 0.0 <= out[kernels.O_CONFIDENCE] <= 1.0
    size = wrench_size(out[kernels.O_NORMAL : kernels.O_NORMAL + 3])
    assert size == pytest.approx(1.0, abs=1e-6) or (size == 0.0 and reason not in (kernels.GOOD, kernels.IMPRECISE))
    close(out[:9], wanted[:9], "contact", 1e-5)
