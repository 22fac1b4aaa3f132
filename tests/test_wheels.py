"""What a user gets: the wheels, in an environment with nothing but what they declare, and a third party's strategy.

The declared dependencies are linked in from the environment of the tests, with theirs and no others. Environment and
compiled kernels are kept in pytest's cache folder. What the other tests have compiled from the very files that are in
the wheels is taken over, since it is the same numba that would compile it again.
"""

import filecmp
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import venv
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "how-to" / "write-your-own-strategy.md"
SOURCES = (ROOT / "src", ROOT / "drivers", ROOT / "strategies", ROOT / "examples" / "lwrprobe-edges" / "src")

FAULTY = '''
from dataclasses import dataclass
from lwrprobe.contracts import STRATEGY_CONTRACT, Goal, Progress

@dataclass
class Config:
    after: float = 0.5

class Faulty:
    """Fails in the middle of a motion."""
    Config = Config
    contract = STRATEGY_CONTRACT
    line_spacing = None
    trace = ()

    def start(self, task):
        self.task = task

    def step(self, seen):
        pose = seen.pose.copy()
        pose[2, 3] -= 0.001
        if seen.time > self.task.options.after:
            1 / 0
        return Goal(pose, self.task.approach_speed)

    def progress(self):
        return Progress("failing soon")
'''


class Clean:
    """The environment with both wheels in it."""

    def __init__(self, folder, wheels):
        self.folder, self.cache, self.wheels = folder, folder.parent / "numba", wheels
        self.packages = folder / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"

    def run(self, *command, cwd, seconds=900):
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
        environment |= {"NUMBA_CACHE_DIR": str(self.cache), "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"}
        return subprocess.run(
            [self.folder / "bin" / command[0], *command[1:]],
            cwd=cwd, env=environment, capture_output=True, text=True, timeout=seconds,
        )  # fmt: skip


def link_declared(name, packages, done):
    """Link a distribution and all that it declares into `packages`."""
    wanted = Requirement(name)
    if wanted.name in done or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
        return
    done.add(wanted.name)
    try:
        found = distribution(wanted.name)
    except PackageNotFoundError:
        return  # optional on this platform: an import that needs it will tell
    for top in {file.parts[0] for file in found.files if file.parts[0] not in ("..", "__pycache__")}:
        source, target = Path(found.locate_file(top)), packages / top
        if source.exists() and not target.exists():
            target.symlink_to(source)
    for requirement in found.requires or ():
        link_declared(requirement, packages, done)


@pytest.fixture(scope="module")
def clean(request, tmp_path_factory):
    wheels = tmp_path_factory.mktemp("wheels")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", wheels]
    subprocess.run([*build, ROOT, ROOT / "examples" / "lwrprobe-edges"], check=True, timeout=300)
    folder = request.config.cache.mkdir("wheels") / "env"
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=False, symlinks=True)
    made = Clean(folder, sorted(wheels.glob("*.whl")))
    done = {"lwrprobe"}
    for requirement in distribution("lwrprobe").requires:
        link_declared(requirement, made.packages, done)
    install = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install", "--quiet"]
    subprocess.run([*install, "--no-deps", "--no-index", *made.wheels], check=True, timeout=300)
    share_kernels(made)
    return made


def cache_of(name):
    """Where numba keeps what it compiles from a module of kernels."""
    kernels = (value for value in vars(importlib.import_module(name)).values() if hasattr(value, "py_func"))
    return next(kernel.stats.cache_path for kernel in kernels if kernel.py_func.__module__ == name)


def share_kernels(clean):
    """Give the environment's numba what is compiled already from files that are the same byte for byte."""
    same = []
    for source in SOURCES:
        for file in source.rglob("*kernels*.py"):
            installed = clean.packages / file.relative_to(source)
            if installed.exists() and filecmp.cmp(file, installed, shallow=False):
                # numba looks at a file's time to tell whether it changed: the source's, not that of the installation
                os.utime(installed, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns))
                same.append(".".join(file.relative_to(source).with_suffix("").parts))
    ask = (
        f"import importlib, json, sys\n{inspect.getsource(cache_of)}\nprint(json.dumps([*map(cache_of, sys.argv[1:])]))"
    )
    raised = clean.run("python", "-c", ask, *same, cwd=clean.folder)
    assert raised.returncode == 0, raised.stderr
    for name, theirs in zip(same, json.loads(raised.stdout)):
        for file in Path(cache_of(name)).glob(f"{name.rpartition('.')[2]}.*.nb[ic]"):
            copy = Path(theirs, file.name)
            if not copy.exists() or copy.stat().st_mtime_ns < file.stat().st_mtime_ns:
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(file, copy)


