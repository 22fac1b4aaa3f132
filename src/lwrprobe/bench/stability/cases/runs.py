"""Whole processes: killed in the middle, and run twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from lwrprobe.bench.stability.case import Case, Finding

COMMAND = "import sys; sys.argv[0] = 'lwrprobe'; from lwrprobe.cli.app import main; main()"
PATIENCE = 300.0
SHORT = (
    "area.lower=[-0.006, -0.045, 0.006]", "area.upper=[0.006, 0.045, 0.058]", "strategy.step=0.012",
    "strategy.across=false", "strategy.find_ends=false",
)  # fmt: skip


def _explore(folder: Path, *arguments: str) -> subprocess.Popen:
    settings = [word for setting in SHORT for word in ("--set", setting)]
    call = ["explore", "cylinder_vertical", "--quiet", "--out", "run", *settings, *arguments]
    return subprocess.Popen([sys.executable, "-c", COMMAND, *call], cwd=folder, stdout=subprocess.DEVNULL)


def _killed(quick: bool) -> list[Finding]:
    """SIGKILL as soon as twenty contacts are on disk, then read them; then look for a way to go on."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = _explore(folder, "--realtime")
        contacts = folder / "run" / "contacts.csv"
        give_up = time.monotonic() + PATIENCE
        while time.monotonic() < give_up and process.poll() is None:
            if contacts.is_file() and contacts.read_text().count("\n") > 20:
                break
            time.sleep(0.1)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        lines = contacts.read_text().splitlines()[1:] if contacts.is_file() else []
    whole = [line for line in lines if line.count(",") == 8]
    readable = len(whole) >= 20 and len(lines) - len(whole) <= 1
    told = f"{len(whole)} whole rows of {len(lines)} in contacts.csv"
    resumes = _offers("--resume")
    words = "explore --resume goes on from there" if resumes else "explore has no way to go on from a run folder"
    return [Finding("SIGKILL while touching", told, readable), Finding("going on afterwards", words, resumes)]


def _offers(option: str) -> bool:
    call = [sys.executable, "-c", COMMAND, "explore", "--help"]
    return option in subprocess.run(call, capture_output=True, text=True, check=True).stdout


def _determinism(quick: bool) -> list[Finding]:
    """Two processes with one seed, a third with another."""
    texts = []
    for seed in ("5", "5", "6"):
        with tempfile.TemporaryDirectory() as name:
            process = _explore(Path(name), "--seed", seed)
            code = process.wait(PATIENCE)
            texts.append((Path(name) / "run" / "contacts.csv").read_bytes())
            if code != 0:
                return [Finding(f"seed {seed}", f"exit code {code}", held=False)]
    same, other = texts[0] == texts[1], texts[0] != texts[2]
    rows = texts[0].count(b"\n") - 1
    told = f"contacts.csv of {rows} rows is {'equal' if same else 'not equal'} to the byte"
    told += "; another seed gives others" if other else "; another seed gives the same"
    return [Finding("two processes, one seed", told, same and other and rows > 100)]


CASES = (
    Case(39, "kill -9 in mid-run", "readable to the last sample; the run can go on", _killed),
    Case(40, "determinism", "same seed, same bytes", _determinism),
)
