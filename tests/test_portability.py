"""Whoever only simulates needs no POSIX: what other systems lack is taken away, then everything is imported and run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("lwrprobe", "lwrprobe_sim", "lwrprobe_strategies", "lwrprobe_ati", "lwrprobe_fri", "lwrprobe_rig")

WITHOUT_POSIX = """
import os, signal, socket, sys, warnings

for name in ("crypt", "curses", "fcntl", "grp", "nis", "pty", "pwd", "readline", "resource", "spwd", "syslog",
             "termios", "tty"):
    sys.modules[name] = None  # an import of it raises ImportError
for module, names in (
    (os, ("fork", "forkpty", "geteuid", "getgid", "getpgid", "getuid", "killpg", "mkfifo", "nice", "setsid")),
    (os, [name for name in dir(os) if name.startswith(("sched_", "SCHED_", "posix_"))]),
    (signal, ("SIGALRM", "SIGHUP", "SIGKILL", "SIGQUIT", "SIGUSR1", "SIGUSR2", "pthread_kill", "setitimer")),
    (socket, ("AF_UNIX", "MSG_DONTWAIT", "SOCK_SEQPACKET")),
):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
# A text file without an encoding is read and written differently on each system.
warnings.filterwarnings("error", category=EncodingWarning, module="lwrprobe")
"""


def run(code, *arguments, folder):
    environment = {**os.environ, "PYTHONUTF8": "0"}
    command = [sys.executable, "-X", "warn_default_encoding", "-c", WITHOUT_POSIX + code, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=900)


def test_what_is_taken_away_is_away(tmp_path):
    done = run("import fcntl", folder=tmp_path)
    assert "ModuleNotFoundError" in done.stderr
    done = run("signal.SIGHUP", folder=tmp_path)
    assert "AttributeError" in done.stderr


@pytest.mark.slow
def test_every_module_is_imported_without_posix(tmp_path):
    code = """
from importlib import import_module
from pkgutil import walk_packages

for package in sys.argv[1:]:
    found = [module.name for module in walk_packages(import_module(package).__path__, package + ".")]
    for name in found:
        import_module(name)
    print(len(found))
"""
    done = run(code, *PACKAGES, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    counts = [int(line) for line in done.stdout.split()]
    assert len(counts) == len(PACKAGES)
    assert min(counts) >= 3


@pytest.mark.slow
def test_an_exploration_runs_without_posix(tmp_path):
    code = """
import json
from lwrprobe.cli.app import main

for words in json.loads(sys.argv[1]):
    sys.argv = ["lwrprobe", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""
    area = ["--set", "area.lower=[-0.012, 0.0, 0.030]", "--set", "area.upper=[0.012, 0.045, 0.058]"]
    settings = ["--set", "truth.profile=ideal", *area, "--seed", "11"]
    commands = [
        ["explore", "cylinder_vertical", *settings, "--out", "run", "--quiet"],
        ["report", "run"],
        ["evaluate", "run"],
        ["reconstruct", "run", "--out", "again.stl", "--quiet"],
    ]
    done = run(code, json.dumps(commands), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["status"] == "done"
    assert summary["contacts"] > 10
    assert {"contacts.csv", "map.bt", "mesh.stl", "report.html"} <= {path.name for path in (tmp_path / "run").iterdir()}
    assert (tmp_path / "again.stl").stat().st_size > 0


def test_the_sensor_driver_ends_cleanly_where_there_is_no_hang_up_signal(tmp_path):
    code = """
import signal
from lwrprobe_ati import shutdown_hook

shutdown_hook.register(lambda: print("stopped", flush=True))
signal.raise_signal(signal.SIGTERM)
"""
    done = run(code, folder=tmp_path)
    assert done.stdout.strip() == "stopped", done.stderr
    assert done.returncode == -15


def test_the_scripts_are_imported_without_posix(tmp_path):
    code = "sys.path.insert(0, sys.argv[1]); import environment; print(environment.PYTHON)"
    done = run(code, str(ROOT / "scripts"), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert ".venv" in done.stdout
