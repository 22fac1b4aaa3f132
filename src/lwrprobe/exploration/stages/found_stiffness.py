"""How stiff arm and object are, as touches and presses of a run show it."""

from __future__ import annotations

import math

import numpy as np

from lwrprobe.contact import Deflection, Estimator, PressCompliance, TouchIdentification, Wrench
from lwrprobe.contracts import Contact
from lwrprobe.scene import Scene

NORMAL_ERROR, FRICTION_ANGLE = 0.04, 0.3
"""rad by which a touch's normals are wrong: of estimators that know friction, and of the one that knows none."""
TOUCHES_AGREED = 3
"""Fitted touches after which contacts are corrected: a single one may rest on a wrong normal."""
APART = 3.0
"""Standard deviations between found and stated compliance from which on contacts are corrected with the found one."""


class FoundStiffness:
    """Compliance of arm and object in series, in m/N, and the estimator that corrects its contacts for it.

    Parameters
    ----------
    scene : what it states of the stiffness, and how sure that is
    bend : the probe's own deflection
    estimator : corrects its contacts for the indentation of a soft surface
    rate : Hz, of the sensor
    """

    def __init__(self, scene: Scene, bend: Deflection, estimator: Estimator, rate: float) -> None:
        self.stated = 1.0 / scene.contact.stiffness
        """m/N, an upper bound of the stiffness, and so a lower bound of the compliance of arm and object."""
        self.arm_sigma = 0.01 * scene.uncertainty.sigma("arm_stiffness_percent")
        """Of the stated compliance, its standard deviation."""
        self.compliance = 0.0
        """m/N of arm and object where it differs from what the scene states; 0 where it does not."""
        self._by_presses = False
        self._bend, self._estimator, self._rate = bend, estimator, rate
        wrong = FRICTION_ANGLE if scene.contact.estimator == "force_direction" else NORMAL_ERROR
        self._touch = TouchIdentification(bend, scene.contact.threshold, wrong)
        self._press = PressCompliance(bend, rate)
        estimator.set_indentation(self.stated)

    @property
    def settled(self) -> bool:
        """Contacts may be stored: the first touches have shown whether the surface is soft."""
        return self._touch.settled

    @property
    def touches_fitted(self) -> int:
        """How many touches have shown a compliance."""
        return self._touch.fitted

    @property
    def used(self) -> float:
        """m/N that contacts are corrected with."""
        return self.compliance or self.stated

    @property
    def pressed(self) -> tuple[float, float]:
        """m/N of arm and object as presses show it, and its standard deviation, infinite where they do not."""
        return self._press.value, self._press.sigma

    @property
    def known(self) -> bool:
        """Whether presses have shown it."""
        return math.isfinite(self._press.sigma)

    @property
    def differs(self) -> bool:
        """Whether presses show another compliance than is stated, by more than both are known.

        An object adds compliance; what takes some away is an arm stiffer than stated.
        """
        found, sigma = self.pressed
        doubt = math.hypot(sigma, self.arm_sigma * self.stated) if found < self.stated else sigma
        return abs(found - self.stated) > APART * doubt

    def sigma(self, of_object: float, of_arm: float) -> float:
        """m/N, standard deviation of the compliance that contacts are corrected with.

        `of_object` [m/N] is that of an object that no press has shown, `of_arm` a share of the stated compliance.
        """
        stated = math.hypot(of_object, of_arm * self.stated)
        if not self.known:
            return self._touch.sigma if self.compliance > 0.0 else stated
        pressed, sigma = self.pressed
        shown = math.hypot(sigma, self.used - pressed)
        # What was stated bounds the error of the stated compliance alone.
        return shown if self.compliance > 0.0 else min(stated, shown)

    def likely(self) -> tuple[float, float]:
        """m/N and a share: mean and standard deviation of the stated compliance and that of presses, each by its own
        variance; of that of presses alone where it contradicts the stated. Presses have to be known.
        """
        pressed, theirs = self.pressed
        if self.differs:
            return pressed, theirs / pressed
        ours = self.arm_sigma * self.stated
        mean = (ours**2 * pressed + theirs**2 * self.stated) / (ours**2 + theirs**2)
        return mean, ours * theirs / math.hypot(ours, theirs) / mean

    def touch(self, wrench: Wrench, pose: np.ndarray, contact: Contact | None) -> bool:
        """One sample of a touch; True where contacts are now corrected with a compliance that touches have shown."""
        changed = self._touch.update(wrench, pose, contact)
        if not (changed and self._touch.agreed >= TOUCHES_AGREED and self._touch.certain):
            return False
        if self._contradicted(self._touch.compliance):
            return False
        self._use(self._touch.compliance)
        return self.compliance > 0.0

    def press(self, wrench: Wrench, pose: np.ndarray, contact: Contact | None, rise: float) -> bool:
        """One sample of a press, where arm and object are `rise` times as stiff as stated; True where presses show
        something new.
        """
        return self._press.update(wrench, pose, contact, rise)

    def use_presses(self) -> None:
        """Correct contacts with what presses show, where that is another compliance than was stated or touched."""
        differs = self.differs
        if differs or self._by_presses or self._contradicted(self.compliance):
            self._by_presses = differs
            self._use(self._press.value if differs else 0.0)

    def forget_presses(self) -> bool:
        """Drop what presses have shown, since their normals were wrong; True where they had shown something."""
        if self._press.batches == 0:
            return False
        self._press = PressCompliance(self._bend, self._rate)
        if self._by_presses:
            self._by_presses = False
            self._use(0.0)
        return True

    def _use(self, compliance: float) -> None:
        """Correct contacts with this compliance [m/N] from now on, 0 for the stated one."""
        self.compliance = compliance
        self._estimator.set_indentation(self.used)

    def _contradicted(self, touched: float) -> bool:
        """Whether presses show another compliance than touches did [m/N], 0 for none.

        A touch is fitted over its path, into which a wrong normal brings the surface's; a press over its changes.
        """
        return touched > 0.0 and abs(touched - self._press.value) > APART * self._press.sigma
