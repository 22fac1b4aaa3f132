#!/usr/bin/env python3
"""Run the same explorations in two checkouts, and compare what they touched byte by byte.

    python3 scripts/compare_checkouts.py OTHER [--scene NAME ...] [--strategy NAME ...] [--seed N] [--out FOLDER]

OTHER is another checkout with a `.venv` of its own. The two runs of a pair are made one after the other, and the order
changes from pair to pair, so that a busy machine slows both checkouts down alike. For each scene and strategy the table
says whether the rows of `contacts.csv` are the same, and gives the median time a sample of the strategy in both, in us.
The exit status is 1 when anything differs or a run fails.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parents[1]
SCENES = (
    "block", "cylinder_vertical", "cylinder_horizontal", "bridge", "combination", "polystyrene_1", "polystyrene_2",
    "jaw_chuck", "stacked_blocks",
)  # fmt: skip
STRATEGIES = ("grid_version", "surface_contour", "orientation_change")


@dataclass(slots=True)
class Run:
    """What one run left: the rows of contacts.csv, None where it failed, and the strategy's time a sample, us."""

    contacts: bytes | None
    strategy_us: float


def explore(checkout: Path, scene: str, strategy: str, seed: int, out: Path) -> Run:
    """One run in a checkout; its folder stays in `out`."""
    command = [str(checkout / ".venv" / "bin" / "lwrprobe"), "explore", scene, "--strategy", strategy]
    command += ["--seed", str(seed), "--out", str(out), "--quiet"]
    sources = os.pathsep.join(str(checkout / folder) for folder in ("src", "drivers", "strategies"))
    environment = os.environ | {"PYTHONPATH": sources}  # its own sources, wherever its installation points
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, env=environment)
    contacts, summary = out / "contacts.csv", out / "summary.json"
    if done.returncode not in (0, 1) or not contacts.is_file() or not summary.is_file():
        print(f"{checkout}: {scene}, {strategy}: {done.stderr.strip()[-300:]}", file=sys.stderr)
        return Run(None, float("nan"))
    stages = {stage["name"]: stage["us_median"] for stage in json.loads(summary.read_text())["stages"]}
    rows = contacts.read_bytes().partition(b"\n")[2]  # a column may have been renamed
    return Run(rows, float(stages["strategy"]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--scene", nargs="+", default=SCENES)
    parser.add_argument("--strategy", nargs="+", default=STRATEGIES)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, help="where the run folders stay; a temporary folder when left out")
    options = parser.parse_args()
    other = options.other.resolve()
    for checkout in (HERE, other):
        if not (checkout / ".venv" / "bin" / "lwrprobe").exists():
            parser.error(f"{checkout} has no .venv/bin/lwrprobe")
    with tempfile.TemporaryDirectory() as temporary:
        return compare(other, options, options.out or Path(temporary))


def compare(other: Path, options: argparse.Namespace, out: Path) -> int:
    """Print the table; the exit status."""
    different, ratios = 0, []
    print(f"{'scene':22}{'strategy':22}{'contacts.csv':14}{'strategy us':>12}{'other us':>10}", flush=True)
    for k, (scene, strategy) in enumerate(product(options.scene, options.strategy)):
        pair: dict[Path, Run] = {}
        for checkout in (HERE, other) if k % 2 == 0 else (other, HERE):
            folder = out / f"{scene}.{strategy}.{'this' if checkout == HERE else 'other'}"
            pair[checkout] = explore(checkout, scene, strategy, options.seed, folder)
        mine, theirs = pair[HERE], pair[other]
        same = mine.contacts is not None and mine.contacts == theirs.contacts
        different += not same
        if mine.contacts is not None and theirs.contacts is not None:
            ratios.append(mine.strategy_us / theirs.strategy_us)
        word = "same" if same else "DIFFERENT"
        print(f"{scene:22}{strategy:22}{word:14}{mine.strategy_us:12.1f}{theirs.strategy_us:10.1f}", flush=True)
    total = len(options.scene) * len(options.strategy)
    print(f"{total - different} of {total} the same", end="")
    print(f"; strategy time, this over other: median {median(ratios):.2f}" if ratios else "")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
