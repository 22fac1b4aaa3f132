"""The first start: time of an exploration with an empty kernel cache, and of the same one after it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from typing import Any

from lwrprobe.bench.options import Options
from lwrprobe.bench.report import BenchReport
from lwrprobe.errors import LwrprobeError
from lwrprobe.evaluation.machine import machine, versions

PARTS = {"llvm": "LLVM", "nopython_type_inference": "type inference", "native_lowering": "lowering"}
"""What numba calls a pass, and what the table calls it; all other passes count as one."""

_CHILD = """
import json, sys
from lwrprobe.bench.start import measure
print(json.dumps(measure(sys.argv[1], sys.argv[2])))
"""


def run(quick: bool, options: dict[str, str]) -> BenchReport:
    """`lwrprobe bench start`; option `scene` (block). A cold start has no shorter form: `quick` changes nothing."""
    scene = Options("start", options, "scene").text("scene", "block")
    with tempfile.TemporaryDirectory() as folder:
        starts = {name: _start(scene, folder) for name in ("cold", "warm")}
    report = BenchReport("start", "The first start: compilation of kernels")
    report.machine = {**machine(), **versions("numba", "llvmlite")}
    columns = ["start", "wall s", "processor s", "of it second process", "kernels", *PARTS.values(), "other passes"]
    rows: list[list[Any]] = []
    for name, s in starts.items():
        parts = [s["parts"].get(part, 0.0) for part in (*PARTS.values(), "other passes")]
        rows.append([name, s["wall"], s["total"], s["beside"], s["kernels"], *parts])
    report.table(f"Time of exploring {scene}", columns, rows)
    left = starts["warm"]["kernels"]
    report.require("A second start compiles no kernel", f"{left} kernels", left == 0)
    report.data = {"starts": starts}
    report.notes = [
        "wall s: longer by whatever else the machine is doing; processor s is the figure to compare",
        "processor s: of both processes, exploration and reconstruction included",
        "the difference of the two rows is what compilation costs",
        "second process: compiles late kernels where there are two cores or more; Windows does not report its time",
        "kernels and the columns after them: of the first process alone",
    ]
    return report


def _start(scene: str, cache: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", _CHILD, scene, folder],
            env={**os.environ, "NUMBA_CACHE_DIR": cache},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        raise LwrprobeError(
            f"scene {scene}: the exploration to be measured failed: {lines[-1] if lines else 'no output'}"
        )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measure(scene: str, folder: str) -> dict[str, Any]:
    """Explore `scene` in this process: wall seconds, processor seconds in all, in other processes and by part of the
    compilation, kernels compiled."""
    from numba.core import event

    from lwrprobe.compiled.pipeline import on_compilation

    begin = time.perf_counter()
    seconds: defaultdict[str, float] = defaultdict(float)
    stack = ["outside"]
    last = time.process_time()

    class Clock(event.Listener):
        """Time goes to the innermost pass; a call of another kernel compiles that one within type inference."""

        def _switch(self) -> None:
            nonlocal last
            now = time.process_time()
            seconds[stack[-1]] += now - last
            last = now

        def on_start(self, event: Any) -> None:
            self._switch()
            name = "llvm" if event.kind == "numba:llvm_lock" else event.data["name"].split(" [")[0]
            stack.append(PARTS.get(name, "other passes"))

        def on_end(self, event: Any) -> None:
            self._switch()
            stack.pop()

    clock = Clock()
    kernels: list[str] = []
    for kind in ("numba:run_pass", "numba:llvm_lock"):
        event.register(kind, clock)
    with on_compilation(kernels.append):
        from lwrprobe.runs.explore import explore

        explore(scene, seed=7, out=folder, progress=False)
    wall, times = time.perf_counter() - begin, os.times()
    beside = times.children_user + times.children_system
    total = times.user + times.system + beside
    return {"wall": wall, "total": total, "beside": beside, "kernels": len(kernels), "parts": dict(seconds)}
