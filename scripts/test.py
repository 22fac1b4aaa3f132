#!/usr/bin/env python3
"""Set up the project's environment with the test extra when missing, then run pytest in it on all cores.

python3 scripts/test.py                 all tests
python3 scripts/test.py --quick         the fast ones, within a minute
python3 scripts/test.py tests/mapping   what pytest is given, relative to the current folder; `-n 0` uses one core
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import environment

# Tests of one file share its fixtures; tests/conftest.py says which group goes where and in which order.
SIDE_BY_SIDE = ["--dist", "loadgroup", "--no-loadscope-reorder"]
LWRPROBE = "from lwrprobe.cli.app import main; main()"


def main() -> None:
    seconds = environment.ensure("test")
    if seconds:
        print(f"[set-up] done in {seconds:.0f} s", file=sys.stderr, flush=True)
    arguments = [str(Path(a).resolve()) if Path(a).exists() else a for a in sys.argv[1:]]
    os.chdir(environment.ROOT)
    _compile_kernels()
    processes = ["-n", str(_processes(quick="--quick" in arguments))]
    environment.hand_over([str(environment.PYTHON), "-m", "pytest", *processes, *SIDE_BY_SIDE, *arguments])


def _processes(quick: bool) -> int:
    """One for each core, and one more for the tests that mostly wait, which the quick path leaves out."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores if quick else cores + 1


def _compile_kernels() -> None:
    """In a fresh clone once: several processes may compile into one cache, but each would compile the same kernels."""
    if any((environment.ROOT / "src").rglob("*.nbi")) or not (environment.ROOT / "src").is_dir():
        return
    print("[set-up] compiling the kernels", file=sys.stderr, flush=True)
    with TemporaryDirectory() as folder:
        short = ["explore", "block", "--out", folder, "--set", "run.time_limit=1.0", "--quiet"]
        subprocess.run([environment.PYTHON, "-c", LWRPROBE, *short], stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
