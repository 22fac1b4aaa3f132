"""Runs over one object joined: moved ones are laid back, others refused with the reason, and what is left behind."""

import json
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from lwrprobe.bench.sampled_lines import sample_lines
from lwrprobe.cli.app import app
from lwrprobe.contracts import InputError, TouchRecord
from lwrprobe.evaluation.mesh_error import is_watertight
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.procedures.merge import merge
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.reconstruction.meshes import read_mesh
from lwrprobe.reconstruction.registration import intruding, register
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow

SOLID = {name: load_scene(name).solid() for name in ("combination", "bridge", "block", "polystyrene_1")}


@cache
def sampled(name, phase, seed):
    return sample_lines(SOLID[name], 0.010, phase, seed)


def touches(name, phase=0.5, seed=1, yaw_deg=0.0, shift_mm=(0.0, 0.0, 0.0)):
    """Contacts on lines over a scene's true shape, with noise, of an object that stands elsewhere."""
    record = sampled(name, phase, seed)
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    turn, shift = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), 1e-3 * np.array(shift_mm)
    return TouchRecord(
        record.points @ turn.T + shift,
        normals=record.normals @ turn.T,
        free_path=record.free_path @ turn.T + shift,
        probe_radius=record.probe_radius,
        table=record.table,
        lowest=record.lowest,
    )


def run_folder(folder, name, record, settings=(), known=True, line_spacing=None):
    """What a run leaves behind, made of such contacts."""
    folder.mkdir()
    write_scene(load_scene(name, ["truth.profile=ideal", *settings]), folder / "scene.toml")
    n, free = len(record.points), record.free_path
    rows = np.column_stack([0.01 * np.arange(n), record.points, record.normals, np.full(n, 0.8), np.ones(n)])
    np.savetxt(folder / "contacts.csv", rows, "%.7f", ",", header="time,x,y,z,nx,ny,nz,force,confidence", comments="")
    zero = np.zeros(len(free))
    displacement = np.column_stack([0.02 * np.arange(len(free)), free, zero, zero, zero + 0.05])
    np.savetxt(
        folder / "trace.csv", displacement, "%.6f", ",", header="time,x,y,z,force,touching,clearance", comments=""
    )
    summary = {"status": "done", "sim_time_s": 12.5, "peak_force_n": 1.5, "link_collisions": 0 if known else None}
    summary["line_spacing_m"] = line_spacing
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


@pytest.mark.parametrize("name", ["combination", "bridge", "polystyrene_1"])
@pytest.mark.parametrize("motion", [(0.0, (3.0, 0.0, 0.0)), (1.5, (2.2, -2.1, 0.0)), (-3.0, (-4.0, 3.0, 0.0))])
def test_an_object_that_was_moved_on_its_table_is_laid_back(name, motion):
    fixed, still = touches(name, 0.5, 1), touches(name, 0.1, 2)
    moving = touches(name, 0.1, 2, *motion)
    found = register(moving, fixed, on_table=True)
    assert np.median(np.linalg.norm(found.points(moving.points) - still.points, axis=1)) < 0.15e-3
    assert found.angle == pytest.approx(abs(np.radians(motion[0])), abs=np.radians(0.3))
    assert found.after < 0.2e-3
    assert found.after <= found.before
    assert np.abs(found.directions(moving.normals) - still.normals).max() < 0.01


def test_without_a_table_all_six_directions_are_found():
    fixed, still = touches("combination", 0.5, 1), touches("combination", 0.1, 2)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.01, -0.015, 0.02]).as_matrix()
    moving = TouchRecord(still.points @ turn.T + [1e-3, 2e-3, -2e-3], normals=still.normals @ turn.T)
    found = register(moving, fixed, on_table=False)
    assert np.median(np.linalg.norm(found.points(moving.points) - still.points, axis=1)) < 0.2e-3


def test_what_the_touches_do_not_tell_is_left_as_it_is_and_said():
    # no line along y feels the block's ends in x
    moving = touches("block", 0.1, 2, 0.0, (2.0, 3.0, 0.0))
    found = register(moving, touches("block"), on_table=True)
    assert found.open == ("x",)
    assert 1e3 * found.translation == pytest.approx((0.0, -3.0, 0.0), abs=0.1)


def test_a_run_that_was_not_moved_stays_within_its_noise():
    found = register(touches("combination", 0.1, 2), touches("combination"), on_table=True)
    assert found.shift < 0.15e-3
    assert found.angle < np.radians(0.2)


def test_touches_inside_the_way_of_the_other_sphere_are_told():
    record = touches("bridge")
    inside = record.free_path[::50] + 0.0005
    assert intruding(inside, record).all()
    assert not intruding(record.points, record).any()
    # a place that only the sphere in contact was at
    assert intruding(record.points + 0.004 * record.normals, record).all()


