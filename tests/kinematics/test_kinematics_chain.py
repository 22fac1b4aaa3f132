"""Forward kinematics and Jacobians of any chain, against dense products, roboticstoolbox and pinocchio."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_kinematics import allocations, naive_frames, naive_jacobian, naive_tip

from lwrprobe.contracts import InputError
from lwrprobe.kinematics import Robot, iiwa14, lwr4, panda, puma560, to_roboticstoolbox, ur5e
from lwrprobe.kinematics.batched_kernels import LANES

MODELS = [lwr4, iiwa14, ur5e, panda, puma560]


def pose(rng, size=0.5):
    from spatialmath import SE3

    return SE3.RPY(*rng.uniform(-3, 3, 3)).A + np.pad(size * rng.uniform(-1, 1, (3, 1)), ((0, 1), (3, 0)))


def random_chain(rng, n, convention, scale=1.0):
    """A chain nobody would build: every parameter at random, some joints sliding."""
    sliding = rng.random(n) < 0.3
    ends = np.where(sliding, scale, np.pi)
    return Robot(
        name="random",
        a=scale * rng.uniform(-1, 1, n),
        alpha=rng.uniform(-np.pi, np.pi, n),
        d=scale * rng.uniform(-1, 1, n),
        theta=rng.uniform(-np.pi, np.pi, n),
        lower=-ends,
        upper=ends,
        speed=np.ones(n),
        prismatic=sliding,
        convention=convention,
        base=pose(rng, scale),
        tool=pose(rng, scale),
    )


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("n", [1, 2, 6, 7, 20])
def test_any_chain_is_the_dense_product(n, convention):
    rng = np.random.default_rng(n)
    robot = random_chain(rng, n, convention)
    for q in rng.uniform(robot.lower, robot.upper, (20, n)):
        np.testing.assert_allclose(robot.fk(q).A, naive_tip(robot, q), atol=1e-13 * n)
        np.testing.assert_allclose(robot.link_frames(q), naive_frames(robot, q), atol=1e-13 * n)
        np.testing.assert_allclose(robot.jacobian(q), naive_jacobian(robot, q), atol=2e-8 * n)


@pytest.mark.parametrize("scale", [1e-9, 1e3])
def test_lengths_of_any_scale(scale):
    rng = np.random.default_rng(5)
    robot = random_chain(rng, 6, "standard", scale)
    q = rng.uniform(robot.lower, robot.upper)
    np.testing.assert_allclose(robot.fk(q).t / scale, naive_tip(robot, q)[:3, 3] / scale, atol=1e-12)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.slow
def test_models_agree_with_roboticstoolbox(model):
    rng = np.random.default_rng(0)
    robot = model(tool=pose(rng), base=pose(rng))
    reference = to_roboticstoolbox(robot)
    for q in rng.uniform(robot.lower, robot.upper, (10, robot.n)):
        np.testing.assert_allclose(robot.fk(q).A, reference.fkine(q).A, atol=1e-14)
        np.testing.assert_allclose(robot.jacobian(q), reference.jacob0(q), atol=1e-13)
        assert robot.manipulability(q) == pytest.approx(reference.manipulability(q), abs=1e-12)


@pytest.mark.parametrize("model", [lwr4, ur5e, puma560])
def test_models_agree_with_pinocchio(model):
    pin = pytest.importorskip("pinocchio")
    robot = model(tool=pose(np.random.default_rng(3)))
    reference, data, tip = pinocchio_twin(pin, robot)
    for q in np.random.default_rng(1).uniform(robot.lower, robot.upper, (10, robot.n)):
        jac = pin.computeFrameJacobian(reference, data, q, tip, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        pin.framesForwardKinematics(reference, data, q)
        np.testing.assert_allclose(robot.fk(q).A, data.oMf[tip].homogeneous, atol=1e-13)
        np.testing.assert_allclose(robot.jacobian(q), jac, atol=1e-13)


def pinocchio_twin(pin, robot):
    """Standard DH as pinocchio joints about z, each placed behind its predecessor's fixed part."""
    from naive_kinematics import rot_x, shift

    model, parent, placement = pin.Model(), 0, robot.base
    for i in range(robot.n):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(placement), f"joint{i}")
        placement = shift(z=robot.d[i]) @ shift(x=robot.a[i]) @ rot_x(robot.alpha[i])
    end = pin.Frame("tip", parent, 0, pin.SE3(placement @ robot.tool), pin.FrameType.OP_FRAME)
    tip = model.addFrame(end)
    return model, model.createData(), tip


