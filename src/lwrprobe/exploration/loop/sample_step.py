"""One wrench sample: conditioned, made a contact, put into the map, shown to the strategy, answered with a motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lwrprobe.contact import RELIABLE_FROM, UNCONFIRMED, BiasOutcome, Wrench, stick_contact
from lwrprobe.contracts import (
    Contact,
    Doubt,
    Motion,
    Observation,
    PluginError,
    StorageError,
    VelocityCommand,
    WrenchSample,
)
from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.loop.run_record import RunRecord
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.safety.force_guard import ForceGuard
from lwrprobe.exploration.safety.retreat import Retreat
from lwrprobe.exploration.safety.silence_guard import SensorLost, SilenceGuard
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene

DISAGREEING = 3.0
"""Ratio of found to expected disagreement of torque and force from which on presses are not relied on."""
FORGET = 0.5
"""s without a touch, after which the surface is another one for the contact estimator."""
GIVE_WAY = 0.001
"""m off the surface when samples are missing: more than the stick bends under the target force."""
MISSED = 2.5
"""Periods of the sensor between two samples of a touch, from which on the tip has given way meanwhile: the touch begins
anew."""
RATE_SPAN = 0.032
"""s over which the rate is taken at which the stick bends: over one period the force's noise would show."""
SETTLED = 3
"""Samples of one touch before its contacts are stored: until then the slip that friction opposes is the approach's."""


