"""The contact step against a textbook form, over random rows and at the edges of its range."""

import naive_sim as naive
import numpy as np
import pytest

from lwrprobe_sim import contact_kernels as contact

STEP = 1e-3


def random_row(rng, stiffness):
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    bristle = rng.normal(size=3) * 1e-6
    return dict(
        normal=normal, gap=rng.uniform(-2e-5, 5e-6), stiffness=stiffness, damping=rng.choice([0.0, 2e-4 * stiffness]),
        friction=rng.choice([0.0, 0.3, 0.6]), shear=0.8 * stiffness, bristle=bristle - bristle @ normal * normal,
        penetration=max(0.0, rng.normal() * 1e-5), lever=rng.choice([1.0, 0.4]),
    )  # fmt: skip


def as_array(rows):
    out = np.zeros((len(rows), contact.WIDTH))
    for c, row in zip(out, rows):
        c[contact.NORMAL : contact.NORMAL + 3] = row["normal"]
        c[contact.GAP], c[contact.STIFFNESS], c[contact.DAMPING] = row["gap"], row["stiffness"], row["damping"]
        c[contact.STATIC] = c[contact.SLIDING] = c[contact.LIMIT] = row["friction"]
        c[contact.SHEAR], c[contact.PENETRATION], c[contact.LEVER] = row["shear"], row["penetration"], row["lever"]
        c[contact.BRISTLE : contact.BRISTLE + 3] = row["bristle"]
        c[contact.FIXED_LIMIT] = -1.0
    return out


def random_compliance(rng, size):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.ascontiguousarray(turn @ np.diag(size * rng.uniform(0.01, 1.0, 3)) @ turn.T)


def both(bending, moving=0.0):
    """Of what bends and of what moves as a whole; nothing of the latter."""
    bending = np.array(bending)
    return np.array([bending, np.broadcast_to(moving, bending.shape)])


def settled(rows, free, compliance, slow=0.0):
    c, x = as_array(rows), np.zeros((2, 3))
    status = contact.settle(c, len(rows), np.array(free), compliance, STEP, slow, x, np.zeros(contact.SCRATCH))
    return c, x, status


@pytest.mark.parametrize("seed", range(20))
def test_force_of_one_contact_is_the_textbook_one(seed):
    rng = np.random.default_rng(seed)
    row = random_row(rng, 10 ** rng.uniform(2, 7))
    x = rng.normal(size=3) * 1e-5
    c = as_array([row])
    slipping = contact.contact_force(c, 0, *x, STEP)
    force, expected = naive.contact_force(row, x, STEP)
    assert c[0, contact.FORCE : contact.FORCE + 3] == pytest.approx(force, rel=1e-9, abs=1e-12)
    if np.linalg.norm(force) > 0 and row["friction"] > 0:
        assert slipping == expected


@pytest.mark.parametrize("seed", range(12))
def test_tangent_stiffness_is_the_derivative(seed):
    rng = np.random.default_rng(100 + seed)
    row = random_row(rng, 1e4)
    x = -2e-5 * row["normal"] * rng.uniform(0.5, 1.0) + rng.normal(size=3) * 1e-6
    c, tangent, e = as_array([row]), np.zeros((3, 3, 3)), 1e-10
    contact.add_tangent_stiffness(c, 0, *x, STEP, tangent)
    columns = [
        naive.contact_force(row, x - e * i, STEP)[0] - naive.contact_force(row, x + e * i, STEP)[0] for i in np.eye(3)
    ]
    for power, sums in enumerate(tangent):
        assert sums == pytest.approx(row["lever"] ** power * np.array(columns).T / (2 * e), rel=1e-4, abs=1.0)


