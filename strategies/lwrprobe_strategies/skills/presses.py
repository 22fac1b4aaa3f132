"""Presses: load and let go several times on what is touched along the stick, which shows how stiff the arm is there."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from lwrprobe.contracts import Motion, Observation
from lwrprobe_strategies.outcomes import Ended
from lwrprobe_strategies.skills.load import load, unload
from lwrprobe_strategies.skills.skill import tried
from lwrprobe_strategies.tip import Tip

PRESSES, PRESSED, PRESS_TIME = 4, 2.0, 0.25
"""How often, with how many times the wanted force, and s for each way."""
ALONG = 0.95
"""Share of a normal along the stick, from which on presses show the stiffness along it."""


def along_stick(tip: Tip, normal: np.ndarray) -> bool:
    """Whether pressing on a surface with a unit normal (3,) shows the stiffness along the stick."""
    return -float(normal @ tip.seen.pose[:3, 2]) >= ALONG


def press(tip: Tip, normal: np.ndarray) -> Generator[Motion, Observation, None]:
    """Press several times along a unit normal (3,), and end in contact.

    As long as the stiffness of the arm is only stated, motions are as slow as the stiffest one in doubt demands.
    """
    tip.pressed, target = True, tip.task.force_target
    for _ in range(PRESSES):
        before = tip.here
        if (yield from tried(load(tip, normal, PRESSED * target, PRESS_TIME))) is not Ended.CONTACT:
            break
        depth = max(float((before - tip.here) @ normal), PRESSED * target / tip.task.stiffness)
        yield from tried(unload(tip, normal, depth, PRESS_TIME))
    yield from tried(load(tip, normal, target, PRESS_TIME))