class SampleStep:
    """Takes one wrench sample through the pipeline.

    Parameters
    ----------
    scene : contact and motion settings
    pipeline : its stages
    arm : where the tip was at the sample's instant
    request : takes the strategy's motion
    recorder, record : contacts go to the one, path and forces to the other
    clock : takes the time of each stage
    silence : counts usable samples
    confirm : asks the operator for the first motions, None = does not ask

    Attributes
    ----------
    zero_time : s on the arm's clock at which the run begins
    observation : the last one, None before the first sample
    force_guard : how often it took over
    retreat : where the tip was
    """

    def __init__(
        self,
        scene: Scene,
        pipeline: Pipeline,
        arm: ArmMotion,
        request: MotionRequest,
        recorder: Recorder,
        record: RunRecord,
        clock: StageClock,
        silence: SilenceGuard,
        confirm: Confirm | None,
    ) -> None:
        self._pipeline, self._arm, self._request = pipeline, arm, request
        self._recorder, self._record, self._clock = recorder, record, clock
        self._silence, self._confirm = silence, confirm
        self._strategy_name = scene.strategy.name
        self._missed = MISSED / scene.sensor.rate
        self._give_way = VelocityCommand(np.zeros(3), GIVE_WAY / scene.motion.contour_speed, "sensor silent")
        self._way_speed = scene.motion.contour_speed
        contact, torque = scene.contact, scene.safety.torque_share * pipeline.probe.torque_range
        self._threshold, self._light = float(contact.threshold), 0.5 * contact.target
        self.force_guard = ForceGuard(contact.limit, contact.target, 2.0 * scene.motion.contour_speed, torque)
        self.retreat = Retreat(scene.safety.lift)
        self.zero_time = 0.0
        self.observation: Observation | None = None
        self._last_touch, self._touch_age = -np.inf, 0
        self._shifts: deque[tuple[float, np.ndarray]] = deque(
            maxlen=max(round(RATE_SPAN * scene.sensor.rate), 1) + 1
        )  # s and m: how far the sphere is from the unloaded tip

    def watch(self, sample: WrenchSample) -> Wrench:
        """Condition a sample that the strategy is not shown; its force counts for the peak.

        Raises SensorLost where the sensor cannot be relied on.
        """
        arm, bag = self._arm, self._recorder.bag
        pose, velocity = arm.history.tip_at(sample.time)
        if bag is not None:
            measured, gain = arm.history.measured_velocity(sample.time), arm.history.acceleration
            bag.sample(sample, arm.time, gain, False, "", pose, velocity, measured, arm.history.q, shown=False)
            bag.flush_when_due()
        wrench = self._conditioned(sample, pose[:3, :3])
        if wrench.usable:
            self._record.note_unseen(wrench.magnitude)
        return wrench

    def give_way(self) -> None:
        """Samples are missing: leave what was touched last, a little, and stand still."""
        normal = self.retreat.normal
        velocity = np.zeros(3) if normal is None else self._way_speed * normal
        self._request.adopt(replace(self._give_way, velocity=velocity), urgent=True)

    def interrupt(self, why: str) -> None:
        """The strategy has to wait."""
        if self._recorder.bag is not None:
            self._recorder.bag.interrupted(why)

    def check_zero(self, samples: Sequence[WrenchSample], since: float, rotation: np.ndarray) -> BiasOutcome:
        """Take the sensor's zero from those of the samples at rest that are later than `since` s.

        Where it agrees with the zero before; `rotation` (3, 3) is the sensor's in the world.
        """
        if self._recorder.bag is not None:
            self._recorder.bag.zero_checked(len(samples), since, rotation)
        conditioner = self._pipeline.conditioner
        later = [sample for sample in samples if sample.time > since]
        return conditioner.take_bias(later, rotation, 0.5 * self._threshold, conditioner.bias)

    def resume(self, pause: float) -> None:
        """The strategy goes on after a pause [s] that it is not shown."""
        if self._recorder.bag is not None:
            self._recorder.bag.went_on(pause)
        self.zero_time += pause
        self._last_touch += pause
        self._touch_age = 0
        self.force_guard.forget()
        self._pipeline.estimator.reset()
        self._record.interrupt()
        if self._pipeline.sweep is not None:
            self._pipeline.sweep.leave()

    def process(self, sample: WrenchSample) -> Observation:
        """Process one sample; returns the observation that the strategy was shown.

        Raises SensorLost where the sensor cannot be relied on, SafetyStop and PluginError.
        """
        clock, pipeline, arm = self._clock, self._pipeline, self._arm
        pose, velocity = arm.history.tip_at(sample.time)
        bag = self._recorder.bag
        if bag is not None:
            arrived, blocked = pipeline.trajectory.arrived, arm.blocked
            measured, gain = arm.history.measured_velocity(sample.time), arm.history.acceleration
            bag.sample(sample, arm.time, gain, arrived, blocked, pose, velocity, measured, arm.history.q)
            clock.lap("bag")
        rotation, place = pose[:3, :3], pose[:3, 3].copy()  # kernels take their vectors in one piece
        wrench = self._conditioned(sample, rotation)
        clock.lap("condition")
        size = wrench.magnitude
        if size > self._light:
            self._record.note_range(wrench)
        contact = self._contact(sample, wrench, size, place, rotation)
        confirmed = not wrench.status & UNCONFIRMED
        torque = pipeline.torque
        pipeline.force.update(wrench, pose, contact, torque is None or torque.surprise < DISAGREEING)
        time = sample.time - self.zero_time
        if pipeline.object_motion is not None and pipeline.force.settled and confirmed:
            doubt = torque.disagreement if torque is not None and torque.surprise > 1.0 else 0.0
            pipeline.object_motion.see(time, place, wrench.world_force, contact, pipeline.force.compliance, doubt)
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
            goal_reached=pipeline.trajectory.arrived,
            blocked=arm.blocked,
        )
        self._answer(seen, wrench, confirmed)
        self.retreat.note(place, contact.normal if contact is not None else None)
        self._record.note(seen, place, size)
        clock.lap("record")
        if bag is not None:
            bag.decided(seen, self._request.asked, pipeline.strategy.progress, pipeline.voxels, arm.history.q)
            clock.lap("bag")
        self.observation = seen
        return seen

    def _conditioned(self, sample: WrenchSample, rotation: np.ndarray) -> Wrench:
        conditioner = self._pipeline.conditioner
        wrench = conditioner.condition(sample, rotation)
        self._silence.update(sample.status | wrench.status)
        failing = conditioner.failing
        if failing:
            raise SensorLost(f"the sensor cannot be relied on: {failing}")
        return wrench

    def _contact(
        self,
        sample: WrenchSample,
        wrench: Wrench,
        size: float,
        place: np.ndarray,
        rotation: np.ndarray,
    ) -> Contact | None:
        """The contact of a sample above the threshold, stored where it can be trusted; else free space is recorded."""
        clock, pipeline = self._clock, self._pipeline
        if size < self._threshold:
            self._touch_age = 0
            if pipeline.sweep is not None:
                pipeline.sweep.move_to(place)
                clock.lap("carve")
            return None
        passed = sample.time - self._last_touch
        if passed > self._missed:
            self._touch_age = 0
        if passed > FORGET:
            pipeline.estimator.reset()
        self._last_touch = sample.time
        centre = place
        if pipeline.deflection is not None:
            centre = pipeline.deflection.centre(place, rotation, wrench.world_force)
        velocity = self._arm.history.measured_velocity(sample.time)
        if self._touch_age == 0:
            self._shifts.clear()
        self._shifts.append((sample.time, centre - place))
        (first, before), (last, now) = self._shifts[0], self._shifts[-1]
        if last > first:  # while the force changes, sphere and tip move differently
            velocity = velocity + (now - before) / (last - first)
        measured = wrench
        if pipeline.torque is not None:
            wrench, lever_error = pipeline.torque.corrected(measured)
            pipeline.estimator.set_lever_error(lever_error)
        contact = pipeline.estimator.estimate(wrench, centre, rotation, velocity)
        if pipeline.torque is not None:
            pipeline.torque.learn(measured, rotation, velocity)
        contact.time = sample.time - self.zero_time
        if contact.reason is Doubt.AXIS_MISSES:
            point = stick_contact(wrench, centre, rotation, pipeline.probe)
            contact.point = contact.point if point is None else point
        clock.lap("estimate")
        self._touch_age += 1
        # A light touch says little: the error of its normal goes with one over the force.
        settled = self._touch_age > SETTLED and size >= self._light
        if contact.confidence_score >= RELIABLE_FROM and settled and pipeline.force.settled:
            pipeline.add_point(contact.point)
            clock.lap("map")
            self._recorder.contact(contact, sample.sequence, (self._arm.history.q.copy(), velocity))
            clock.lap("record")
        if pipeline.sweep is not None:
            pipeline.sweep.leave()
        return contact

    def _answer(self, seen: Observation, wrench: Wrench, confirmed: bool) -> None:
        """The strategy's motion, or the force guard's, to the generator."""
        arm, force = self._arm, self._pipeline.force
        force.excess = arm.excess.seconds
        override = self.force_guard.check(arm.time, wrench.world_force, wrench.torque, confirmed)
        motion: Motion
        if confirmed or override is None:
            self._request.asked = self._ask(seen)
            motion = force.limit(self._request.asked, wrench, arm.history.acceleration)
        else:
            motion = override  # maybe a spike: the strategy is not shown it, the tip holds still until the next sample
        self._clock.lap("strategy")
        if self._confirm is not None and override is None:
            motion = self._confirm.filter(motion)
        self._request.adopt(override or motion, urgent=override is not None)
        self._clock.lap("trajectory")

    def _ask(self, seen: Observation) -> Motion:
        try:
            return self._pipeline.strategy.step(seen)
        except StorageError:
            raise
        except Exception as error:
            raise failed(self._strategy_name, error) from error


def failed(name: str, error: Exception) -> PluginError:
    """A strategy's error in words that name the strategy."""
    return PluginError(f"strategy plug-in {name!r} failed: {type(error).__name__}: {error}")
