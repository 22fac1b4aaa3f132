"""The second process of a first start: it fills the cache, leaves nothing else behind, and may fail."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lwrprobe.compiled import kernel
from lwrprobe.compiled.disk_cache import is_stored, make_safe
from lwrprobe.exploration.procedures import compile_ahead
from lwrprobe.exploration.procedures.compile_ahead import CompileAhead, compile_late_kernels
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow


def explored(folder):
    area = ["area.lower=[-0.012, 0.0, 0.030]", "area.upper=[0.012, 0.045, 0.058]", "run.time_limit=15.0"]
    explore(load_scene("cylinder_vertical", ["run.seed=11", "truth.profile=ideal", *area]), folder)
    return (folder / "contacts.csv").read_bytes()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The contacts of a run without a second process."""
    contacts = explored(tmp_path_factory.mktemp("alone"))
    assert contacts.count(b"\n") > 20
    return contacts


@pytest.fixture
def scene():
    return load_scene("block")


def wait_for(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(0.02)


def gone(ahead, folder):
    return ahead.process.poll() is not None and not Path(folder).exists()


def folder_of(ahead):
    return ahead.process.args[-1]


def test_what_it_compiles_goes_to_the_cache(scene, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    ahead = CompileAhead(scene)
    wait_for(lambda: any(tmp_path.rglob("surface_kernels*.nbi")))
    folder = folder_of(ahead)
    ahead.close()
    assert gone(ahead, folder)


def test_nothing_of_it_is_left_when_it_is_closed_at_once_or_twice(scene):
    ahead = CompileAhead(scene)
    folder = folder_of(ahead)
    assert Path(folder, "scene.toml").is_file()
    ahead.close()
    ahead.close()
    assert gone(ahead, folder)


def test_it_ends_when_the_process_that_started_it_has_ended(scene, tmp_path):
    write_scene(scene, tmp_path / "scene.toml")
    # With an empty cache it would be at work for about a minute.
    process = subprocess.Popen(
        [sys.executable, "-m", compile_ahead.__name__, str(tmp_path)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}, stdin=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    process.stdin.close()  # as the system does for a process that was killed
    process.wait(60.0)
    assert (process.returncode, process.stderr.read()) == (0, b"")
    assert not (tmp_path / "mesh.stl").exists()


def test_the_late_phases_run_for_a_known_and_for_an_unknown_object(scene, tmp_path):
    for name, given in (("known", scene), ("unknown", scene.model_copy(update={"objects": ()}))):
        folder = tmp_path / name
        folder.mkdir()
        write_scene(given, folder / "scene.toml")
        compile_late_kernels(given, folder)
        assert {"mesh.stl", "preview.png", "report.html"} <= {file.name for file in folder.iterdir()}
        assert (folder / "mesh.stl").stat().st_size > 1000


def test_a_second_process_is_started_for_a_cold_cache_and_severalcores_alone(scene, monkeypatch):
    for cores, stored, wanted in ((2, False, True), (1, False, False), (2, True, False)):
        monkeypatch.setattr(compile_ahead, "cores", lambda cores=cores: cores)
        monkeypatch.setattr(compile_ahead, "is_stored", lambda kernel, stored=stored: stored)
        ahead = CompileAhead.where_it_pays(scene)
        assert (ahead is not None) == wanted
        if ahead is not None:
            ahead.close()


def test_no_process_where_none_can_be_started(scene, monkeypatch):
    monkeypatch.setattr(compile_ahead, "cores", lambda: 2)
    monkeypatch.setattr(compile_ahead, "is_stored", lambda kernel: False)
    monkeypatch.setattr(sys, "executable", "/no/such/interpreter")
    assert CompileAhead.where_it_pays(scene) is None


@pytest.mark.parametrize("killed", [False, True])
def test_a_run_is_the_same_beside_a_second_process_and_beside_a_killed_one(alone, killed, tmp_path, monkeypatch):
    monkeypatch.setattr(compile_ahead, "is_stored", lambda kernel: False)  # the cache is never full enough
    monkeypatch.setattr(compile_ahead, "cores", lambda: 2)
    make, started = CompileAhead.where_it_pays, []

    def where_it_pays(scene):
        started.append(make(scene))
        if killed:
            started[0].process.kill()
        return started[0]

    monkeypatch.setattr(CompileAhead, "where_it_pays", where_it_pays)
    assert explored(tmp_path) == alone
    assert started[0].process.poll() is not None


def test_a_kernel_counts_as_stored_from_its_first_specialisation_on(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))

    @kernel
    def twice(a):
        return 2 * a

    assert not is_stored(twice)
    assert twice(2) == 4
    assert is_stored(twice)
    assert is_stored(make_safe)  # no kernel: nothing can be said
