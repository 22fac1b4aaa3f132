"""Variance pokes: touches from above where a Gaussian process knows least of the height (as MSEC2018 V002T07A003)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from lwrprobe.contracts import InputError
from lwrprobe_strategies.pokes import Places, Pokes

LENGTHS = (0.005, 0.01, 0.02, 0.04, 0.08)
"""m, of the kernel, among which the heights decide."""
NOISE = 1e-4
"""Variance of a height, in that of the process."""
APART = 0.003
"""m between the places that are considered."""


@dataclass(slots=True, frozen=True)
class VariancePokesConfig:
    """Options.

    Attributes
    ----------
    pokes : how many
    """

    pokes: int = 100

    def __post_init__(self) -> None:
        if self.pokes < 1:
            raise InputError("strategy.pokes", self.pokes, "at least 1")


class VariancePokes(Pokes):
    """Touches from above at the largest variance of a Gaussian process over the plan view."""

    Config: ClassVar[type] = VariancePokesConfig

    def places(self) -> Places:
        """First the middle of the area; the kernel's length is always the likeliest of `LENGTHS`."""
        options, area = self.task.options or self.Config(), self.task.area
        low, high = area.lower[:2], area.upper[:2]
        axes = [np.linspace(a, b, int(np.ceil((b - a) / APART)) + 1) for a, b in zip(low, high)]
        candidates = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        place = 0.5 * (area.lower + area.upper)[:2]
        touched, heights = np.empty((0, 2)), np.empty(0)
        for _ in range(options.pokes):
            height = yield float(place[0]), float(place[1])
            touched, heights = np.vstack([touched, place]), np.append(heights, height)
            length = max(LENGTHS, key=lambda scale: log_likelihood(touched, heights, scale))
            place = candidates[int(np.argmax(variances(touched, candidates, length)))]


def log_likelihood(places: np.ndarray, heights: np.ndarray, length: float) -> float:
    """Of heights (n,) at places (n, 2) m for a kernel's length [m], with the likeliest mean and variance, less a
    constant.
    """
    factor = cho_factor(_kernel(places, places, length) + NOISE * np.eye(len(places)), lower=True)
    ones = np.ones(len(places))
    mean = (ones @ cho_solve(factor, heights)) / (ones @ cho_solve(factor, ones))
    off = heights - mean
    variance = max(float(off @ cho_solve(factor, off)) / len(off), 1e-12)
    return -0.5 * len(off) * float(np.log(variance)) - float(np.log(np.diag(factor[0])).sum())


def variances(places: np.ndarray, at: np.ndarray, length: float) -> np.ndarray:
    """(k,) share of the process's variance that heights at places (n, 2) m leave at others (k, 2) m."""
    factor = cho_factor(_kernel(places, places, length) + NOISE * np.eye(len(places)), lower=True)
    across = _kernel(places, at, length)
    return 1.0 - np.einsum("ij,ij->j", across, cho_solve(factor, across))


def _kernel(a: np.ndarray, b: np.ndarray, length: float) -> np.ndarray:
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / length**2)
