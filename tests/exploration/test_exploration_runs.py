"""Whole explorations in simulation: what a run promises, and what it leaves behind."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import cache

import numpy as np
import pytest

import lwrprobe as lp
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.mapping import VoxelMap
from lwrprobe.mapping.clouds import read_cloud
from lwrprobe.reconstruction.meshes import read_mesh
from lwrprobe.scene import load_scene
from run_alone import run_alone

pytestmark = pytest.mark.slow

WANTED = {
    "scene", "strategy", "seed", "status", "contacts", "voxels", "sim_time_s", "wall_time_s", "real_time_factor",
    "path_length_m", "contact_path_length_m", "peak_force_n", "link_collisions", "min_clearance_m", "coverage",
    "coverage_5mm", "contact_error_mm", "surface_error_mm", "normal_error_deg", "mesh_error_mm",
    "lower_bound_time_s", "stages", "left_out", "versions", "machine",
}  # fmt: skip

FILES = (
    "summary.json", "scene.toml", "contacts.csv", "states.csv", "contacts.ply", "cloud.pcd", "map.bt", "mesh.stl",
    "preview.png",
)  # fmt: skip


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "block"
    return explore(load_scene("block", ["run.seed=7", "truth.profile=ideal"]), folder), folder


def test_block_is_touched_on_all_sides_in_little_more_than_twice_the_least_time(block):
    summary, _ = block
    assert summary["status"] == "done"
    assert summary["link_collisions"] == 0
    assert summary["peak_force_n"] <= 3.0
    assert summary["range_used"] < 1.0
    assert summary["coverage"] >= 0.97
    assert summary["contact_error_mm"]["median"] <= 0.15
    assert summary["contact_error_mm"]["p95"] <= 0.5
    assert max(map(abs, summary["end_errors_mm"])) <= 0.3
    assert summary["sim_time_s"] <= 2.62 * summary["lower_bound_time_s"]
    assert summary["sim_time_s"] <= 2.0 * summary["lower_bound_descending_s"]
    assert summary["lower_bound_descending_s"] < summary["lower_bound_unknown_s"]
    assert summary["sim_time_s"] <= 1.9 * summary["lower_bound_unknown_s"]
    assert summary["true_peak_force_n"] >= summary["peak_force_n"]
    assert summary["rejected_share"] <= 0.05
    assert summary["warnings"] == []
    assert summary["truth"] == {"profile": "ideal"}
    assert summary["contact_error_aligned_mm"]["rms"] <= summary["contact_error_mm"]["rms"]
    assert summary["mesh_error_aligned_mm"]["mean"] == pytest.approx(summary["mesh_error_mm"]["mean"], abs=0.01)
    assert summary["mesh_error_mm"]["method"] == "contact_surface"
    assert summary["mesh_error_mm"]["mean"] <= 1.0
    assert (summary["bridged"], summary["open_borders"]) == ([], [])
    assert summary["stillness"]["moved_since_s"] is None
    assert max(summary["stillness"]["contradiction_mm"], summary["stillness"]["pushed_mm"]) < 0.4


def test_summary_holds_what_it_promises(block):
    summary, folder = block
    assert summary.keys() >= WANTED
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert {"arm", "sensor", "strategy", "trajectory", "set points"} <= {stage["name"] for stage in summary["stages"]}
    assert sum(stage["share"] for stage in summary["stages"]) == pytest.approx(1.0, abs=0.01)


def angle(normals, others):
    """Degrees between unit vectors (N, 3) and (N, 3)."""
    return np.degrees(np.arccos(np.einsum("ni,ni->n", normals, others).clip(-1.0, 1.0)))


def test_run_folder_can_be_read_back(block):
    summary, folder = block
    for name in FILES:
        assert (folder / name).stat().st_size > 0, name
    rows = np.loadtxt(folder / "contacts.csv", delimiter=",", skiprows=1)
    assert len(rows) == summary["contacts"]
    assert np.allclose(np.linalg.norm(rows[:, 4:7], axis=1), 1.0, atol=1e-5)
    assert len(VoxelMap.read(folder / "map.bt")) == summary["voxels"]
    assert len(read_cloud(folder / "cloud.pcd").points) == summary["voxels"]
    cloud, radius = read_cloud(folder / "contacts.ply"), load_scene(folder / "scene.toml").probe.radius
    # In the cloud normals are turned towards the path, about the sphere's centre, and what gave way by all touches is
    # taken off; the table has both as measured.
    assert np.allclose(cloud.points + radius * cloud.normals, rows[:, 1:4] + radius * rows[:, 4:7], atol=1e-4)
    (box,) = load_scene("block").objects
    centres, half = cloud.points + radius * cloud.normals - box.at.xyz, 0.5 * np.array(box.size)
    outward = centres - centres.clip(-half, half)
    true = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    turned, before, after = (angle(cloud.normals, rows[:, 4:7]), angle(rows[:, 4:7], true), angle(cloud.normals, true))
    large = turned > 4.0
    assert np.any(large)
    assert np.all(after[large] < before[large])
    assert np.percentile(after, 99.0) < np.percentile(before, 99.0)
    assert np.percentile(turned, 99.0) < 2.0
    assert len(read_mesh(folder / "mesh.stl").faces) > 4


def test_the_resolved_scene_explores_again(block):
    _, folder = block
    again = load_scene(folder / "scene.toml")
    assert again.run.seed == 7
    assert again.objects == load_scene("block").objects


SHORT = ["truth.profile=ideal", "run.seed=11", "area.lower=[-0.012, 0.0, 0.030]", "area.upper=[0.012, 0.045, 0.058]"]


def test_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    def contacts(name, *settings):
        run_alone(load_scene("cylinder_vertical", [*SHORT, *settings]), tmp_path / name)
        return (tmp_path / name / "contacts.csv").read_bytes()

    first = contacts("first")
    assert first.count(b"\n") > 100
    assert contacts("second") == first
    assert contacts("third", "run.seed=12") != first


@pytest.fixture(scope="module")
def stacked():
    """Summary and contact points of a strategy on one end of the stacked blocks; each is run once."""

    @cache
    def run(strategy):
        area = ["area.lower=[0.03, -0.06, 0.006]", "area.upper=[0.07, 0.06, 0.108]", "strategy.step=0.02"]
        scene = load_scene(
            "stacked_blocks", [f"strategy.name='{strategy}'", "run.time_limit=600.0", "truth.profile=ideal", *area]
        )
        run = lp.explore(scene, progress=False)
        return run.summary, run.contacts.points

    return run


@pytest.mark.parametrize("strategy", ["grid_version", "surface_contour", "orientation_change"])
def test_every_strategy_finishes_on_the_stacked_blocks(stacked, strategy):
    summary, _ = stacked(strategy)
    assert summary.status == "done", summary.reason
    assert summary.link_collisions == 0
    assert summary.peak_force_n <= 3.0


def test_orientation_change_reaches_lower_than_grid_version(stacked):
    lowest = {name: stacked(name)[1][:, 2].min() for name in ("grid_version", "orientation_change")}
    assert lowest["grid_version"] > 0.04
    assert lowest["orientation_change"] < 0.007


@pytest.mark.slow
def test_both_sides_of_a_lying_cylinder_are_touched_as_far_under_as_the_stick_allows():
    area = {"area.lower": [-0.055, -0.012, 0.006], "area.upper": [0.055, 0.012, 0.056], "truth.profile": "ideal"}
    run = lp.explore("cylinder_horizontal", strategy="surface_contour", settings=area, progress=False)
    points, normals = run.contacts.points, run.contacts.normals
    for side in (-1.0, 1.0):
        lowest = points[side * normals[:, 0] > 0.8, 2].min()
        assert lowest < 0.015, "the stick allows 14 mm, the equator is at 24"
    assert run.summary.status == "done"
    assert run.summary.true_peak_force_n < 3.0


def test_what_the_arm_cannot_reach_is_named_before_it_moves():
    messages = []
    far = ["area.lower=[-0.05, -0.05, 0.006]", "area.upper=[0.25, 0.05, 0.058]", "run.time_limit=2.0"]
    summary = explore(load_scene("empty", far), message=messages.append)
    assert messages[0].startswith("out of reach:")
    assert "x " in summary["unreachable_area"]
    assert explore(load_scene("empty", ["run.time_limit=2.0"]))["unreachable_area"] == ""


def test_nothing_there_is_no_failure(tmp_path):
    summary = explore(load_scene("empty"), tmp_path)
    assert summary["status"] == "done"
    assert "no contact" in summary["reason"]
    assert summary["contacts"] == summary["voxels"] == 0
    assert (tmp_path / "contacts.csv").read_text().count("\n") == 1
    assert len(VoxelMap.read(tmp_path / "map.bt")) == 0
    assert len(read_cloud(tmp_path / "cloud.pcd").points) == 0
    assert len(read_mesh(tmp_path / "mesh.stl").faces) == 0


def test_a_failing_strategy_is_named_and_its_data_kept(tmp_path, monkeypatch):
    from lwrprobe_strategies.grid_version import GridVersion

    step, touched = GridVersion.step, []

    def fail(self, seen):
        if seen.contact is not None:
            touched.append(seen)
        if len(touched) > 40:
            raise ZeroDivisionError("made up")
        return step(self, seen)

    monkeypatch.setattr(GridVersion, "step", fail)
    summary = explore(load_scene("cylinder_vertical", SHORT), tmp_path)
    assert summary["status"] == "ended early"
    assert "grid_version" in summary["reason"]
    assert "made up" in summary["reason"]
    assert summary["contacts"] >= 1
    assert (tmp_path / "contacts.csv").read_text().count("\n") == summary["contacts"] + 1


def test_what_was_touched_survives_a_kill(tmp_path):
    code = "import sys; sys.argv[0] = 'lwrprobe'; from lwrprobe.cli.app import main; main()"
    top = ["--set", "area.lower=[-0.012, -0.012, 0.045]", "--set", "area.upper=[0.012, 0.012, 0.058]"]
    arguments = ["explore", "sphere", "--out", "run", "--quiet", "--realtime", *top]
    arguments += ["--set", "truth.profile=ideal"]
    process = subprocess.Popen([sys.executable, "-c", code, *arguments], cwd=tmp_path)
    contacts = tmp_path / "run" / "contacts.csv"
    give_up = time.monotonic() + 240.0
    while time.monotonic() < give_up and not (contacts.is_file() and contacts.read_text().count("\n") > 20):
        time.sleep(0.2)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    rows = [line.split(",") for line in contacts.read_text().splitlines()[1:]]
    assert len(rows) >= 20
    assert all(len(row) == 9 for row in rows[:-1])


def test_under_a_table_top_no_touch_is_hard_and_the_run_comes_to_its_end():
    """With the strategy that does what `grid_version` does, and may tilt the probe besides."""
    changes = ["run.seed=7", "truth.profile=ideal", "strategy.name=orientation_change", "strategy.step=0.02"]
    summary = explore(load_scene("overhang", changes))
    assert (summary["status"], summary["link_collisions"]) == ("done", 0)
    assert summary["true_peak_force_n"] <= 4.5
    assert summary["untouched"], "the post under the table top is out of reach"


BEHIND = """
[[object]]
shape = "box"
size = [0.05, 0.03, 0.008]
at = { xyz = [0.0, -0.025, 0.03] }

