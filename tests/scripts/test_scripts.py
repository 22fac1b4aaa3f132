"""The two commands: they set themselves up once, survive an interruption, and work from any folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def copy(tmp_path):
    """A copy of the project without its environment, whose pip and venv are stood in for by quick ones."""
    project = tmp_path / "project"
    project.mkdir()
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, project)
    shutil.copytree(ROOT / "scripts", project / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    return project


def ready(project: Path, extra: str) -> None:
    """An environment in the state a finished set-up leaves: programs that answer, and the stamp."""
    programs = project / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name in ("python", "lwrprobe"):
        program = programs / name
        program.write_text('#!/bin/sh\necho "$0" "$@" "in $PWD"\n')
        program.chmod(0o755)
    code = f"import environment as e; e._stamp({extra!r}).write_text(e._fingerprint())"
    subprocess.run([sys.executable, "-c", code], cwd=project / "scripts", check=True)


def call(
    project: Path, script: str, *arguments: str, folder: Path | None = None, **variables: str
) -> subprocess.CompletedProcess:
    command = [sys.executable, str(project / "scripts" / script), *arguments]
    environment = {**os.environ, **variables}
    return subprocess.run(command, cwd=folder or project, capture_output=True, text=True, timeout=600, env=environment)


def inside(project: Path, code: str) -> subprocess.CompletedProcess:
    """Code that runs with the scripts' own module `environment` imported as `e`."""
    command = [sys.executable, "-c", f"import os, sys\nimport environment as e\n{code}"]
    return subprocess.run(command, cwd=project / "scripts", capture_output=True, text=True, timeout=600)


def write_program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def test_run_passes_arguments_on_and_stays_in_the_current_folder(copy, tmp_path):
    ready(copy, "")
    done = call(copy, "run.py", "explore", "block", "--seed", "7", folder=tmp_path)
    assert done.returncode == 0
    assert "explore block --seed 7" in done.stdout
    assert f"in {tmp_path}" in done.stdout
    assert "[set-up]" not in done.stderr


def test_test_runs_pytest_in_the_project_from_any_folder(copy, tmp_path):
    ready(copy, "test")
    done = call(copy, "test.py", "-k", "nothing", folder=tmp_path)
    assert done.returncode == 0
    cores = len(os.sched_getaffinity(0))
    assert f"-m pytest -n {cores + 1} " in done.stdout
    assert "-k nothing in" in done.stdout
    assert f"in {copy}" in done.stdout
    assert f"-m pytest -n {cores} " in call(copy, "test.py", "--quick").stdout


def test_check_runs_the_steps_it_is_asked_for(copy):
    ready(copy, "test")
    done = call(copy, "check.py", "lint", "types")
    assert done.returncode == 0
    assert "-m ruff check" in done.stdout
    assert "-m mypy" in done.stdout
    assert "docs.py" not in done.stdout
    (copy / ".venv" / "bin" / "python").write_text('#!/bin/sh\n[ "$2" != mypy ]\n')
    done = call(copy, "check.py", "types", "lint")
    assert done.returncode == 1
    assert done.stderr.strip() == "failed: types"
    assert "allowed: lint, types, docs" in call(copy, "check.py", "lnit").stderr


def test_docs_builds_the_site_with_warnings_as_errors(copy, tmp_path):
    ready(copy, "docs")
    done = call(copy, "docs.py", "-E", folder=tmp_path)
    assert done.returncode == 0
    assert "-m sphinx -b html --fail-on-warning" in done.stdout
    assert f"-E docs docs/_build in {copy}" in done.stdout
    assert "the site is in docs/_build/index.html" in done.stdout


def test_byte_code_is_kept_for_the_next_start(copy):
    ready(copy, "")
    write_program(copy / ".venv" / "bin" / "lwrprobe", 'echo "forbidden: ${PYTHONDONTWRITEBYTECODE:-no}"')
    assert call(copy, "run.py", PYTHONDONTWRITEBYTECODE="1").stdout == "forbidden: no\n"


def test_any_complete_setup_serves_run(copy):
    ready(copy, "test")
    assert "[set-up]" not in call(copy, "run.py", "--version").stderr


def test_changed_requirements_install_again(copy):
    ready(copy, "")
    (copy / "constraints.txt").write_text("numpy==0.0.0\n")
    done = call(copy, "run.py", "--version")
    assert "[set-up] installing" in done.stderr


