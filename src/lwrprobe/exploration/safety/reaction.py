"""How much later than stated the loop reacts to a force: what the speed towards a surface follows."""

from __future__ import annotations

from math import exp

LASTING = 10.0
"""s in which what was measured loses two thirds of its weight: load on a host comes and goes."""
LASTING_SILENCE = 120.0
"""The same of a silent sensor: a radio link that has lost several samples in a row will do so again."""
MAX_LATE = 3
"""Cycles in a row without an answer that count: after those an arm brakes by itself."""


class ReactionExcess:
    """Time by which the measured reaction to a force exceeds the stated one, at its worst of late.

    It is a sum: the cycles in a row in which the arm got no answer in time and went on all the same; and the age of
    the samples when they arrive, or the silence after which the tip stands still where that is longer.

    Parameters
    ----------
    cycle : s, of the arm
    latency : s, of the sensor, as stated
    period : s, between two samples
    """

    def __init__(self, cycle: float, latency: float, period: float) -> None:
        self._cycle = cycle
        # A sample that is older than this comes after the tip has given way.
        self._most_age = 2.5 * period + cycle
        # Samples are taken in once a cycle, and their order of arrival varies by a fraction of a period.
        self._usual_age = latency + max(0.5 * period, 3.0 * cycle)
        self._late = 0
        self._answer = self._age = self._silence = 0.0
        self._time: float | None = None
        self.largest = 0.0
        """s, the largest so far."""

    @property
    def seconds(self) -> float:
        """s, 0 where all is as stated."""
        return self._answer + max(self._age, self._silence)

    def note_state(self, time: float, late: bool) -> None:
        """A state of the arm came; `late` where the arm has gone on without an answer since the one before."""
        if self._time is not None and (self._answer or self._age or self._silence):
            passed = max(0.0, time - self._time)
            keep, keep_silence = exp(-passed / LASTING), exp(-passed / LASTING_SILENCE)
            self._answer, self._age, self._silence = self._answer * keep, self._age * keep, self._silence * keep_silence
        self._time = time
        self._late = min(self._late + 1, MAX_LATE) if late else 0
        if self._late:
            self._answer = max(self._answer, self._late * self._cycle)
            self.largest = max(self.largest, self.seconds)

    def note_age(self, age: float) -> None:
        """The newest sample was so old [s] when it came."""
        if age > self._usual_age:
            self._age = max(self._age, min(age - self._usual_age, self._most_age))
            self.largest = max(self.largest, self.seconds)

    def note_silence(self, seconds: float) -> None:
        """Samples were missing, and the tip stood still so much later [s] than with all of them."""
        self._silence = max(self._silence, seconds)
        self.largest = max(self.largest, self.seconds)
