"""Back into motion after an interruption: off the surface, the sensor's zero checked, back to where the tip was.

The strategy is not shown any of this. For it no time passes: it goes on with the next sample as after a contact that
was lost for a moment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from time import sleep
from typing import Any

import numpy as np

from lwrprobe.contact import Wrench
from lwrprobe.contracts import DriverError, MotionInterrupted, RestartableArm, SafetyStop, WrenchSample
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.loop.paused_strategy import PausedStrategy
from lwrprobe.exploration.loop.sample_step import SampleStep
from lwrprobe.exploration.safety.silence_guard import SensorLost, SensorSilent

LOOK = 0.1
"""s at rest, over which the force is looked at before anything moves."""
ZERO = 0.4
"""s at rest, over which the sensor's zero is checked."""
BACK = 5
"""Usable samples in a row after which a stream is back."""
TRIES = 3
"""Places, each farther back, at which the zero is looked for."""
RISE = 0.5
"""N by which a force above the limit may rise while the probe begins to leave it."""
LEG_TIME = 20.0
"""s for one leg of the return path at most."""
_PAUSE = 0.05  # s


@dataclass(slots=True, frozen=True)
class Interruption:
    """One interruption that the run has survived.

    Attributes
    ----------
    time_s : s of the run's time, which stood still meanwhile
    device : `arm` or `sensor`
    reason : one sentence
    pause_s : s on the robot's clock until the strategy went on
    """

    time_s: float
    device: str
    reason: str
    pause_s: float


