"""How long each stage of the pipeline takes: one lap a call, summed up at the end."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from time import perf_counter_ns
from typing import Any

import numpy as np


class StageClock:
    """A stopwatch with one list of laps a stage; a lap costs some 0.1 us."""

    def __init__(self, stages: Iterable[str]) -> None:
        self._stages = tuple(stages)
        self.reset()

    def reset(self) -> None:
        """Forget all laps."""
        self._laps = {name: array("q") for name in self._stages}
        self._rounds, self._cycles = array("q"), array("q")
        self._last = self._begun = perf_counter_ns()

    def start(self, cycles: int = 1) -> None:
        """Begin a round, the last one of so many cycles: what came since the last lap belongs to no stage."""
        self._rounds.append(self._last - self._begun)
        self._cycles.append(cycles)
        self._last = self._begun = perf_counter_ns()

    def lap(self, stage: str) -> None:
        """What has passed since the last lap belongs to `stage`."""
        now = perf_counter_ns()
        self._laps[stage].append(now - self._last)
        self._last = now

    def cycle_median(self) -> float:
        """us, of all stages of one cycle together; those of one round share its time."""
        if not self._rounds:
            return 0.0
        rounds, cycles = np.frombuffer(self._rounds, dtype=np.int64), np.frombuffer(self._cycles, dtype=np.int64)
        return round(float(np.median(np.repeat(rounds / cycles, cycles))) / 1000.0, 3)

    def table(self) -> list[dict[str, Any]]:
        """`{name, calls, us_median, us_p99, us_max, share}` a stage that ran; the shares sum to one."""
        total = sum(sum(laps) for laps in self._laps.values()) or 1
        rows = []
        for name, laps in self._laps.items():
            if not laps:
                continue
            micro = np.frombuffer(laps, dtype=np.int64) / 1000.0
            rows.append(
                {
                    "name": name,
                    "calls": len(laps),
                    "us_median": round(float(np.median(micro)), 3),
                    "us_p99": round(float(np.percentile(micro, 99)), 3),
                    "us_max": round(float(micro.max()), 3),
                    "share": round(float(micro.sum() * 1000.0 / total), 4),
                }
            )
        return rows
