"""When a run may end before its strategy has: the scene's `[run.until]`."""

from __future__ import annotations

from lwrprobe.exploration.recording.certification import Certification
from lwrprobe.exploration.recording.expected_error import ExpectedError
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.mapping.estimate import P95
from lwrprobe.scene.scene import UntilTable

CERTIFY_EVERY = 5.0
"""s of the robot's time between two looks at the certificate, which takes some tenths of a second."""
ESTIMATE_EVERY = 2.0
"""s of the robot's time between two looks at the expected error, which takes some hundredths of a second."""


class StopRules:
    """Says which rule has been reached first; without rules none ever is.

    Parameters
    ----------
    until : the rules
    recorder : path and contacts of the run
    pipeline : area, probe and, once the strategy has started, its line spacing
    """

    def __init__(self, until: UntilTable, recorder: Recorder, pipeline: Pipeline) -> None:
        self._until, self._recorder, self._pipeline = until, recorder, pipeline
        self._certification: Certification | None = None
        self._expected: ExpectedError | None = None
        self._due, self._estimate_due = CERTIFY_EVERY, ESTIMATE_EVERY

    def met(self, time: float) -> tuple[str, str]:
        """Key of the rule that is reached at a time [s] of the run, and a sentence; empty where none is."""
        until = self._until
        if until.time is not None and time >= until.time:
            return "time", f"{until.time:g} s of robot time, as wanted"
        return self._accurate(time) or self._certified(time) or ("", "")

    def _accurate(self, time: float) -> tuple[str, str] | None:
        wanted = self._until.accurate
        if wanted is None or time < self._estimate_due:
            return None
        self._estimate_due = time + ESTIMATE_EVERY
        if self._expected is None:
            self._expected = ExpectedError(self._recorder, self._pipeline.area)
        mean, p95 = (1e3 * error for error in self._expected.now())
        if mean > wanted or p95 > P95 * wanted:
            return None
        return "accurate", f"expected error {mean:.2f} mm in the mean, 95 % within {p95:.2f} mm, as wanted"

    def _certified(self, time: float) -> tuple[str, str] | None:
        wanted = self._until.certified
        if wanted is None or time < self._due:
            return None
        self._due = time + CERTIFY_EVERY
        if self._certification is None:
            pipeline = self._pipeline
            self._certification = Certification(self._recorder, pipeline.area, pipeline.probe, pipeline.line_spacing)
        diameter = 1e3 * self._certification.at().diameter
        if diameter > wanted:
            return None
        return "certified", f"nothing larger than {diameter:.2f} mm can hide within reach, as wanted"
