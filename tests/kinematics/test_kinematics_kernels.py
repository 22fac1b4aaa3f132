"""The solver's own building blocks, each against its textbook form."""

import numba
import numpy as np
import pytest
from naive_kinematics import naive_tip
from scipy.spatial.transform import Rotation
from test_kinematics_tracking import TOOL

from lwrprobe.kinematics import IKSolver, Preference, chain_kernels, lwr4
from lwrprobe.kinematics import dls_kernels as dls
from lwrprobe.kinematics import ik_kernels as ik
from lwrprobe.kinematics import preference_kernels as preference
from lwrprobe.kinematics import srs_kernels as srs


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 0.3, 3.0, np.pi - 1e-6, np.pi - 1e-12, np.pi])
def test_the_error_of_a_tip_lies_along_the_rotation_vector(angle):
    rng, e = np.random.default_rng(1), np.zeros(8)
    for _ in range(20):
        start, axis = Rotation.random(rng=rng), rng.normal(size=3)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        tip, target = np.eye(4), np.eye(4)
        tip[:3, :3], target[:3, :3] = start.as_matrix(), (turn * start).as_matrix()
        tip[:3, 3], target[:3, 3] = rng.normal(size=3), rng.normal(size=3)
        half_square = dls.tip_error(tuple(tip.T[:, :3].ravel()), target.ravel(), 0.5, 3.0, e)
        np.testing.assert_allclose(e[:3], 0.5 * (target - tip)[:3, 3], atol=1e-14)
        chord = np.linalg.norm(e[3:6]) / 3.0
        assert chord == pytest.approx(2.0 * np.sin(angle / 2.0), abs=1e-9)
        if chord > 0.0:
            back = Rotation.from_rotvec(angle * e[3:6] / np.linalg.norm(e[3:6]))
            # near half a turn the two directions of the axis are one rotation
            np.testing.assert_allclose(back.as_matrix(), turn.as_matrix(), atol=1e-5 if angle > 3.1 else 1e-8)
        assert half_square == pytest.approx(0.5 * e[:6] @ e[:6])
        assert e[dls.OFF_POSITION] == pytest.approx(np.sum((target - tip)[:3, 3] ** 2))
        assert e[dls.OFF_ROTATION] == pytest.approx(chord**2)


def test_the_factor_solves_the_normal_equations():
    rng = np.random.default_rng(2)
    for _ in range(20):
        jac, free, m = rng.normal(size=(6, 9)), rng.uniform(0.5, 2.0, 9), np.empty((6, 6))
        free[rng.integers(9)] = 0.0
        dls.gram(jac, 9, free, m)
        normal = (jac * free) @ jac.T
        np.testing.assert_allclose(np.tril(m), np.tril(normal), atol=1e-12)
        y = rng.normal(size=6)
        wanted = np.linalg.solve(normal, y)
        dls.factorise(m)
        dls.substitute(m, y)
        np.testing.assert_allclose(y, wanted, rtol=1e-8)


def test_the_active_set_shares_out_what_a_joint_at_its_limit_cannot_do():
    """Steps from next to the limits to a place within them: clamping misses, a bounded least-squares solver judges."""
    from scipy.optimize import lsq_linear

    robot = lwr4(tool=TOOL)
    rng, work = np.random.default_rng(3), np.zeros((dls.SCRATCH, 32))
    low, high = robot.lower, robot.upper
    work[dls.LOW, :7], work[dls.HIGH, :7], work[dls.WEIGHT, :7] = low, high, 1.0
    optimal, clamped = 0, 0
    for _ in range(100):
        q = np.where(rng.random(7) < 0.5, low, high) + rng.uniform(-0.02, 0.02, 7)
        q = np.clip(q, low, high)
        jac = rng.normal(size=(6, 7))
        e = jac @ (np.clip(q + rng.uniform(-0.1, 0.1, 7), low, high) - q)
        work[dls.JAC : dls.JAC + 6, :7], work[dls.ERROR, :6] = jac, e
        dls.damped_step(7, q, 1e-12, work)
        step = work[dls.STEP, :7]
        assert ((q + step >= low - 1e-12) & (q + step <= high + 1e-12)).all()
        best = np.linalg.norm(jac @ lsq_linear(jac, e, (low - q - 1e-12, high - q + 1e-12), tol=1e-14).x - e)
        optimal += np.linalg.norm(jac @ step - e) < best + 1e-6
        clamped += np.linalg.norm(jac @ (np.clip(q + np.linalg.pinv(jac) @ e, low, high) - q) - e) < best + 1e-6
    assert optimal > 60 > 30 > clamped


def test_the_wish_is_the_descent_of_the_potential():
    robot = lwr4(tool=TOOL)
    wanted = Preference(near_posture=0.3, off_limits=0.7, off_singularity=0.2, zone=0.5)
    solver, rng, h = IKSolver(robot, preference=wanted), np.random.default_rng(4), 1e-6
    chain, settings, work, _, _ = ik.parts.py_func(solver._table, 7)
    places, target = ik.places_of.py_func(solver._table, 7), np.eye(4).ravel()
    dls.bound(chain, robot.middle, 10.0, work)

    def potential(q):
        dls.look(chain, settings, target, q, work)
        return preference.potential(settings, places, q, work)

    for q in rng.uniform(robot.lower, robot.upper, (10, 7)):
        slope = [(potential(q + h * e) - potential(q - h * e)) / (2 * h) for e in np.eye(7)]
        dls.look(chain, settings, target, q, work)
        largest = preference.wish(settings, places, q, work)
        push = work[dls.PUSH, :7]
        np.testing.assert_allclose(push, -np.array(slope), atol=1e-5 * max(1.0, largest))
        assert largest == pytest.approx(np.abs(push).max())


