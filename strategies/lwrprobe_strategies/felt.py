"""What one observation says about the surface."""

from __future__ import annotations

import numpy as np

from lwrprobe.contracts import Observation

BELIEVED = 0.5
"""Trust of a contact, from which on it is one of the sphere with one surface."""
STICK_TRUST = 0.1
"""Trust of a contact, up to which it may be the stick that touches."""


def surface_normal(seen: Observation) -> np.ndarray:
    """(3,) unit: the estimated contact's, or the direction of the force where that estimate is not to be had."""
    contact = seen.contact
    if contact is not None and contact.trust > 0.0:
        return contact.normal
    size = float(np.sqrt(seen.force @ seen.force))
    return seen.force / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])


def believed(seen: Observation) -> bool:
    """Whether what is touched is one surface, and touched by the sphere."""
    return seen.contact is not None and seen.contact.trust >= BELIEVED


def maybe_stick(seen: Observation) -> bool:
    """Whether no contact of the sphere explains the force: something stands out above it, or the force is weak yet."""
    return seen.contact is not None and seen.contact.trust <= STICK_TRUST
