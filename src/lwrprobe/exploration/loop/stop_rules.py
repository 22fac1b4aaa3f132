"""When a run may end before its strategy has: the scene's `[run.until]`."""

from __future__ import annotations

from math import inf

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
        mean, p95 = self._error()
        if mean > wanted or p95 > P95 * wanted:
            return None
        return "accurate", f"expected error {mean:.2f} mm in the mean, 95 % within {p95:.2f} mm, as wanted"

    def _certified(self, time: float) -> tuple[str, str] | None:
        wanted = self._until.certified
        if wanted is None or time < self._due:
            return None
        self._due = time + CERTIFY_EVERY
        diameter = self._diameter()
        if diameter > wanted:
            return None
        return "certified", f"nothing larger than {diameter:.2f} mm can hide within reach, as wanted"

    def missed(self) -> list[str]:
        """Sentences on what was wanted of the surface and is not reached, where the strategy has nothing left to do."""
        until, found = self._until, []
        if until.accurate is not None:
            mean, p95 = self._error()
            if not (mean <= until.accurate and p95 <= P95 * until.accurate):
                now = (
                    f"it is {mean:.2f} mm in the mean, 95 % within {p95:.2f} mm" if mean < inf else "nothing is touched"
                )
                found.append(
                    f"run.until.accurate: an expected error of {until.accurate:g} mm was wanted; {now}, and the "
                    "strategy has nothing left to touch"
                )
        if until.certified is not None and (diameter := self._diameter()) > until.certified:
            found.append(
                f"run.until.certified: nothing larger than {until.certified:g} mm was to hide; {diameter:.2f} mm can, "
                "and the strategy has nothing left to touch"
            )
        return found

    def _error(self) -> tuple[float, float]:
        """mm, mean and 95th percentile of the expected error."""
        if self._expected is None:
            self._expected = ExpectedError(self._recorder, self._pipeline.area)
        mean, p95 = self._expected.now()
        return 1e3 * mean, 1e3 * p95

    def _diameter(self) -> float:
        """mm, of the largest ball that can still hide."""
        if self._certification is None:
            pipeline = self._pipeline
            self._certification = Certification(self._recorder, pipeline.area, pipeline.probe, pipeline.line_spacing)
        return 1e3 * self._certification.at().diameter
