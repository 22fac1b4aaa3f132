"""Sweeps: on spawned processes, on a real Dask scheduler, cut off, with workers that die; pyarrow is the judge."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import csv as arrow_csv
from pyarrow import parquet
from task_functions import deadly, doubled, squared

from lwrprobe.contracts import InputError, SceneError
from lwrprobe.sweeps.execute import KILLED, run_cluster, run_in_order, run_kept, run_local
from lwrprobe.sweeps.journal import Journal
from lwrprobe.sweeps.page import pareto
from lwrprobe.sweeps.plan import read_plan
from lwrprobe.sweeps.sweep import sweep
from lwrprobe.sweeps.worker import THREADS

pytestmark = pytest.mark.slow  # its imports take seconds

# The area is the top of the sphere: a run over it takes some seconds of the robot's time.
PLAN = """
scenes = ["sphere"]
strategies = ["grid_version", "surface_contour"]
seeds = 2
set = ["truth.profile=ideal", "area.lower=[-0.012, -0.012, 0.045]", "area.upper=[0.012, 0.012, 0.058]"]

[[variant]]
name = "coarse"
set = ["strategy.step=0.03"]
"""


def test_results_of_all_tasks_come_back_from_processes_of_one_thread(monkeypatch):
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    found = dict(run_local({str(k): k for k in range(9)}, squared, 2))
    assert {key: result["square"] for key, result in found.items()} == {str(k): k * k for k in range(9)}
    assert {tuple(result["threads"]) for result in found.values()} == {("1",) * len(THREADS)}


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_tasks(workers):
    assert [result["double"] for result in run_in_order([5, 3, 4], doubled, workers)] == [10, 6, 8]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_journal_has_is_not_made_again(tmp_path, workers):
    journal = tmp_path / "j.jsonl"
    first = run_kept({"a": 5, "b": 3}, doubled, workers, journal)
    assert {key: result["double"] for key, result in first.items()} == {"a": 10, "b": 6}
    both = run_kept({"c": 4, "a": -1}, doubled, workers, journal)
    assert {key: result["double"] for key, result in both.items()} == {"c": 8, "a": 10}
    assert list(both) == ["c", "a"]


def test_a_process_that_dies_costs_its_own_task():
    found = dict(run_local({str(k): k for k in range(9)}, deadly, 2))
    assert found["3"]["status"] == KILLED
    assert "four is refused" in found["4"]["reason"]
    assert {found[str(k)]["square"] for k in (0, 1, 2, 5, 6, 7, 8)} == {k * k for k in (0, 1, 2, 5, 6, 7, 8)}


@pytest.fixture(scope="module")
def plan(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("plan") / "plan.toml"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def swept(plan, made_once) -> Path:
    """The folder of a sweep on two processes."""
    return made_once("swept", lambda folder: sweep(plan, folder, workers=2))


def test_the_tables_hold_a_row_each_run(swept, plan, tmp_path):
    out = shutil.copytree(swept, tmp_path / "out")
    found = sweep(plan, out)
    assert found.known == 4  # no run is repeated
    assert [(row["strategy"], row["seed"]) for row in found.rows] == [
        ("grid_version", 1), ("grid_version", 2), ("surface_contour", 1), ("surface_contour", 2),
    ]  # fmt: skip
    assert all(row["status"] in ("done", "ended early") for row in found.rows)
    for table in (arrow_csv.read_csv(out / "results.csv"), parquet.read_table(out / "results.parquet")):
        assert table.num_rows == 4
        assert table.column("contacts").to_pylist() == [row["contacts"] for row in found.rows]
        assert table.column("contact_median_mm").to_pylist() == [row["contact_median_mm"] for row in found.rows]
    page = (out / "sweep.html").read_text()
    assert page.count("<svg") == 2
    assert "surface_contour" in page


def test_a_sweep_that_was_cut_off_does_the_rest(swept, plan, tmp_path):
    content = (swept / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "journal.jsonl").write_bytes(b"".join(content[:2]) + content[2][:40])
    seen = []
    found = sweep(plan, tmp_path, workers=1, watch=lambda done, of, name: seen.append((done, of)))
    assert found.known == 2
    assert seen == [(3, 4), (4, 4)]
    assert (tmp_path / "results.csv").read_bytes() == (swept / "results.csv").read_bytes()


@pytest.mark.realtime
def test_a_cluster_that_loses_a_worker_gives_the_same_table(swept, plan, tmp_path):
    """A real scheduler and two workers on loopback; one is killed after the first run."""
    # A nanny would start the worker again: here the other one takes its runs over.
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None, processes=True) as cluster:
        environment = os.environ | dict.fromkeys(THREADS, "1")
        command = [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address, "--no-nanny"]
        command += ["--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path)]
        workers = [subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) for _ in range(2)]
        try:
            end = time.monotonic() + 60.0
            while len(cluster.scheduler_info["workers"]) < 2:
                assert time.monotonic() < end
                time.sleep(0.1)
            seen = []

            def watch(done, of, name):
                seen.append(done)
                if done == 1:
                    workers[0].kill()

            sweep(plan, tmp_path / "out", scheduler=cluster.scheduler_address, watch=watch)
        finally:
            for worker in workers:
                worker.kill()
    assert seen == [1, 2, 3, 4]
    assert (tmp_path / "out" / "results.csv").read_bytes() == (swept / "results.csv").read_bytes()
    ours, theirs = (parquet.read_table(folder / "results.parquet") for folder in (swept, tmp_path / "out"))
    assert ours.equals(theirs)


def test_a_scheduler_that_does_not_answer_is_named():
    with pytest.raises(InputError, match="--scheduler"):
        list(run_cluster({"a": 1}, squared, "nonsense://127.0.0.1:1", None))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("scenes = []", "scenes"),
        ("scenes = ['block']\nseed = 3", "seed"),
        ("scenes = ['block']\nseeds = -1", "seeds"),
        ("scenes = ['block']\nseeds = 100000000", "runs"),
        ("scenes = ['block']\n[[variant]]\nname='a'\n[[variant]]\nname='a'", "variant"),
        ("scenes = [", "TOML"),
    ],
)
def test_a_plan_that_cannot_be_used_names_the_key(tmp_path, text, named):
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(SceneError, match=named):
        read_plan(tmp_path / "plan.toml")


def test_an_unknown_setting_is_refused_before_anything_runs(tmp_path):
    (tmp_path / "plan.toml").write_text("scenes = ['block']\nset = ['probe.radios=1']")
    with pytest.raises(InputError, match="radios"):
        sweep(tmp_path / "plan.toml", tmp_path / "out")


def test_tasks_have_different_keys_and_keep_theirs(plan):
    tasks = read_plan(plan)
    assert len({task.key for task in tasks}) == len(tasks) == 4
    assert [task.key for task in tasks] == [task.key for task in read_plan(plan)]


@pytest.mark.parametrize("edited", ["scene.toml", "ball.stl", "calibration.toml", "fast.toml", "plan.toml"])
def test_a_run_with_a_file_that_was_edited_is_another_one(tmp_path, edited):
    """Only the scene file's text counted: results of an edited profile, mesh or calibration were stale."""
    (tmp_path / "ball.stl").write_bytes(b"a mesh")
    (tmp_path / "calibration.toml").write_text("date = 1")
    (tmp_path / "fast.toml").write_text("[motion]\napproach_speed = 0.01")
    mesh = '[[object]]\nshape = "union"\n[[object.children]]\nshape = "mesh"\nfile = "ball.stl"\n'
    (tmp_path / "scene.toml").write_text('calibration = "calibration.toml"\n' + mesh)
    (tmp_path / "plan.toml").write_text('scenes = ["scene.toml"]\nprofiles = ["fast.toml"]\nset = ["run.seed=1"]')
    (task,) = read_plan(tmp_path / "plan.toml")
    assert [Path(name) for name in (task.scene, task.profile)] == [tmp_path / "scene.toml", tmp_path / "fast.toml"]
    assert read_plan(tmp_path / "plan.toml")[0].key == task.key
    content = (tmp_path / edited).read_text()
    (tmp_path / edited).write_text(content.replace("1", "2") if "1" in content else content.replace("mesh", "Mesh"))
    assert read_plan(tmp_path / "plan.toml")[0].key != task.key


@given(st.lists(st.tuples(st.text(max_size=5), st.integers()), max_size=8), st.integers(0, 400))
def test_a_journal_cut_anywhere_keeps_its_whole_lines(tmp_path_factory, entries, cut):
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    journal = Journal(path)
    for key, number in entries:
        journal.add(key, {"number": number})
    journal.close()
    content = path.read_bytes()
    path.write_bytes(content[:cut])
    whole = content[:cut].count(b"\n")
    expected = {key: {"number": number} for key, number in entries[:whole]}
    again = Journal(path)
    assert again.results == expected
    again.add("more", {"number": 1})
    again.close()
    assert [json.loads(line)["key"] for line in path.read_text().splitlines()][-1] == "more"


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=30))
def test_the_front_is_that_of_the_definition(points):
    time_, error = np.array(points, dtype=float).T
    front = {tuple(points[k]) for k in pareto(time_, error)}
    beaten = lambda p: any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)  # noqa: E731
    assert front == {p for p in points if not beaten(p)}
