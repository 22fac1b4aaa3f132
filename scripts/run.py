#!/usr/bin/env python3
"""Set up the project's environment when missing, then run `lwrprobe ARGS...` in it.

python3 scripts/run.py explore block
"""

from __future__ import annotations

import sys

import environment


def main() -> None:
    seconds = environment.ensure()
    if seconds:
        print(f"[set-up] done in {seconds:.0f} s", file=sys.stderr, flush=True)
    environment.hand_over([str(environment.program("lwrprobe")), *sys.argv[1:]])


if __name__ == "__main__":
    main()
