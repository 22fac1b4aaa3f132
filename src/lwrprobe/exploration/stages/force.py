"""What a run learns of its touch as it goes: how stiff the surface is, and whether the loop oscillates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lwrprobe.contact import (
    Deflection,
    Estimator,
    LimitCycle,
    PressCompliance,
    ReturnPeaks,
    TouchIdentification,
    TouchRises,
    Wrench,
    WrenchConditioner,
)
from lwrprobe.contracts import Contact, Goal, Motion, Probe, SafetyStop, VelocityCommand
from lwrprobe.control import RETURN, Refusal
from lwrprobe.exploration.stages.sensor_zero import SensorZero
from lwrprobe.exploration.stages.touch_law import touch_law
from lwrprobe.scene import Scene

NORMAL_ERROR, FRICTION_ANGLE = 0.04, 0.3
"""rad by which a touch's normals are wrong: of estimators that know friction, and of the one that knows none."""
SPEED_STEPS = 40
"""Steps in which a speed is reduced."""
COVERED = 1.25
"""Ratio of found to stated stiffness that the reserves of the speeds cover."""
TOUCHES_AGREED = 3
"""Fitted touches after which contacts are corrected: a single one may rest on a wrong normal."""
APART = 3.0
"""Standard deviations between found and stated compliance from which on contacts are corrected with the found one."""

DOUBT = 3.0
"""Standard deviations by which arm and object may be stiffer than stated before that is measured."""
UNSURE = 2.0
"""The same once presses have shown it."""
ACROSS = 0.1
"""Cosine to the stick below which a motion or a normal counts as across it."""
LEANING_GIVE = 0.1
"""Of the stated compliance, that arm and object give at least along a stick that leans."""


class TouchRefused(SafetyStop):
    """There is no safe way to touch this; the message has the numbers."""


