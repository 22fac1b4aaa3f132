"""Fair timing on a noisy machine: candidates take turns in one process, medians are compared."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar

import numpy as np

Name = TypeVar("Name")


def interleave(candidates: Mapping[Name, Callable[[], object]], rounds: int) -> dict[Name, np.ndarray]:
    """Seconds of each call, (rounds,) a candidate; each round calls every candidate once, after one warm-up."""
    return {name: each[:, 0] for name, each in take_turns(candidates, [()], 1, rounds).items()}


def take_turns(
    candidates: Mapping[Name, Callable[..., object]],
    tasks: Sequence[tuple[Any, ...]],
    block: int,
    rounds: int,
    inspect: Callable[[Name, int, Any], None] | None = None,
) -> dict[Name, np.ndarray]:
    """Seconds (rounds, tasks) of each candidate's call with the arguments of each task.

    Candidates take turns, a `block` of tasks each. The first task of a block is done once more before it, not timed:
    it pays for what the others left in the caches. `inspect` gets
    candidate, number and answer of each task of the first round, outside the clock.
    """
    seconds = {name: np.empty((rounds, len(tasks))) for name in candidates}
    for call in candidates.values():
        call(*tasks[0])
    with _no_collection():
        for turn in range(rounds):
            for start in range(0, len(tasks), block):
                for name, call in candidates.items():
                    if block > 1:
                        call(*tasks[start])
                    for k in range(start, min(start + block, len(tasks))):
                        given = tasks[k]
                        begin = time.perf_counter()
                        answer = call(*given)
                        seconds[name][turn, k] = time.perf_counter() - begin
                        if inspect is not None and turn == 0:
                            inspect(name, k, answer)
    return seconds


@contextmanager
def _no_collection() -> Iterator[None]:
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def first_use(what: str) -> list[list[Any]]:
    """Cache, wall and CPU seconds of a fresh process that uses all kernels of `what` (see `bench.first_use`)."""
    rows: list[list[Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        for cache in ("empty cache", "filled cache"):
            command = [sys.executable, "-m", "lwrprobe.bench.first_use", what]
            answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            rows.append([cache, *map(float, answer.stdout.split())])
    return rows


def installed(modules: Mapping[str, str]) -> tuple[dict[str, Any], list[str]]:
    """Modules by distribution of those that can be imported, of {distribution: module}; a sentence for each other."""
    found, missing = {}, []
    for name, module in modules.items():
        try:
            found[name] = import_module(module)
        except (ImportError, OSError):
            missing.append(f"{name} is not installed: left out")
    return found, missing


def load_before() -> dict[str, str]:
    """How busy the machine was with other work: processes that ran or waited in the minute before."""
    return {"load before": f"{os.getloadavg()[0]:.1f}"}
