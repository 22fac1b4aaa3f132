"""A spiral outwards from the first contact."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, pi

import numpy as np

from lwrprobe.contracts import (
    STRATEGY_CONTRACT,
    Done,
    Goal,
    InputError,
    Motion,
    Observation,
    Progress,
    Task,
    VelocityCommand,
)

UP = np.array([0.0, 0.0, 1.0])


@dataclass(slots=True, frozen=True)
class SpiralConfig:
    """Options of the spiral.

    Attributes
    ----------
    pitch : m, distance between two turns
    radius : m, where the spiral ends
    """

    pitch: float = 0.004
    radius: float = 0.03

    def __post_init__(self) -> None:
        for name in ("pitch", "radius"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(f"strategy.{name}", getattr(self, name), "a length in metres, between 0 and 1")


class Spiral:
    """Feels its way down in the middle of the area, then slides outwards on a spiral."""

    Config = SpiralConfig
    contract = STRATEGY_CONTRACT

    def start(self, task: Task) -> None:
        """Take over; the first motion leads over the middle of the area."""
        self.task = task
        self.options = task.options
        self.centre: np.ndarray | None = None
        self.over_middle = False
        self.turned = 0.0
        self.bearing: float | None = None

    def step(self, seen: Observation) -> Motion:
        """Over the middle, down to the first contact, then round."""
        if self.centre is None and seen.contact is None:
            return self._look(seen)
        if self.centre is None:
            self.centre = seen.pose[:2, 3].copy()
        arm = seen.pose[:2, 3] - self.centre
        if self._radius_wanted(arm) > self.options.radius:
            return Done("the spiral has reached its end")
        return self._slide(seen, arm)

    def progress(self) -> Progress:
        """Share of the radius."""
        reached = self.options.pitch * self.turned / (2.0 * pi)
        state = "looking" if self.centre is None else "sliding"
        return Progress(f"spiral: {state}", min(reached / self.options.radius, 1.0), state)

    def _look(self, seen: Observation) -> Motion:
        area, pose = self.task.area, seen.pose.copy()
        pose[:3, :3] = self.task.orientation
        pose[:2, 3] = 0.5 * (area.lower + area.upper)[:2]
        self.over_middle = self.over_middle or bool(np.abs(pose[:2, 3] - seen.pose[:2, 3]).max() < 1e-4)
        if not self.over_middle:
            pose[2, 3] = area.upper[2]
            return Goal(pose, self.task.free_speed, "over the middle")
        if seen.pose[2, 3] <= area.lower[2] + 1e-4:
            return Done("nothing under the middle of the area", complete=False)
        pose[2, 3] = area.lower[2]
        return Goal(pose, 0.5 * self.task.approach_speed, "down")

    def _radius_wanted(self, arm: np.ndarray) -> float:
        if float(arm @ arm) > 1e-8:
            bearing = atan2(arm[1], arm[0])
            if self.bearing is not None:
                self.turned += (bearing - self.bearing + pi) % (2.0 * pi) - pi
            self.bearing = bearing
        return self.options.pitch * max(self.turned, 0.0) / (2.0 * pi)

    def _slide(self, seen: Observation, arm: np.ndarray) -> Motion:
        size = float(np.sqrt(arm @ arm))
        outward = arm / size if size > 1e-4 else np.array([1.0, 0.0])
        around = np.array([-outward[1], outward[0]])
        excess = self._radius_wanted(arm) + 0.5 * self.options.pitch - size
        course = around + np.clip(excess / self.options.pitch, -1.0, 1.0) * outward
        normal = seen.contact.normal if seen.contact is not None else UP
        level = np.array([course[0], course[1], 0.0])
        tangent = level - (level @ normal) * normal
        tangent /= max(float(np.sqrt(tangent @ tangent)), 1e-9)
        force = float(seen.force @ normal)
        yielding = np.e * self.task.delay * self.task.stiffness
        press = np.clip((force - self.task.force_target) / yielding, -0.01, 0.02)
        feed = 0.5 * self.task.contour_speed if seen.contact is not None else 0.0
        return VelocityCommand(feed * tangent + press * normal, reason="spiral")
