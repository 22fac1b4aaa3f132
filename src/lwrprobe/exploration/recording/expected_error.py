"""How wrong the surface may still be, by what a recorder has recorded so far."""

from __future__ import annotations

from lwrprobe.contracts import Area, Confidence
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.mapping.estimate import REACH, SurfaceEstimate


class ExpectedError:
    """Feeds an estimate of the surface with what a recorder has recorded since the last time.

    Parameters
    ----------
    recorder : path and contacts of the run
    area : of the sphere's centre
    """

    def __init__(self, recorder: Recorder, area: Area) -> None:
        self._recorder, self._estimate = recorder, SurfaceEstimate(area, REACH)
        self._passed = self._touched = 0

    def now(self) -> tuple[float, float]:
        """m, mean and 95th percentile over the estimated surface; infinite before the first contact."""
        free = self._recorder.free_places(self._passed)
        for place in free:
            self._estimate.passed(place)
        self._passed = self._recorder.places
        contacts = self._recorder.contacts
        for contact in contacts[self._touched :]:
            if contact.confidence is Confidence.RELIABLE:
                self._estimate.touch(contact.centre, contact.normal)
        self._touched = len(contacts)
        self._estimate.update(stroke_ended=len(free) > 0)
        return self._estimate.faces().error()
