"""Covariances of contacts: each cause against the shift that it really makes."""

from dataclasses import replace

import numpy as np
import pytest

from lwrprobe.bench.budget import Contacts, drawn_errors
from lwrprobe.contact import Settings
from lwrprobe.contracts import Contact, Reconstruction, TriangleMesh
from lwrprobe.evaluation import aligned_points
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_budget import ErrorBudget, without_rigid_motion
from lwrprobe.exploration.recording.error_sources import _of_arm, _of_probe, error_budget
from lwrprobe.exploration.recording.force_error import matrix_errors, shifts_by_force
from lwrprobe.exploration.recording.mesh_errors import expect_mesh_errors
from lwrprobe.exploration.recording.neighbour_normals import NeighbourTurn
from lwrprobe.exploration.recording.path_normals import CHORD, PathTurn
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.exploration.stages.sensor_errors import estimator_settings
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

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
    found = covariance(_of_arm(scene, robot, Q, np.zeros((2, 3)))["kinematics"])
    expected = np.zeros((2, 3, 3))
    for joint in range(robot.n):
        value = getattr(robot, field).copy()
        value[joint] += 1e-6
        shift = (replace(robot, **{field: value}).fk_batch(Q) - robot.fk_batch(Q))[:, :3, 3] / 1e-6 * sigma * unit
        expected += np.einsum("ni,nj->nij", shift, shift)
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())


def test_what_a_calibration_leaves_of_arm_and_tool_counts_together():
    scene = alone("dh_offset_deg=0.05", "dh_d_mm=0.3", "probe_length_mm=0.3", "sphere_off_axis_mm=0.2")
    robot, still = robot_of(scene), np.zeros((2, 3))
    rotations = robot.fk_batch(Q)[:, :3, :3]
    sigma = np.concatenate([np.zeros(14), np.full(7, 3e-4), np.full(7, np.radians(0.05)), [2e-4, 2e-4, 3e-4]])

    def left(rows):
        correction = scene.arm.correction.model_copy(update={"errors": tuple(map(tuple, rows.tolist()))})
        known = scene.model_copy(update={"arm": scene.arm.model_copy(update={"correction": correction})})
        probe = _of_probe(known, still, rotations)
        assert list(probe) == ["sphere radius"], "where the sphere's centre is, is contained"
        return covariance(_of_arm(known, robot, Q, still)["kinematics"])

    single = _of_probe(scene, still, rotations)
    expected = covariance(_of_arm(scene, robot, Q, still)["kinematics"])
    expected += covariance(single["probe length"]) + covariance(single["sphere off axis"])
    assert left(np.diag(sigma)) == pytest.approx(expected), "independent errors are the single numbers"
    longer = np.zeros((1, 31))
    longer[0, 20], longer[0, 30] = 3e-4, -3e-4
    assert left(longer) == pytest.approx(0.0, abs=1e-12), "a longer last link and a shorter probe are one and the same"


def test_a_normal_that_was_turned_to_other_lines_is_as_wrong_aside_as_they_have_shown():
    """What is left contains the contact's own noise and zero: neither counts again."""
    scene, single = alone("zero_force_mn=6.0", "zero_torque_unm=28.0"), np.radians(0.5)
    made = budget(scene, beside=NeighbourTurn(np.full(40, 0.7), np.full(40, single))).covariance()[0]
    assert made[0, 0] == pytest.approx((0.005 * single) ** 2 + 2e-5**2)
    assert made[1, 1] == pytest.approx(budget(scene).covariance()[0][1, 1]), "along the path"


def test_two_answers_aside_of_the_path_are_not_worse_than_the_better_one():
    """Force direction and torque are weighed by the errors of their zeros."""
    noise = budget(alone()).covariance()[0][0, 0]
    plane = np.sqrt(2.0) * 6e-3 / np.hypot(0.8, 0.0)
    for torque in (28.0, 1e5):
        made = budget(alone("zero_force_mn=6.0", f"zero_torque_unm={torque}")).covariance()[0][0, 0] - noise
        assert 0.98 < made / (0.005 * plane) ** 2 <= 1.0


