"""Whether the stick touches and not the sphere, while a surface is sought."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Confidence, Contact, Doubt
from lwrprobe.control import normal_velocity
from lwrprobe_strategies.tip import Tip

DECIDED = 2
"""Samples in a row from which on they decide: the first may be a spike."""
CLEAR = 0.7
"""Share of the target force, from which on a force shows which of the two touches."""
SETTLED = 2.0
"""Delays of the loop, after which a touch has come to rest; until then it may decide without a harder press."""
PATIENCE = 0.3
"""s, for which the force may take to grow that far."""


class StickDoubt:
    """What samples in a row say whose contact may be one of the stick.

    The tip stands still. Where the force stays too small to decide, the force law then raises it.
    """

    def __init__(self, waiting: bool = False) -> None:
        self.found = waiting
        """The latest contact may be one of the stick; or the tip is to stand still for the first sample."""
        self._count = self._unexplained = 0
        self._since = np.inf

    def doubtful(self, tip: Tip) -> bool:
        """Whether the latest contact may be one of the stick."""
        contact = tip.seen.contact
        if contact is None or tip.leaving or contact.confidence > Confidence.DOUBTFUL or self._explained(tip, contact):
            self.found, self._count, self._unexplained, self._since = False, 0, 0, np.inf
            return False
        self.found, self._count = True, self._count + 1
        self._unexplained = self._unexplained + 1 if contact.confidence is Confidence.NONE else 0
        self._since = min(self._since, tip.seen.time)
        return True

    def decided(self, tip: Tip) -> bool:
        """The stick touches."""
        return self._unexplained >= DECIDED or (self._count >= DECIDED and self._clear(tip))

    def velocity(self, tip: Tip, ahead: np.ndarray) -> np.ndarray:
        """(3,) m/s, in the direction `ahead` (3,) unit, until it is decided."""
        contact = tip.seen.contact
        resting = tip.seen.time - self._since > SETTLED * tip.task.delay
        if not resting or contact is None or contact.confidence is not Confidence.DOUBTFUL:
            return np.zeros(3)
        rotation = tip.seen.pose[:3, :3]
        damping, inward = tip.control.damping(ahead, rotation), tip.control.approach_speed(ahead, rotation)
        return -normal_velocity(_force(tip) - tip.task.force_target, damping, 0.0, inward, 0.0) * ahead

    def _explained(self, tip: Tip, contact: Contact) -> bool:
        """Whether a touch of the sphere explains the force, and no harder press would show the normal better.

        That is so where gain and lever of the sensor are uncertain: their error grows with the force.
        """
        return contact.reason is Doubt.IMPRECISE and self._count + 1 >= DECIDED and self._clear(tip)

    def _clear(self, tip: Tip) -> bool:
        """Whether the force is as clear as it gets."""
        return _force(tip) > CLEAR * tip.task.force_target or tip.seen.time - self._since > PATIENCE


def _force(tip: Tip) -> float:
    return float(np.sqrt(tip.seen.force @ tip.seen.force))
