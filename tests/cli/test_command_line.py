"""The command line: what it answers, how it fails, and what it does not load."""

import json
import socket
import subprocess
import sys

import pytest
from answer import ask

pytestmark = pytest.mark.slow


def lwrprobe(*arguments, folder=None):
    """In a process of its own, as a user runs it."""
    start = "import sys; sys.argv[0] = 'lwrprobe'; from lwrprobe.cli.app import main; main()"
    command = [sys.executable, "-c", start, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


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


KINDS = ["scenes", "profiles", "strategies", "drivers", "robots", "reconstructors", "emulators", "benches"]


@pytest.mark.parametrize("kind", KINDS)
def test_list_describes_each_name(kind):
    done = ask("list", kind)
    assert done.returncode == 0
    assert done.stdout.strip()
    assert "BROKEN" not in done.stdout
    assert all(len(line.split()) > 3 for line in done.stdout.splitlines()), done.stdout


COMMANDS = [
    [], ["explore"], ["resume"], ["reconstruct"], ["fit"], ["evaluate"], ["report"], ["merge"], ["list"], ["doctor"],
    ["calibrate"], ["repeat"],
    ["recover"], ["replay"], ["rescan"], ["sweep"], ["compare"], ["view"], ["film"],
    ["bench"], ["map"], ["map", "info"], ["map", "cloud"],
    ["emulate"], ["emulate", "fri"], ["emulate", "ati"], ["emulate", "rig"],
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_says_what_each_option_takes(command):
    done = ask(*command, "--help", COLUMNS="80")
    assert done.returncode == 0, done.stderr
    assert f"Usage: {' '.join(['lwrprobe', *command])} " in done.stdout or not command
    assert "--help" in done.stdout
    assert "bool" not in done.stdout
    for line in done.stdout.splitlines():
        assert len(line) <= 80
        words = line.strip("│ ").split()
        if words and words[0].startswith("--"):
            assert len(words) > 1, f"no word about {words[0]}"


def test_help_of_emulate_names_the_emulators():
    for arguments in (["emulate", "--help"], ["emulate"]):
        answer = ask(*arguments)
        assert "FRI 1.0" in answer.stdout + answer.stderr
        assert "ATI Wireless F/T" in answer.stdout + answer.stderr


WRONG_NAMES = [
    ("explore blok", ["'blok'", "did you mean 'block'", "lwrprobe list scenes"]),
    ("explore nowhere.toml", ["nowhere.toml", "existing"]),
    ("explore block --arm ur", ["driver", "'ur'", "fri, mujoco, sim", "lwrprobe list drivers"]),
    ("explore block --sensor simm", ["driver", "did you mean 'sim'"]),
    ("explore block --strategy x", ["strategy", "'x'", "grid_version", "lwrprobe list strategies"]),
    ("explore block --strategy grid_verson", ["strategy", "did you mean 'grid_version'"]),
    ("explore block --profile these", ["profile", "did you mean 'thesis'", "lwrprobe list profiles"]),
    ("explore block --set arm.robot=lwr", ["robot", "did you mean 'lwr4'", "lwrprobe list robots"]),
    ("explore block --set reconstruction.method=poison", ["reconstructor", "did you mean 'poisson'"]),
    ("explore block --set contact.estimator=fuse", ["contact.estimator", "'fuse'", "'fused'"]),
    ("explore block --out file/run", ["--out", "file is a file"]),
    ("explore block --dry-run --arm ur", ["driver", "'ur'"]),
    ("resume nowhere", ["run", "nowhere", "existing"]),
    ("resume folder", ["run", "folder", "lwrprobe explore"]),
    ("report folder", ["folder", "lwrprobe explore"]),
    ("merge folder folder --out x", ["folder", "lwrprobe explore"]),
    ("merge folder --out x", ["two run folders"]),
    ("reconstruct nowhere.ply", ["source", "nowhere.ply"]),
    ("reconstruct folder --method hull", ["reconstructor", "hull", "lwrprobe list reconstructors"]),
    ("reconstruct folder --out mesh.xyz", ["--out", "mesh.xyz", ".stl"]),
    ("fit nowhere.ply", ["source", "nowhere.ply"]),
    ("evaluate nowhere.stl --truth block", ["subject", "nowhere.stl"]),
    ("evaluate file", ["--truth", "scene"]),
    ("calibrate bloc --reference-sphere 0.03", ["did you mean 'block'"]),
    ("calibrate block --reference-sphere 0.03 --arm ur", ["driver", "'ur'"]),
    ("repeat bloc", ["did you mean 'block'"]),
    ("repeat block --arm ur", ["driver", "'ur'"]),
    ("doctor --arm ur", ["driver", "'ur'", "lwrprobe list drivers"]),
    ("list scene", ["kind", "did you mean 'scenes'"]),
    ("list drivers --pictures x", ["--pictures", "scenes"]),
    ("list scenes --pictures file/x", ["--pictures", "file is a file"]),
    ("bench kin", ["bench", "did you mean 'kinematics'", "lwrprobe list benches"]),
    ("bench kinematics --out file", ["--out", "file is a file"]),
    ("bench kinematics --json folder", ["--json", "this is a folder"]),
    ("emulate fro", ["emulator", "did you mean 'fri'", "lwrprobe list emulators"]),
    ("map info nowhere.bt", ["nowhere.bt", "existing"]),
    ("map cloud nowhere.bt --out x.ply", ["nowhere.bt", "existing"]),
]

WITHOUT_KERNELS = """
import io, json, os, sys, time
from contextlib import redirect_stderr

began = time.process_time()
from lwrprobe.cli.app import main

for number, words in enumerate(json.loads(sys.argv[1])):
    folder = f"{number}"
    os.makedirs(f"{folder}/folder")
    open(f"{folder}/file", "w").close()
    os.chdir(folder)
    sys.argv, said, code = ["lwrprobe", *words], io.StringIO(), 0
    with redirect_stderr(said):
        try:
            main()
        except SystemExit as end:
            code = end.code
    used, began = time.process_time() - began, time.process_time()
    loaded = [name for name in ("numba", "scipy", "spatialmath", "trimesh") if name in sys.modules]
    print(json.dumps([code, said.getvalue(), loaded, used, sorted(os.listdir())]), file=sys.__stdout__, flush=True)
    os.chdir("..")
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What each wrong line is answered, one after the other in one process; the first pays for the imports."""
    lines = [arguments.split() for arguments, _ in WRONG_NAMES]
    command = [sys.executable, "-c", WITHOUT_KERNELS, json.dumps(lines)]
    folder = tmp_path_factory.mktemp("told")
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    answers = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    return dict(zip([arguments for arguments, _ in WRONG_NAMES], answers, strict=True))


@pytest.mark.parametrize(("arguments", "words"), WRONG_NAMES)
def test_a_wrong_name_is_told_at_once_and_with_what_to_do(told, arguments, words):
    code, said, loaded, seconds, files = told[arguments]
    assert code == 2, said
    assert "Traceback" not in said
    sentence = said.strip().splitlines()[-1]
    for word in words:
        assert word in sentence
    assert loaded == []
    assert seconds < 1.5
    assert files == ["file", "folder"]


def test_the_scene_names_the_estimators_that_there_are():
    from typing import get_args

    from lwrprobe.contact import ESTIMATORS
    from lwrprobe.scene.scene import ContactTable

    assert get_args(ContactTable.model_fields["estimator"].annotation) == tuple(ESTIMATORS)


def test_doctor_finds_everything_needed():
    done = lwrprobe("doctor")
    assert "numpy" in done.stdout
    assert "strategy grid_version" in done.stdout
    assert done.returncode == 0, done.stdout


def test_doctor_tells_of_a_silent_controller_and_goes_on():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = [f'drivers.fri.bind="127.0.0.1:{port}"', "drivers.fri.connect_timeout=0.2"]
    done = ask("doctor", "--arm", "fri", *(word for each in address for word in ("--set", each)))
    assert done.returncode == 1
    assert "! fri connection" in done.stdout
    assert "no measurement came" in done.stdout
    assert "problems found: 1" in done.stdout
    assert done.stderr == ""


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
    done = ask(*arguments, folder=tmp_path)
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
