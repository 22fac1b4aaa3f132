"""Touching one place again and again at several speeds: how well the whole chain repeats, and what speed does to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Confidence,
    Contact,
    Done,
    Goal,
    InputError,
    LwrprobeError,
    Motion,
    Observation,
    Progress,
    SafetyStop,
    Task,
    VelocityCommand,
)
from lwrprobe.contracts.samples import Vector
from lwrprobe.control import Refusal
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import WatchFunction
from lwrprobe.exploration.procedures.explore import explore
from lwrprobe.exploration.procedures.start_posture import scene_at_start
from lwrprobe.exploration.stages.pipeline import choose, reaction_delay
from lwrprobe.exploration.stages.touch_law import tip_mass, touch_law
from lwrprobe.scene import Scene

STANDOFF = 0.005
"""m between two touches of the same place."""

_SAMPLES, _PATIENCE = 8, 40  # trusted samples that make up a touch, and samples after which fewer have to do


@dataclass(slots=True, frozen=True)
class Touch:
    """One touch.

    Attributes
    ----------
    speed : m/s, of the approach
    place : m along the direction of the touch, of the contact point
    aside : (2,) m, of the contact point across it
    force : N, held meanwhile
    """

    speed: float
    place: float
    aside: tuple[float, float]
    force: float


@dataclass(slots=True)
class Plan:
    """What is to be touched.

    Attributes
    ----------
    above : (3,) m, from where the place is first sought, None = the middle of the area's top
    direction : (3,) unit, of the touch
    reach : m that are sought through at most, None = to the area's bottom
    speeds : m/s, each in turn; count : touches at each
    """

    above: Vector | None = None
    direction: Vector = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    reach: float | None = None
    speeds: tuple[float, ...] = ()
    count: int = 10

    def __post_init__(self) -> None:
        self.direction = np.asarray(self.direction, dtype=np.float64)
        size = float(np.linalg.norm(self.direction)) if self.direction.shape == (3,) else 0.0
        if not (np.isfinite(size) and size > 0.0):
            raise InputError("direction", self.direction.tolist(), "three numbers, not all zero")
        self.direction = self.direction / size
        if self.reach is not None and not (np.isfinite(self.reach) and self.reach > 0.0):
            raise InputError("reach", self.reach, "a positive length in m")
        if self.count < 2:
            raise InputError("count", self.count, "at least 2 touches")
        if not all(np.isfinite(v) and v > 0.0 for v in self.speeds):
            raise InputError("speeds", list(self.speeds), "positive speeds in m/s")


class RepeatedTouch:
    """Seeks the place once at the slowest speed, then touches it from `STANDOFF` away, `count` times at each speed.

    As soon as the touch is noticed the tip holds still, and the mean of the samples that can be trusted counts.
    """

    Config: ClassVar[type] = Plan
    contract: ClassVar[int] = STRATEGY_CONTRACT
    line_spacing: float | None = None
    trace: Sequence[tuple[float, str, str, str]] = ()

    def __init__(self, plan: Plan, log: list[Touch]) -> None:
        self._plan, self._log = plan, log
        self._left = [min(plan.speeds), *(speed for speed in plan.speeds for _ in range(plan.count))]
        self._path: list[np.ndarray] = []
        self._felt: list[Contact] = []
        self._held = 0
        self._seeking = False
        self._first = True

    def start(self, task: Task) -> None:
        self._task = task
        area, plan = task.area, self._plan
        above = plan.above
        if above is None:
            above = np.array([*(0.5 * (area.lower + area.upper))[:2], area.upper[2]])
        self._from = np.asarray(above, dtype=np.float64)
        depth = self._from[2] - area.lower[2]
        self._reach = plan.reach if plan.reach is not None else depth if depth > 0.0 else 0.05
        level = np.array([self._from[0], self._from[1], max(task.start[2], self._from[2])])
        self._path = [level, self._from]

    def step(self, observation: Observation) -> Motion:
        """Go there, touch, go back."""
        if self._seeking:
            return self._approach(observation)
        if observation.goal_reached and self._path and self._at(observation, self._path[0]):
            self._path.pop(0)
        if self._path:
            speed = self._task.free_speed if self._first else self._task.approach_speed
            return self._goal(self._path[0], speed)
        if not self._left:
            return Done("touched as often as asked for")
        self._seeking = True
        return self._approach(observation)

    def progress(self) -> Progress:
        total = 1 + len(self._plan.speeds) * self._plan.count
        return Progress("touching again and again", 1.0 - len(self._left) / total, f"touch {total - len(self._left)}")

    def _approach(self, seen: Observation) -> Motion:
        direction, speed = self._plan.direction, self._left[0]
        if seen.contact is not None or self._held:
            self._held += 1
            if seen.contact is not None and seen.contact.confidence > Confidence.DOUBTFUL:
                self._felt.append(seen.contact)
            if len(self._felt) < _SAMPLES and self._held < _PATIENCE:
                return VelocityCommand(np.zeros(3), reason="hold")
            if not self._felt:
                return Done("the touch was not firm enough to be measured", complete=False)
            self._note(speed)
            self._felt, self._held = [], 0
            self._from = seen.pose[:3, 3] - STANDOFF * direction
            self._reach = 2.0 * STANDOFF
            self._left.pop(0)
            self._first = self._seeking = False
            self._path = [self._from]
            return self._goal(self._from, self._task.approach_speed)
        gone = float((seen.pose[:3, 3] - self._from) @ direction)
        if gone > self._reach:
            return Done(f"nothing was touched within {1e3 * self._reach:.0f} mm", complete=False)
        return VelocityCommand(speed * direction, reason="touch")

    def _note(self, speed: float) -> None:
        if self._first:
            return  # the seeking touch comes from far; it is not one of the series
        direction = self._plan.direction
        point = np.mean([contact.point for contact in self._felt], axis=0)
        across = np.linalg.svd(direction[None])[2][1:] @ point
        force = float(np.mean([contact.magnitude for contact in self._felt]))
        self._log.append(Touch(speed, float(point @ direction), (float(across[0]), float(across[1])), force))

    def _goal(self, place: Vector, speed: float) -> Goal:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._task.orientation, place
        return Goal(pose, speed, "to the next touch")

    def _at(self, seen: Observation, place: Vector) -> bool:
        return bool(np.linalg.norm(seen.pose[:3, 3] - place) < 1e-3)


def repeat(
    scene: Scene,
    plan: Plan,
    out: Path | None = None,
    *,
    realtime: bool = False,
    watch: WatchFunction | None = None,
    message: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Touch as planned; a row a speed: mean, sigma and range along the direction, sigma across, and bias.

    Raises InputError for a speed at which the force limit would be passed, SafetyStop with the reason when the series
    did not come to its end.
    """
    devices = Devices.assemble(scene, scene.run.seed, False)
    fastest = safe_speed(scene, devices.arm.cycle, devices.sensor.latency, devices.arm_mass, devices.arm_delay)
    if not plan.speeds:
        plan = replace(plan, speeds=tuple(share * fastest for share in (0.25, 0.5, 1.0)))
    for speed in plan.speeds:
        if speed > fastest * (1.0 + 1e-6):
            raise InputError("speeds", speed, f"up to {fastest:.6f} m/s, or the force limit would be passed")
    touches: list[Touch] = []
    choices = choose(scene, lambda: RepeatedTouch(plan, touches), plan)
    summary = explore(scene, out, realtime=realtime, watch=watch, message=message, choices=choices)
    if summary["status"] != "done":
        raise SafetyStop(f"the touches ended early: {summary['reason']}")
    return {"speeds": statistics(touches), "summary": summary}


