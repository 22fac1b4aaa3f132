"""Make the project's virtual environment, once, with nothing but Python and a package index.

A stamp beside the environment says what was installed into it; as long as it matches pyproject.toml and
constraints.txt nothing is done. An interrupted set-up has left no stamp, so the next call starts it anew.
"""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import subprocess
import sys
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
OLDEST = (3, 11)


def ensure(extra: str = "") -> float:
    """Environment with lwrprobe and one extra installed; returns the seconds that setting it up took."""
    if sys.version_info < OLDEST:
        sys.exit(f"lwrprobe needs Python {OLDEST[0]}.{OLDEST[1]} or newer; this is {sys.version.split()[0]}")
    if _installed(extra):
        return 0.0
    begin = time.monotonic()
    with open(ROOT / ".venv.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not _installed(extra):  # another call may have done it while this one waited
            _install(extra)
    return time.monotonic() - begin


def _install(extra: str) -> None:
    if not _usable():
        _say(f"creating {VENV.name} with Python {sys.version.split()[0]}")
        shutil.rmtree(VENV, ignore_errors=True)
        venv.create(VENV, with_pip=True)
    _say(f"installing lwrprobe{f' with the extra {extra!r}' if extra else ''} (about a minute)")
    target = f"{ROOT}[{extra}]" if extra else str(ROOT)
    command = [str(PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--constraint", str(ROOT / "constraints.txt"), "--editable", target]
    if subprocess.run(command, cwd=ROOT).returncode != 0:
        sys.exit("the installation failed (see above); run the same command again to retry")
    _stamp(extra).write_text(_fingerprint())


def _installed(extra: str) -> bool:
    # Without an extra any complete set-up will do: every extra installs lwrprobe itself too.
    stamps = [_stamp(extra)] if extra else list(VENV.glob(_stamp("*").name))
    wanted = _fingerprint()
    return PYTHON.exists() and any(s.is_file() and s.read_text() == wanted for s in stamps)


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