def test_records_that_cannot_be_registered_are_refused():
    with pytest.raises(InputError, match="moving: got '0 touches'"):
        register(TouchRecord(np.empty((0, 3)), normals=np.empty((0, 3))), touches("block"), on_table=True)
    with pytest.raises(InputError, match="fixed"):
        register(touches("block"), TouchRecord(np.zeros((5, 3))), on_table=True)


@pytest.fixture(scope="module")
def merged(tmp_path_factory):
    place = tmp_path_factory.mktemp("merge")
    a = run_folder(place / "a", "combination", touches("combination", 0.5, 1))
    b = run_folder(place / "b", "combination", touches("combination", 0.1, 2, 1.0, (3.0, 0.0, 0.0)))
    c = run_folder(place / "c", "combination", touches("combination", 0.8, 3, 0.0, (0.0, -2.0, 0.0)))
    return merge([a, b, c], place / "out", method="contact_surface"), place


def test_a_merged_folder_holds_all_runs_in_the_place_of_the_first(merged):
    summary, place = merged
    back = read_run(place / "out")
    parts = [read_run(place / name).record for name in "abc"]
    assert len(back.record.points) == summary["contacts"] == sum(len(part.points) for part in parts)
    assert len(back.record.free_path) == sum(len(part.free_path) for part in parts)
    assert np.abs(SOLID["combination"].signed_distance(back.record.points)).max() < 1e-3
    assert (np.diff(back.record.times) >= 0.0).all()
    runs = read_cloud(place / "out" / "contacts.csv").scalars["run"]
    assert [int((runs == i).sum()) for i in range(3)] == [len(part.points) for part in parts]
    assert json.loads((place / "out" / "summary.json").read_text()) == summary
    shifts = [fact["registration"]["shift_mm"] for fact in summary["merged"][1:]]
    assert shifts[1] == pytest.approx(2.0, abs=0.2)
    assert summary["surface_error_mm"]["median"] < 0.2
    assert (summary["status"], summary["sim_time_s"], summary["link_collisions"]) == ("done", 37.5, 0)
    assert summary["coverage"] > 0.7


def test_a_merged_folder_has_map_cloud_and_a_mesh_better_than_one_run_s(merged):
    summary, place = merged
    out = place / "out"
    voxels = VoxelMap.read(out / "map.bt")
    assert len(voxels) == summary["voxels"] == len(read_cloud(out / "cloud.pcd").points)
    assert is_watertight(read_mesh(out / "mesh.stl"))
    assert (out / "preview.png").stat().st_size > 1000
    assert summary["mesh_error_mm"]["method"] == "contact_surface"
    assert summary["mesh_error_mm"]["mean"] < 0.35


def test_contacts_and_path_of_merged_runs_are_on_one_rising_clock(merged):
    """The path's times had begun anew with each run, beside contacts whose times went on."""
    _, place = merged
    back = read_run(place / "out")
    assert (np.diff(back.trace[:, 0]) >= 0.0).all()
    contacts = read_cloud(place / "out" / "contacts.csv").scalars
    delay, path = 0.0, 0
    for i, name in enumerate("abc"):
        part = read_run(place / name)
        assert back.trace[path : path + len(part.trace), 0] == pytest.approx(part.trace[:, 0] + delay, abs=1e-4)
        assert back.times[contacts["run"] == i] == pytest.approx(part.times + delay, abs=1e-4)
        delay, path = delay + part.duration, path + len(part.trace)
    assert back.duration == pytest.approx(delay, abs=1e-3)


def test_the_pitch_of_merged_runs_is_the_larger_one_of_theirs(tmp_path):
    """It was lost: coverage took 10 mm, and `reconstruct` another pitch than the merge had."""
    one, other = touches("combination"), touches("combination", 0.1, 2)
    fine = run_folder(tmp_path / "fine", "combination", one, line_spacing=0.006)
    finer = run_folder(tmp_path / "finer", "combination", other, line_spacing=0.004)
    coarse = run_folder(tmp_path / "coarse", "combination", other, line_spacing=0.024)
    shares = []
    for beside, larger in ((finer, 0.006), (coarse, 0.024)):
        summary = merge([fine, beside], tmp_path / "out", method="convex_hull")
        assert summary["line_spacing_m"] == read_run(tmp_path / "out").record.pitch == larger
        shares.append(summary["coverage"])
    assert shares[0] < shares[1]


