"""`lwrprobe reconstruct`, `fit` and `evaluate`: from a run folder, a cloud or a map to figures and files."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from answer import ask
from typer.testing import CliRunner

import lwrprobe as lp
from lwrprobe.bench.sampled_lines import sample_lines, voxelised
from lwrprobe.cli.app import app
from lwrprobe.cli.checks import beside
from lwrprobe.contracts import FormatError, StorageError
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.exploration.procedures.recover import recover
from lwrprobe.exploration.recording.recorder import TRACE_COLUMNS
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import Cloud, write_cloud
from lwrprobe.reconstruction.meshes import read_mesh, write_mesh
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow


def as_json(*arguments):
    """What a command that succeeds tells with `--json`."""
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout.strip().splitlines()[-1])


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    """A run folder as a run killed in the middle of a line leaves it."""
    folder = tmp_path_factory.mktemp("runs") / "block"
    folder.mkdir()
    scene = load_scene("block", ["truth.profile=ideal"])
    write_scene(scene, folder / "scene.toml")
    record = sample_lines(scene.solid(), 0.01, 0.25)
    lines = [
        f"{0.01 * i:.4f}," + ",".join(f"{v:.7f}" for v in (*p, *n)) + ",0.8,0.9"
        for i, (p, n) in enumerate(zip(record.points, record.normals))
    ]
    text = "time,x,y,z,nx,ny,nz,force,confidence\n" + "\n".join(lines) + "\n3.0,0.01,0.0"
    (folder / "contacts.csv").write_text(text)
    trace = "\n".join(f"{i},{p[0]},{p[1]},{p[2]},0.0,0,inf,line" for i, p in enumerate(record.free_path))
    (folder / "trace.csv").write_text("time,x,y,z,force,touching,clearance,state\n" + trace + "\n")
    return folder, record


def test_a_run_that_was_killed_is_read_to_its_last_whole_line(run_folder):
    folder, record = run_folder
    run = read_run(folder)
    assert len(run.record.points) == len(record.points)
    assert np.allclose(run.record.points, record.points, atol=1e-7)
    assert np.allclose(run.record.free_path, record.free_path)
    assert run.summary is None


def test_where_the_stick_leaned_is_read_and_is_nowhere_in_an_older_run(run_folder, tmp_path):
    older = read_run(run_folder[0])
    assert older.record.leaning is None
    assert not older.trace[:, 7].any()
    folder = shutil.copytree(run_folder[0], tmp_path / "block")
    header, *rows = (folder / "trace.csv").read_text().splitlines()
    leans = [0.2 if i % 3 == 0 else 0.01 for i in range(len(rows))]
    lines = [f"{header},lean", *(f"{row},{lean}" for row, lean in zip(rows, leans))]
    (folder / "trace.csv").write_text("\n".join(lines) + "\n")
    run = read_run(folder)
    assert run.trace[:, 7] == pytest.approx(leans)
    assert run.record.leaning == pytest.approx(run.record.free_path[::3])
    part = run.until(4.0)
    assert part.free_path == pytest.approx(run.record.free_path[:5])
    assert part.leaning == pytest.approx(run.record.free_path[[0, 3]])
    assert run.times[len(part.points) - 1] <= 4.0
    assert len(part.normals) == len(part.times) == len(part.points) == (run.times <= 4.0).sum()
    (folder / "trace.csv").write_text("\n".join([*lines, rows[0]]) + "\n")
    with pytest.raises(FormatError, match=r"8 numbers"):
        read_run(folder)


@pytest.mark.parametrize("columns", [7, 8])
def test_a_recovered_run_keeps_the_path_of_an_older_one_and_of_a_merged_one(run_folder, tmp_path, columns):
    folder = shutil.copytree(run_folder[0], tmp_path / "block")
    rows = [",".join(row.split(",")[:columns]) for row in (folder / "trace.csv").read_text().splitlines()]
    (folder / "trace.csv").write_text("\n".join(rows) + "\n")
    before = read_run(folder).trace
    with open(folder / "trace.csv", "a") as file:
        file.write("9.0,0.0,0")
    assert recover(folder).dropped["trace.csv"] == 1
    assert read_run(folder).trace == pytest.approx(before)


@pytest.mark.parametrize("cut", ["", "time,x", "time,x,y,z,force,touching,clearance,state"])
def test_a_table_that_was_cut_in_its_header_is_made_anew(run_folder, tmp_path, cut):
    folder = shutil.copytree(run_folder[0], tmp_path / "block")
    (folder / "trace.csv").write_text(cut)
    recover(folder)
    assert (folder / "trace.csv").read_text() == TRACE_COLUMNS + "\n"


def test_contacts_are_read_as_the_run_corrected_them(run_folder, tmp_path):
    folder = shutil.copytree(run_folder[0], tmp_path / "block")
    measured = read_run(folder).record
    points = measured.points + np.array([0.0, 0.0, 0.002])
    write_cloud(folder / "contacts.ply", Cloud(points, -measured.normals))
    corrected = read_run(folder).record
    assert corrected.points == pytest.approx(points, abs=1e-7)
    assert corrected.normals == pytest.approx(-measured.normals, abs=1e-6)
    assert (corrected.times == measured.times).all()
    assert (read_run(folder, corrected=False).record.points == measured.points).all()
    # A run that was resumed after its cloud had been written, and cut off again, has more contacts.
    write_cloud(folder / "contacts.ply", Cloud(points[:-1], measured.normals[:-1]))
    assert (read_run(folder).record.points == measured.points).all()


def test_reconstruct_then_evaluate(run_folder, tmp_path):
    folder, _ = run_folder
    mesh = tmp_path / "block.ply"
    report = as_json("reconstruct", folder, "--out", mesh, "--set", "step=0.0025")
    assert report["watertight"]
    assert report["without"] == []
    assert report["step"] == pytest.approx(0.0025)
    assert read_mesh(mesh).vertex_error is not None
    figures = as_json("evaluate", mesh, "--truth", "block", "--out", tmp_path / "deviation")
    assert figures["mesh"]["mean"] < 0.3
    assert {facing["facing"] for facing in figures["mesh"]["facings_mm"]} >= {"+x", "-x", "+y", "-y", "+z"}
    assert sum(facing["share"] for facing in figures["mesh"]["facings_mm"]) == pytest.approx(1.0, abs=0.01)
    picture = (tmp_path / "deviation" / "deviation.png").read_bytes()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    content = (tmp_path / "deviation" / "deviation.ply").read_bytes()
    assert content.count(b"property float deviation") == 2


def test_evaluate_a_run_tells_contacts_and_normals(run_folder):
    figures = as_json("evaluate", run_folder[0])
    assert figures["contacts"]["surface_error_mm"]["median"] == pytest.approx(0.07, abs=0.03)
    assert figures["contacts"]["normal_error_deg"]["mean"] == pytest.approx(2.0 * np.sqrt(2.0 / np.pi), abs=0.3)
    assert figures["contacts"]["coverage_5mm"] > 0.75
    assert "mesh" not in figures


def test_a_mesh_from_another_frame_is_laid_over_the_truth(tmp_path):
    truth = load_scene("bridge").solid().mesh()
    turn = np.radians(80.0)
    matrix = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    write_mesh(tmp_path / "true.stl", truth)
    truth.vertices = truth.vertices @ matrix.T + [0.3, -0.2, 0.05]
    write_mesh(tmp_path / "moved.stl", truth)
    plain = as_json("evaluate", tmp_path / "moved.stl", "--truth", tmp_path / "true.stl")
    laid = as_json("evaluate", tmp_path / "moved.stl", "--truth", tmp_path / "true.stl", "--align")
    assert plain["mesh"]["mean"] > 100.0
    assert laid["mesh"]["mean"] < 0.05
    assert laid["alignment"]["rms_after_mm"] < 0.05


@pytest.mark.parametrize("ending", [".pcd", ".ply", ".csv", ".bt"])
def test_clouds_and_maps_are_taken_too(run_folder, tmp_path, ending):
    """Without what they cannot know, and saying so."""
    _, record = run_folder
    path = tmp_path / f"cloud{ending}"
    if ending == ".bt":
        voxels = VoxelMap(0.002)
        voxels.insert(voxelised(record).points)
        voxels.write(path)
    else:
        write_cloud(path, Cloud(record.points, record.normals))
    report = as_json("reconstruct", path, "--probe-radius", 0.005, "--table", 0.0, "--out", tmp_path / "mesh.stl")
    assert "free path" in report["without"]
    assert ("normals" in report["without"]) == (ending == ".bt")
    assert as_json("evaluate", tmp_path / "mesh.stl", "--truth", "block")["mesh"]["mean"] < 2.5


def test_fit_tells_the_block(run_folder):
    fits = as_json("fit", run_folder[0])
    assert fits[0]["kind"] == "box"
    assert fits[0]["warranted"]
    assert fits[0]["dimensions"]["width"] == pytest.approx(0.05, abs=2e-4)
    assert not any(found["warranted"] for found in fits[1:])
    text = ask("fit", run_folder[0]).stdout
    assert "no cylinder" in text
    assert "±" in text


def test_a_run_keeps_what_was_touched_where_its_table_is_stated_too_high(run_folder, tmp_path):
    scene = load_scene("block", ["table.height=0.08", "area.lower=[-0.1,-0.1,0.09]", "area.upper=[0.1,0.1,0.12]"])
    write_scene(scene, tmp_path / "scene.toml")
    for name in ("contacts.csv", "trace.csv"):
        (tmp_path / name).write_text((run_folder[0] / name).read_text())
    record = read_run(tmp_path).record
    assert record.table > record.points[:, 2].max()


def test_folders_of_what_is_written_are_made(run_folder, tmp_path):
    write_cloud(tmp_path / "four.csv", Cloud(np.vstack([np.zeros(3), 0.02 * np.eye(3)])))
    mesh, cloud = tmp_path / "new" / "deep" / "four.stl", tmp_path / "other" / "four.pcd"
    as_json("reconstruct", tmp_path / "four.csv", "--method", "convex_hull", "--out", mesh)
    assert mesh.is_file()
    assert write_cloud(cloud, Cloud(np.eye(3))).is_file()


def test_four_points_make_the_smallest_solid(tmp_path):
    write_cloud(tmp_path / "four.csv", Cloud(np.vstack([np.zeros(3), 0.02 * np.eye(3)])))
    report = as_json("reconstruct", tmp_path / "four.csv", "--method", "convex_hull", "--out", tmp_path / "four.stl")
    assert report["faces"] == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["reconstruct", "nowhere"], ["nowhere", "no such"]),
        (["reconstruct", "cloud.xyz"], [".xyz", ".pcd"]),
        (["reconstruct", "broken.pcd"], ["broken.pcd"]),
        (["reconstruct", "three.csv"], ["points", "at least 4"]),
        (["reconstruct", "flat.csv", "--method", "convex_hull"], ["one plane"]),
        (["reconstruct", "."], ["scene.toml"]),
        (["reconstruct", "three.csv", "--method", "concave"], ["concave", "concave_hull"]),
        (["reconstruct", "three.csv", "--set", "step"], ["--set", "key=value"]),
        (["reconstruct", "three.csv", "--set", "stepp=1.0"], ["stepp", "step"]),
        (["evaluate", "three.csv"], ["--truth"]),
        (["evaluate", "three.csv", "--truth", "blok"], ["blok", "block"]),
        (["evaluate", "broken.stl", "--truth", "block"], ["broken.stl"]),
        (["fit", "three.csv"], ["points", "at least 4"]),
        (["reconstruct", "gap.csv"], ["gap.csv", "point 3", "finite"]),
        (["reconstruct", "three.csv", "--table", "nan"], ["table", "nan", "finite"]),
        (["reconstruct", "three.csv", "--table", "10"], ["table", "10", "highest point, 1"]),
        (["reconstruct", "three.csv", "--probe-radius", "-1"], ["probe_radius", "-1", "positive"]),
        (["reconstruct", "three.csv", "--set", "step=1e-9"], ["step", "1e-09", "5e-05"]),
        (["explore", "block", "--until", "tim=3"], ["--until", "tim=3", "certified=MM"]),
        (["explore", "block", "--quiet", "--set", "strategy.step=1e-6"], ["strategy.step", "1e-06", "0.0002"]),
        (["explore", "block", "--quiet", "--set", "arm.start_deg=[0,0]"], ["arm.start_deg", "7 joint values"]),
        (["explore", "block", "--quiet", "--set", "arm.start_deg=[0,0,0,0,0,0,900]"], ["arm.start_deg", "-170 to 170"]),
    ],
)
def test_what_is_wrong_is_told_in_one_sentence(tmp_path, arguments, words):
    for name in ("cloud.xyz", "broken.pcd", "broken.stl"):
        (tmp_path / name).write_bytes(b"VERSION nonsense\n\x00\x01")
    write_cloud(tmp_path / "three.csv", Cloud(np.eye(3)))
    (tmp_path / "gap.csv").write_text("x,y,z\n0,0,0\n1,0,0\n0,nan,0\n0,0,1\n")
    write_cloud(tmp_path / "flat.csv", Cloud(np.pad(np.random.default_rng(0).random((20, 2)), ((0, 0), (0, 1)))))
    done = ask(*arguments, folder=tmp_path)
    assert done.returncode == 2
    sentence = done.stderr.strip().splitlines()
    assert len(sentence) == 1, done.stderr
    for word in words:
        assert word in sentence[0]


def test_a_line_that_is_no_contact_is_named(run_folder, tmp_path):
    (tmp_path / "scene.toml").write_text((run_folder[0] / "scene.toml").read_text())
    (tmp_path / "contacts.csv").write_text("time,x,y,z,nx,ny,nz,force,confidence\n1,2,3\n")
    with pytest.raises(FormatError, match="line 2"):
        read_run(tmp_path)


def test_interrupted_it_leaves_no_mesh(run_folder, tmp_path, monkeypatch):
    from lwrprobe.cli.bar import StageBar

    def press(bar, stage, share):
        if stage == "field":
            raise KeyboardInterrupt

    monkeypatch.setattr(StageBar, "__call__", press)
    done = CliRunner().invoke(app, ["reconstruct", str(run_folder[0]), "--out", str(tmp_path / "mesh.stl")])
    assert done.exit_code == 130
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def four_points(run_folder, tmp_path):
    """A run folder with so few contacts that its mesh takes no time, a map and a cloud beside it."""
    folder = tmp_path / "four"
    folder.mkdir()
    shutil.copy(run_folder[0] / "scene.toml", folder)
    points = ["0,0,0.05", "0.02,0,0.05", "0,0.02,0.05", "0,0,0.07"]
    rows = [f"{k},{point},0,0,1,0.8,0.9" for k, point in enumerate(points)]
    (folder / "contacts.csv").write_text("\n".join(["time,x,y,z,nx,ny,nz,force,confidence", *rows, ""]))
    voxels = VoxelMap(0.001)
    voxels.insert(np.eye(3))
    voxels.write(tmp_path / "map.bt")
    return folder


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (["map", "cloud", "map.bt", "--out", "new/cloud.pcd"], "new/cloud.pcd"),
        (["reconstruct", "four", "--method", "convex_hull", "--out", "new/mesh.stl"], "new/mesh.stl"),
        (["report", "four"], "four/report.html"),
        (["evaluate", "new/hull.stl", "--truth", "block", "--out", "new"], "new/deviation.ply"),
        (["evaluate", "new/hull.stl", "--truth", "block", "--out", "new"], "new/deviation.png"),
        (["list", "scenes", "--pictures", "new"], "new/scenes.md"),
        (["compare", "four", "four", "--out", "new/both.html"], "new/both.html"),
    ],
)
def test_a_full_disk_is_one_sentence_and_keeps_what_was_there(four_points, tmp_path, arguments, file):
    (tmp_path / "new").mkdir()
    write_mesh(tmp_path / "new" / "hull.stl", load_scene("block").solid().mesh())
    (tmp_path / file).write_text("as it was")
    (tmp_path / f"{file}.part").symlink_to("/dev/full")
    done = ask(*arguments, folder=tmp_path)
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert file in done.stderr
    assert "cannot be written" in done.stderr
    assert (tmp_path / file).read_text() == "as it was"


def test_a_table_of_a_run_is_whole_or_named(four_points, tmp_path):
    run = lp.open_run(four_points)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "contacts.csv.part").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"contacts\.csv: cannot be written"):
        run.save(tmp_path / "out")


@pytest.mark.parametrize("inside", [".", "deeper/.."])
def test_a_run_is_named_from_within_its_folder(four_points, inside):
    (four_points / "deeper").mkdir()
    assert ask("reconstruct", inside, "--method", "convex_hull", folder=four_points).returncode == 0
    assert (four_points.parent / "four_convex_hull.stl").is_file()
    asked = ask("film", inside, "--rate", "0", folder=four_points)
    assert "rate" in asked.stderr
    region = ask("rescan", inside, "--region", "0,0,0.01,0.01", "--set", "arm.base.xyz=[3, 0, 0]", folder=four_points)
    assert "reach" in region.stderr


def test_beside_a_folder_or_file_is_its_name_with_another_end(tmp_path, monkeypatch):
    (tmp_path / "run.2" / "in").mkdir(parents=True)
    (tmp_path / "cloud.pcd").touch()
    monkeypatch.chdir(tmp_path / "run.2" / "in")
    assert beside(tmp_path / "run.2", ".gif") == tmp_path / "run.2.gif"
    assert beside(tmp_path / "cloud.pcd", "_hull.stl") == tmp_path / "cloud_hull.stl"
    assert beside(Path("in"), ".gif") == Path("in.gif")
    assert beside(Path(), "-rescan") == tmp_path / "run.2" / "in-rescan"
    assert beside(Path(".."), ".gif") == tmp_path / "run.2.gif"
