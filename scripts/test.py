#!/usr/bin/env python3
"""Set up the project's environment with the test extra when missing, then run pytest in it.

python3 scripts/test.py                 all tests, fast ones first
python3 scripts/test.py tests/mapping   what pytest is given, relative to the current folder
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import environment


def main() -> None:
    seconds = environment.ensure("test")
    if seconds:
        print(f"[set-up] done in {seconds:.0f} s", file=sys.stderr, flush=True)
    arguments = [str(Path(a).resolve()) if Path(a).exists() else a for a in sys.argv[1:]]
    os.chdir(environment.ROOT)
    os.execv(environment.PYTHON, [str(environment.PYTHON), "-m", "pytest", *arguments])


if __name__ == "__main__":
    main()
