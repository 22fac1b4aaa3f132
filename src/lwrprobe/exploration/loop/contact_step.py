"""From the conditioned wrench of one sample to a contact, stored where it can be trusted."""

from __future__ import annotations

from collections import deque

import numpy as np

from lwrprobe.contact import Wrench, stick_contact
from lwrprobe.contracts import Confidence, Contact, Doubt, WrenchSample
from lwrprobe.exploration.loop.loop_parts import LoopParts

FORGET = 0.5
"""s without a touch, after which the surface is another one for the contact estimator."""
MISSED = 2.5
"""Periods of the sensor between two samples of a touch, from which on the tip has given way meanwhile: the touch begins
anew."""
RATE_SPAN = 0.032
"""s over which the rate is taken at which the stick bends: over one period the force's noise would show."""
SETTLED = 3
"""Samples of one touch before its contacts are stored: until then the slip that friction opposes is the approach's."""


class ContactStep:
    """Estimates the contact of a sample; without one the sphere's path is recorded as free space."""

    def __init__(self, parts: LoopParts) -> None:
        scene = parts.scene
        self._pipeline, self._arm, self._recorder, self._clock = parts.pipeline, parts.arm, parts.recorder, parts.clock
        self._threshold, self._light = float(scene.contact.threshold), 0.5 * scene.contact.target
        self._missed = MISSED / scene.sensor.rate
        self._last_touch, self._touch_age = -np.inf, 0
        self._shifts: deque[tuple[float, np.ndarray]] = deque(
            maxlen=max(round(RATE_SPAN * scene.sensor.rate), 1) + 1
        )  # s and m: how far the sphere is from the unloaded tip

    def find(
        self, sample: WrenchSample, wrench: Wrench, place: np.ndarray, rotation: np.ndarray, time: float
    ) -> Contact | None:
        """The contact of a sample above the threshold, else None.

        Parameters
        ----------
        place, rotation : (3,) m and (3, 3), the unloaded tip at the sample's instant
        time : s since the start of the run
        """
        sweep, size = self._pipeline.sweep, wrench.magnitude
        if size < self._threshold:
            self._touch_age = 0
            if sweep is not None:
                sweep.move_to(place)
                self._clock.lap("carve")
            return None
        self._go_on(sample.time)
        centre = place
        if self._pipeline.deflection is not None:
            centre = self._pipeline.deflection.centre(place, rotation, wrench.world_force)
        velocity = self._sphere_velocity(sample.time, centre - place)
        contact = self._estimate(wrench, centre, rotation, velocity)
        contact.time = time
        self._clock.lap("estimate")
        self._touch_age += 1
        # A light touch says little: the error of its normal goes with one over the force.
        settled = self._touch_age > SETTLED and size >= self._light
        if contact.confidence is Confidence.RELIABLE and settled and self._pipeline.force.stiffness.settled:
            self._pipeline.add_point(contact.point)
            self._clock.lap("map")
            self._recorder.contact(contact, sample.sequence, (self._arm.history.q.copy(), velocity))
            self._clock.lap("record")
        elif contact.confidence_score > 0.0:
            self._recorder.touch(contact, self._pipeline.probe.radius)
        if sweep is not None:
            sweep.leave()
        return contact

    def resume(self, pause: float) -> None:
        """What is touched after a pause [s] is touched anew."""
        self._last_touch += pause
        self._touch_age = 0
        self._pipeline.estimator.reset()

    def _go_on(self, time: float) -> None:
        """A sample above the threshold: the same touch as the last one, or another."""
        passed = time - self._last_touch
        if passed > self._missed:
            self._touch_age = 0
        if passed > FORGET:
            self._pipeline.estimator.reset()
        if self._touch_age == 0:
            self._shifts.clear()
        self._last_touch = time

    def _estimate(self, measured: Wrench, centre: np.ndarray, rotation: np.ndarray, velocity: np.ndarray) -> Contact:
        pipeline, wrench = self._pipeline, measured
        if pipeline.torque is not None:
            wrench, lever_error = pipeline.torque.corrected(measured)
            pipeline.estimator.set_lever_error(lever_error)
        contact = pipeline.estimator.estimate(wrench, centre, rotation, velocity)
        if pipeline.torque is not None:
            pipeline.torque.learn(measured, rotation, velocity)
        if contact.reason is Doubt.AXIS_MISSES:
            point = stick_contact(wrench, centre, rotation, pipeline.probe)
            contact.point = contact.point if point is None else point
        return contact

    def _sphere_velocity(self, time: float, shift: np.ndarray) -> np.ndarray:
        """(3,) m/s, of the sphere, which is a shift (3,) m off the unloaded tip."""
        velocity = self._arm.history.measured_velocity(time)
        self._shifts.append((time, shift))
        (first, before), (last, now) = self._shifts[0], self._shifts[-1]
        # While the force changes, sphere and tip move differently.
        return velocity + (now - before) / (last - first) if last > first else velocity
