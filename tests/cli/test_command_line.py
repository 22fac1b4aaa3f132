"""The command line: what it answers, how it fails, and what it does not load."""

import json
import subprocess
import sys

import pytest


def lwrprobe(*arguments, folder=None, timeout=300):
    command = [sys.executable, "-c", "from lwrprobe.cli.app import main; main()", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout)


def test_version():
    from lwrprobe import __version__

    assert lwrprobe("--version").stdout.strip() == f"lwrprobe {__version__}"


def test_help_names_the_commands():
    done = lwrprobe("--help")
    assert done.returncode == 0
    for command in ("explore", "list", "doctor", "bench", "map"):
        assert command in done.stdout


@pytest.mark.parametrize("code", ["import lwrprobe", "import lwrprobe.cli.app", "import lwrprobe.contracts"])
def test_nothing_heavy_is_loaded_before_it_is_needed(code):
    heavy = ["scipy.spatial", "matplotlib", "roboticstoolbox", "fcl", "trimesh", "numba", "spatialmath", "pydantic"]
    probe = f"{code}; import sys; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("kind", ["scenes", "strategies", "drivers", "robots", "reconstructors", "benches"])
def test_list_names_something(kind):
    done = lwrprobe("list", kind)
    assert done.returncode == 0
    assert done.stdout.strip()
    assert "BROKEN" not in done.stdout


def test_doctor_finds_everything_needed():
    done = lwrprobe("doctor")
    assert "numpy" in done.stdout
    assert "strategy grid_version" in done.stdout
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["explore", "blok"], ["blok", "block"]),
        (["explore", "block", "--strategy", "grid"], ["strategy", "grid_version"]),
        (["explore", "block", "--arm", "robot"], ["driver", "sim"]),
        (["explore", "block", "--set", "strategy.stepp=0.01"], ["stepp", "step"]),
        (["explore", "block", "--set", "strategy.step=-1"], ["strategy.step", "-1"]),
        (["explore", "block", "--set", "strategy.step='wide'"], ["strategy", "step", "wide"]),
        (["explore", "block", "--set", "contact.estimator='nose'"], ["nose", "force_direction"]),
        (["explore", "block", "--set", "probe.radius=nan"], ["probe.radius"]),
        (["explore", "block", "--set", "drivers.sim.noize=1"], ["noize"]),
        (["explore", "block", "--set", "arm.base.xyz=[3.0, 0.0, 0.0]"], ["area", "reach"]),
        (["explore", "block", "--seed", "-1"], ["seed", "-1"]),
        (["bench", "kinematix"], ["kinematix", "kinematics"]),
        (["map", "info", "nowhere.bt"], ["nowhere.bt"]),
    ],
    ids=lambda value: "-".join(value)[:60] if isinstance(value, list) else None,
)
def test_bad_input_is_one_sentence_and_exit_code_two(arguments, words, tmp_path):
    done = lwrprobe(*arguments, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    sentence = done.stderr.strip().splitlines()[-1]
    for word in words:
        assert word in sentence


def test_out_that_cannot_be_written_is_refused(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    done = lwrprobe("explore", "empty", "--out", str(blocked / "run"), folder=tmp_path)
    assert done.returncode == 2
    assert "out" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_early_end_keeps_its_data_and_says_so_with_exit_code_one(tmp_path):
    arguments = ["explore", "block", "--out", "run", "--json", "--quiet", "--set", "run.time_limit=12.0"]
    done = lwrprobe(*arguments, folder=tmp_path)
    assert done.returncode == 1, done.stderr
    summary = json.loads(done.stdout.strip().splitlines()[-1])
    assert summary["status"] == "ended early"
    assert "time limit" in summary["reason"]
    rows = (tmp_path / "run" / "contacts.csv").read_text().splitlines()
    assert len(rows) == summary["contacts"] + 1
