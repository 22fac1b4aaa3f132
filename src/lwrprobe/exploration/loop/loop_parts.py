"""What the steps of the loop share."""

from __future__ import annotations

from dataclasses import dataclass

from lwrprobe.exploration.loop.arm_motion import ArmMotion
from lwrprobe.exploration.loop.motion_request import MotionRequest
from lwrprobe.exploration.loop.run_record import RunRecord
from lwrprobe.exploration.loop.stage_clock import StageClock
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.safety.confirm import Confirm
from lwrprobe.exploration.safety.silence_guard import SilenceGuard
from lwrprobe.exploration.stages.pipeline import Pipeline
from lwrprobe.scene import Scene


@dataclass(slots=True, frozen=True)
class LoopParts:
    """Made once a run or replay; each step takes from it what it needs.

    Attributes
    ----------
    scene : the settings
    pipeline : the stages composed from them
    arm : its motion, and where it was
    request : takes the motions that are asked for
    recorder, record : contacts go to the one, path and forces to the other
    clock : takes the time of each stage
    silence : the guard of the sensor
    confirm : asks the operator, None = nobody is asked
    """

    scene: Scene
    pipeline: Pipeline
    arm: ArmMotion
    request: MotionRequest
    recorder: Recorder
    record: RunRecord
    clock: StageClock
    silence: SilenceGuard
    confirm: Confirm | None
