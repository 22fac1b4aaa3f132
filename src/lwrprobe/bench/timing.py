"""Fair timing on a noisy machine: candidates take turns in one process, medians are compared."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Mapping

import numpy as np


def interleave(candidates: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Seconds of each call, (rounds,) a candidate; each round calls every candidate once, after one warm-up."""
    for call in candidates.values():
        call()
    seconds = {name: np.empty(rounds) for name in candidates}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i in range(rounds):
            for name, call in candidates.items():
                begin = time.perf_counter()
                call()
                seconds[name][i] = time.perf_counter() - begin
    finally:
        if collecting:
            gc.enable()
    return seconds


def load_before() -> dict[str, str]:
    """How busy the machine was with other work: processes that ran or waited in the minute before."""
    return {"load before": f"{os.getloadavg()[0]:.1f}"}
