"""What a plug-in answers is checked where it is handed over, and the error names the plug-in."""

import re
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from lwrprobe.cli.app import app
from lwrprobe.contracts import (
    Done,
    Goal,
    InputError,
    PluginError,
    Progress,
    Reconstruction,
    TouchRecord,
    TriangleMesh,
    VelocityCommand,
    plugins,
)
from lwrprobe.contracts.motion import check_motion
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.reconstruction.contact_surface import ContactSurface
from lwrprobe.reconstruction.reconstruct import reconstructed
from lwrprobe.scene import load_scene
from lwrprobe_strategies.grid_version import GridVersion

POSE = np.eye(4)
BOX = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
SIDES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                  [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (None, "motion: got None"),
        ("up", "motion: got 'up'"),
        (VelocityCommand(np.zeros(2)), "velocity"),
        (VelocityCommand(np.array([0.0, 0.0, -50.0])), "at most 0.3 m/s"),
        (VelocityCommand(np.array([0.0, np.nan, 0.0])), "velocity"),
        (VelocityCommand(np.zeros(3), pose=np.zeros(3)), "velocity.pose"),
        (Goal(np.array([0.0, 0.0, 0.1]), 0.1), "goal.pose"),
        (Goal(np.full((4, 4), np.nan), 0.1), "goal.pose"),
        (Goal(POSE, -0.1), "goal.speed"),
    ],
)
def test_a_motion_that_is_none_is_refused(motion, words):
    with pytest.raises(InputError, match=words):
        check_motion(motion, 0.3)


def test_motions_are_no_error():
    for motion in (Goal(POSE, 0.1), VelocityCommand(np.array([0.0, 0.2, -0.2])), Done("over")):
        check_motion(motion, 0.3)


@pytest.mark.parametrize("answer", [None, "down", VelocityCommand(np.array([0.0, 0.0, -50.0]))])
def test_a_run_whose_strategy_answers_nonsense_keeps_its_data_and_names_it(answer, tmp_path, monkeypatch):
    """It had ended with a traceback, and without a summary."""
    monkeypatch.setattr(GridVersion, "step", lambda self, seen: answer)
    found = explore(load_scene("block", ["truth.profile=ideal"]), tmp_path / "run")
    assert found["status"] == "ended early"
    assert "strategy plug-in 'grid_version' failed" in found["reason"]
    assert (tmp_path / "run" / "summary.json").is_file()


@pytest.mark.parametrize(
    ("what", "answer", "words"),
    [
        ("progress", lambda self: None, "progress().*allowed: a Progress"),
        ("progress", lambda self: Progress("on", np.nan), "covered: got nan"),
        ("line_spacing", property(lambda self: "10 mm"), "line_spacing: got '10 mm'; allowed: a positive length"),
        ("trace", property(lambda self: 7), "not subscriptable"),
        ("trace", property(lambda self: [("a state", 3.0)]), "trace: got .* rows of a time"),
    ],
)
def test_what_a_strategy_says_of_itself_is_checked_too(what, answer, words, tmp_path, monkeypatch):
    """It had ended with a traceback."""
    monkeypatch.setattr(GridVersion, what, answer)
    found = explore(load_scene("block", ["truth.profile=ideal"]), tmp_path / "run", watch=lambda snapshot: None)
    assert found["status"] == "ended early"
    assert re.match(f"strategy plug-in 'grid_version' failed: .*{words}", found["reason"])
    assert (tmp_path / "run" / "summary.json").is_file()


def test_a_run_whose_reconstructor_fails_keeps_its_contacts(tmp_path, monkeypatch):
    """Summary, map and report had been lost with it."""

    def fails(self, record):
        raise KeyError("boom")

    monkeypatch.setattr(ContactSurface, "reconstruct", fails)
    found = explore(load_scene("block", ["truth.profile=ideal", "run.until.time=30"]), tmp_path / "run")
    assert found["contacts"] > 0
    assert any("'contact_surface' failed: KeyError" in left["why"] for left in found["left_out"])
    assert (tmp_path / "run" / "report.html").is_file()