def test_interrupted_setup_is_started_anew(copy):
    (copy / ".venv" / "bin").mkdir(parents=True)
    (copy / "pyproject.toml").write_text("[build-system]\nrequires = []\nbuild-backend = 'nowhere'\n")
    os.environ.pop("PIP_REQUIRE_VIRTUALENV", None)
    done = call(copy, "run.py", "--version", PIP_NO_INDEX="1", PIP_FIND_LINKS="")
    assert "[set-up] creating .venv" in done.stderr
    assert done.returncode != 0
    assert "run the same command again" in done.stderr
    assert not list((copy / ".venv").glob("installed-*"))


PIP = """case "$*" in
*"config list"*) echo "global.index-url='https://example.org/simple'"; echo ":env:.find-links='/a /b'" ;;
*--version*) ;;
*) echo "pip $*" >> "$0.log"; echo "warning about this machine" >&2 ;;
esac"""


@pytest.mark.parametrize("works", [True, False])
def test_uv_installs_from_where_pip_looks_and_pip_does_where_uv_fails(copy, tmp_path, works):
    ready(copy, "")
    (copy / "constraints.txt").write_text("numpy==0.0.0\n")
    write_program(copy / ".venv" / "bin" / "python", PIP)
    report = 'echo "$UV_DEFAULT_INDEX $UV_FIND_LINKS $*" > "$0.log"; echo "no such index" >&2'
    write_program(tmp_path / "bin" / "uv", f"{report}; exit {0 if works else 1}")
    done = call(copy, "run.py", "--version", PATH=f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    assert done.returncode == 0
    asked = (tmp_path / "bin" / "uv.log").read_text()
    assert asked.startswith("https://example.org/simple /a,/b pip install")
    assert f"--editable {copy}" in asked
    log = copy / ".venv" / "bin" / "python.log"
    assert log.exists() != works
    assert works or f"--editable {copy}" in log.read_text()
    assert all(line.startswith("[set-up]") for line in done.stderr.splitlines()), done.stderr
    assert "[set-up]" not in call(copy, "run.py", "--version").stderr


def test_an_error_of_pip_is_shown_with_what_to_do(copy, tmp_path):
    ready(copy, "")
    (copy / "constraints.txt").write_text("numpy==0.0.0\n")
    write_program(
        copy / ".venv" / "bin" / "python", 'case "$*" in *install*) echo "ERROR: none found" >&2; exit 1;; esac'
    )
    write_program(tmp_path / "bin" / "uv", "exit 1")
    done = call(copy, "run.py", "--version", PATH=f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    assert done.returncode == 1
    assert "ERROR: none found" in done.stderr
    assert "run the same command again" in done.stderr


def test_the_exit_code_is_that_of_the_program_on_windows_too(copy):
    for windows in (False, True):
        code = f"e.WINDOWS = {windows}; e.hand_over([sys.executable, '-c', 'raise SystemExit(7)']); print('after')"
        done = inside(copy, code)
        assert done.returncode == 7
        assert "after" not in done.stdout


def test_one_set_up_at_a_time(copy):
    code = """
import threading, time
inside, most = [], []
def one():
    with e._alone():
        inside.append(1); most.append(len(inside)); time.sleep(0.05); inside.pop()
threads = [threading.Thread(target=one) for _ in range(4)]
[t.start() for t in threads]; [t.join() for t in threads]
print(max(most), len(most))
"""
    assert inside(copy, code).stdout.split() == ["1", "4"]
    windows = """
sys.modules["fcntl"] = None
class Locking:
    LK_NBLCK = 2
    held = False
    def locking(self, descriptor, mode, size):
        assert (mode, size) == (2, 1)
        if Locking.held: raise OSError
        Locking.held = True
sys.modules["msvcrt"] = Locking()
def released(): Locking.held = False
"""
    release = "threading.Timer(0.3, released).start()\n"
    code = f"{windows}import threading\nwith e._alone(): print('first')\n{release}with e._alone(): print('second')"
    assert inside(copy, code).stdout.split() == ["first", "second"]


@pytest.mark.parametrize(("code", "said"), [(0, "1 of 1 the same"), (1, "1 of 1 the same"), (2, "0 of 1 the same")])
def test_checkouts_are_compared_by_what_a_run_leaves_that_ends_early_too(copy, tmp_path, code, said):
    """Exit code 1 is a run that ended early with its data kept, 2 is one that was refused."""
    stages = '{"stages": [{"name": "strategy", "us_median": 2.0}]}'
    explores = f"mkdir -p $8; echo a row > $8/contacts.csv; echo '{stages}' > $8/summary.json; exit {code}"
    for checkout in (copy, tmp_path / "other"):
        write_program(checkout / ".venv" / "bin" / "lwrprobe", explores)
    done = call(copy, "compare_checkouts.py", str(tmp_path / "other"), "--scene", "block", "--strategy", "active")
    assert said in done.stdout
    assert done.returncode == (said[0] == "0")