def safe_speed(scene: Scene, cycle: float, latency: float, arm_mass: float = 0.0, late: float = 0.0) -> float:
    """m/s at which the stiffest direction may be touched by an arm of `arm_mass` kg that follows `late` [s].

    As stiff as a run takes it to be: where the scene refers to a calibration, as that found.
    """
    scene, robot, _, q = scene_at_start(scene)
    delay = reaction_delay(scene, cycle, latency, scene.sensor.rate, arm_delay=late)
    law = touch_law(scene, delay, tip_mass(robot, arm_mass, q))
    if isinstance(law, Refusal):
        raise InputError("contact.stiffness", scene.contact.stiffness, f"something that may be touched: {law.reason}")
    return min(law.approach_speed, scene.motion.approach_speed)


def statistics(touches: list[Touch]) -> list[dict[str, float]]:
    """A row a speed, in mm, m/s and N; places are relative to the mean of the slowest speed, along the direction."""
    if not touches:
        raise LwrprobeError("nothing was touched")
    speeds = list(dict.fromkeys(touch.speed for touch in touches))
    zero = float(np.mean([t.place for t in touches if t.speed == min(speeds)]))
    rows = []
    for speed in speeds:
        own = [t for t in touches if t.speed == speed]
        places = 1e3 * (np.array([t.place for t in own]) - zero)
        aside = 1e3 * np.array([t.aside for t in own])
        rows.append(
            {
                "speed_mm_s": 1e3 * speed,
                "touches": len(own),
                "sigma_mm": float(places.std(ddof=1)) if len(own) > 1 else 0.0,
                "range_mm": float(np.ptp(places)),
                "bias_mm": float(places.mean()),
                "sigma_across_mm": float(aside.std(axis=0, ddof=1).max()) if len(own) > 1 else 0.0,
                "force_n": float(np.mean([t.force for t in own])),
            }
        )
    return rows