def test_a_base_that_is_turned_moves_what_is_far_from_it():
    scene = alone("base_turn_deg=0.1")
    robot = robot_of(scene)
    found = covariance(_of_arm(scene, robot, Q, np.zeros((2, 3)))["base"])
    arm = robot.fk_batch(Q)[:, :3, 3] - robot.base[:3, 3]
    assert np.trace(found, axis1=1, axis2=2) == pytest.approx(2.0 * np.radians(0.1) ** 2 * (arm**2).sum(axis=1))


def test_what_a_calibration_leaves_of_the_force_counts_in_place_of_gain_and_crosstalk():
    scene = alone("sensor_crosstalk_percent=1.0", "sensor_gain_percent=1.5")
    probe, draw = scene.probe.as_probe(), np.random.default_rng(3)
    forces, normals = draw.normal(size=(5, 3)), np.eye(3)[[0, 1, 2, 0, 1]]
    single = matrix_errors(scene.uncertainty, probe, forces, normals)
    spans = np.concatenate([probe.force_range, probe.torque_range])
    sigma = 0.01 * spans[:3, None] / spans
    np.fill_diagonal(sigma, 0.015)

    def left(rows):
        known = scene.uncertainty.model_copy(update={"force_errors": tuple(map(tuple, rows.tolist()))})
        return covariance(matrix_errors(known, probe, forces, normals))

    assert left(np.diag(sigma.ravel())) == pytest.approx(covariance(single)), (
        "independent errors are the single numbers"
    )
    none = np.zeros((1, 18))
    assert not left(none).any()


def budget(scene, count=40, turned=None, beside=None):
    pipeline = compose(scene, choose(scene), 0.001, 125.0)
    up, joints = np.array([0.0, 0.0, 1.0]), np.repeat(Q[:1], count, axis=0)
    contacts = [Contact(0.1 * k, np.zeros(3), up, 0.8 * up, 0.005 * up, 0.95) for k in range(count)]
    paths = np.repeat([[0.0, 0.02, 0.0]], count, axis=0)
    return error_budget(scene, pipeline, contacts, joints, paths, Corrections(path=turned, neighbours=beside))


def test_without_uncertainty_only_noise_and_the_rest_remain():
    made = budget(alone())
    assert made.along_normal() == pytest.approx(2e-5)
    assert made.causes["kinematics"] == made.causes["base"] == made.causes["probe length"] == 0.0
    turned = 0.1 * np.sqrt(0.5 * (1.0 / 0.95 - 1.0))  # rad in each of two directions, at this confidence
    assert np.trace(made.covariance()[0]) == pytest.approx(2.0 * (0.005 * turned) ** 2 + 3.0 * 2e-5**2)


def test_a_normal_that_was_turned_to_its_path_keeps_its_noise_aside_of_it_alone():
    plain = budget(alone()).covariance()[0]
    turned = budget(alone(), turned=PathTurn(np.full(40, 0.9), np.zeros(40))).covariance()[0]
    assert turned[0, 0] == pytest.approx(plain[0, 0]), "aside of the path"
    normal = 0.1 * np.sqrt(0.5 * (1.0 / 0.95 - 1.0))
    left = np.hypot(0.1 * normal, 0.9 * CHORD)
    assert turned[1, 1] == pytest.approx((0.005 * left) ** 2 + 2e-5**2)
    assert turned[1, 1] < 0.2 * plain[1, 1]


def test_a_wider_belief_gives_a_wider_band():
    known = ["uncertainty.base_shift_mm=0.0", "uncertainty.base_turn_deg=0.0"]
    lab, sheet = (budget(load_scene("block", [f"uncertainty.profile={p}", *known])) for p in ("lab", "datasheet"))
    assert sheet.report()["whole_mm"] > 2.0 * lab.report()["whole_mm"]
    assert lab.report()["whole_mm"] > lab.report()["shape_mm"] >= lab.report()["random_mm"]


