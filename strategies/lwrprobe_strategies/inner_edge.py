"""Inner edges: where two surfaces are felt at once, the one met last is followed."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Observation
from lwrprobe_strategies.felt import believed
from lwrprobe_strategies.following import Follower, Vector

STEEPEST_FRICTION = 0.5
"""Share of the normal force that may act against the feed before that means another surface."""
MEETS = 0.5
"""Share of the wanted force, beyond friction, that acts against the feed when another surface is met."""
EDGE_WAY = 0.001
"""m from an inner edge, after which the surface met there is felt alone."""


class InnerEdge:
    """Remembers the surface met last until it is felt alone."""

    def __init__(self, force_target: float) -> None:
        self._target = force_target
        self._met: tuple[np.ndarray, np.ndarray] | None = None

    def forget(self) -> None:
        """The contour has been left."""
        self._met = None

    def watch(self, seen: Observation, follower: Follower, across: Vector) -> None:
        """A force against the feed that friction does not explain: another surface has been met."""
        if self._met is not None:
            return
        pressed = float(seen.force @ follower.normal)
        against = STEEPEST_FRICTION * max(pressed, 0.0) + MEETS * self._target
        if seen.force @ seen.force <= pressed * pressed + against * against:
            return  # nowhere along the surface is there so much
        onward = np.array(follower.tangent(across))
        if -float(seen.force @ onward) > against:
            self._met = (-onward, seen.pose[:3, 3].copy())
            follower.restart(-onward)

    def normal(self, seen: Observation) -> np.ndarray | None:
        """(3,) of the surface met last, None where one is felt alone."""
        if self._met is None:
            return None
        normal, place = self._met
        contact = seen.contact
        alone = contact is not None and believed(seen) and contact.normal @ normal > 0.8
        if not alone and np.abs(seen.pose[:3, 3] - place).max() < EDGE_WAY:
            return normal
        self._met = None
        return None
