"""The strategy waits while the arm recovers: samples are watched and recorded, and not shown to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lwrprobe.contact import BiasOutcome, Wrench
from lwrprobe.contracts import WrenchSample
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.loop.sample_step import SampleStep


class PausedStrategy:
    """What a run does with samples from an interruption until the strategy goes on.

    Parameters
    ----------
    parts : of the loop
    sample : the step that the strategy's samples take
    """

    def __init__(self, parts: LoopParts, sample: SampleStep) -> None:
        self._pipeline, self._bag, self._record = parts.pipeline, parts.recorder.bag, parts.record
        self._sample, self._threshold = sample, float(parts.scene.contact.threshold)

    def interrupt(self, why: str) -> None:
        """The strategy has to wait."""
        if self._bag is not None:
            self._bag.interrupted(why)

    def watch(self, sample: WrenchSample) -> Wrench:
        """Condition a sample; its force counts for the peak.

        Raises SensorLost where the sensor cannot be relied on.
        """
        pose = self._sample.located(sample, shown=False)[0]
        if self._bag is not None:
            self._bag.flush_when_due()
        wrench = self._sample.conditioned(sample, pose[:3, :3])
        if wrench.usable:
            self._record.note_unseen(wrench.magnitude)
        return wrench

    def check_zero(self, samples: Sequence[WrenchSample], since: float, rotation: np.ndarray) -> BiasOutcome:
        """Take the sensor's zero from those of the samples at rest that are later than `since` s.

        Where it agrees with the zero before; `rotation` (3, 3) is the sensor's in the world.
        """
        if self._bag is not None:
            self._bag.zero_checked(len(samples), since, rotation)
        conditioner = self._pipeline.conditioner
        later = [sample for sample in samples if sample.time > since]
        return conditioner.take_bias(later, rotation, 0.5 * self._threshold, conditioner.bias)

    def resume(self, pause: float) -> None:
        """The strategy goes on after a pause [s] that it is not shown."""
        if self._bag is not None:
            self._bag.went_on(pause)
        self._sample.resume(pause)
        self._record.interrupt()
        if self._pipeline.sweep is not None:
            self._pipeline.sweep.leave()
