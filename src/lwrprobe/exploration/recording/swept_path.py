"""Where the probe has been, for the certificate of what can still hide."""

from __future__ import annotations

from math import isfinite
from operator import sub

import numpy as np

from lwrprobe.contracts import Confidence, Observation
from lwrprobe.mapping.certificate import Certificate

APART = 0.0003
"""m between two places that are kept, at least, unless the probe turns."""
TURNED = 0.01
"""Largest change of an entry of the rotation matrix without which the probe has not turned."""
LONGEST = 0.003
"""m between two samples, up to which the sphere is taken to have gone straight."""
TOLERANCE = 0.0002
"""m by which a place of the sphere, or a contact, may be wrong: the certificate takes the sphere that much smaller."""
WIDER = 1.8
"""An opening that is narrower than this many sphere diameters, or line spacings, counts as closed."""


class SweptPath:
    """The probe's poses at the samples, but for those at which nobody knows where exactly the sphere was."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._joined: list[bool] = []
        self._poses: list[np.ndarray] = []
        self._last: list[float] = []
        self._turn: list[float] = []  # entries of the rotation that was kept last
        self._broken = True

    def note(self, seen: Observation) -> None:
        """One sample; in contact the sphere is where the bent stick holds it."""
        pose, contact = seen.pose, seen.contact
        if contact is not None and contact.confidence is not Confidence.RELIABLE:
            self._broken = True
            return
        place = pose[:3, 3].tolist() if contact is None else contact.centre.tolist()
        if not isfinite(sum(place)):
            self._broken = True
            return
        joined, turn = False, pose[:3, :3].ravel().tolist()
        if not self._broken:
            # Number by number: so few take numpy several times as long.
            moved = max(map(abs, map(sub, place, self._last)))
            if moved < APART and max(map(abs, map(sub, turn, self._turn))) < TURNED:
                return
            joined = moved <= LONGEST
        self._broken, self._last, self._turn = False, place, turn
        pose = pose.copy()
        pose[:3, 3] = place
        self._times.append(seen.time)
        self._joined.append(joined)
        self._poses.append(pose)

    def interrupt(self) -> None:
        """What comes next does not continue the path."""
        self._broken = True

    def sweep_into(self, certificate: Certificate, first: int = 0, until: float = np.inf) -> int:
        """Add what was noted from number `first` on, up to `until` s, to a certificate; the number to go on with."""
        last = int(np.searchsorted(self._times, until, side="right"))
        if last > first:
            begin = max(first - 1, 0)  # the piece from the last place on
            poses = np.array(self._poses[begin:last])
            joined = np.array(self._joined[begin:last])
            certificate.sweep(poses[:, :3, 3], joined, poses)
        return max(first, last)

    def __len__(self) -> int:
        return len(self._times)