@pytest.mark.parametrize("seed", range(12))
def test_newtons_step_solves_its_linear_equations(seed):
    rng = np.random.default_rng(150 + seed)
    compliance = np.array([random_compliance(rng, 10 ** rng.uniform(-7, -3)) for _ in range(2)])
    tangent, r, system = 10 ** rng.uniform(2, 6) * rng.normal(size=(3, 3, 3)), rng.normal(size=6), np.zeros((6, 7))
    contact.newton_direction(tangent, compliance, r, system)
    whole = np.block([[g @ tangent[2 - p - q] for q in range(2)] for p, g in enumerate(compliance)]) + np.eye(6)
    assert system[:, 6] == pytest.approx(np.linalg.solve(whole, r), rel=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_balance_is_where_slow_relaxation_ends(seed):
    rng = np.random.default_rng(200 + seed)
    rows = [random_row(rng, 1e4) for _ in range(rng.integers(1, 4))]
    compliance = np.array([random_compliance(rng, 4e-5), random_compliance(rng, 4e-5)])
    free = rng.normal(size=(2, 3)) * 2e-5
    _, x, status = settled(rows, free, compliance)
    assert status == 1
    assert x == pytest.approx(naive.balance_by_relaxation(rows, free, compliance, STEP), abs=2e-12)


@pytest.mark.slow
def test_random_stiff_jammed_and_rigid_cases_all_balance():
    rng = np.random.default_rng(7)
    in_turns = 0
    for _ in range(3000):
        rows = [random_row(rng, 10 ** rng.uniform(2, 7)) for _ in range(rng.integers(1, 6))]
        sizes = 10 ** rng.uniform(-7, -2, 2) * rng.integers(0, 2, 2)
        compliance = np.array([random_compliance(rng, size) for size in sizes])
        free = rng.normal(size=(2, 3)) * 10 ** rng.uniform(-6, -3)
        c, x, status = settled(rows, free, compliance)
        assert status > 0
        in_turns += status == 2
        forces = c[:, contact.FORCE : contact.FORCE + 3]
        pulls = c[:, contact.LEVER] @ forces, forces.sum(axis=0)
        # the force is read at x, so a rounding of x counts as stiffness times rounding
        slack = 1e-9 + 1e-12 * np.linalg.norm(compliance, 2, axis=(1, 2)).max() * np.sum(c[:, contact.STIFFNESS])
        for moved, unpushed, soft, pull in zip(x, free, compliance, pulls):
            assert moved == pytest.approx(unpushed + soft @ pull, abs=slack)
    assert in_turns < 60


@pytest.mark.parametrize("way", [1e-4, 1e-8, 1e-12, 1e-15])
def test_however_short_the_way_its_share_is_right(way):
    """In a step of a microsecond a mass moves by less than 1e-13 m, and all of it must count."""
    row = dict(
        normal=np.array([0.0, 0, 1]), gap=0.0, stiffness=1e4, damping=0.0, friction=0.0, shear=8e3,
        bristle=np.zeros(3), penetration=0.0, lever=1.0,
    )  # fmt: skip
    _, x, status = settled([row], both([0.0, 0.0, -way]), both(1e-4 * np.eye(3)))
    assert status == 1
    assert x[0, 2] == pytest.approx(-way / (1.0 + 1e-4 * 1e4), rel=1e-8)


@pytest.mark.parametrize("stiffness", 10.0 ** np.arange(2, 8))
def test_friction_never_leaves_the_cone(stiffness):
    rng = np.random.default_rng(3)
    for _ in range(200):
        rows = [random_row(rng, stiffness) for _ in range(2)]
        c, _, status = settled(rows, both(rng.normal(size=3) * 1e-4), both(random_compliance(rng, 4e-4)))
        if status != 1:
            continue
        for row, out in zip(rows, c):
            force = out[contact.FORCE : contact.FORCE + 3]
            press = force @ row["normal"]
            assert press >= 0.0
            assert np.linalg.norm(force - press * row["normal"]) <= row["friction"] * press * (1 + 1e-9) + 1e-12


def test_static_friction_holds_longer_than_sliding_friction_and_falls_to_it():
    row = dict(
        normal=np.array([0.0, 0, 1]), gap=-1e-4, stiffness=1e4, damping=0.0, friction=0.3, shear=8e3,
        bristle=np.zeros(3), penetration=1e-4, lever=1.0,
    )  # fmt: skip
    compliance = np.diag([4e-4, 4e-4, 0.0])

    def pulled(share):
        c, x = as_array([row]), np.zeros((2, 3))
        c[0, contact.STATIC] = 0.45
        pull = share * 1.0  # N, of a normal force of 1 N
        free = np.array([pull * (4e-4 + 1.0 / 8e3), 0.0, 0.0])
        contact.settle(c, 1, both(free), both(compliance), STEP, 1e-3, x, np.zeros(contact.SCRATCH))
        return -c[0, contact.FORCE], c[0, contact.SLIP]

    assert pulled(0.44) == pytest.approx((0.44, 0.0), abs=1e-9)
    force, speed = pulled(0.46)
    assert force == pytest.approx(0.30, abs=1e-9)
    assert speed > 0.0


@pytest.mark.parametrize("lever", [1.0, 0.5, 0.05])
def test_near_its_end_the_stick_is_stiff_and_what_carries_it_is_not(lever):
    """Springs in series: the object, the bending by the lever twice, and all of what moves as a whole."""
    row = dict(
        normal=np.array([0.0, 0, 1]), gap=0.0, stiffness=1e5, damping=0.0, friction=0.0, shear=8e4,
        bristle=np.zeros(3), penetration=0.0, lever=lever,
    )  # fmt: skip
    stick, joints, pushed = 4e-4, 5e-5, 1e-4
    c, x, status = settled([row], [np.zeros(3), [0.0, 0.0, -pushed]], np.array([stick * np.eye(3), joints * np.eye(3)]))
    assert status == 1
    force = pushed / (1.0 / 1e5 + lever**2 * stick + joints)
    assert c[0, contact.PRESS] == pytest.approx(force, rel=1e-6)
    assert x[:, 2] == pytest.approx([lever * stick * force, joints * force - pushed], rel=1e-6)
