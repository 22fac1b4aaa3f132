"""Make the project's virtual environment, once, with nothing but Python and a package index.

A stamp beside the environment says what was installed into it; as long as it matches pyproject.toml and
constraints.txt nothing is done. An interrupted set-up has left no stamp, so the next call starts it anew.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
WINDOWS = os.name == "nt"
PROGRAMS = VENV / ("Scripts" if WINDOWS else "bin")
SUFFIX = ".exe" if WINDOWS else ""
PYTHON = PROGRAMS / f"python{SUFFIX}"
OLDEST = (3, 11)


def ensure(extra: str = "") -> float:
    """Environment with lwrprobe and one extra installed; returns the seconds that setting it up took."""
    if sys.version_info < OLDEST:
        sys.exit(f"lwrprobe needs Python {OLDEST[0]}.{OLDEST[1]} or newer; this is {sys.version.split()[0]}")
    # Byte code belongs into this environment as compiled kernels do: without it each start takes seconds longer.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if _installed(extra):
        return 0.0
    begin = time.monotonic()
    with _alone():
        if not _installed(extra):  # another call may have done it while this one waited
            _install(extra)
    return time.monotonic() - begin


def program(name: str) -> Path:
    """A program that is installed in the environment."""
    return PROGRAMS / f"{name}{SUFFIX}"


def hand_over(command: list[str]) -> NoReturn:
    """Go on as this command: its exit code is that of this process."""
    if WINDOWS:  # exec* returns to the shell at once there, and the exit code is lost
        sys.exit(subprocess.run(command).returncode)
    os.execv(command[0], command)


@contextmanager
def _alone() -> Iterator[None]:
    """Holds a lock that one process has at a time and that the system takes back when the process dies."""
    with open(ROOT / ".venv.lock", "w") as lock:
        try:
            import fcntl
        except ImportError:
            _lock_on_windows(lock.fileno())
        else:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _lock_on_windows(descriptor: int) -> None:
    import msvcrt  # the lock ends when the file is closed

    while True:
        try:
            return msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, no-any-return, unused-ignore]
        except OSError:
            time.sleep(0.5)


def _install(extra: str) -> None:
    if not _usable():
        _say(f"creating {VENV.name} with Python {sys.version.split()[0]}")
        shutil.rmtree(VENV, ignore_errors=True)
        venv.create(VENV, with_pip=True)
    _say(f"installing lwrprobe{f' with the extra {extra!r}' if extra else ''} (less than a minute)")
    target = ["--constraint", str(ROOT / "constraints.txt"), "--editable", f"{ROOT}[{extra}]" if extra else str(ROOT)]
    if not _install_by_uv(target):
        # Byte code is written at the first import anyway, and of most modules never.
        done = _pip("install", "--no-compile", *target)
        if done.returncode != 0:
            sys.exit(f"{done.stderr}the installation failed (see above); run the same command again to retry")
    _stamp(extra).write_text(_fingerprint(), encoding="utf-8")


def _install_by_uv(target: list[str]) -> bool:
    """Install with uv, which takes a quarter of pip's time; False where uv is not to be had or fails."""
    uv = shutil.which("uv")
    if uv is None:
        constraints = ("--constraint", str(ROOT / "constraints.txt"))
        _pip("install", "--no-compile", "--only-binary", "uv", "--retries", "1", *constraints, "uv")
        uv = str(program("uv"))
        if not Path(uv).exists():
            return False
    command = [uv, "pip", "install", "--quiet", "--python", str(PYTHON), *target]
    return _run(command, {**_as_uv_reads_it(_pip_configuration()), **os.environ}).returncode == 0


def _as_uv_reads_it(pip: dict[str, str]) -> dict[str, str]:
    """Where this machine's pip looks for packages, as variables of uv, which does not read pip's configuration."""
    variables = {
        "index-url": "UV_DEFAULT_INDEX",
        "extra-index-url": "UV_INDEX",
        "find-links": "UV_FIND_LINKS",
        "cert": "SSL_CERT_FILE",
    }
    found = {variables[key]: value for key, value in pip.items() if key in variables}
    if "UV_FIND_LINKS" in found:
        found["UV_FIND_LINKS"] = ",".join(found["UV_FIND_LINKS"].split())
    # All indexes are equal, as they are to pip; a dead one is given up early, since pip comes next.
    return {**found, "UV_INDEX_STRATEGY": "unsafe-best-match", "UV_HTTP_TIMEOUT": "30", "UV_HTTP_RETRIES": "1"}


def _pip_configuration() -> dict[str, str]:
    """pip's settings by name, those of the environment last: `global.index-url='https://...'`."""
    settings = {}
    for line in _pip("config", "list").stdout.splitlines():
        key, equals, value = line.partition("=")
        if equals:
            settings[key.rpartition(".")[2]] = value.strip().strip("'\"")
    return settings


def _pip(*arguments: str) -> subprocess.CompletedProcess[str]:
    """pip's errors are its result; its warnings, of which most are about the machine, are not shown."""
    return _run([str(PYTHON), "-m", "pip", "--quiet", "--quiet", "--disable-pip-version-check", *arguments])


def _run(command: list[str], environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, encoding="utf-8", errors="replace")


def _installed(extra: str) -> bool:
    # Without an extra any complete set-up will do: every extra installs lwrprobe itself too.
    stamps = [_stamp(extra)] if extra else list(VENV.glob(_stamp("*").name))
    wanted = _fingerprint()
    return PYTHON.exists() and any(s.is_file() and s.read_text(encoding="utf-8") == wanted for s in stamps)


def _usable() -> bool:
    if not PYTHON.exists():
        return False
    return subprocess.run([str(PYTHON), "-m", "pip", "--version"], capture_output=True).returncode == 0


def _stamp(extra: str) -> Path:
    return VENV / f"installed-{extra or 'lwrprobe'}"


def _fingerprint() -> str:
    digest = hashlib.sha256(str(ROOT).encode())
    for name in ("pyproject.toml", "constraints.txt"):
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()


def _say(text: str) -> None:
    print(f"[set-up] {text}", file=sys.stderr, flush=True)
