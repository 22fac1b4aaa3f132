"""What a run adds up sample by sample: path, forces, the strategy's trace."""

from __future__ import annotations

from math import dist

import numpy as np

from lwrprobe.contact import Wrench
from lwrprobe.contracts import Observation, Probe, Strategy
from lwrprobe.exploration.recording.recorder import Recorder

TRACE_EVERY = 5
"""Samples between two rows of the path."""


class RunRecord:
    """Sums up path and forces, and hands the path and the strategy's trace to the recorder.

    Parameters
    ----------
    recorder : of the run folder
    strategy : whose trace is recorded
    probe : the sensor's range

    Attributes
    ----------
    touches : samples with a contact, accepted or not
    path, contact_path : m, of the sphere's centre, and the part of it in contact
    peak_force, force : N, the largest measured, and the last
    range_used : largest share of the sensor's range so far
    """

    def __init__(self, recorder: Recorder, strategy: Strategy, probe: Probe) -> None:
        self._recorder, self._strategy = recorder, strategy
        self._range = (*probe.force_range.tolist(), *probe.torque_range.tolist())
        self.path = self.contact_path = self.peak_force = self.force = self.range_used = 0.0
        self._last: list[float] | None = None
        self.touches = 0
        self._samples = self._transitions = 0

    def note_range(self, wrench: Wrench) -> None:
        """The share of the sensor's range that a wrench takes up."""
        for value, limit in zip(wrench.force.tolist() + wrench.torque.tolist(), self._range):
            self.range_used = max(self.range_used, abs(value) / limit)

    def note(self, seen: Observation, tip: np.ndarray, force: float) -> None:
        """One sample: the sphere's centre (3,) m at its instant, and the size of its force [N]."""
        place = tip.tolist()
        self.touches += seen.contact is not None
        if self._last is not None:
            length = dist(place, self._last)
            self.path += length
            if seen.contact is not None:
                self.contact_path += length
        self._last = place
        self.peak_force = max(self.peak_force, force)
        self.force = force
        self._samples += 1
        trace = self._strategy.trace
        if len(trace) > self._transitions:
            for step in trace[self._transitions :]:
                self._recorder.transition(*step)
            self._transitions = len(trace)
        if self._samples % TRACE_EVERY == 0:
            near = seen.clearance
            distance = near.distance if near is not None else np.inf
            state = self._strategy.progress().state
            self._recorder.trace_row(seen.time, tip, force, seen.contact is not None, distance, state)
