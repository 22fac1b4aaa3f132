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


def call(project: Path, script: str, *arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess:
    command = [sys.executable, str(project / "scripts" / script), *arguments]
    return subprocess.run(command, cwd=folder or project, capture_output=True, text=True, timeout=120)


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
    assert "-m pytest -n auto" in done.stdout
    assert "-k nothing in" in done.stdout
    assert f"in {copy}" in done.stdout


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
    done = call(copy, "run.py", "--version")
    assert "[set-up] creating .venv" in done.stderr
    assert done.returncode != 0
    assert "run the same command again" in done.stderr
    assert not list((copy / ".venv").glob("installed-*"))
