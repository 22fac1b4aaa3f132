"""Whole processes: killed in the middle, and run twice."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from lwrprobe.bench.stability.case import Case, Finding, within

COMMAND = "import sys; sys.argv[0] = 'lwrprobe'; from lwrprobe.cli.app import main; main()"
PATIENCE = 300.0
_ENOUGH = 1500
"""Contacts after which the run is killed: a third of them."""
SHORT = (
    "area.lower=[-0.006, -0.045, 0.006]", "area.upper=[0.006, 0.045, 0.058]", "strategy.step=0.012",
    "strategy.across=false", "strategy.find_ends=false", "truth.profile=ideal",
)  # fmt: skip


def _explore(folder: Path, *arguments: str) -> subprocess.Popen:
    settings = [word for setting in SHORT for word in ("--set", setting)]
    call = ["explore", "cylinder_vertical", "--quiet", "--out", "run", *settings, *arguments]
    return subprocess.Popen([sys.executable, "-c", COMMAND, *call], cwd=folder, stdout=subprocess.DEVNULL)


def _killed(quick: bool) -> list[Finding]:
    """SIGKILL in mid-run, then read what is on disk, then take the run up; beside it a run that nobody cut off."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = _explore(folder)
        contacts = folder / "run" / "contacts.csv"
        give_up = time.monotonic() + PATIENCE
        while time.monotonic() < give_up and process.poll() is None:
            if contacts.is_file() and contacts.read_text(encoding="utf-8").count("\n") > _ENOUGH:
                break
            time.sleep(0.05)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        lines = contacts.read_text(encoding="utf-8").splitlines()[1:] if contacts.is_file() else []
        whole = [line for line in lines if line.count(",") == 8]
        readable = len(whole) >= _ENOUGH and len(lines) - len(whole) <= 1
        text = f"{len(whole)} whole rows of {len(lines)} in contacts.csv"
        found = [Finding("SIGKILL in mid-run", text, readable)]
        call = [sys.executable, "-c", COMMAND, "resume", "run", "--quiet"]
        code = subprocess.run(call, cwd=folder, stdout=subprocess.DEVNULL, check=False).returncode
        if code != 0:
            return [*found, Finding("lwrprobe resume", f"exit code {code}", held=False)]
        kept = contacts.read_text(encoding="utf-8").splitlines()[1:][: len(whole)] == whole
        resumed = json.loads((folder / "run" / "summary.json").read_text(encoding="utf-8"))
        _explore(folder, "--out", "unbroken").wait(PATIENCE)
        unbroken = json.loads((folder / "unbroken" / "summary.json").read_text(encoding="utf-8"))
    text = (
        f"resumed at {resumed['resumed']['from_s']:.0f} s, {resumed['status']} after "
        f"{resumed['sim_time_s']:.1f} s of robot time (never cut off: {unbroken['sim_time_s']:.1f} s), coverage "
        f"{100 * resumed['coverage']:.1f} % ({100 * unbroken['coverage']:.1f} %), what was on disk "
        f"{'is still there' if kept else 'has changed'}; more time"
    )
    also = kept and resumed["coverage"] > unbroken["coverage"] - 0.01
    more = resumed["sim_time_s"] - unbroken["sim_time_s"]
    return [*found, within("lwrprobe resume", text, more, 10.0, "s", also=also)]


def _determinism(quick: bool) -> list[Finding]:
    """Two processes with one seed, a third with another."""
    texts = []
    for seed in ("5", "5", "6"):
        with tempfile.TemporaryDirectory() as name:
            process = _explore(Path(name), "--seed", seed, "--set", "run.time_limit=15.0")
            code = process.wait(PATIENCE)
            texts.append((Path(name) / "run" / "contacts.csv").read_bytes())
            if code != 1:  # the time was up
                return [Finding(f"seed {seed}", f"exit code {code}", held=False)]
    same, other = texts[0] == texts[1], texts[0] != texts[2]
    rows = texts[0].count(b"\n") - 1
    text = f"contacts.csv of {rows} rows is {'equal' if same else 'not equal'} to the byte"
    text += "; another seed gives others" if other else "; another seed gives the same"
    return [Finding("two processes, one seed", text, same and other and rows > 100)]


CASES = (
    Case(39, "kill -9 in mid-run", "readable to the last sample; the run continues where it was", _killed),
    Case(40, "determinism", "same seed, same bytes", _determinism),
)
