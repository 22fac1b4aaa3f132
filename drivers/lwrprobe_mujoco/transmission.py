"""From the true wrench to the samples that arrive: the sensor faults of the plug-in `sim` on MuJoCo's wrench."""

from __future__ import annotations

from collections import deque

import numpy as np

from lwrprobe.contracts import Probe, SampleStatus, WrenchSample
from lwrprobe_mujoco.config import MujocoConfig
from lwrprobe_sim import sensor_kernels as kernels
from lwrprobe_sim.sensor_settings import sensor_settings

RECENT = 16
"""Samples that the tare averages."""


class Transmission:
    """Takes samples of a wrench that is known at the ends of cycles, and delivers them later."""

    def __init__(self, config: MujocoConfig, probe: Probe, rate: float, seed: int) -> None:
        self._settings = sensor_settings(config, probe, rate)
        self._period = 1.0 / rate
        self._seed = seed
        self._taken = 0
        self._gap = False
        self._last = np.zeros(kernels.SAMPLE)
        self._recent: deque[np.ndarray] = deque(maxlen=RECENT)
        self._waiting: deque[np.ndarray] = deque()

    @property
    def next_number(self) -> int:
        """Number of the next sample to be taken."""
        return self._taken + 1

    @property
    def next_instant(self) -> float:
        """s, when it is taken."""
        return (self._taken + 1) * self._period

    @property
    def next_arrival(self) -> float:
        """s, before which no sample arrives."""
        if self._waiting:
            return float(self._waiting[0][kernels.ARRIVAL])
        return self.next_instant + float(kernels.delay(self._settings, self._seed, self.next_number))

    def take(self, wrench: np.ndarray) -> None:
        """Measure the true wrench (6,) N, N m in the sensor frame at `next_instant`; the array is overwritten."""
        self._taken += 1
        number, instant, s = self._taken, self._taken * self._period, self._settings
        if kernels.lost(s, self._seed, number):
            self._gap = True
            return
        fresh = np.zeros(kernels.SAMPLE)
        kernels.measure(s, self._seed, number, instant, wrench, fresh)
        self._recent.append(fresh[kernels.FORCE : kernels.FORCE + 6].copy())
        if s[kernels.FREEZE_FROM] <= instant < s[kernels.FREEZE_TO]:
            fresh = self._last.copy()
        elif self._gap:
            fresh[kernels.STATUS] = int(fresh[kernels.STATUS]) | SampleStatus.LOST_BEFORE
            self._gap = False
        wait = float(kernels.delay(s, self._seed, number))
        if wait > s[kernels.LATE_LIMIT]:
            fresh[kernels.STATUS] = int(fresh[kernels.STATUS]) | SampleStatus.LATE
        # the line keeps the order: one late sample delays those behind it
        fresh[kernels.ARRIVAL] = max(instant + wait, self._last[kernels.ARRIVAL])
        self._last = fresh
        self._waiting.append(fresh)

    def arrived(self, time: float) -> list[WrenchSample]:
        """All samples that have arrived by `time` [s] and were not fetched before, oldest first."""
        samples = []
        while self._waiting and self._waiting[0][kernels.ARRIVAL] <= time + 1e-12:
            row = self._waiting.popleft()
            force, torque = row[kernels.FORCE : kernels.TORQUE], row[kernels.TORQUE : kernels.SEQUENCE]
            sequence, status = int(row[kernels.SEQUENCE]), int(row[kernels.STATUS])
            samples.append(WrenchSample(float(row[kernels.TIME]), force.copy(), torque.copy(), sequence, status))
        return samples

    def tare(self) -> None:
        """Move the bias so that the mean of the last samples reads zero."""
        if self._recent:
            self._settings[kernels.BIAS : kernels.BIAS + 6] -= np.mean(self._recent, axis=0)
