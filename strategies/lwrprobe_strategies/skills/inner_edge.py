"""Inner edges: where two surfaces are touched at once, the one met last is followed."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Confidence, Observation
from lwrprobe.control import ContourControl

MAX_FRICTION = 0.5
"""Share of the normal force that may act against the sliding motion before that means another surface."""
MEETS = 0.5
"""Share of the wanted force, beyond friction, that acts against the sliding motion when another surface is met."""
ALONE = 0.8
"""Cosine between a reliable normal and the met surface's, from which on that surface is touched alone."""
EDGE_PATH = 0.001
"""m from an inner edge, after which the surface met there is touched alone."""


class InnerEdge:
    """Remembers the surface met last during one contour, until it is touched alone.

    Parameters
    ----------
    force_target : N
    """

    def __init__(self, force_target: float) -> None:
        self._meets = MEETS * force_target
        self._met: tuple[np.ndarray, np.ndarray] | None = None

    def watch(self, seen: Observation, control: ContourControl, binormal: tuple[float, float, float]) -> None:
        """A force against the motion that friction does not explain: another surface has been met, and is tracked."""
        if self._met is not None:
            return
        force = seen.force
        (fx, fy, fz), (nx, ny, nz) = force.tolist(), control.normal.tolist()
        pressed = fx * nx + fy * ny + fz * nz
        against = MAX_FRICTION * max(pressed, 0.0) + self._meets
        if fx * fx + fy * fy + fz * fz <= pressed * pressed + against * against:
            return  # in no direction along the surface is there so much
        onward = np.array(control.tangent(binormal))
        if -float(force @ onward) > against:
            self._met = (-onward, seen.pose[:3, 3].copy())
            control.begin(-onward)

    def normal(self, seen: Observation) -> np.ndarray | None:
        """(3,) of the surface met last, None where one surface is touched alone."""
        if self._met is None:
            return None
        normal, place = self._met
        contact = seen.contact
        if contact is not None and contact.confidence is Confidence.RELIABLE:
            alone = bool(contact.normal @ normal > ALONE)
        else:
            alone = False
        if not alone and np.abs(seen.pose[:3, 3] - place).max() < EDGE_PATH:
            return normal
        self._met = None
        return None