def test_the_lwr_stands_upright_at_zero():
    robot = lwr4()
    np.testing.assert_allclose(robot.fk(np.zeros(7)).t, [0.0, 0.0, 0.79], atol=1e-15)
    np.testing.assert_allclose(np.rad2deg(robot.upper), [170, 120, 170, 120, 170, 120, 170])
    np.testing.assert_allclose(np.rad2deg(robot.speed), [110, 110, 128, 128, 204, 184, 184])


def test_batches_equal_single_calls_and_into_forms_allocate_nothing():
    robot = lwr4(tool=pose(np.random.default_rng(9)))
    qs = np.random.default_rng(2).uniform(robot.lower, robot.upper, (50, 7))
    tip, jac, frames = np.empty((4, 4)), np.empty((6, 7)), np.empty((8, 4, 4))
    robot.fk_into(qs[0], tip), robot.jacobian_into(qs[0], jac), robot.link_frames_into(qs[0], frames)
    batches = robot.fk_batch(qs), robot.jacobian_batch(qs)
    before = allocations()
    for q, tips, jacs in zip(qs, *batches):
        robot.fk_into(q, tip), robot.jacobian_into(q, jac), robot.link_frames_into(q, frames)
        np.testing.assert_array_equal(tip, tips)
        np.testing.assert_array_equal(jac, jacs)
    # not even a handle an array argument, which numba takes where views are counted
    assert allocations() - before == 0


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=7, max_size=7))
def test_the_tip_is_always_a_rigid_motion(q):
    r = lwr4().fk(np.array(q)).A[:3, :3]
    np.testing.assert_allclose(r.T @ r, np.eye(3), atol=1e-14)
    assert np.linalg.det(r) > 0.0


def test_quarter_turn_twists_are_exact():
    # pi/2 in floating point would leave the wrist 6e-17 off the axes, and the closed form's singularities blurred
    assert lwr4().fk(np.zeros(7)).A[0, 2] == 0.0


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("robot.theta", {"theta": np.zeros(6)}),
        ("robot.alpha", {"alpha": np.full(7, np.nan)}),
        ("robot.d", {"d": np.full(7, np.inf)}),
        ("robot.lower", {"lower": np.full(7, 9.0)}),
        ("robot.speed", {"speed": np.zeros(7)}),
        ("robot.convention", {"convention": "craig"}),
        ("robot.tool", {"tool": 2.0 * np.eye(4)}),
        ("robot.base", {"base": np.eye(3)}),
        ("robot.prismatic", {"prismatic": np.zeros(3, bool)}),
    ],
)
def test_a_table_that_makes_no_arm_is_refused(field, change):
    import dataclasses

    with pytest.raises(InputError) as caught:
        dataclasses.replace(lwr4(), **change)
    assert caught.value.field == field


@pytest.mark.parametrize("q", [np.zeros(6), np.zeros((7, 1)), np.full(7, np.nan), [np.inf] + 6 * [0.0]])
def test_joint_values_that_are_none_are_refused(q):
    for ask in (lwr4().fk, lwr4().jacobian, lwr4().limit_margin, lwr4().manipulability):
        with pytest.raises(InputError) as caught:
            ask(q)
        assert caught.value.field == "q"


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1, 3 * LANES + 7])
def test_a_batch_is_one_tip_after_another(count, convention):
    rng = np.random.default_rng(count)
    robot = random_chain(rng, 5, convention)
    qs = rng.uniform(robot.lower, robot.upper, (count, 5))
    np.testing.assert_allclose(robot.fk_batch(qs), [naive_tip(robot, q) for q in qs], atol=1e-14)


@pytest.mark.parametrize("size", [1e-300, 1e-8, 0.785398163, 1e3, 9.9e4, 1e5, 1e12])
def test_a_batch_of_endless_joints_keeps_its_digits_however_far_they_turned(size):
    rng = np.random.default_rng(8)
    robot = lwr4().with_limits(np.full(7, -np.inf), np.full(7, np.inf))
    qs = size * rng.uniform(-1.0, 1.0, (2 * LANES, 7))
    qs[:7] = 0.5 * np.pi * rng.integers(-4, 5, (7, 7))
    one_by_one = np.array([robot.fk(q).A for q in qs])
    np.testing.assert_allclose(robot.fk_batch(qs), one_by_one, atol=3e-15)