class ForceStage:
    """Watches every sample of a run, and says what to change.

    Parameters
    ----------
    scene : contact and motion settings
    conditioner : whose zero is moved in free space
    estimator : corrects its contacts for the indentation of a soft surface
    rate : Hz, of the sensor
    """

    def __init__(
        self, scene: Scene, probe: Probe, conditioner: WrenchConditioner, estimator: Estimator, rate: float
    ) -> None:
        self._scene, self._contact = scene, scene.contact
        self._approach = scene.motion.approach_speed
        self.excess = 0.0
        """s by which the loop reacts later to a force than its delay says; whoever measures it sets it."""
        self.learns = True
        """Whether touches and presses show the stiffness. With a probe that is not calibrated they do not: across the
        stick, a fifth of its compliance is more than all of the arm's."""
        self._origin, self._slope = np.zeros(3), np.zeros(3)
        self.softer = np.zeros((3, 3))
        """m/N, by which the arm gives way more than along the stick, see `Task.softer`."""
        self._delay = self._tip_mass = 0.0
        self._touch_speed = self._approach
        self._normal: np.ndarray | None = None
        self._estimator, self._rate = estimator, rate
        self._bend = Deflection(probe)
        self._axial, self._across = float(probe.compliance[2]), float(probe.compliance[:2].min())
        self.zero = SensorZero(scene, probe, conditioner)
        wrong = FRICTION_ANGLE if scene.contact.estimator == "force_direction" else NORMAL_ERROR
        self._touch = TouchIdentification(self._bend, scene.contact.threshold, wrong)
        self._press = PressCompliance(self._bend, rate)
        self.rises = TouchRises(scene.contact.threshold)
        """Of all touches, for what is learnt of the stiffness after the run."""
        # Before it is measured, arm and object may be stiffer than stated.
        self._arm_sigma = 0.01 * scene.uncertainty.sigma("arm_stiffness_percent")
        # The samples' age follows from the stamps of two clocks.
        self._delay_sigma = 1e-3 * math.hypot(*map(scene.uncertainty.sigma, ("clock_skew_ms", "sensor_delay_ms")))
        self._at_first = self._of_stiffness = 1.0 / self._doubt(self._arm_sigma, DOUBT)
        self._axis, self._place = np.array([0.0, 0.0, 1.0]), np.zeros(3)
        self._compliance, self._by_presses, self._gives = 0.0, False, 0.0
        self._cycle: LimitCycle | None = None
        self._returns: ReturnPeaks | None = None
        self._report: dict[str, Any] = {}
        # An upper bound of the stiffness is a lower bound of the compliance of object and arm.
        estimator.set_indentation(1.0 / scene.contact.stiffness)

    def expect(self, place: np.ndarray, slope: np.ndarray, softer: np.ndarray | None = None) -> None:
        """The stiffness is that stated at a place (3,) m, and its logarithm rises by `slope` (3,) 1/m from there on.

        `softer` (3, 3) m/N is by how much the arm gives way more in other directions than along the stick.
        """
        self._origin, self._slope = place.copy(), slope.copy()
        if softer is not None:
            self.softer = softer.copy()

    def begin(self, delay: float, stated: float | None = None, tip_mass: float = 0.0) -> None:
        """Choose speeds and damping for what the scene says of the surface; raises TouchRefused where none is safe.

        `delay` is the loop's in s, `stated` what scene and devices say of it, where it was measured to be longer;
        `tip_mass` kg is the arm's as its tip shows it.
        """
        c = self._contact
        series = 1.0 / (1.0 / c.stiffness + self._axial)
        law = touch_law(self._scene, delay, tip_mass, max_speed=1.0)
        self._report = {"delay_s": round(delay, 6), "stiffness_along_stick": round(series, 1)}
        if tip_mass > 0.0:
            self._report["arm_mass_at_tip_kg"] = round(tip_mass, 3)
        self._delay, self._tip_mass = delay, tip_mass
        self._at_first = self._of_stiffness = 1.0 / self._doubt(self._arm_sigma, DOUBT)
        self._cycle = LimitCycle(c.target, delay, 1.0 / self._rate, band=0.5 * c.target)
        self._returns = ReturnPeaks(max(RETURN * c.target, 1.5 * c.threshold), c.threshold, delay)
        if isinstance(law, Refusal):
            self._report["refused"] = law.reason
            raise TouchRefused(f"touch refused: {law.reason}")
        slower = []
        if stated is not None and delay > stated:
            slower = [
                f"the loop reacts after {1e3 * delay:.1f} ms, scene and devices state {1e3 * stated:.1f} ms: the probe "
                "moves slower"
            ]
        self._touch_speed = min(self._approach, law.approach_speed)
        self._update_from_presses()  # of the part before, where a run is resumed
        self._report |= {
            "stability_number": round(law.stability_number, 4),
            "damping": round(law.damping, 3),
            "safe_approach_mm_s": round(1e3 * law.approach_speed, 4),
            "warnings": [*slower, *law.warnings],
        }

    @property
    def settled(self) -> bool:
        """Contacts may be stored: the first touches have shown whether the surface is soft."""
        return self._touch.settled

    @property
    def compliance(self) -> float:
        """m/N of object and arm where it differs from what the scene states; 0 where it does not."""
        return self._compliance

    @property
    def pressed(self) -> tuple[float, float]:
        """m/N of object and arm as presses show it, and its standard deviation, infinite where they do not."""
        return self._press.value, self._press.sigma

    def compliance_sigma(self, of_object: float, of_arm: float) -> float:
        """m/N, standard deviation of the compliance that contacts are corrected with.

        `of_object` [m/N] is that of an object that no press has shown, `of_arm` a share of the stated compliance.
        """
        stated = math.hypot(of_object, of_arm / self._contact.stiffness)
        if not math.isfinite(self._press.sigma):
            return self._touch.sigma if self._compliance > 0.0 else stated
        used = self._compliance or 1.0 / self._contact.stiffness
        shown = math.hypot(self._press.sigma, used - self._press.value)
        # What was stated bounds the error of the stated compliance alone.
        return shown if self._compliance > 0.0 else min(stated, shown)

    def update(
        self,
        wrench: Wrench,
        pose: np.ndarray,
        contact: Contact | None,
        certain: bool = True,
        time: float | None = None,
    ) -> None:
        """One sample; `certain` says that torque and force agree well enough for the normals to be relied on.

        `time` is that of the run [s] where the sensor counts from another instant.

        Raises TouchRefused when the surface turns out too stiff for the damping that was chosen.
        """
        self.zero.note(0.0 if time is None else wrench.time - time)
        if self._cycle is not None and self._returns is not None:
            if contact is not None:
                force = float(contact.normal @ wrench.world_force)
                self._cycle.update(wrench.time, force)
                self._returns.update(wrench.time, force, self._share * self._stiffness_share * self._cycle.scale)
            else:
                self._cycle.lose(wrench.time)
                self._returns.lose(wrench.time)
        self._axis, self._place = pose[:3, 2], pose[:3, 3]
        self._normal = contact.normal if contact is not None else None
        if contact is not None:
            series = self._compliance or 1.0 / self._contact.stiffness
            self._gives = series + self._bend.along(pose[:3, :3], contact.normal)
        if not self.learns:
            return
        self.rises.update(wrench, pose[:3, 3], wrench.time if time is None else time)
        changed = self._touch.update(wrench, pose, contact)
        if changed and self._touch.agreed >= TOUCHES_AGREED and self._touch.certain:
            found = self._touch.compliance
            if not self._contradicted(found):
                self._adopt(found)
        if not certain:
            self._forget_presses()
        elif self._tip_mass == 0.0 and self._press.update(wrench, pose, contact, self._rise):
            # An arm with mass hardly moves while the force changes: its quick presses show the object alone.
            self._update_from_presses()

    def limit(self, motion: Motion, wrench: Wrench, acceleration: float) -> Motion:
        """The motion, slowed while the force oscillates; a contact is interrupted where the sensor's zero asks for it.

        `acceleration` m/s^2 of the tip, see `SensorZero.lift`.
        """
        lift = self.zero.lift(motion, wrench, self._place, self._normal, self._gives, acceleration, self._axis)
        if lift is not None:
            return lift
        motion = self._slowed(motion, wrench)
        if self._cycle is None or self._cycle.scale == 1.0 or not isinstance(motion, VelocityCommand):
            return motion
        return VelocityCommand(motion.velocity * self._cycle.scale, motion.hold, motion.reason, motion.pose)

    @property
    def touch_speed(self) -> float:
        """m/s at which something may be met in any direction, as late as the loop is now."""
        return self._touch_speed * self._share * self._stiffness_share

    @property
    def _rise(self) -> float:
        """Stiffness of arm and object along the stick, as it is held where the tip is, over the stated one.

        An arm whose joints give way is stiff towards its own shoulder: along a stick that leans that way several times
        as much as along an upright one.
        """
        stated, of_object = 1.0 / self._contact.stiffness, 1.0 / self._contact.object_stiffness
        arm = max(stated - of_object, 0.0) * math.exp(float(self._slope @ (self._origin - self._place)))
        leaning = float(self._axis @ self.softer @ self._axis)
        return stated / max(arm + leaning + of_object, LEANING_GIVE * stated)

    @property
    def _stiffness_share(self) -> float:
        """Of the speed that the stated stiffness allows; in steps where the arm is stiffer here than the reserve
        covers, which is used up where presses or doubt have slowed it already.

        Contacts that were lost and have come back harder than planned show the same in their own way.
        """
        reserve = COVERED if self._of_stiffness == 1.0 else 1.0
        share = min(reserve / self._rise, 1.0)
        share = self._of_stiffness * max(1.0, math.floor(SPEED_STEPS * share)) / SPEED_STEPS
        harder = self._returns.excess if self._returns is not None else 1.0
        return min(share, COVERED / harder) if harder > COVERED else share

    @property
    def _share(self) -> float:
        """Of the speed that the stated delay allows; in steps, so that a plan is not made anew with every sample."""
        if self._delay <= 0.0:
            return 1.0
        return max(1.0, math.floor(SPEED_STEPS * self._delay / (self._delay + self.excess))) / SPEED_STEPS

    def _slowed(self, motion: Motion, wrench: Wrench) -> Motion:
        """The motion at the speed that measured delay and stiffness allow; what leaves too large a force is not slowed.

        With less force it is: where the tip presses slowly and leaves fast, a flat surface is lost again and again.
        """
        late = self._share
        if isinstance(motion, Goal) and motion.speed <= self._approach:
            share = late * self._share_along(motion.pose[:3, 3] - self._place)
            return motion if share == 1.0 else replace(motion, speed=share * motion.speed)
        if isinstance(motion, VelocityCommand):
            share = late * self._share_along(motion.velocity)
            if share == 1.0:
                return motion
            leaving = np.zeros(3)
            if self._normal is not None and float(self._normal @ wrench.world_force) > self._contact.target:
                leaving = max(0.0, float(motion.velocity @ self._normal)) * self._normal
            return replace(motion, velocity=leaving + share * (motion.velocity - leaving))
        return motion

    def _share_along(self, path: np.ndarray) -> float:
        """Share of the speed along a path (3,): another where nothing can be met, or is touched, along the stick."""
        share = self._stiffness_share
        if share == 1.0:
            return 1.0
        if self._normal is not None and abs(float(self._normal @ self._axis)) > ACROSS:
            return share
        along = abs(float(path @ self._axis))
        return share if along > ACROSS * math.sqrt(float(path @ path)) else self._share_across(share)

    def _share_across(self, share: float) -> float:
        """Share of the speed across the stick, where that along it is `share`: the probe's own give, of which all is
        known, adds to that of arm and object.
        """
        series = 1.0 / self._contact.stiffness
        stiffer = (series + self._across) / (series * share / COVERED + self._across)
        share = min(COVERED / stiffer, 1.0)
        return max(1.0, math.floor(SPEED_STEPS * share)) / SPEED_STEPS

    def _forget_presses(self) -> None:
        """Normals were wrong: what presses have shown with them is dropped."""
        if self._press.batches == 0:
            return
        self._press, self._of_stiffness = PressCompliance(self._bend, self._rate), self._at_first
        if self._by_presses:
            self._by_presses, self._compliance = False, 0.0
            self._estimator.set_indentation(1.0 / self._contact.stiffness)

    def _update_from_presses(self) -> None:
        """Presses have shown the stiffness of object and arm: adapt the speeds, and the contacts where it is another.

        Raises TouchRefused where no speed is safe.
        """
        stated = 1.0 / self._contact.stiffness
        if not math.isfinite(self._press.sigma):
            return
        found = self._press.value if self._differs() else stated
        # Speeds follow both by how sure they are: an arm that is hardly known is the one that presses show.
        likely, sigma = self._likely(found, stated)
        # Speeds and one over the damping go with the compliance along the stick, where the probe hardly adds to it.
        share = (likely + self._axial) / (stated + self._axial) / self._doubt(sigma, UNSURE)
        self._of_stiffness = share if COVERED * share < 1.0 else 1.0
        if self._of_stiffness < 1.0:
            law = touch_law(self._scene, self._delay, self._tip_mass, likely)
            if isinstance(law, Refusal):
                raise TouchRefused(f"touch refused: {law.reason}")
        if found != stated or self._by_presses or self._contradicted(self._compliance):
            self._by_presses = found != stated
            self._compliance = found if self._by_presses else 0.0
            self._estimator.set_indentation(found)

    def _likely(self, found: float, stated: float) -> tuple[float, float]:
        """m/N and a share: mean and standard deviation of the stated compliance and that of presses, each by its own
        variance; of the `found` one alone where it contradicts the stated.
        """
        theirs = self._press.sigma
        if found != stated:
            return found, theirs / found
        ours = self._arm_sigma * stated
        mean = (ours**2 * self._press.value + theirs**2 * stated) / (ours**2 + theirs**2)
        return mean, ours * theirs / math.hypot(ours, theirs) / mean

    def _doubt(self, sigma: float, times: float) -> float:
        """How many times larger stiffness times delay may be than likely, beyond what the reserves of the speeds cover.

        `sigma` is the standard deviation of the stiffness over its value; it counts `times`, with the delay's.
        """
        late = self._delay_sigma / self._delay if self._delay > 0.0 else 0.0
        return max((1.0 + times * math.hypot(sigma, late)) / COVERED, 1.0)

    def _contradicted(self, touched: float) -> bool:
        """Whether presses show another compliance than touches did [m/N], 0 for none.

        A touch is fitted over its path, into which a wrong normal brings the surface's; a press over its changes.
        """
        return touched > 0.0 and abs(touched - self._press.value) > APART * self._press.sigma

    def _differs(self) -> bool:
        """Whether presses show another compliance than is stated, by more than both are known.

        An object adds compliance; what takes some away is an arm stiffer than stated.
        """
        stated, found, sigma = 1.0 / self._contact.stiffness, self._press.value, self._press.sigma
        doubt = math.hypot(sigma, self._arm_sigma * stated) if found < stated else sigma
        return abs(found - stated) > APART * doubt

    def _adopt(self, found: float) -> None:
        """A touch has been fitted: subtract its indentation from now on, check the damping against its stiffness."""
        self._compliance = found
        self._estimator.set_indentation(found)
        if found <= 0.0:
            return
        stated = 1.0 / self._contact.stiffness + self._axial
        number = stated / (found + self._axial) / math.e
        self._report["stability_number_found"] = round(number, 4)
        if number > 1.0:
            raise TouchRefused(
                f"touch refused: the surface has {1.0 / found:.3g} N/m where contact.stiffness says "
                f"{self._contact.stiffness:.3g} at most; stability number {number:.3g}, above 1 the force would swing"
            )

    @property
    def planned(self) -> tuple[float, float] | None:
        """N/m along the stick and s of delay, for which the first touches were planned; None before that."""
        return (self._report["stiffness_along_stick"], self._report["delay_s"]) if self._report else None

    def report(self) -> dict[str, Any]:
        """For the summary."""
        found, pressed, stated = self._compliance, self._press.value, 1.0 / self._contact.stiffness
        known = math.isfinite(self._press.sigma)
        report = self._report | {"stiffness_found": round(1.0 / pressed, 1) if known else None}
        if known and (self._of_stiffness < 1.0 or self._differs()):
            slower = self._of_stiffness < 1.0
            report["warnings"] = [
                *report.get("warnings", []),
                f"arm and object have {1.0 / pressed:.3g} N/m along the stick, contact.stiffness says "
                f"{1.0 / stated:.3g}: "
                + ("the probe moves slower" if slower else "contacts are corrected with what was found"),
            ]
        return report | {
            "object_stiffness": round(1.0 / found, 1) if found > 0.0 else None,
            "touches_fitted": self._touch.fitted,
            "limit_cycles": self._cycle.detections if self._cycle is not None else 0,
            **self.zero.report(),
        }
