"""The judge of `bench shapes`: distances, what an upright probe reaches, edges, and what a report says."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lwrprobe.bench.shapes import CRITERIA, MEDIANS, _jobs, _judged, _report
from lwrprobe.bench.true_mesh import TrueMesh, edges_of_two, link_points, mesh_errors
from lwrprobe.contracts import InputError, TriangleMesh, UnknownNameError
from lwrprobe.scene.scene import ProbeTable

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(scope="module")
def table():
    """A plate of 60 x 60 x 10 mm on a post of 10 mm, 40 mm high: most of its underside is hidden."""
    post = trimesh.creation.box([0.01, 0.01, 0.04], trimesh.transformations.translation_matrix([0, 0, 0.02]))
    plate = trimesh.creation.box([0.06, 0.06, 0.01], trimesh.transformations.translation_matrix([0, 0, 0.045]))
    whole = trimesh.boolean.union([post, plate], engine="manifold")
    return TrueMesh(np.asarray(whole.vertices), np.asarray(whole.faces))


def test_distances_are_those_of_a_box():
    box = trimesh.creation.box([0.04, 0.03, 0.02])
    points = np.random.default_rng(1).uniform(-0.03, 0.03, (400, 3))
    over = np.abs(points) - [0.02, 0.015, 0.01]
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    expected = np.where(over.max(axis=1) > 0.0, outside, -over.max(axis=1))
    found = TrueMesh(np.asarray(box.vertices), np.asarray(box.faces)).distance(points)
    assert found == pytest.approx(expected, abs=2e-6)


def test_a_mesh_is_moved_to_where_its_points_lie():
    box = trimesh.creation.box([0.08, 0.06, 0.04])
    true = TrueMesh(np.asarray(box.vertices), np.asarray(box.faces))
    points = true.surface(2000, -1.0, 0.0)[0]
    turn = Rotation.from_rotvec([0.01, -0.02, 0.015])
    moved = turn.apply(points) + np.array([1e-3, -2e-3, 5e-4])
    assert np.median(true.distance(moved)) > 5e-4
    assert true.aligned_with(moved).distance(moved).max() < 1e-6


def test_points_of_a_rotor_that_leave_its_turn_open_are_met():
    rotor = trimesh.creation.cylinder(0.03, 0.05, sections=256)
    true = TrueMesh(np.asarray(rotor.vertices), np.asarray(rotor.faces))
    points = true.surface(2000, -1.0, 0.0)[0] + np.array([1e-3, 0.0, -1e-3])
    assert np.percentile(true.aligned_with(points).distance(points), 95.0) < 1e-5


def test_an_upright_probe_reaches_the_top_and_not_what_is_under_it(table):
    points, normals = table.surface(4000, 0.006, 0.005)
    links = ProbeTable().as_probe().links
    tip = np.diag([1.0, -1.0, -1.0])  # the stick rises from the sphere
    offsets = np.concatenate([link_points(link) for link in links]) @ tip.T
    reached = table.fits(points + 0.005 * normals, 0.005, offsets, np.full(len(offsets), 1e-4))
    top = normals[:, 2] > 0.5
    assert reached[top].mean() > 0.99
    assert not reached[(normals[:, 2] < -0.5)].any()
    hidden = (np.abs(points[:, :2]).max(axis=1) < 0.006) & ~top
    assert hidden.any()
    assert not reached[hidden].any()


@pytest.mark.slow
def test_the_error_of_a_larger_ball_is_the_difference_of_the_radii():
    true, larger = (trimesh.creation.icosphere(5, radius) for radius in (0.02, 0.021))
    judge = TrueMesh(np.asarray(true.vertices), np.asarray(true.faces))
    mesh = TriangleMesh(np.asarray(larger.vertices), np.asarray(larger.faces))
    mean, largest = mesh_errors(mesh, judge, judge.surface(3000, -1.0, 0.0)[0], -1.0)
    assert mean == pytest.approx(1e-3, abs=1e-5)
    assert largest == pytest.approx(1e-3, abs=2e-5)


def test_what_the_mesh_makes_of_an_underside_is_no_error_of_what_is_judged():
    true, low = trimesh.creation.box([0.04, 0.03, 0.02]), trimesh.creation.box([0.04, 0.03, 0.03])
    low.apply_translation([0.0, 0.0, -0.005])  # 10 mm too deep below
    judge = TrueMesh(np.asarray(true.vertices), np.asarray(true.faces))
    points, normals = judge.surface(4000, -1.0, 0.0)
    mesh = TriangleMesh(np.asarray(low.vertices), np.asarray(low.faces))
    assert mesh_errors(mesh, judge, points, -1.0)[0] > 1e-3
    above = normals[:, 2] > -0.5
    assert mesh_errors(mesh, judge, points, -1.0, above)[0] < 2e-4
    assert mesh_errors(mesh, judge, points, -1.0, ~above)[0] > 4e-3
    none = np.zeros(len(points), dtype=bool)
    assert mesh_errors(mesh, judge, points, -1.0, none) is None, "no figure, not an infinite one"


def test_edges_with_four_faces_and_open_ones_are_told():
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    vertices, faces = np.asarray(box.vertices), np.asarray(box.faces)
    assert edges_of_two(TriangleMesh(vertices, faces))
    assert not edges_of_two(TriangleMesh(vertices, faces[1:]))
    assert not edges_of_two(TriangleMesh(vertices, np.concatenate([faces[:1, ::-1], faces[1:]])))
    twice = np.concatenate([vertices, vertices + np.array([1.0, 1.0, 0.0])])
    merged, same = np.unique(np.round(twice, 9), axis=0, return_inverse=True)  # two boxes that share an edge
    assert not edges_of_two(TriangleMesh(merged, same.reshape(-1)[np.concatenate([faces, faces + 8])]))


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"kinds": "orgnic"}, UnknownNameError, "organic"),
        ({"strategies": "grid"}, UnknownNameError, "grid_version"),
        ({"profiles": "labb"}, UnknownNameError, "'lab'"),
        ({"count": "0"}, InputError, "above 0"),
        ({"number": "3"}, UnknownNameError, "count"),
    ],
)
def test_wrong_options_are_refused(options, error, said):
    with pytest.raises(error, match=said):
        _jobs(False, options)


def test_kinds_take_turns_and_seeds_go_up():
    asked = {"count": "4", "kinds": "hull,thin", "strategies": "grid_version", "base_seed": "11", "profiles": "lab"}
    jobs, _, _ = _jobs(False, asked)
    assert [job.name for job in jobs] == [f"random:{name}" for name in ("hull:11", "thin:12", "hull:13", "thin:14")]
    assert [job.seed for job in jobs] == [11, 12, 13, 14]


def test_given_objects_are_felt_with_several_seeds_and_a_multiple_of_the_noise():
    asked = {"objects": "block,random:hull:5", "seeds": "2", "strategies": "grid_version", "profiles": "ideal"}
    jobs, _, _ = _jobs(False, asked | {"noise": "3"})
    assert [(job.name, job.seed) for job in jobs] == [(o, s) for o in ("block", "random:hull:5") for s in (1, 2)]
    assert {job.noise for job in jobs} == {3.0}
    quiet, _, _ = _jobs(False, asked)
    assert len({job.key for job in [*jobs, *quiet]}) == 8, "a journal tells them apart"


def test_the_noise_of_the_simulated_sensor_is_multiplied(monkeypatch, tmp_path):
    explored = []
    monkeypatch.setattr("lwrprobe.exploration.procedures.explore.explore", lambda scene, folder: explored.append(scene))
    monkeypatch.setattr("lwrprobe.bench.shapes.judge", lambda *given: {})
    for noise in ("1", "3"):
        (job,), _, _ = _jobs(True, {"objects": "block", "noise": noise})
        _judged(job)
    (usual, loud) = (scene.drivers.get("sim", {}) for scene in explored)
    assert "noise_force" not in usual
    assert (loud["noise_force"], loud["noise_torque"]) == (pytest.approx(0.009), pytest.approx(6e-5))


def test_each_object_is_felt_in_the_world_that_the_scene_knows_and_in_the_default_one():
    jobs, _, _ = _jobs(False, {"count": "1", "strategies": "grid_version"})
    assert [job.profile for job in jobs] == ["ideal", "lab"]
    assert len({job.key for job in jobs}) == 2


def test_a_report_counts_what_holds_and_puts_the_worst_first():
    good = {
        "object": "random:hull:1", "strategy": "grid_version", "status": "done", "collisions": 0, "peak": 2.0,
        "coverage": 1.0, "over_best": 0.5, "manifold": True, "mesh": 0.1, "contact": 0.03, "ratio": 2.0,
        "ratio_unknown": 1.5, "threats": 4, "false_threats": 1, "profile": "ideal",
    }  # fmt: skip
    bad = {**good, "object": "random:thin:2", "status": "ended early", "mesh": None, "manifold": None, "peak": 4.0}
    report = _report([good, bad])
    assert report.tables[1].rows[0][2] == "random:thin:2"
    held = {verdict.requirement: verdict for verdict in report.verdicts}
    assert held["ideal: done in 98 %"].measured == "1 of 2"
    assert held["ideal: largest force <= 4.5 N in 100 %"].held
    assert not held["false collision threats < 5 %"].held
    assert len(report.verdicts) == len(CRITERIA) + len(MEDIANS) + 1
    assert held["ideal: mesh error of what is reachable, median <= 0.15 mm"].measured == "no run has it"
