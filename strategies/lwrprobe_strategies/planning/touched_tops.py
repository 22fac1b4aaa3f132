"""What the contacts since some moment say of the top of an object; contacts as in `ContactMemory.contacts`."""

from __future__ import annotations

import numpy as np

from lwrprobe_strategies.planning.contact_memory import NORMAL_Z
from lwrprobe_strategies.planning.lines import Z

LEVEL = 0.7
"""Share of the normal along z, from which on a touch is one of a top."""
BESIDE = 0.003
"""m from a place, within which a contact is one there."""


def crown(contacts: np.ndarray) -> np.ndarray | None:
    """(n, 3) m, of the sphere's centre on tops, or of all contacts where no top was touched; None without contacts."""
    level = contacts[contacts[:, NORMAL_Z] > LEVEL]
    rows = level if len(level) else contacts
    return rows[:, :3] if len(rows) else None


def middle_of(places: np.ndarray) -> np.ndarray:
    """(3,) m, that of the places (n, 3) which is nearest to the middle of them in the plan view."""
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return places[int(np.argmin(np.hypot(*(places - middle)[:, :2].T)))]


def lowest_top_since(contacts: np.ndarray, place: np.ndarray) -> float | None:
    """m, lowest height of the sphere's centre on tops since it was at a place (3,); None where it never was."""
    near = np.flatnonzero(np.abs(contacts[:, :3] - place).max(axis=1) < BESIDE)
    if not len(near):
        return None
    rows = contacts[near[-1] :]
    return float(rows[rows[:, NORMAL_Z] > LEVEL, Z].min(initial=np.inf))


def is_outer(contacts: np.ndarray) -> bool:
    """Whether an outline runs around the object and not around a hole in it."""
    away = contacts[:, :2] - contacts[:, :2].mean(axis=0)
    return bool((away * contacts[:, 6:8]).sum() > 0.0)