[[object]]
shape = "box"
size = [0.01, 0.01, 0.028]
at = { xyz = [0.0, -0.025, 0.014] }

[[object]]
shape = "box"
size = [0.05, 0.02, 0.02]
at = { xyz = [0.0, 0.03, 0.01] }

[area]
lower = [-0.06, -0.07, 0.006]
upper = [0.06, 0.07, 0.042]
"""


def test_what_stands_behind_a_table_top_is_touched_from_both_sides(tmp_path):
    """A line that comes down to the table top's lower edge leads on from there: nothing else leads behind it."""
    (tmp_path / "behind.toml").write_text(BEHIND)
    changes = ["truth.profile=ideal", "strategy.name=grid_version", "strategy.step=0.02"]
    summary = explore(load_scene(str(tmp_path / "behind.toml"), changes), tmp_path / "run")
    assert (summary["status"], summary["link_collisions"]) == ("done", 0)
    points = read_cloud(tmp_path / "run" / "contacts.ply").points
    for side in (0.02, 0.04):
        beside = points[(np.abs(points[:, 1] - side) < 5e-4) & (points[:, 2] < 0.012)]
        assert len(np.unique(beside[:, 0].round(2))) >= 3, "each line over it, whichever border it came from"


@pytest.mark.parametrize("strategy", ["grid_version", "active"])
def test_an_object_far_lower_than_the_area_is_found_and_explored(strategy):
    """All lines pass 20 mm above it at first: they are driven once more, lower."""
    changes = [f"strategy.name={strategy}", "strategy.step=0.02", "truth.profile=ideal", "area.upper=[0.085,0.06,0.13]"]
    summary = explore(load_scene("block", changes))
    assert (summary["status"], summary["link_collisions"], summary["warnings"]) == ("done", 0, [])
    assert summary["coverage"] >= 0.97


def test_a_leaning_probe_feels_the_foot_and_the_waist_of_an_hourglass():
    """An upright stick meets the upper rim first: it covers 58 % of what the leaning one reaches."""
    settings = {"run.seed": 5, "strategy.name": "orientation_change"}
    summary = explore(load_scene("random:revolution:12", settings))
    assert (summary["status"], summary["link_collisions"]) == ("done", 0)
    assert summary["true_peak_force_n"] <= 3.0
    assert summary["coverage"] > 0.75
