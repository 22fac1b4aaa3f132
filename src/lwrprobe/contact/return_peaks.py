"""How hard contacts come back that were lost for a moment: where arm or object is stiffer, or the loop later, than the
speeds were chosen for, they come back harder than planned."""

from __future__ import annotations

from collections import deque

from lwrprobe.contracts import InputError

MOMENT = 6.0
"""Delays, for which a contact that comes back may have been lost: a longer way is no return."""
PEAK = 2.0
"""Delays after its return, within which a contact has its peak."""
KEPT = 20
"""Returns that count: the last ones."""
AGREED = 2
"""Returns that have to be as hard: a single one may have met an edge or a corner."""
MOST = 4.0
"""Largest excess that is believed."""


class ReturnPeaks:
    """Compares the peak of each return with the planned one.

    Parameters
    ----------
    planned : N, peak of a return at the chosen speed
    threshold : N, of a contact
    delay : s, of the loop
    """

    def __init__(self, planned: float, threshold: float, delay: float) -> None:
        if not 0.0 < threshold < planned:
            raise InputError("return_peaks.planned", (threshold, planned), "a threshold above 0 and a larger peak")
        if not delay >= 0.0:
            raise InputError("return_peaks.delay", delay, "zero seconds or more")
        self._room, self._threshold, self._delay = planned - threshold, threshold, delay
        self._lost: float | None = None
        self._back: float | None = None
        self._peak = 0.0
        self._found: deque[float] = deque(maxlen=KEPT)
        self.excess = 1.0
        """Ratio of found to planned force beyond the threshold, 1 where returns are as planned or softer."""

    def update(self, time: float, force: float, share: float) -> None:
        """One reading in contact at a time [s]: the force [N] along the normal, and the `share` of the chosen speed at
        which the probe moves."""
        if self._lost is not None:
            if time - self._lost <= MOMENT * self._delay:
                self._back, self._peak = time, 0.0
            self._lost = None
        if self._back is None:
            return
        self._peak = max(self._peak, (force - self._threshold) / (self._room * share))
        if time - self._back >= PEAK * self._delay:
            self._close()

    def lose(self, time: float) -> None:
        """No contact at a time [s]."""
        if self._back is not None:
            self._close()
        if self._lost is None:
            self._lost = time

    def _close(self) -> None:
        self._back = None
        self._found.append(self._peak)
        if len(self._found) >= AGREED:
            self.excess = min(max(sorted(self._found)[-AGREED], 1.0), MOST)
