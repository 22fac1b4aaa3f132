"""Compliance of arm and object along the stick, from how force and depth change together while the probe presses."""

from __future__ import annotations

from math import erfc, exp, hypot, pi, sqrt

import numpy as np

from lwrprobe.contact.deflection import Deflection
from lwrprobe.contact.wrench import Wrench
from lwrprobe.contracts import Contact
from lwrprobe.contracts.contact import NORMAL_AT_HALF_CONFIDENCE
from lwrprobe.contracts.samples import Vector

MIN_CHANGE = 0.02
"""N between two samples: seven times the noise of a reading, which makes the slope some percent too small."""
GAP = 2.5
"""Periods of the sensor between two samples, from which on they are not compared."""
ALONG = 0.9
"""Least cosine between normal and stick: across it the stick itself gives way hundreds of times more."""
MOVING, SCORED = 0.1, 2.0
"""rad, least standard deviation of a normal between two samples: with it a move sideways looks like one in depth; and
how many times the error that its score of confidence stands for is added, as where the sphere chatters."""
PLACE = 3e-6
"""m, standard deviation of the change in depth between two samples of a sphere that does not move sideways."""
BATCH, LEAST = 3e-5, 10
"""m/N, standard deviation of a batch when it is complete, and how many changes it has at least."""
LOWEST = 8.0
"""Standard deviations below zero from which on a median is taken as no lower."""
FEWEST = 4
"""Batches that have to agree before contacts are corrected."""
NORMAL = 0.05
"""rad, standard deviation of a normal in motion; it changes what the stick gives along it, aside from its axis."""
FLOOR = 0.1
"""Smallest standard deviation over the value: sliding with a wrong normal is common to all batches."""


class PressCompliance:
    """Weighted median over batches of changes, each the slope of the sphere's depth over force between neighbouring
    samples.

    Only changes count, so that a slope of the surface and an error of the normal enter as noise. A change weighs less
    the further the sphere has moved sideways with it: pressing shows the compliance, sliding hardly. A batch weighs
    less the more its changes scatter and the more the stick's give depends on the normal there; the median does not
    follow a single one.

    Parameters
    ----------
    bend : the probe's own deflection, which leads from the tip to the sphere
    rate : Hz, of the sensor
    """

    def __init__(self, bend: Deflection, rate: float = 125.0) -> None:
        self._bend, self._gap = bend, GAP / rate
        self._last: tuple[float, list[float], list[float], list[float]] | None = None
        self._squares = [0.0, 0.0, 0.0]
        self._count = 0
        self._slopes: list[float] = []
        self._sigmas: list[float] = []

    @property
    def batches(self) -> int:
        """How many estimates there are."""
        return len(self._slopes)

    @property
    def value(self) -> float:
        """m/N of arm and object in series; 0 before the first batch.

        The mean of what the batches leave possible above zero: a median that scatter has brought near zero or below
        it is no sign of a surface that does not give at all.
        """
        if not self._slopes:
            return 0.0
        middle, sigma = self._middle(self._slopes), self.sigma
        if sigma == float("inf"):
            return max(middle, 1e-9)
        at = max(middle / sigma, -LOWEST)
        return sigma * (at + sqrt(2.0 / pi) * exp(-0.5 * at * at) / erfc(-at / sqrt(2.0)))

    @property
    def sigma(self) -> float:
        """m/N, standard deviation of `value`; infinite with fewer than `FEWEST` batches."""
        if len(self._slopes) < FEWEST:
            return float("inf")
        middle, say = self._middle(self._slopes), np.array(self._sigmas) ** -2
        spread = 1.4826 * self._middle([abs(slope - middle) for slope in self._slopes])
        counted = float(say.sum() ** 2 / (say**2).sum())  # batches of equal weight that say as much
        return max(1.2533 * spread / sqrt(counted), 1.2533 / sqrt(float(say.sum())), FLOOR * abs(middle))

    def _middle(self, values: list[float]) -> float:
        """Median of one value a batch, each weighted by one over its standard deviation."""
        order = np.argsort(values)
        weight = np.cumsum(1.0 / np.array(self._sigmas)[order])
        shares = (weight - 0.5 * np.diff(weight, prepend=0.0)) / weight[-1]
        return float(np.interp(0.5, shares, np.array(values)[order]))

    def update(self, wrench: Wrench, pose: np.ndarray, contact: Contact | None, rise: float = 1.0) -> bool:
        """One sample and the tip's nominal pose (4, 4) at its instant; True when a batch has been added.

        `rise` is the arm's stiffness there over that where `value` counts.
        """
        before, self._last = self._last, None
        if contact is None or contact.confidence_score <= 0.0 or not wrench.usable:
            return False
        normal, (x, y, z) = contact.normal.tolist(), pose[:3, 2].tolist()
        if abs(normal[0] * x + normal[1] * y + normal[2] * z) < ALONG:
            return False
        # The sphere's own place: friction bends the stick as well as what presses along the normal.
        place = self._bend.centre(pose[:3, 3], pose[:3, :3], wrench.world_force).tolist()
        force = wrench.world_force.tolist()
        self._last = (wrench.time, place, force, normal)
        if before is None or not 0.0 < wrench.time - before[0] < self._gap:
            return False
        mean = [a + b for a, b in zip(normal, before[3])]
        length = hypot(*mean)
        change = sum((b - a) * m for a, b, m in zip(before[2], force, mean)) / length
        if abs(change) < MIN_CHANGE:
            return False
        deeper = sum((a - b) * m for a, b, m in zip(before[1], place, mean)) / length
        far = sum((b - a) ** 2 for a, b in zip(before[1], place)) - deeper**2
        turned = MOVING**2 + (SCORED * NORMAL_AT_HALF_CONFIDENCE) ** 2 * (1.0 / contact.confidence_score - 1.0)
        weight, sums = 1.0 / (PLACE**2 + turned * max(far, 0.0)), self._squares
        sums[0], sums[1] = sums[0] + weight * change**2, sums[1] + weight * change * deeper
        sums[2] += weight * deeper**2
        self._count += 1
        complete = self._count >= LEAST and sums[0] > BATCH**-2
        if complete:
            self._close(pose[:3, :3], contact.normal, rise)
        return complete

    def _close(self, rotation: np.ndarray, normal: Vector, rise: float) -> None:
        """Add the batch: weighted least squares through zero, and how well its changes agree with it."""
        (ff, fd, dd), count, self._squares, self._count = self._squares, self._count, [0.0, 0.0, 0.0], 0
        give = self._bend.shift(rotation, normal)
        along = float(np.dot(normal, give))
        self._slopes.append(rise * fd / ff)
        scatter = sqrt(max(1.0, (dd - fd**2 / ff) / (count - 1)))
        turned = 2.0 * NORMAL * float(np.linalg.norm(give - along * normal))  # by a normal that is wrong
        self._sigmas.append(rise * hypot(scatter / sqrt(ff), turned))
