"""Whether the stick touches and not the sphere: the first sample alone may be too weak to decide."""

from __future__ import annotations

from lwrprobe.contracts import Confidence
from lwrprobe_strategies.tip import Tip

DECIDED = 2
"""Doubtful samples in a row, from which on the stick is what touches."""


class StickDoubt:
    """Counts samples in a row whose contact may be one of the stick; the tip stands still meanwhile.

    Attributes
    ----------
    count : so far
    """

    def __init__(self, count: int = 0) -> None:
        self.count = count

    def doubtful(self, tip: Tip) -> bool:
        """Whether the latest contact may be one of the stick."""
        contact = tip.seen.contact
        doubtful = contact is not None and not tip.leaving and contact.confidence <= Confidence.DOUBTFUL
        self.count = self.count + 1 if doubtful else 0
        return doubtful

    @property
    def decided(self) -> bool:
        """The stick touches."""
        return self.count >= DECIDED
