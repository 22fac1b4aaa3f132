"""The certificate of a run: while it goes on, and over its time once it has ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lwrprobe.contracts import Area, Probe
from lwrprobe.evaluation.run_folder import HIDING_FILE
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.swept_path import TOLERANCE, WIDER
from lwrprobe.mapping.certificate import Certificate, Hiding
from lwrprobe.mapping.clouds import Cloud, write_cloud

INSTANTS = 5
"""At which the certificate is computed for the error against time, evenly over the run."""
WORTH_SHOWING = 0.6
"""Share of the certified diameter from which a place is kept for the picture of where something could hide."""


class Certification:
    """Feeds a certificate with what a recorder has recorded since the last time.

    Parameters
    ----------
    recorder : path and contacts of the run
    area : of the sphere's centre
    probe : its sphere and links
    line_spacing : m between the lines of the strategy, None for one without lines
    """

    def __init__(self, recorder: Recorder, area: Area, probe: Probe, line_spacing: float | None) -> None:
        self._recorder = recorder
        opening = WIDER * max(2.0 * probe.radius, line_spacing or 0.0)
        self._certificate = Certificate(area, probe.radius, probe.links, opening=opening, tolerance=TOLERANCE)
        self._swept = self._touched = 0

    @property
    def edge(self) -> float:
        """m, of the certificate's grid."""
        return self._certificate.edge

    def at(self, time: float = np.inf) -> Hiding:
        """What could hide at a time [s] of the run, no earlier than that of the call before."""
        contacts = self._recorder.contacts
        until = min(time, self._recorder.withheld_since)  # what was swept after the object has moved says nothing
        self._swept = self._recorder.swept.sweep_into(self._certificate, self._swept, until)
        last = self._touched
        while last < len(contacts) and contacts[last].time <= time:
            last += 1
        points = np.array([contact.point for contact in contacts[self._touched : last]]).reshape(-1, 3)
        self._certificate.touch(points)
        self._touched = last
        return self._certificate.hiding()


@dataclass(slots=True, frozen=True, eq=False)
class CertifiedRun:
    """The certificate over a run.

    Attributes
    ----------
    times : (k,) s, the last is the end of the run
    diameters : (k,) m
    last : what can hide at the end
    edge : m, of the certificate's grid
    """

    times: np.ndarray
    diameters: np.ndarray
    last: Hiding
    edge: float

    def write(self, folder: Path) -> None:
        """Write the places where something about as large as certified could hide, `hiding.ply`."""
        shown = self.last.sizes >= WORTH_SHOWING * self.last.diameter
        write_cloud(folder / HIDING_FILE, Cloud(self.last.points[shown], None, {"size": self.last.sizes[shown]}))


def certify(
    recorder: Recorder, area: Area, probe: Probe, line_spacing: float | None, end: float
) -> CertifiedRun | None:
    """The certificate over a run of `end` s, parameters as of `Certification`; None where the probe did not move."""
    if not len(recorder.swept) or not end > 0.0:
        return None
    certification = Certification(recorder, area, probe, line_spacing)
    times = np.linspace(0.0, end, INSTANTS + 1)[1:]
    found = [certification.at(time) for time in times[:-1]] + [certification.at()]
    return CertifiedRun(times, np.array([hiding.diameter for hiding in found]), found[-1], certification.edge)
