"""One simulated world behind two emulated devices: the arm's set points move it, the sensor measures its forces."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from lwrprobe.contracts import DriverContext, DriverError
from lwrprobe.contracts.options import configure
from lwrprobe.contracts.plugins import load

SENSOR_RATE = 1000.0
"""Hz, of the simulated wrench; the emulated device samples that at its own rate."""

_LONGEST = 7200.0
"""s for which memory for the truth is reserved at the start; enlarging it would keep the controller waiting."""

_PATIENCE = 0.05
"""s after which a record is measured although the world has not come to its instant: the controller pauses."""

# What the line does to the samples is up to the emulated device.
_IDEAL_LINE = {"latency": 0.0, "late_share": 0.0, "loss": 0.0, "saturation": False}
_LINE_TRUTH = ("loss_burst_ms", "clock_skew_ms")
"""What the table `[truth]` says of the line."""


class SimulatedWorld:
    """The world of the simulator plug-in as the plant of an emulated controller and the load of a sensor.

    Parameters
    ----------
    scene : resolved; its table `[drivers.sim]` sets the world up
    seed : of its noise
    start : (7,) rad where the arm stands, None = where the simulator puts it
    """

    def __init__(self, scene: Any, seed: int, start: np.ndarray | None = None) -> None:
        plugin = load("driver", "sim")
        options = dict(scene.drivers.get("sim", {})) | _IDEAL_LINE
        if start is not None:
            options["start_q"] = start.tolist()
        truth = scene.truth
        if line := {name: 0.0 for name in _LINE_TRUTH if truth.departure(name) is not None}:
            truth = type(truth)(**truth.model_dump(exclude_none=True) | line)
        sensor = scene.sensor.model_copy(update={"rate": SENSOR_RATE})
        resampled = scene.model_copy(update={"sensor": sensor, "truth": truth})
        driver = plugin(DriverContext(configure(plugin.Config, options, "drivers.sim"), resampled, seed))
        self._arm, self._sensor, self.ground_truth = driver.arm(), driver.sensor(), driver.ground_truth()
        self.ground_truth.reserve(round(_LONGEST * SENSOR_RATE))
        self._arm.open()
        self._sensor.open()
        self._lately: list[tuple[int, np.ndarray]] = [(0, np.zeros(6))]
        self._before = self._now = 0.0
        self._records: dict[int, int] = {}
        self._joints = self._arm.read().q
        self.elapsed = 0.0
        """s that have passed in this world."""
        self.force = 0.0
        """N, true force on the sphere, the latest."""
        self.peak_since = 0.0
        """N, largest true force on the sphere since `mark`."""
        self.refused = ""
        """The last set point that the world could not follow, in words."""
        # The first steps compile; after the sockets are open there is no time for that.
        self.advance(self._joints, self._joints, 2.0 / SENSOR_RATE)

    def joints(self) -> np.ndarray:
        """(7,) rad, as the encoders read them."""
        return self._joints.copy()

    def advance(self, begin: np.ndarray, end: np.ndarray, seconds: float) -> None:
        """Let time pass at the simulator's own cycle while the set point moves evenly; it ends now."""
        lately = self._lately[-1:]
        steps = max(1, round(seconds / self._arm.cycle))
        for step in range(1, steps + 1):
            self._command(begin + (step / steps) * (end - begin))
            self._joints = self._arm.read().q
            for sample in self._sensor.read():
                lately.append((sample.sequence, np.concatenate([sample.force, sample.torque])))
                touch = self.ground_truth.contact_at(sample.sequence)
                self.force = 0.0 if touch is None else touch.force
                self.peak_since = max(self.peak_since, self.force)
        # Now, and not when the steps began: the measurement of these joints leaves now, and its arrival dates it.
        self._lately, self._before, self._now = lately, self._now, time.monotonic()
        self.elapsed += seconds

    def mark(self) -> None:
        """From now on a new peak is looked for."""
        self.peak_since = 0.0

    def truth(self) -> dict[str, Any]:
        """What only the simulated world knows, for checks of a run from outside."""
        return {
            "time_s": round(self.elapsed, 6),
            "joints": self._joints.tolist(),
            "force_n": self.force,
            "peak_force_n": self.ground_truth.peak_force,
            "probe_peak_force_n": self.ground_truth.probe_peak_force,
            "differences": self.ground_truth.differences,
            "peak_since_mark_n": self.peak_since,
            "link_collisions": self.ground_truth.link_collisions,
            "refused": self.refused,
        }

    def measured_at(self, instant: float) -> float:
        """When a record of that instant can be measured: once the world has come there, on `time.monotonic`."""
        return instant if instant <= self._now else instant + _PATIENCE

    def record(self, number: int, instant: float) -> np.ndarray:
        """(6,) N and N·m at an instant, for the sensor's record of that number, which is remembered for `contacts`."""
        # A cycle that began late has taken longer than the world was moved on by. Whoever reads the joints before and
        # after it takes them to have moved evenly in between.
        share = (instant - self._before) / max(self._now - self._before, 1e-9)
        sample, wrench = self._lately[round(min(max(share, 0.0), 1.0) * (len(self._lately) - 1))]
        self._records[number] = sample
        return wrench

    def contacts(self, first: int, count: int) -> list[list[float] | None]:
        """True contacts of the sensor's records from `first` on: point m, normal, force N; None where it was free."""
        found: list[list[float] | None] = []
        for number in range(first, first + count):
            touch = self.ground_truth.contact_at(self._records.get(number, 0))
            found.append(None if touch is None else [*touch.point.tolist(), *touch.normal.tolist(), touch.force])
        return found

    def wrench(self, now: float) -> np.ndarray:
        """(6,) N and N·m on the probe in the sensor frame, the latest."""
        return self._lately[-1][1]

    def _command(self, q: np.ndarray) -> None:
        try:
            self._arm.command(q)
        except DriverError as error:
            self.refused = str(error)
