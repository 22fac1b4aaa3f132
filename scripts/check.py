#!/usr/bin/env python3
"""Set up the project's environment with the test extra when missing, then check style, types and documentation.

python3 scripts/check.py                all of it
python3 scripts/check.py lint types     only these
"""

from __future__ import annotations

import subprocess
import sys

import environment

STEPS = {
    "lint": (["-m", "ruff", "check", "."], ["-m", "ruff", "format", "--check", "."]),
    "types": (["-m", "mypy"],),
    "docs": (["scripts/docs.py"],),
}
"""What Python is called with, step by step; a step fails when one of its calls does."""


def main() -> None:
    wanted = sys.argv[1:] or list(STEPS)
    for name in wanted:
        if name not in STEPS:
            sys.exit(f"check {name!r}: allowed: {', '.join(STEPS)}")
    seconds = environment.ensure("test")
    if seconds:
        print(f"[set-up] done in {seconds:.0f} s", file=sys.stderr, flush=True)
    failed = [name for name in wanted if not _passes(name)]
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


def _passes(name: str) -> bool:
    print(f"[check] {name}", flush=True)
    calls = [subprocess.run([environment.PYTHON, *call], cwd=environment.ROOT) for call in STEPS[name]]
    return all(call.returncode == 0 for call in calls)


if __name__ == "__main__":
    main()