def answered(mesh, report=None):
    """What becomes of the answer of a reconstructor."""
    worker = SimpleNamespace(reconstruct=lambda record: Reconstruction(mesh, {} if report is None else report))
    return reconstructed(worker, TouchRecord(BOX), "mine")


@pytest.mark.parametrize(
    "mesh",
    [
        TriangleMesh(BOX, SIDES[:0]),
        TriangleMesh(np.where(BOX == 1.0, np.nan, BOX), SIDES),
        TriangleMesh(BOX, SIDES + 1),
        TriangleMesh(BOX, SIDES.astype(float)),
        TriangleMesh(BOX[:, :2], SIDES),
        None,
    ],
)
def test_a_mesh_that_is_none_is_refused_by_the_name_of_its_method(mesh):
    with pytest.raises(PluginError, match="reconstructor plug-in 'mine'"):
        answered(mesh)


def test_whether_a_mesh_is_closed_is_looked_at_and_not_believed():
    assert answered(TriangleMesh(BOX, SIDES), {"watertight": False}).report["watertight"]
    assert not answered(TriangleMesh(BOX, SIDES[1:]), {"watertight": True}).report["watertight"]


def test_a_reconstructor_of_another_shape_is_refused():
    for wrong in (None, TriangleMesh(BOX, SIDES)):
        with pytest.raises(PluginError, match="allowed: a Reconstruction"):
            reconstructed(SimpleNamespace(reconstruct=lambda record, wrong=wrong: wrong), TouchRecord(BOX), "mine")


class Old(GridVersion):
    """One that was written for an earlier contract."""

    contract = 1


def entry(name, value, distribution):
    found = EntryPoint(name, value, "lwrprobe.strategies")
    vars(found)["dist"] = SimpleNamespace(name=distribution, version="1")
    return found


def test_no_plug_in_takes_over_the_name_of_a_built_in_one(monkeypatch):
    """Any installed package could have replaced `grid_version` in silence."""
    own = entry("grid_version", "lwrprobe_strategies.grid_version:GridVersion", "lwrprobe")
    other = entry("grid_version", "collections:Counter", "another")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [other, own])
    assert plugins.load("strategy", "grid_version") is GridVersion
    first, second = plugins.discover("strategy")
    assert (first.distribution, first.broken) == ("lwrprobe", "")
    assert "same name" in second.broken


def test_two_others_of_one_name_are_refused(monkeypatch):
    both = [entry("mine", "collections:Counter", "one"), entry("mine", "collections:deque", "two")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: both)
    with pytest.raises(PluginError, match="have this name"):
        plugins.load("strategy", "mine")
    assert all("same name" in plugin.broken for plugin in plugins.discover("strategy"))


@pytest.mark.parametrize("command", [["list", "strategies"], ["doctor"]])
def test_a_plug_in_of_another_contract_is_marked_in_the_lists(command, monkeypatch):
    """They had shown it as in order; a run refused it."""
    found = plugins._entries
    old = entry("mine", f"{__name__}:Old", "another")
    monkeypatch.setattr(plugins, "_entries", lambda kind: [*found(kind), *([old] if kind == "strategy" else [])])
    done = CliRunner().invoke(app, command)
    (line,) = (line for line in done.output.splitlines() if "mine" in line.split())
    assert "broken: written for contract 1, this lwrprobe speaks contract 2" in line.replace("BROKEN", "broken")
    assert done.exit_code == (1 if command == ["doctor"] else 0)


def test_a_module_that_ends_the_program_breaks_only_itself(monkeypatch, tmp_path):
    (tmp_path / "ends_here.py").write_text("raise SystemExit(3)\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry("mine", "ends_here:Any", "one")])
    assert "SystemExit" in plugins.discover("strategy")[0].broken
