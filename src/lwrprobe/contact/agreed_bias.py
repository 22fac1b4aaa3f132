"""The bias at the start of a run, when it is unknown whether the probe is in contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lwrprobe.contact.conditioner import BiasOutcome, WrenchConditioner
from lwrprobe.contracts import WrenchSample

AGREEMENT = 0.03
"""N by which the biases of two places may differ: ten times the noise of one reading, less than a touch of any use."""

MEAN_ERROR = 0.25
"""Of the noise of one reading: a less certain mean is taken over a longer rest."""

RESTS = 6
"""Most rests at one place: with twice the noise a mean needs four times the samples."""

TOUCHING = "touching"


@dataclass(slots=True, frozen=True)
class AgreedBias:
    """How the bias was found.

    Attributes
    ----------
    outcome : of the last attempt; `taken` says whether there is a bias
    retreats : how often the probe was moved away
    touched : the probe stood in contact at first
    """

    outcome: BiasOutcome
    retreats: int
    touched: bool


def agreed_bias(
    conditioner: WrenchConditioner,
    listen: Callable[[], Sequence[WrenchSample]],
    retreat: Callable[[], None],
    rotation: np.ndarray,
    max_retreats: int = 4,
) -> AgreedBias:
    """Take the bias, retreat, take it again, until two places in a row agree.

    A sensor's unknown offset is larger than a light touch, so one reading cannot tell them apart; a touch differs
    between two places, an offset does not. A contact that the retreat slides along with unchanged force is not seen.

    Parameters
    ----------
    listen : rests and returns the samples of that time; called again at the same place for a noisy sensor
    retreat : moves the probe away from whatever it may touch, keeping its orientation
    rotation : (3, 3) of the sensor in the world
    """
    before = conditioner.take_bias(_rest(conditioner, listen), rotation)
    touched = before.reason == TOUCHING
    for retreats in range(1, max_retreats + 1):
        retreat()
        samples = _rest(conditioner, listen)
        measured = before.reason in ("", TOUCHING)
        now = conditioner.take_bias(samples, rotation, AGREEMENT, before.bias if measured else None)
        if now.taken and measured:
            return AgreedBias(now, retreats, touched)
        touched = touched or now.reason == TOUCHING
        before = now
    return AgreedBias(before if before.reason else replace(before, taken=False, reason="unsteady"), retreats, touched)


def _rest(conditioner: WrenchConditioner, listen: Callable[[], Sequence[WrenchSample]]) -> list[WrenchSample]:
    """Samples at one place, as many as the mean of a noisy sensor needs."""
    samples = list(listen())
    for _ in range(RESTS - 1):
        error = conditioner.mean_error(samples)
        if error <= MEAN_ERROR or not np.isfinite(error):
            break
        samples += listen()
    return samples
