"""The force of a run's contacts: speeds that are safe for what is touched, the sensor's zero, and oscillations."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lwrprobe.contact import Deflection, Estimator, LimitCycle, ReturnPeaks, TouchRises, Wrench, WrenchConditioner
from lwrprobe.contracts import Contact, Goal, Motion, Probe, SafetyStop, VelocityCommand
from lwrprobe.control import RETURN, ForceLaw, Refusal
from lwrprobe.exploration.stages.found_stiffness import FoundStiffness
from lwrprobe.exploration.stages.sensor_zero import SensorZero
from lwrprobe.exploration.stages.speed_share import SpeedShare
from lwrprobe.exploration.stages.touch_law import touch_law
from lwrprobe.scene import Scene


class TouchRefused(SafetyStop):
    """There is no safe way to touch this; the message has the numbers."""


class ForceStage:
    """Watches every sample of a run, and slows the motions that a strategy asks for.

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
        self._scene, self._contact, self._rate = scene, scene.contact, rate
        self._approach = self._touch_speed = scene.motion.approach_speed
        self._bend = Deflection(probe)
        self.learns = True
        """Whether touches and presses show the stiffness. With a probe that is not calibrated they do not: across the
        stick, a fifth of its compliance is more than all of the arm's."""
        self.stiffness = FoundStiffness(scene, self._bend, estimator, rate)
        self.speeds = SpeedShare(scene, probe, self.stiffness.arm_sigma)
        self.zero = SensorZero(scene, probe, conditioner)
        self.rises = TouchRises(scene.contact.threshold)
        """Of all touches, for what is learnt of the stiffness after the run."""
        self._tip_mass = 0.0
        self._normal: np.ndarray | None = None
        self._pose, self._gives = np.eye(4), 0.0
        self._cycle: LimitCycle | None = None
        self._returns: ReturnPeaks | None = None
        self._report: dict[str, Any] = {}

    def begin(self, delay: float, stated: float | None = None, tip_mass: float = 0.0) -> None:
        """Choose speeds and damping for what the scene says of the surface; raises TouchRefused where none is safe.

        `delay` is the loop's in s, `stated` what scene and devices say of it, where it was measured to be longer;
        `tip_mass` kg is the arm's as its tip shows it.
        """
        c = self._contact
        series = 1.0 / (self.stiffness.stated + self.speeds.axial)
        self._report = {"delay_s": round(delay, 6), "stiffness_along_stick": round(series, 1)}
        if tip_mass > 0.0:
            self._report["arm_mass_at_tip_kg"] = round(tip_mass, 3)
        self._tip_mass = tip_mass
        self.speeds.begin(delay)
        self._cycle = LimitCycle(c.target, delay, 1.0 / self._rate, band=0.5 * c.target)
        self._returns = ReturnPeaks(max(RETURN * c.target, 1.5 * c.threshold), c.threshold, delay)
        law = touch_law(self._scene, delay, tip_mass, max_speed=1.0)
        if isinstance(law, Refusal):
            self._report["refused"] = law.reason
        law = _allowed(law)
        slower = []
        if stated is not None and delay > stated:
            slower = [
                f"the loop reacts after {1e3 * delay:.1f} ms, scene and devices state {1e3 * stated:.1f} ms: the probe "
                "moves slower"
            ]
        self._touch_speed = min(self._approach, law.approach_speed)
        self._follow_presses()  # of the part before, where a run is resumed
        self._report |= {
            "stability_number": round(law.stability_number, 4),
            "damping": round(law.damping, 3),
            "safe_approach_mm_s": round(1e3 * law.approach_speed, 4),
            "warnings": [*slower, *law.warnings],
        }

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
        self._watch_swinging(wrench, contact)
        self._pose, self._normal = pose, contact.normal if contact is not None else None
        self.speeds.at(pose)
        if contact is not None:
            self._gives = self.stiffness.used + self._bend.along(pose[:3, :3], contact.normal)
        if not self.learns:
            return
        self.rises.update(wrench, pose[:3, 3], wrench.time if time is None else time)
        if self.stiffness.touch(wrench, pose, contact):
            self._check_damping()
        if not certain:
            if self.stiffness.forget_presses():
                self.speeds.forget_stiffness()
        elif self._tip_mass == 0.0 and self.stiffness.press(wrench, pose, contact, self.speeds.rise):
            # An arm with mass hardly moves while the force changes: its quick presses show the object alone.
            self._follow_presses()

    def limit(self, motion: Motion, wrench: Wrench, acceleration: float) -> Motion:
        """The motion, slowed while the force oscillates; a contact is interrupted where the sensor's zero asks for it.

        `acceleration` m/s^2 of the tip, see `SensorZero.lift`.
        """
        place, axis = self._pose[:3, 3], self._pose[:3, 2]
        lift = self.zero.lift(motion, wrench, place, self._normal, self._gives, acceleration, axis)
        if lift is not None:
            return lift
        motion = self._slowed(motion, wrench)
        if self._cycle is None or self._cycle.scale == 1.0 or not isinstance(motion, VelocityCommand):
            return motion
        return replace(motion, velocity=motion.velocity * self._cycle.scale)

    @property
    def touch_speed(self) -> float:
        """m/s at which something may be met in any direction, as late as the loop is now."""
        return self._touch_speed * self.speeds.everywhere

    @property
    def planned(self) -> tuple[float, float] | None:
        """N/m along the stick and s of delay, for which the first touches were planned; None before that."""
        return (self._report["stiffness_along_stick"], self._report["delay_s"]) if self._report else None

    def report(self) -> dict[str, Any]:
        """For the summary."""
        stiffness, report = self.stiffness, dict(self._report)
        pressed, _ = stiffness.pressed
        if stiffness.known and (self.speeds.stiffer or stiffness.differs):
            report["warnings"] = [
                *report.get("warnings", []),
                f"arm and object have {1.0 / pressed:.3g} N/m along the stick, contact.stiffness says "
                f"{1.0 / stiffness.stated:.3g}: "
                + ("the probe moves slower" if self.speeds.stiffer else "contacts are corrected with what was found"),
            ]
        return report | {
            "stiffness_found": round(1.0 / pressed, 1) if stiffness.known else None,
            "object_stiffness": round(1.0 / stiffness.compliance, 1) if stiffness.compliance > 0.0 else None,
            "touches_fitted": stiffness.touches_fitted,
            "limit_cycles": self._cycle.detections if self._cycle is not None else 0,
            **self.zero.report(),
        }

    def _watch_swinging(self, wrench: Wrench, contact: Contact | None) -> None:
        """Whether the force oscillates, and how hard a contact that was lost comes back."""
        if self._cycle is None or self._returns is None:
            return
        if contact is None:
            self._cycle.lose(wrench.time)
            self._returns.lose(wrench.time)
        else:
            force = float(contact.normal @ wrench.world_force)
            self._cycle.update(wrench.time, force)
            self._returns.update(wrench.time, force, self.speeds.everywhere * self._cycle.scale)
        self.speeds.harder = self._returns.excess

    def _slowed(self, motion: Motion, wrench: Wrench) -> Motion:
        """The motion at the speed that measured delay and stiffness allow; what leaves too large a force is not slowed.

        With less force it is: where the tip presses slowly and leaves fast, a flat surface is lost again and again.
        """
        if isinstance(motion, Goal) and motion.speed <= self._approach:
            share = self.speeds.along(motion.pose[:3, 3] - self._pose[:3, 3], self._normal)
            return motion if share == 1.0 else replace(motion, speed=share * motion.speed)
        if isinstance(motion, VelocityCommand):
            share = self.speeds.along(motion.velocity, self._normal)
            if share == 1.0:
                return motion
            leaving = np.zeros(3)
            if self._normal is not None and float(self._normal @ wrench.world_force) > self._contact.target:
                leaving = max(0.0, float(motion.velocity @ self._normal)) * self._normal
            return replace(motion, velocity=leaving + share * (motion.velocity - leaving))
        return motion

    def _follow_presses(self) -> None:
        """Presses have shown the stiffness of object and arm: adapt the speeds, and the contacts where it is another.

        Raises TouchRefused where no speed is safe.
        """
        if not self.stiffness.known:
            return
        # Speeds follow both by how sure they are: an arm that is hardly known is the one that presses show.
        likely, sigma = self.stiffness.likely()
        self.speeds.follow(likely, sigma)
        if self.speeds.stiffer:
            _allowed(touch_law(self._scene, self.speeds.delay, self._tip_mass, likely))
        self.stiffness.use_presses()

    def _check_damping(self) -> None:
        """Touches have shown how soft the surface is; raises TouchRefused where the damping is too low for it."""
        found, contact = self.stiffness.compliance, self._contact
        series = self.stiffness.stated + self.speeds.axial
        number = series / (found + self.speeds.axial) / math.e
        self._report["stability_number_found"] = round(number, 4)
        if number > 1.0:
            raise TouchRefused(
                f"touch refused: the surface has {1.0 / found:.3g} N/m where contact.stiffness says "
                f"{contact.stiffness:.3g} at most; stability number {number:.3g}, above 1 the force would swing"
            )


def _allowed(law: ForceLaw | Refusal) -> ForceLaw:
    if isinstance(law, Refusal):
        raise TouchRefused(f"touch refused: {law.reason}")
    return law
