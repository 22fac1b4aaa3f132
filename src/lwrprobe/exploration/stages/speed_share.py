"""Which share of the planned speeds is safe, for the delay and the stiffness that are found during a run."""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.contracts import Probe
from lwrprobe.scene import Scene

STEPS = 40
"""Steps in which a speed is reduced, so that a plan is not made anew with every sample."""
COVERED = 1.25
"""Ratio of found to stated stiffness that the reserves of the speeds cover."""
DOUBT = 3.0
"""Standard deviations by which arm and object may be stiffer than stated before that is measured."""
UNSURE = 2.0
"""The same once presses have shown it."""
ACROSS = 0.1
"""Cosine to the stick below which a motion or a normal counts as across it."""
LEANING_GIVE = 0.1
"""Of the stated compliance, that arm and object give at least along a stick that leans."""


class SpeedShare:
    """Shares of the speeds that were planned for the stated stiffness and delay; 1 where nothing is worse than that.

    Parameters
    ----------
    scene : what it states of the stiffness, and how sure stiffness and delay are
    arm_sigma : standard deviation of the stated compliance, as a share of it
    """

    def __init__(self, scene: Scene, probe: Probe, arm_sigma: float) -> None:
        contact = scene.contact
        self._stated, self._of_object = 1.0 / contact.stiffness, 1.0 / contact.object_stiffness
        self.axial, self._across = float(probe.compliance[2]), float(probe.compliance[:2].min())
        """m/N, of the probe along the stick and, at least, across it."""
        self.excess = 0.0
        """s by which the loop reacts later to a force than its delay says; whoever measures it sets it."""
        self.harder = 1.0
        """Ratio of measured to planned force of contacts that were lost and have come back."""
        self.softer = np.zeros((3, 3))
        """m/N, by which the arm gives way more than along the stick, see `Task.softer`."""
        self._origin, self._slope = np.zeros(3), np.zeros(3)
        self._pose = np.eye(4)
        self.delay = 0.0
        """s, of the loop."""
        self._arm_sigma = arm_sigma
        # The samples' age follows from the stamps of two clocks.
        self._delay_sigma = 1e-3 * math.hypot(*map(scene.uncertainty.sigma, ("clock_skew_ms", "sensor_delay_ms")))
        self.forget_stiffness()

    def begin(self, delay: float) -> None:
        """Speeds are planned for a `delay` s of the loop; arm and object may be stiffer than stated."""
        self.delay, self.harder = delay, 1.0
        self.forget_stiffness()

    def expect(self, place: np.ndarray, slope: np.ndarray, softer: np.ndarray | None = None) -> None:
        """The stiffness is that stated at a place (3,) m, and its logarithm rises by `slope` (3,) 1/m from there on.

        `softer` (3, 3) m/N is by how much the arm gives way more in other directions than along the stick.
        """
        self._origin, self._slope = place.copy(), slope.copy()
        if softer is not None:
            self.softer = softer.copy()

    def at(self, pose: np.ndarray) -> None:
        """The tip is at this pose (4, 4)."""
        self._pose = pose

    def forget_stiffness(self) -> None:
        """Nothing is known of the stiffness but what is stated."""
        self._found = 1.0 / self._doubt(self._arm_sigma, DOUBT)

    def follow(self, compliance: float, sigma: float) -> None:
        """Arm and object have this compliance in m/N along the stick, `sigma` is its standard deviation over it.

        Speeds and one over the damping go with the compliance, to which the probe hardly adds along the stick.
        """
        share = (compliance + self.axial) / (self._stated + self.axial) / self._doubt(sigma, UNSURE)
        self._found = share if COVERED * share < 1.0 else 1.0

    @property
    def stiffer(self) -> bool:
        """Whether arm and object are, or may be, stiffer than the reserves of the speeds cover."""
        return self._found < 1.0

    @property
    def rise(self) -> float:
        """Stiffness of arm and object along the stick, as it is held where the tip is, over the stated one.

        An arm whose joints give way is stiff towards its own shoulder: along a stick that leans that way several times
        as much as along an upright one.
        """
        axis, place = self._pose[:3, 2], self._pose[:3, 3]
        arm = max(self._stated - self._of_object, 0.0) * math.exp(float(self._slope @ (self._origin - place)))
        leaning = float(axis @ self.softer @ axis)
        return self._stated / max(arm + leaning + self._of_object, LEANING_GIVE * self._stated)

    @property
    def of_delay(self) -> float:
        """Of the speed that the stated delay allows."""
        return _stepped(self.delay / (self.delay + self.excess)) if self.delay > 0.0 else 1.0

    @property
    def of_stiffness(self) -> float:
        """Of the speed that the stated stiffness allows; lower where the arm is stiffer here than the reserve covers,
        which is used up where presses or doubt have slowed it already.

        Contacts that were lost and have come back harder than planned show the same in their own way.
        """
        reserve = COVERED if self._found == 1.0 else 1.0
        share = self._found * _stepped(min(reserve / self.rise, 1.0))
        return min(share, COVERED / self.harder) if self.harder > COVERED else share

    @property
    def everywhere(self) -> float:
        """Of a planned speed where something may be met in any direction."""
        return self.of_delay * self.of_stiffness

    def along(self, path: np.ndarray, normal: np.ndarray | None) -> float:
        """Of a planned speed along a path (3,), while something with this normal (3,) is touched, or nothing.

        It is another where nothing can be met, or is touched, along the stick.
        """
        share = self.of_stiffness
        if share < 1.0 and self._is_across(path) and (normal is None or self._is_across(normal)):
            share = self._across_where(share)
        return self.of_delay * share

    def _is_across(self, vector: np.ndarray) -> bool:
        """Whether a vector (3,) lies across the stick."""
        return abs(float(vector @ self._pose[:3, 2])) <= ACROSS * math.sqrt(float(vector @ vector))

    def _across_where(self, share: float) -> float:
        """Share of the speed across the stick, where that along it is `share`: the probe's own give, of which all is
        known, adds to that of arm and object.
        """
        stiffer = (self._stated + self._across) / (self._stated * share / COVERED + self._across)
        return _stepped(min(COVERED / stiffer, 1.0))

    def _doubt(self, sigma: float, times: float) -> float:
        """How many times larger stiffness times delay may be than likely, beyond what the reserves of the speeds cover.

        `sigma` is the standard deviation of the stiffness over its value; it counts `times`, with the delay's.
        """
        late = self._delay_sigma / self.delay if self.delay > 0.0 else 0.0
        return max((1.0 + times * math.hypot(sigma, late)) / COVERED, 1.0)


def _stepped(share: float) -> float:
    """The share, rounded down to a step; never zero."""
    return max(1.0, math.floor(STEPS * share)) / STEPS