def test_moved_runs_left_as_they_are_do_not_fit(tmp_path):
    a = run_folder(tmp_path / "a", "combination", touches("combination", 0.5, 1))
    b = run_folder(tmp_path / "b", "combination", touches("combination", 0.1, 2, 0.0, (3.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"runs\[1\].*(are not to be moved|lie where a sphere went)"):
        merge([a, b], tmp_path / "out", as_is=True)
    still = run_folder(tmp_path / "still", "combination", touches("combination", 0.1, 2))
    summary = merge([a, still], tmp_path / "out", as_is=True, method="convex_hull")
    assert not summary["merged"][1]["registration"]["moved"]
    assert summary["surface_error_mm"]["max"] < 1.0


@pytest.mark.parametrize(
    ("name", "changed", "why"),
    [
        ("bridge", {}, "lie where a sphere went|off the others' surface|apart when they fit"),
        ("polystyrene_1", {}, "moved by|near them|apart when|off the others'|lie where"),
        ("block", {"shift_mm": (0.0, 18.0, 0.0)}, "moved by"),
        ("block", {"yaw_deg": 12.0}, "moved by"),
    ],
)
def test_runs_over_another_object_or_one_far_away_are_refused_with_the_reason(tmp_path, name, changed, why):
    a = run_folder(tmp_path / "a", "block", touches("block"))
    b = run_folder(tmp_path / "b", name, touches(name, 0.1, 2, **changed))
    with pytest.raises(InputError, match=why) as refused:
        merge([a, b], tmp_path / "out")
    assert refused.value.field == "runs[1]"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        (["table.height=-0.02"], "same table .*0 and -20 mm"),
        (["table.present=false"], "same table .* has none"),
        (["probe.radius=0.004"], "same sphere .*5 and 4 mm"),
    ],
)
def test_other_tables_and_other_spheres_are_refused(tmp_path, settings, why):
    a = run_folder(tmp_path / "a", "block", touches("block"))
    b = run_folder(tmp_path / "b", "block", touches("block", 0.1, 2), settings)
    with pytest.raises(InputError, match=why):
        merge([a, b], tmp_path / "out")


def test_what_only_a_simulator_knows_is_left_out_for_real_runs(tmp_path):
    a = run_folder(tmp_path / "a", "combination", touches("combination"))
    b = run_folder(tmp_path / "b", "combination", touches("combination", 0.1, 2), known=False)
    summary = merge([a, b], tmp_path / "out", method="convex_hull")
    assert summary["surface_error_mm"] is summary["mesh_error_mm"] is summary["link_collisions"] is None
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"out: .*can be written to"):
        merge([a, b], tmp_path / "file" / "out", method="convex_hull")


def test_one_run_alone_or_without_touches_is_refused(tmp_path):
    a = run_folder(tmp_path / "a", "block", touches("block"))
    with pytest.raises(InputError, match="two run folders"):
        merge([a], tmp_path / "out")
    empty = touches("block")
    empty.points, empty.normals = np.empty((0, 3)), np.empty((0, 3))
    b = run_folder(tmp_path / "b", "block", empty)
    with pytest.raises(InputError, match="touched something"):
        merge([a, b], tmp_path / "out")


def test_none_of_the_merged_runs_is_written_over(tmp_path):
    """It had been replaced, without a question, by what it was a part of."""
    a, b = (run_folder(tmp_path / name, "block", touches("block")) for name in "ab")
    before = (a / "contacts.csv").read_bytes()
    with pytest.raises(InputError, match=r"out.*a folder apart from"):
        merge([a, b], tmp_path / "x" / ".." / "a")
    done = CliRunner().invoke(app, ["merge", str(a), str(b), "--out", str(a)])
    assert done.exit_code != 0
    assert (a / "contacts.csv").read_bytes() == before


def test_real_runs_over_an_object_moved_by_three_millimetres(tmp_path):
    small = [
        "truth.profile=ideal",
        "area.lower=[0.025, -0.050, 0.025]",
        "area.upper=[0.070, 0.010, 0.058]",
        "strategy.step=0.012",
    ]
    explore(load_scene("block", [*small, "run.seed=1"]), tmp_path / "a")
    other = load_scene("block", [*small, "run.seed=2", "strategy.step=0.009"])
    shapes = [shape.model_copy(update={"at": _moved_by(shape.at, (0.0015, 0.0026))}) for shape in other.objects]
    explore(other.model_copy(update={"objects": tuple(shapes)}), tmp_path / "b")
    summary = merge([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    found = summary["merged"][1]["registration"]
    assert found["shift_mm"] == pytest.approx(3.0, abs=0.4)
    assert found["apart_after_mm"] < 0.15
    assert summary["surface_error_mm"]["median"] < 0.15


def _moved_by(at, displacement):
    x, y, z = at.xyz
    return at.model_copy(update={"xyz": (x + displacement[0], y + displacement[1], z)})