@pytest.fixture
def plugin(clean):
    """Puts a distribution with one strategy beside the wheels, and takes it away again."""
    made = []

    def put(name, text):
        module, info = clean.packages / f"{name}_plugin.py", clean.packages / f"{name}-1.0.dist-info"
        made.extend((module, info))
        module.write_text(text)
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[lwrprobe.strategies]\n{name} = {name}_plugin:{name.capitalize()}\n")

    yield put
    for path in made:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def test_the_wheels_hold_the_packages_and_nothing_of_the_tests(clean, tmp_path):
    raised = clean.run("python", "-c", "import lwrprobe, lwrprobe_sim; print(lwrprobe.__file__)", cwd=tmp_path)
    assert raised.returncode == 0, raised.stderr
    assert Path(raised.stdout.strip()).is_relative_to(clean.packages)
    names = {path.name for path in clean.packages.iterdir()}
    drivers = {"lwrprobe_sim", "lwrprobe_mujoco", "lwrprobe_fri", "lwrprobe_ati", "lwrprobe_rig"}
    assert {"lwrprobe", "lwrprobe_strategies"} | drivers <= names
    assert not {"tests", "pytest", "hypothesis", "pin", "pinocchio", "octomap"} & names
    assert list((clean.packages / "lwrprobe" / "scene" / "library").glob("*.toml"))


def test_the_page_for_authors_holds_word_for_word(clean, tmp_path):
    blocks = re.findall(r"```bash\n(pip install .*?)```", PAGE.read_text(), re.DOTALL)
    install, listing, explore = blocks[0].strip().splitlines()
    assert install == "pip install ./lwrprobe-edges"  # the fixture's second wheel is that folder's
    assert [wheel.name.split("-")[0] for wheel in clean.wheels] == ["lwrprobe", "lwrprobe_edges"]
    listed = clean.run(*listing.split(), cwd=tmp_path)
    assert re.search(r"^edges +Touches down", listed.stdout, re.MULTILINE), listed.stdout
    assert "[lwrprobe-edges 0.1.0]" in listed.stdout
    done = clean.run(*explore.split(), "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    assert summary["status"] == "done"
    assert summary["contacts"] > 100
    assert summary["link_collisions"] == 0
    assert summary["surface_error_mm"]["median"] < 0.3
    assert json.loads((tmp_path / "runs" / "block" / "summary.json").read_text()) == summary


def test_a_misspelt_option_of_the_plugin_is_refused_by_name(clean, tmp_path):
    raised = clean.run(
        "lwrprobe", "explore", "block", "--strategy", "edges", "--set", "strategy.closd=0.003", cwd=tmp_path
    )
    assert raised.returncode == 2
    assert "closd" in raised.stderr
    assert "did you mean 'closed'" in raised.stderr


def test_a_broken_plugin_is_listed_with_its_reason_and_takes_nothing_down(clean, plugin, tmp_path):
    plugin("broken", "import unobtainium\n")
    listed = clean.run("lwrprobe", "list", "strategies", cwd=tmp_path)
    assert listed.returncode == 0
    assert re.search(r"^broken +BROKEN: ModuleNotFoundError: No module named 'unobtainium'", listed.stdout, re.M)
    assert {"grid_version", "surface_contour", "orientation_change", "edges"} <= set(listed.stdout.split())
    raised = clean.run("lwrprobe", "doctor", cwd=tmp_path)
    assert "unobtainium" in raised.stdout + raised.stderr
    used = clean.run("lwrprobe", "explore", "sphere", "--strategy", "broken", cwd=tmp_path)
    assert used.returncode == 2
    assert "'broken'" in used.stderr
    assert "unobtainium" in used.stderr


def test_an_error_inside_a_plugin_names_it_and_keeps_the_run(clean, plugin, tmp_path):
    plugin("faulty", FAULTY)
    done = clean.run("lwrprobe", "explore", "sphere", "--strategy", "faulty", "--out", "run", "--json", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    assert summary["status"] == "ended early"
    assert summary["reason"].startswith("strategy plug-in 'faulty' failed: ZeroDivisionError")
    assert (tmp_path / "run" / "trace.csv").read_text().count("\n") > 5