def test_the_hysteresis_of_the_sensor_turns_normals_as_its_zero_does():
    """A reading stands half the width of the loop away from the load: 0.3 % of 12 N are 18 mN, as those of a zero."""
    none, wide = (budget(alone("zero_force_mn=6.0", f"sensor_hysteresis_percent={h}")) for h in (0.0, 0.3))
    same = budget(alone(f"zero_force_mn={np.hypot(6.0, 18.0)}", "zero_torque_unm=180.0"))
    assert np.trace(wide.covariance()[0]) == pytest.approx(np.trace(same.covariance()[0]))
    assert np.trace(wide.covariance()[0]) > 2.0 * np.trace(none.covariance()[0])
    assert estimator_settings(alone("sensor_hysteresis_percent=0.3")).zero_error == Settings().zero_error
    lab, worse = (load_scene("block", s) for s in ([], ["uncertainty.sensor_hysteresis_percent=0.3"]))
    assert estimator_settings(lab).zero_error == pytest.approx(np.hypot(6e-3, 6e-3))
    assert estimator_settings(worse).zero_error == pytest.approx(np.hypot(6e-3, 18e-3))


def test_a_chord_is_tilted_by_the_waves_and_where_those_swing_the_force_by_the_hysteresis_too():
    """A reading that lags by 36 mN leaves 36 mN / k of what gives way over a chord of 1 mm."""
    path = PathTurn(np.ones(40), np.zeros(40))

    def along(hysteresis, ripple):
        scene = alone(f"sensor_hysteresis_percent={hysteresis}", f"gear_ripple_deg={ripple}")
        return scene, budget(scene, turned=path).covariance()[0, 1, 1]

    plain = along(0.0, 0.0)[1]
    assert plain == pytest.approx((0.005 * CHORD) ** 2 + 2e-5**2)
    assert along(0.3, 0.0)[1] == pytest.approx(plain), "a force that does not swing stays on one side of the loop"
    scene, swinging = along(0.3, 0.02)
    robot = robot_of(scene)
    jacobian = robot.jacobian_batch(Q[:1])[0]
    speeds = np.linalg.pinv(jacobian) @ [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    place = np.radians(0.02) / np.sqrt(2.0) * jacobian[:3]
    tilt = 320.0 * np.linalg.norm(place[2] * speeds)
    own = robot.fk_batch(Q[:1])[0, 2, :3]
    stick = own**2 @ np.array([1.0 / 2500.0, 1.0 / 2500.0, 1.0 / 1.3e6])
    lag = 0.036 * (stick + 1.0 / scene.contact.stiffness) / 1e-3
    assert 2.0 * tilt > lag > 0.05 * tilt > 0.0
    expected = 0.005**2 * (tilt**2 + lag**2) + (place[1] ** 2).sum() + 2e-5**2
    assert swinging == pytest.approx(expected, rel=1e-4)


def test_the_sensors_matrix_turns_the_normal_aside_of_the_path():
    """A push across the stick puts a torque on the sensor, of which crosstalk makes a force along the stick."""
    scene = alone("sensor_crosstalk_percent=1.0", "sphere_off_axis_mm=0.0")
    probe, aside = scene.probe.as_probe(), np.array([[0.0, 0.0, -1.0]])
    normal, path = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    force = normal - 0.3 * path
    errors = matrix_errors(scene.uncertainty, probe, force, normal)
    shifts = shifts_by_force(probe, errors, np.eye(3)[None], force, normal, path)[0]
    assert np.abs(shifts @ normal[0]).max() == pytest.approx(0.0, abs=0.06 * probe.compliance[0])
    torque = np.cross([0.0, 0.0, probe.sensor_distance] - probe.radius * normal[0], force[0])
    along_stick = (
        0.01 * probe.force_range[2] * np.append(force[0][:2] / probe.force_range[:2], torque / probe.torque_range)
    )
    turned = probe.radius * along_stick + probe.compliance[2] * along_stick
    found = shifts.reshape(3, 6, 3)[2, [0, 1, 3, 4, 5]]
    assert np.abs(found @ aside[0]) == pytest.approx(np.abs(turned), rel=0.05)
    assert np.abs(turned).max() > 0.04 * probe.radius, "1 % is 0.04 rad at 1 N"
    still = shifts_by_force(probe, errors, np.eye(3)[None], force, normal, 0.0 * path)[0]
    assert np.abs(still).max() < 0.06 * probe.compliance.max()


def test_a_stick_that_is_a_fifth_softer_bends_by_a_quarter_more():
    table = "stick_stiffness_percent"
    small, fifth, none = (budget(alone(f"{table}={value}")).causes["stick"] for value in (1e-3, 20.0, 0.0))
    assert fifth == pytest.approx(0.25e5 * small, rel=1e-3)
    assert none == 0.0


def test_the_drift_of_the_zero_grows_with_the_time_in_contact():
    made = budget(alone("drift_mn_per_min=60.0"))
    expected = 5.0 * 1e-3 * np.sqrt(np.mean((0.1 * np.arange(40)) ** 2)) / 0.8
    causes = np.einsum("nki,nki->n", made.shared, made.shared)
    assert 1e3 * np.sqrt(causes.mean()) == pytest.approx(expected, rel=0.25)
    assert causes[0] == 0.0
    assert causes[39] == pytest.approx(4.0 * causes[39 // 2], rel=0.15)


def test_torque_and_force_that_disagree_by_more_than_stated_widen_the_band():
    class Disagreeing:
        surprise = 3.0

    scene = alone("sensor_crosstalk_percent=0.15")
    pipeline, where = compose(scene, choose(scene), 0.001, 125.0), np.repeat(Q[:1], 2, axis=0)
    contacts = [Contact(0.0, np.zeros(3), np.eye(3)[0], np.array([0.8, -0.2, 0.1]), np.zeros(3), 0.9999)] * 2
    found = []
    for pipeline.torque in (None, Disagreeing()):
        made = error_budget(scene, pipeline, contacts, where, np.repeat([[0.0, 0.02, 0.0]], 2, axis=0))
        found.append(made.causes["force"])
    assert found[1] == pytest.approx(3.0 * found[0])
    assert found[0] > 0.0


def test_a_rigid_motion_is_no_error_of_shape():
    random = np.random.default_rng(1)
    points = random.uniform(-0.05, 0.05, (50, 3))
    motions = [np.tile(axis, (50, 1)) for axis in np.eye(3)] + [np.cross(axis, points) for axis in np.eye(3)]
    other = random.standard_normal((50, 3))
    left = without_rigid_motion(points, np.stack([*motions, other], axis=1))
    assert np.abs(left[:, :6]).max() < 1e-12
    design = np.stack(motions, axis=2).reshape(150, 6)
    rest = other.ravel() - design @ np.linalg.lstsq(design, other.ravel(), rcond=None)[0]
    assert left[:, 6].ravel() == pytest.approx(rest, abs=1e-12)
    few = without_rigid_motion(points[:1], other[:1, None])
    assert np.abs(few).max() < 1e-12


def test_what_is_left_is_what_the_judge_of_shapes_sees():
    random = np.random.default_rng(2)
    points = random.uniform(-0.05, 0.05, (40, 3))
    shift = 1e-6 * random.standard_normal((40, 3)) + np.cross([1e-4, 2e-4, -1e-4], points) + 3e-4
    left = without_rigid_motion(points, shift[:, None])[:, 0]
    assert aligned_points(points + shift, points) - points == pytest.approx(left, abs=5e-8)


def test_errors_drawn_from_the_covariance_lie_inside_in_95_of_100():
    random = np.random.default_rng(4)
    root = np.diag([1e-4, 3e-4, 2e-4])
    part = np.repeat((0.5 * root @ root)[None], 4000, axis=0)
    rows = np.repeat((np.sqrt(0.5) * root)[None], 4000, axis=0)
    up = np.repeat([[0.0, 0.0, 1.0]], 4000, axis=0)
    made = ErrorBudget.of(random.uniform(-1.0, 1.0, (4000, 3)), up, {"noise": part}, {"common": rows})
    errors = random.standard_normal((4000, 3)) @ root
    every = np.ones(4000, dtype=bool)
    assert made.claims_within_95(errors, every) == pytest.approx(0.95, abs=0.015)
    assert made.claims_within_95(np.sqrt(0.5) * errors, every, aligned=True) == pytest.approx(0.95, abs=0.015)
    assert made.claims_within_95(np.empty((0, 3)), np.zeros(4000, dtype=bool)) is None


@pytest.mark.parametrize("profile", ["lab", "datasheet"])
def test_over_many_drawn_worlds_the_claims_hold(profile):
    """Forward kinematics of drawn arms and probes, pooled over draws: a single draw moves all contacts together."""
    random = np.random.default_rng(3)
    scene = load_scene("block", [f"uncertainty.profile={profile}"])
    pipeline, count = compose(scene, choose(scene), 0.001, 125.0), 200
    joints = Q[0] + random.uniform(-0.06, 0.06, (count, 7))
    normals = np.eye(3)[random.integers(0, 3, count)] * random.choice([-1.0, 1.0], (count, 1))
    paths = np.cross(normals, random.standard_normal((count, 3)))
    paths /= np.linalg.norm(paths, axis=1, keepdims=True)
    forces = 0.8 * normals - 0.25 * paths
    tips = pipeline.robot.fk_batch(joints)[:, :3, 3]
    contacts = [
        Contact(0.1 * k, tips[k] - 0.005 * normals[k], normals[k], forces[k], tips[k], 0.98) for k in range(count)
    ]
    made = error_budget(scene, pipeline, contacts, joints, 0.008 * paths)
    gives = pipeline.force.stiffness.sigma(5e-5, 0.01 * scene.uncertainty.sigma("arm_stiffness_percent"))
    since = pipeline.force.zero.age(np.array([contact.time for contact in contacts]))
    known = Contacts(scene, pipeline.robot, contacts, joints, 0.008 * paths, gives, since)
    inside = {False: [], True: []}
    for seed in range(150):
        errors = drawn_errors(known, profile, seed)
        left = aligned_points(made.points + errors, made.points) - made.points
        for aligned, found in ((False, errors), (True, left)):
            inside[aligned].append(made.claims_within_95(found, np.ones(count, dtype=bool), aligned))
    assert 0.90 <= np.mean(inside[False]) <= 0.98
    assert 0.90 <= np.mean(inside[True]) <= 0.98


def test_the_mesh_takes_over_the_error_of_the_nearest_contact():
    made = budget(load_scene("block"), 5)
    mesh = TriangleMesh(
        np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]), np.array([[0, 1, 2]]), np.full(3, 3e-5)
    )
    surface = Reconstruction(mesh, unreachable=np.array([False, False, True]))
    table = expect_mesh_errors(made, surface)
    expected = np.hypot(3e-5, np.sqrt(2.0 / np.pi) * made.along_normal()[0])
    assert mesh.vertex_error == pytest.approx(expected)
    assert mesh.vertex_error_aligned.max() < mesh.vertex_error.min()
    assert table["mean"] == pytest.approx(1e3 * expected, abs=1e-4)


def test_the_whole_mesh_has_what_no_sphere_can_touch_but_not_what_is_below_its_lowest_height():
    heights, own = np.array([0.0, 0.02, 0.02]), np.array([3e-3, 3e-5, 2e-3])
    mesh = TriangleMesh(np.column_stack([np.arange(3.0), np.zeros(3), heights]), np.array([[0, 1, 2]]), own)
    table = expect_mesh_errors(
        budget(load_scene("block"), 5), Reconstruction(mesh, unreachable=np.array([True, False, True])), lowest=0.01
    )
    assert table["mean"] == pytest.approx(1e3 * mesh.vertex_error[1], abs=1e-4)
    assert table["whole_mean"] == pytest.approx(1e3 * mesh.vertex_error[1:].mean(), abs=1e-4)
    assert table["aligned_whole_mean"] == pytest.approx(1e3 * mesh.vertex_error_aligned[1:].mean(), abs=1e-4)


def test_the_file_has_a_row_for_each_contact(tmp_path):
    made = budget(load_scene("block"), 5)
    made.write(tmp_path / "contact_errors.csv", [0.1 * k for k in range(5)])
    rows = np.loadtxt(tmp_path / "contact_errors.csv", delimiter=",", skiprows=1)
    assert rows.shape == (5, 10)
    assert rows[:, 2] == pytest.approx(1e3 * made.along_normal(), rel=1e-4)
    assert rows[:, 9] == pytest.approx(1e3 * made.along_normal(aligned=True), rel=1e-4)