class Recovery:
    """Takes the arm back into motion, within the bounds that the scene's `[safety]` sets.

    Parameters
    ----------
    parts : of the loop
    devices : arm and sensor
    sample : what the strategy was shown last, and where the tip was free
    message : called with a sentence for the operator

    Attributes
    ----------
    interruptions : those that were survived, oldest first
    """

    def __init__(self, parts: LoopParts, devices: Devices, sample: SampleStep, message: Callable[[str], None]) -> None:
        scene = parts.scene
        self._safety, self._threshold = scene.safety, float(scene.contact.threshold)
        self._limit, self._speed = float(scene.contact.limit), float(scene.motion.approach_speed)
        self._pipeline, self._devices, self._arm = parts.pipeline, devices, parts.arm
        self._sample, self._paused, self._silence = sample, PausedStrategy(parts, sample), parts.silence
        self._confirm, self._message = parts.confirm, message
        self._return_path: list[np.ndarray] = []
        self._received = 0.0
        self._attempts = 0
        self.interruptions: list[Interruption] = []

    def table(self) -> list[dict[str, Any]]:
        """For the summary."""
        return [asdict(one) for one in self.interruptions]

    def after_stop(self, cause: MotionInterrupted) -> None:
        """Set an arm in motion that has stopped by itself, also where it does so once more on the return path.

        Raises what ends the run where that may not or cannot be.
        """
        begin = self._arm.time
        while True:
            try:
                return self._after_stop(cause, begin)
            except MotionInterrupted as again:
                if again is cause:
                    raise
                cause = again

    def _after_stop(self, cause: MotionInterrupted, begin: float) -> None:
        device, seen = self._devices.arm, self._sample.observation
        if not isinstance(device, RestartableArm) or seen is None:
            raise cause
        if self._confirm is None and not cause.unasked:
            raise cause
        allowed = self._safety.reentries
        if self._attempts >= allowed:
            raise SafetyStop(f"{cause}; not re-entered: safety.reentries allows {allowed}") from cause
        self._attempts += 1
        self._message(f"interrupted: {cause}")
        self._paused.interrupt(str(cause))
        asked = self._asked(cause)
        try:
            device.reenter(self._safety.reentry_time, asked)
            self._arm.rest(device.read())
        except DriverError as error:
            raise DriverError(f"{cause}; not re-entered: {error}") from error
        self._go_on(cause, "arm", begin, seen.pose)

    def after_silence(self, cause: SensorSilent) -> None:
        """Retreat without a sensor and wait for it; raises SensorSilent where it stays silent."""
        begin, seen = self._arm.time, self._sample.observation
        # Before the strategy has seen anything, the arm is where it started.
        back = self._pipeline.trajectory.pose.copy() if seen is None else seen.pose
        self._received = begin - self._silence.silent
        self._message(f"interrupted: {cause}")
        self._paused.interrupt(str(cause))
        self._pipeline.trajectory.stop()
        self._arm.finish_plan(1.0)
        self._retreat(self._safety.retreat)
        in_a_row = 0
        while in_a_row < BACK:
            elapsed = self._arm.time - self._received
            if elapsed > self._safety.sensor_wait:
                allowed = self._safety.sensor_wait
                raise SensorSilent(f"no usable wrench sample for {elapsed:.3f} s (allowed {allowed:.3f} s)")
            self._arm.hold()
            for sample in self._samples():
                in_a_row = in_a_row + 1 if self._watch(sample).usable else 0
        self._go_on(cause, "sensor", begin, back)

    def _asked(self, cause: MotionInterrupted) -> bool:
        """Whether the operator has allowed it; waits for that where there is one. Raises SafetyStop on a no."""
        if self._confirm is None:
            return False
        what = f"back into motion after: {cause}"
        while not self._confirm.ask(("re-entry", len(self.interruptions)), what):
            try:
                self._devices.arm.read()
            except DriverError:
                sleep(_PAUSE)  # nothing comes from an arm that has been left alone
        return True

    def _go_on(self, cause: Exception, device: str, begin: float, pose: np.ndarray) -> None:
        """From where the arm rests to the pose (4, 4) in which it was, over a place that is free."""
        self._release()
        self._check_zero()
        self._return(pose)
        self._sample.retreat.note(self._tip, self._sample.retreat.normal)
        pause = self._arm.time - begin
        self._paused.resume(pause)
        self._silence.forget()
        self._arm.blocked = ""
        time = begin - self._sample.zero_time + pause
        self.interruptions.append(Interruption(round(time, 3), device, str(cause), round(pause, 3)))
        self._message(f"went on after {pause:.1f} s")

    def _release(self) -> None:
        """Off what the probe touches, as the force tells it now."""
        begin, rows = self._rest(LOOK)
        usable = [wrench.world_force for sample, wrench in rows if wrench.usable and sample.time > begin]
        if not usable:
            raise SensorSilent("no usable wrench sample while the arm rests")
        force = np.mean(usable, axis=0)
        size = float(np.linalg.norm(force))
        if size > 0.5 * self._threshold:
            self._sample.retreat.note(self._tip, force / size)
            self._return_path = []
        if self._sample.retreat.normal is not None and not self._return_path:
            self._retreat(self._safety.lift)

    def _check_zero(self) -> None:
        """Take the sensor's zero where it agrees with the one before; raises SafetyStop where no place does."""
        reason = ""
        for attempt in range(TRIES):
            if attempt:
                self._retreat(self._safety.retreat)
            rotation = self._pipeline.trajectory.pose[:3, :3].copy()
            begin, rows = self._rest(ZERO)
            found = self._paused.check_zero([sample for sample, _ in rows], begin, rotation)
            if found.taken:
                return
            reason = found.reason
        raise SafetyStop(f"the sensor's zero cannot be checked after an interruption: {reason}")

    def _retreat(self, length: float) -> None:
        """Off the surface and back on the tip's own path, which was free a moment ago."""
        places = self._sample.retreat.places(self._tip, length)
        for place in places:
            self._return_path.append(self._tip)
            self._leg(place, self._pipeline.trajectory.pose, touch=False)

    def _return(self, pose: np.ndarray) -> None:
        """Back on the same places, and to the pose (4, 4); the first touch ends it."""
        path, self._return_path = self._return_path, []
        for place in reversed(path[1:]):
            if self._leg(place, pose, touch=True):
                return
        self._leg(pose[:3, 3], pose, touch=True, speed=min(self._speed, self._pipeline.force.touch_speed))

    def _leg(self, place: np.ndarray, pose: np.ndarray, touch: bool, speed: float | None = None) -> bool:
        """Straight to a place (3,), turned as in a pose (4, 4); whether something was touched, where that ends it."""
        arm, trajectory = self._arm, self._pipeline.trajectory
        goal = pose.copy()
        goal[:3, 3] = place
        trajectory.set_goal(goal, self._speed if speed is None else speed)
        most = self._limit
        begin, end = arm.time, arm.time + LEG_TIME
        while not trajectory.resting and arm.time < end:
            arm.observe()
            for sample in self._samples():
                wrench = self._watch(sample)
                if not wrench.usable:
                    continue
                if touch and wrench.magnitude > self._threshold:
                    trajectory.stop()
                    arm.finish_plan(1.0)
                    return True
                # What presses at the beginning is being left.
                most = max(most, wrench.magnitude + RISE) if arm.time < begin + LOOK else most
                if wrench.magnitude > most:
                    raise SafetyStop(f"force {wrench.magnitude:.2f} N on the return path after an interruption")
            arm.move()
            if arm.blocked:
                raise SafetyStop(f"no way back after an interruption: {arm.blocked}")
        return False

    def _rest(self, seconds: float) -> tuple[float, list[tuple[WrenchSample, Wrench]]]:
        """When a rest of so many s began, and the samples that came in it with what they mean."""
        arm, rows = self._arm, []
        begin = arm.time
        while arm.time < begin + seconds:
            arm.hold()
            rows += [(sample, self._watch(sample)) for sample in self._samples()]
        return begin, rows

    def _watch(self, sample: WrenchSample) -> Wrench:
        wrench = self._paused.watch(sample)
        if wrench.usable:
            self._received = self._arm.time
        return wrench

    def _samples(self) -> list[WrenchSample]:
        try:
            return self._devices.sensor.read()
        except DriverError as error:
            raise SensorLost(str(error)) from error

    @property
    def _tip(self) -> np.ndarray:
        return self._pipeline.trajectory.pose[:3, 3].copy()
