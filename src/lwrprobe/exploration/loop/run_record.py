"""What a run adds up sample by sample: path, forces, the strategy's trace."""

from __future__ import annotations

from math import acos, dist, hypot
from operator import sub

import numpy as np

from lwrprobe.contact import Wrench
from lwrprobe.contracts import Observation
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene

TRACE_EVERY = 5
"""Samples between two rows of the path."""


class RunRecord:
    """Sums up path and forces, and hands the path and the strategy's trace to the recorder.

    Parameters
    ----------
    scene : force of a contact, stiffness of object and arm
    pipeline : the strategy whose trace is recorded; the sensor's range and the stick's compliance
    recorder : of the run folder

    Attributes
    ----------
    touches : samples with a contact, accepted or not
    path, contact_path : m, of the sphere's centre, and the part of it in contact
    peak_force, force : N, the largest measured, and the last
    peak_bound : N, above which no force on the sphere was while it was touched, as far as the stiffness is as stated
    range_used : largest share of the sensor's range so far
    """

    def __init__(self, scene: Scene, pipeline: Pipeline, recorder: Recorder) -> None:
        self._recorder, self._pipeline = recorder, pipeline
        probe, self._threshold = pipeline.probe, scene.contact.threshold
        self._range = (*probe.force_range.tolist(), *probe.torque_range.tolist())
        self._compliance, self._soft = probe.compliance.tolist(), 1.0 / scene.contact.stiffness
        self.path = self.contact_path = self.peak_force = self.force = self.range_used = self.peak_bound = 0.0
        self._last: list[float] | None = None
        self._normal: np.ndarray | None = None
        self.touches = 0
        self._samples = self._transitions = 0

    def note_range(self, wrench: Wrench) -> None:
        """The share of the sensor's range that a wrench takes up."""
        for value, limit in zip(wrench.force.tolist() + wrench.torque.tolist(), self._range):
            if abs(value) > self.range_used * limit:
                self.range_used = abs(value) / limit

    def note_unseen(self, force: float) -> None:
        """The size of a force [N] that the strategy is not shown."""
        self.peak_force = max(self.peak_force, force)
        self.peak_bound = max(self.peak_bound, force)

    def interrupt(self) -> None:
        """What comes next does not continue the path."""
        self._last = None
        self._recorder.swept.interrupt()

    def _bound(self, seen: Observation, tip: list[float], force: float) -> None:
        """What no sample shows: a force rises no faster on the path than the stiffness in its direction allows.

        From F1 over a path s to F2 it can have been (F1 + F2 + K s) / 2 in between. The part of the path that leaves
        what is touched does not count.
        """
        if seen.contact is not None:
            self._normal = seen.contact.normal
        largest = max(self.force, force)
        if largest < self._threshold or self._normal is None or self._last is None:
            return
        # Number by number: vectors of three take numpy several times as long.
        (x, y, z), (u, v, w) = map(sub, tip, self._last), self._normal.tolist()
        leaving = x * u + y * v + z * w
        if leaving > 0.0:
            x, y, z = x - leaving * u, y - leaving * v, z - leaving * w
        length = hypot(x, y, z)
        if length > 1e-9:
            soft = self._soft * length * length
            for (a, b, c), compliance in zip(seen.pose[:3, :3].T.tolist(), self._compliance):
                soft += compliance * (a * x + b * y + c * z) ** 2
            largest = max(largest, 0.5 * (self.force + force + length**3 / soft))
        self.peak_bound = max(self.peak_bound, largest)

    def note(self, seen: Observation, tip: np.ndarray, force: float) -> None:
        """One sample: the sphere's centre (3,) m at its instant, and the size of its force [N]."""
        place = tip.tolist()
        self.touches += seen.contact is not None
        if self._last is not None:
            length = dist(place, self._last)
            self.path += length
            self._bound(seen, place, force)
            if seen.contact is not None:
                self.contact_path += length
        self._recorder.swept.note(seen)
        self._last = place
        self.peak_force = max(self.peak_force, force)
        self.force = force
        self._samples += 1
        for step in self._pipeline.transitions(self._transitions):
            self._recorder.transition(*step)
            self._transitions += 1
        if self._samples % TRACE_EVERY == 0:
            near = seen.clearance
            distance = near.distance if near is not None else np.inf
            state = self._pipeline.progress().state
            lean = acos(min(max(-seen.pose.item(2, 2), -1.0), 1.0))
            self._recorder.trace_row(seen.time, tip, force, seen.contact is not None, distance, state, lean)
