"""From an observation to a motion: the strategy's, or the force guard's."""

from __future__ import annotations

from lwrprobe.contact import Wrench
from lwrprobe.contracts import Motion, Observation, StorageError
from lwrprobe.contracts.motion import check_motion
from lwrprobe.contracts.plugins import failed
from lwrprobe.exploration.loop.loop_parts import LoopParts
from lwrprobe.exploration.safety.force_guard import ForceGuard

FASTEST = 1.5
"""Times the free speed: velocities along the surface and off it may add up. Faster is a mistake, as of mm/s for m/s."""


class AnswerStep:
    """Asks the strategy and hands its motion on, limited by the force stage and overridden by the force guard.

    Attributes
    ----------
    force_guard : how often it took over
    """

    def __init__(self, parts: LoopParts) -> None:
        scene = parts.scene
        self._pipeline, self._arm, self._request = parts.pipeline, parts.arm, parts.request
        self._clock, self._confirm, self._strategy_name = parts.clock, parts.confirm, scene.strategy.name
        self._fastest = FASTEST * scene.motion.free_speed
        self._checked: object = self  # the last motion that passed, none yet
        contact, torque = scene.contact, scene.safety.torque_share * parts.pipeline.probe.torque_range
        self.force_guard = ForceGuard(contact.limit, contact.target, 2.0 * scene.motion.contour_speed, torque)

    def answer(self, seen: Observation, wrench: Wrench, confirmed: bool) -> None:
        """Hand on the motion that answers an observation; a wrench that is not `confirmed` may be a spike.

        Raises SafetyStop and PluginError.
        """
        arm, force = self._arm, self._pipeline.force
        force.speeds.excess = arm.excess.seconds
        override = self.force_guard.check(arm.time, wrench.world_force, wrench.torque, confirmed, seen.pose[:3, 2])
        motion: Motion
        if confirmed or override is None:
            self._request.asked = self._ask(seen)
            motion = force.limit(self._request.asked, wrench, arm.history.acceleration)
        else:
            motion = override  # the strategy is not shown the spike, the tip holds still until the next sample
        self._clock.lap("strategy")
        if self._confirm is not None and override is None:
            motion = self._confirm.filter(motion)
        self._request.adopt(override or motion, urgent=override is not None)
        self._clock.lap("trajectory")

    def _ask(self, seen: Observation) -> Motion:
        try:
            motion = self._pipeline.strategy.step(seen)
            if motion is not self._checked:
                check_motion(motion, self._fastest)
                self._checked = motion
            return motion
        except StorageError:
            raise
        except Exception as error:
            raise failed("strategy", self._strategy_name, error) from error
