"""Covariances of contacts: each cause against the shift that it really makes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.error_budget import ErrorBudget, _of_arm, error_budget
from lwrprobe.exploration.stages.pipeline import choose, compose, robot_of
from lwrprobe.scene import load_scene

Q = np.array([[0.3, 0.6, -0.2, -1.4, 0.1, 1.1, 0.4], [-0.2, 0.7, 0.1, -1.2, 0.3, 0.9, 0.0]])


def covariance(rows):
    return np.einsum("nki,nkj->nij", rows, rows)


def alone(*settings):
    return load_scene("block", ["uncertainty.profile=ideal", *(f"uncertainty.{s}" for s in settings)])


@pytest.mark.parametrize(
    ("key", "sigma", "field", "unit"),
    [
        ("dh_offset_deg", 0.05, "theta", np.pi / 180.0),
        ("dh_twist_deg", 0.05, "alpha", np.pi / 180.0),
        ("dh_a_mm", 0.3, "a", 1e-3),
        ("dh_d_mm", 0.3, "d", 1e-3),
    ],
)
def test_a_cause_of_the_arm_is_the_shift_of_the_tip_by_its_parameters(key, sigma, field, unit):
    scene = alone(f"{key}={sigma}")
    robot = robot_of(scene)
    found = covariance(_of_arm(scene, SimpleNamespace(robot=robot), Q, np.zeros((2, 3)))["kinematics"])
    expected = np.zeros((2, 3, 3))
    for joint in range(robot.n):
        value = getattr(robot, field).copy()
        value[joint] += 1e-6
        shift = (replace(robot, **{field: value}).fk_batch(Q) - robot.fk_batch(Q))[:, :3, 3] / 1e-6 * sigma * unit
        expected += np.einsum("ni,nj->nij", shift, shift)
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())


def test_a_base_that_is_turned_moves_what_is_far_from_it():
    scene = alone("base_turn_deg=0.1")
    robot = robot_of(scene)
    found = covariance(_of_arm(scene, SimpleNamespace(robot=robot), Q, np.zeros((2, 3)))["base"])
    arm = robot.fk_batch(Q)[:, :3, 3] - robot.base[:3, 3]
    assert np.trace(found, axis1=1, axis2=2) == pytest.approx(2.0 * np.radians(0.1) ** 2 * (arm**2).sum(axis=1))


def budget(scene, count=40):
    pipeline = compose(scene, choose(scene), 0.001, 125.0)
    up, joints = np.array([0.0, 0.0, 1.0]), np.repeat(Q[:1], count, axis=0)
    contacts = [Contact(0.1 * k, np.zeros(3), up, 0.8 * up, 0.005 * up, 0.95) for k in range(count)]
    return error_budget(scene, pipeline, contacts, joints, np.repeat([[0.0, 0.02, 0.0]], count, axis=0))


def test_without_uncertainty_only_noise_and_the_rest_remain():
    made = budget(alone())
    random, whole = made.along_normal
    assert np.allclose(random, 2e-5)
    assert made.causes["kinematics"] == made.causes["base"] == made.causes["probe length"] == 0.0
    assert whole.max() < 1e-4


def test_a_wider_belief_gives_a_wider_band():
    lab, sheet = (budget(load_scene("block", [f"uncertainty.profile={p}"])) for p in ("lab", "datasheet"))
    assert sheet.report()["shape_mm"] > 2.0 * lab.report()["shape_mm"]
    assert lab.report()["whole_mm"] > lab.report()["shape_mm"] > lab.report()["random_mm"]


def test_errors_drawn_from_the_covariance_lie_inside_in_95_of_100():
    random = np.random.default_rng(4)
    root = np.diag([1e-4, 3e-4, 2e-4])
    parts = np.repeat((root @ root)[None], 4000, axis=0)
    made = ErrorBudget(0.5 * parts, 0.5 * parts, np.repeat([[0.0, 0.0, 1.0]], 4000, axis=0), {})
    errors = random.standard_normal((4000, 3)) @ root
    assert made.claims_within_95(errors, np.ones(4000, dtype=bool)) == pytest.approx(0.95, abs=0.015)
    assert made.claims_within_95(np.empty((0, 3)), np.zeros(4000, dtype=bool)) is None


def test_the_file_has_a_row_for_each_contact(tmp_path):
    made = budget(load_scene("block"), 5)
    made.write(tmp_path / "contact_errors.csv", [0.1 * k for k in range(5)])
    rows = np.loadtxt(tmp_path / "contact_errors.csv", delimiter=",", skiprows=1)
    assert rows.shape == (5, 9)
    assert rows[:, 2] == pytest.approx(1e3 * made.along_normal[1], rel=1e-4)
