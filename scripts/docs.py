#!/usr/bin/env python3
"""Set up the project's environment with the docs extra when missing, then build the documentation site in it.

python3 scripts/docs.py          writes docs/_build/index.html; a warning is an error
"""

from __future__ import annotations

import subprocess
import sys

import environment


def main() -> None:
    seconds = environment.ensure("docs")
    if seconds:
        print(f"[set-up] done in {seconds:.0f} s", file=sys.stderr, flush=True)
    command = [str(environment.PYTHON), "-m", "sphinx", "-b", "html", "--fail-on-warning", "--keep-going", "-q"]
    command += [*sys.argv[1:], "docs", "docs/_build"]
    status = subprocess.run(command, cwd=environment.ROOT).returncode
    if status == 0:
        print("the site is in docs/_build/index.html")
    sys.exit(status)


if __name__ == "__main__":
    main()
