"""Folders that a command may write to: what is no run's, or is read at the same time, is never touched."""

import shutil

import pytest
from answer import ask

import lwrprobe as lp
from lwrprobe.contracts import InputError
from lwrprobe.exploration.procedures.merge import merge
from lwrprobe.exploration.recording.recorder import CONTACT_COLUMNS, Recorder
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow

REGION = ("--region", "-0.01,-0.01,0.01,0.01")


def content(folder):
    """By path: the bytes of each file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def finished(tmp_path):
    """A run that came to its end, with its recording, as far as the checks look at it."""
    folder = tmp_path / "runs" / "block"
    (folder / "bag").mkdir(parents=True)
    write_scene(load_scene("block"), folder / "scene.toml")
    (folder / "contacts.csv").write_text(CONTACT_COLUMNS + "\n")
    (folder / "summary.json").write_text("{}")
    (folder / "mesh.stl").write_text("a mesh")
    (folder / "bag" / "bag_0.mcap").write_text("a recording")
    return folder


@pytest.mark.parametrize("out", [".", "bag", "again", "..", "../../link"])
@pytest.mark.parametrize("command", ["replay", "rescan", "merge"])
def test_a_run_that_is_read_is_not_written_to(finished, command, out):
    (finished.parent.parent / "link").symlink_to(finished)
    before = content(finished)
    reads = {"rescan": [finished, *REGION], "merge": [finished, finished]}.get(command, [finished])
    done = ask(command, *reads, "--out", finished / out, folder=finished.parent)
    assert done.returncode == 2
    assert "--out" in done.stderr
    assert "apart from" in done.stderr
    assert content(finished) == before


@pytest.mark.parametrize(
    "files",
    [["mesh.stl"], ["notes.txt"], ["scene.toml"], ["scene.toml", "mesh.stl", "notes.txt"], ["bag/bag_0.mcap"],
     ["scene.toml", "contacts.csv"], ["summary.json"]],
)  # fmt: skip
@pytest.mark.parametrize("command", ["explore", "repeat", "merge"])
def test_a_folder_that_is_no_run_is_refused_and_stays_as_it_is(finished, tmp_path, command, files):
    mine = tmp_path / "mine"
    for name in files:
        (mine / name).parent.mkdir(parents=True, exist_ok=True)
        (mine / name).write_text("mine")
    other = shutil.copytree(finished, tmp_path / "other")
    done = ask(command, *([finished, other] if command == "merge" else ["block"]), "--out", mine, folder=tmp_path)
    assert done.returncode == 2
    assert "--out" in done.stderr
    assert files[0].partition("/")[0] in done.stderr
    assert set(content(mine).values()) == {b"mine"}
    assert set(content(mine)) == set(files)


@pytest.mark.parametrize("command", ["explore", "repeat"])
@pytest.mark.parametrize("others", [False, True])
def test_the_scene_file_is_not_in_the_folder_that_is_written(finished, tmp_path, command, others):
    folder = finished if others else tmp_path / "mine"
    folder.mkdir(exist_ok=True)
    write_scene(load_scene("block"), folder / "scene.toml")
    before = content(folder)
    done = ask(command, folder / "scene.toml", "--out", folder, folder=tmp_path)
    assert done.returncode == 2
    assert "apart from" in done.stderr
    assert content(folder) == before


@pytest.mark.parametrize("command", ["explore", "merge"])
def test_a_run_that_was_cut_off_is_kept_and_only_an_option_that_there_is_replaces_it(finished, tmp_path, command):
    cut_off, other = (shutil.copytree(finished, tmp_path / name) for name in ("cut_off", "other"))
    (cut_off / "observations.f64").touch()
    before = content(cut_off)
    done = ask(command, *([finished, other] if command == "merge" else ["block"]), "--out", cut_off, folder=tmp_path)
    assert done.returncode == 2
    assert "resume" in done.stderr
    assert ("--overwrite" in done.stderr) is (command == "explore")
    assert content(cut_off) == before


@pytest.mark.parametrize("name", ["scene.toml", "mesh.stl", "bag"])
def test_the_library_writes_over_no_file_that_is_no_runs(tmp_path, name):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / name).write_text("mine")
    with pytest.raises(InputError, match=rf"no run's and has {name}"):
        lp.explore("block", out=mine, progress=False)
    assert set(content(mine).values()) == {b"mine"}


@pytest.mark.parametrize("out", [".", "again", ".."])
def test_the_library_merges_into_no_run_that_it_reads(finished, out):
    before = content(finished)
    with pytest.raises(InputError, match="apart from"):
        merge([finished, finished], finished / out)
    assert content(finished) == before


def test_a_finished_run_is_there_until_the_devices_of_the_next_one_have_answered(finished, tmp_path):
    before = content(finished)
    arguments = ["block", "--out", finished, "--quiet"]
    refused = ask("explore", *arguments, "--set", "arm.base.xyz=[3.0, 0.0, 0.0]", folder=tmp_path)
    assert refused.returncode == 2
    assert "reach" in refused.stderr
    silent = ask("explore", *arguments, "--arm", "fri", "--sensor", "ati", "--no-record", folder=tmp_path)
    assert silent.returncode == 2
    assert "no measurement" in silent.stderr
    assert content(finished) == before


def test_a_run_that_begins_replaces_an_earlier_one_and_nothing_else(finished):
    (finished / "notes.txt").write_text("mine")
    recorder = Recorder(finished)
    assert (finished / "mesh.stl").is_file()
    recorder.open()
    recorder.close()
    assert set(content(finished)) == {"notes.txt", "scene.toml", "contacts.csv", "trace.csv", "states.csv"}