def test_a_preference_is_as_steep_as_its_wish_falls_in_weights_that_fall():
    robot = lwr4(tool=TOOL)
    solver, rng, h = IKSolver(robot, preference=Preference(off_limits=0.7, zone=0.5)), np.random.default_rng(7), 1e-6
    chain, settings, work, _, _ = ik.parts.py_func(solver._table, 7)
    places = ik.places_of.py_func(solver._table, 7)

    def along(q, way):
        work[dls.WEIGHT] = 1.0
        preference.ease(chain, places, q, work)
        preference.wish(settings, places, q, work)
        return float(np.sum(way * work[dls.PUSH, :7] / work[dls.WEIGHT, :7]))

    for q in rng.uniform(robot.lower + 0.05, robot.upper - 0.05, (50, 7)):
        way = rng.normal(size=7)
        falls = -(along(q + h * way, way) - along(q - h * way, way)) / (2 * h)
        along(q, way)
        work[dls.PUSH, :7] = way
        found = preference.steepness(chain, settings, places, q, work)
        assert found == pytest.approx(falls / np.sum(way**2 / work[dls.WEIGHT, :7]), rel=1e-4, abs=1e-6)


def test_roots_are_where_the_line_meets_the_circle():
    rng, cuts = np.random.default_rng(5), np.empty(8)
    for a, b, c in rng.normal(size=(200, 3)):
        count = srs.roots(a, b, c, cuts, 0)
        assert count == (2 if abs(c) <= np.hypot(a, b) else 0)
        for psi in cuts[:count]:
            assert a * np.cos(psi) + b * np.sin(psi) + c == pytest.approx(0.0, abs=1e-12)
    assert srs.roots(0.0, 0.0, 1.0, cuts, 0) == 0
    assert srs.roots(np.nan, 1.0, 0.0, cuts, 0) == 0


def test_the_bend_of_the_elbow_is_exact_where_the_arc_cosine_is_not():
    shape = np.zeros((3, 16))
    shape[2, srs.UPPER_ARM], shape[2, srs.FOREARM] = 0.4, 0.39
    for angle in (0.0, 1e-6, 1e-3, 1.0, 3.0, np.pi):
        # written so that it keeps its digits near the straight arm
        distance = 0.79 - (4 * 0.4 * 0.39 * np.sin(angle / 2) ** 2) / (
            0.79 + np.sqrt(0.79**2 - 4 * 0.4 * 0.39 * np.sin(angle / 2) ** 2)
        )
        assert srs.bend(shape, distance) == pytest.approx(angle, abs=1e-8)


@pytest.mark.parametrize(
    ("angle", "low", "high", "seed", "wanted"),
    [
        (0.5, -1.0, 1.0, 0.0, 0.5),
        (0.5, -1.0, 1.0, 100.0, 0.5),
        (0.5 + 2 * np.pi, -1.0, 1.0, 0.0, 0.5),
        (1.5, -1.0, 1.0, 0.0, srs.NONE),
        (3.0, -4.0, 4.0, -3.1, 3.0 - 2 * np.pi),
        (3.0, -7.0, 7.0, 3.2, 3.0),
        (0.3, -np.inf, np.inf, 20.0, 0.3 + 6 * np.pi),
        (1.0, 1.0, 1.0, 0.0, 1.0),
    ],
)
def test_an_angle_turns_into_its_limits_as_near_the_seed_as_it_goes(angle, low, high, seed, wanted):
    row = np.zeros(16)
    row[chain_kernels.LOWER], row[chain_kernels.UPPER] = low, high
    assert srs.fit(angle, row, seed, 0.0) == pytest.approx(wanted, abs=1e-12)


def test_restarts_fill_the_joint_ranges_evenly():
    robot = lwr4()
    solver, q = IKSolver(robot), np.empty(7)
    qs = []
    for k in range(1, 257):
        ik.restart(robot.chain, solver._table[7 + ik.SPREAD], k, q)
        qs.append((q - robot.lower) / (robot.upper - robot.lower))
    qs = np.array(qs)
    assert qs.min() >= 0.0
    assert qs.max() <= 1.0
    for joint in qs.T:
        counts = np.histogram(joint, 16, (0, 1))[0]
        assert counts.min() >= 12
        assert counts.max() <= 20


def test_forward_kinematics_is_callable_from_compiled_code():
    @numba.njit
    def farthest(chain, qs, out):
        best = -1.0
        for k in range(qs.shape[0]):
            chain_kernels.forward(chain, qs[k], out)
            best = max(best, out[2, 3])
        return best

    robot = lwr4(tool=TOOL)
    qs = np.random.default_rng(6).uniform(robot.lower, robot.upper, (20, 7))
    wanted = max(naive_tip(robot, q)[2, 3] for q in qs)
    assert farthest(robot.chain, qs, np.empty((4, 4))) == pytest.approx(wanted, abs=1e-13)
