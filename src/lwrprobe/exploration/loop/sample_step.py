"""One wrench sample: conditioned, made a contact, put into the map, shown to the strategy, answered with a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lwrprobe.contact import UNCONFIRMED, Wrench
from lwrprobe.contracts import Contact, Observation, VelocityCommand, WrenchSample
from lwrprobe.exploration.loop.answer_step import AnswerStep
from lwrprobe.exploration.loop.contact_step import ContactStep
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.safety.retreat import Retreat
from lwrprobe.exploration.safety.silence_guard import SensorLost

DISAGREEING = 3.0
"""Ratio of found to expected disagreement of torque and force from which on presses are not relied on."""
GIVE_WAY = 1.5
"""Times the way that takes the last force away, by which the tip gives way when samples are missing."""
MOST_WAY = 0.001
"""m of that way: more than the stick bends under the target force."""


class SampleStep:
    """Takes one wrench sample through the pipeline, in `process`.

    Attributes
    ----------
    zero_time : s on the arm's clock at which the run begins
    observation : the last one, None before the first sample
    force_guard : how often it took over
    retreat : where the tip was
    """

    def __init__(self, parts: LoopParts) -> None:
        scene = parts.scene
        self._pipeline, self._arm, self._request = parts.pipeline, parts.arm, parts.request
        self._bag, self._record, self._clock = parts.recorder.bag, parts.record, parts.clock
        self._silence = parts.silence
        self._contact, self._answer = ContactStep(parts), AnswerStep(parts)
        self._light, self._give_way_speed = 0.5 * scene.contact.target, scene.motion.contour_speed
        self._give_way = VelocityCommand(np.zeros(3), reason="sensor silent")
        self._series = 1.0 / scene.contact.stiffness  # m/N
        self.force_guard = self._answer.force_guard
        self.retreat = Retreat(scene.safety.lift, float(scene.area.lower[2]))
        self.zero_time = 0.0
        self.observation: Observation | None = None
        self._resumed = False  # and the strategy has not answered since

    def process(self, sample: WrenchSample) -> Observation:
        """Process one sample; returns the observation that the strategy was shown.

        Raises SensorLost where the sensor cannot be relied on, SafetyStop and PluginError.
        """
        clock, pipeline, arm = self._clock, self._pipeline, self._arm
        pose, velocity = self.located(sample)
        rotation, place = pose[:3, :3], pose[:3, 3].copy()  # kernels take their vectors in one piece
        wrench = self.conditioned(sample, rotation)
        clock.lap("condition")
        time = sample.time - self.zero_time
        contact = self._contact.find(sample, wrench, place, rotation, time)
        confirmed = not wrench.status & UNCONFIRMED
        self._watch(time, pose, place, wrench, contact, confirmed)
        clock.lap("watch")
        near = pipeline.clearance.nearest(pose, arm.history.q) if pipeline.clearance is not None else None
        clock.lap("clearance")
        seen = Observation(
            time=time,
            pose=pose,
            velocity=velocity,
            force=wrench.world_force,
            contact=contact,
            clearance=near,
            goal_reached=self._goal_reached,
            blocked=arm.blocked,
        )
        self._answer.answer(seen, wrench, confirmed)
        self._resumed = False
        self._note(seen, place, wrench)
        self.observation = seen
        return seen

    def give_way(self) -> None:
        """Samples are missing: go where the force that was measured last is gone, and stand still.

        The way is what stick, arm and object give under that force. Along the normal it would be longer, and where the
        normal is wrong it could lead into a surface.
        """
        seen, deflection = self.observation, self._pipeline.deflection
        way = np.zeros(3)
        if seen is not None and seen.contact is not None:
            way = GIVE_WAY * self._series * seen.force
            if deflection is not None:
                way += GIVE_WAY * deflection.shift(seen.pose[:3, :3], seen.force)
        length = float(np.linalg.norm(way))
        command = self._give_way
        if length > 0.0:
            speed = self._give_way_speed
            command = replace(command, velocity=way * (speed / length), hold=min(length, MOST_WAY) / speed)
        self._request.adopt(command, urgent=True)

    @property
    def _goal_reached(self) -> bool:
        """Whether the strategy's goal is reached: after a pause what the generator has reached is the way back."""
        return self._pipeline.trajectory.arrived and not self._resumed

    def resume(self, pause: float) -> None:
        """The strategy goes on after a pause [s] that it is not shown."""
        self._resumed = True
        self.zero_time += pause
        self._contact.resume(pause)
        self.force_guard.forget()

    def located(self, sample: WrenchSample, shown: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Pose (4, 4) and velocity (3,) m/s of the tip at a sample's instant; the bag gets the sample with both.

        `shown` : to the strategy
        """
        arm, bag = self._arm, self._bag
        pose, velocity = arm.history.tip_at(sample.time)
        if bag is not None:
            bag.sample(sample, arm, self._goal_reached, pose, velocity, shown)
            if shown:
                self._clock.lap("bag")
        return pose, velocity

    def conditioned(self, sample: WrenchSample, rotation: np.ndarray) -> Wrench:
        """The wrench of a sample with the sensor turned as (3, 3); raises SensorLost where it cannot be relied on."""
        conditioner = self._pipeline.conditioner
        wrench = conditioner.condition(sample, rotation)
        self._silence.update(sample.status | wrench.status)
        failing = conditioner.failing
        if failing:
            raise SensorLost(f"the sensor cannot be relied on: {failing}")
        return wrench

    def _watch(
        self, time: float, pose: np.ndarray, place: np.ndarray, wrench: Wrench, contact: Contact | None, confirmed: bool
    ) -> None:
        """What a sample says of the stiffness, and of whether the object stays where it is."""
        pipeline, torque = self._pipeline, self._pipeline.torque
        pipeline.force.update(wrench, pose, contact, torque is None or torque.surprise < DISAGREEING, time)
        if pipeline.object_motion is not None and pipeline.force.stiffness.settled and confirmed:
            doubt = torque.doubt if torque is not None else 0.0
            force = pipeline.force
            zero = force.zero.error(time)
            pipeline.object_motion.see(
                time, place, wrench.world_force, contact, force.stiffness.compliance, doubt, zero, pose[:3, 2]
            )

    def _note(self, seen: Observation, place: np.ndarray, wrench: Wrench) -> None:
        """What the run adds up, and the return path."""
        pipeline, contact, size = self._pipeline, seen.contact, wrench.magnitude
        if size > self._light:
            self._record.note_range(wrench)
        self.retreat.note(place, None if contact is None else contact.normal)
        self._record.note(seen, place, size)
        self._clock.lap("record")
        if self._bag is not None:
            self._bag.decided(seen, self._request.asked, pipeline.progress, pipeline.voxels, self._arm.history.q)
            self._clock.lap("bag")
