"""A spiral outwards from the first contact: a skill of one's own beside the built-in ones."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot, pi

import numpy as np

from lwrprobe.contracts import Done, InputError, Progress, VelocityCommand
from lwrprobe_strategies.outcomes import Blocked, CollisionThreat, Ended, Overload
from lwrprobe_strategies.skills import Procedure, search, skill
from lwrprobe_strategies.supervisor import Program, SkillStrategy
from lwrprobe_strategies.tip import Tip


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


class Spiral(SkillStrategy):
    """Touches down in the middle of the area, then slides outwards on a spiral."""

    Config = SpiralConfig

    @property
    def line_spacing(self) -> float | None:
        """m between two turns."""
        return float(self.task.options.pitch)

    def program(self) -> Program:
        """Search, then slide."""
        middle = 0.5 * (self.task.area.lower + self.task.area.upper)
        if (yield from search(self.tip, [(middle[0], middle[1])])) is not Ended.CONTACT:
            return Done("nothing under the middle of the area", complete=False)
        yield from slide_on_spiral(self.tip, self.task.options.pitch, self.task.options.radius)
        return Done("the spiral has reached its end")

    def progress(self) -> Progress:
        """The skill that runs."""
        return Progress(f"spiral: {self.tip.trace.state}", 0.0, self.tip.trace.state)


@skill(Overload, CollisionThreat, Blocked)
def slide_on_spiral(tip: Tip, pitch: float, radius: float) -> Procedure:
    """Slide outwards around the place where the tip is, at half of the contour speed, until `radius` m are reached."""
    centre, turned, bearing = tip.here[:2].copy(), 0.0, None
    while pitch * max(turned, 0.0) / (2.0 * pi) <= radius:
        x, y = (tip.here[:2] - centre).tolist()
        size = hypot(x, y)
        if size > 1e-4:
            now = atan2(y, x)
            turned += 0.0 if bearing is None else (now - bearing + pi) % (2.0 * pi) - pi
            bearing = now
        out = np.array([x, y]) / size if size > 1e-4 else np.array([1.0, 0.0])
        excess = pitch * max(turned, 0.0) / (2.0 * pi) + 0.5 * pitch - size
        course = np.array([-out[1], out[0]]) + np.clip(excess / pitch, -1.0, 1.0) * out
        binormal = (course[1] / hypot(*course), -course[0] / hypot(*course), 0.0)
        normal = tip.normal() if tip.seen.contact is not None else tip.control.normal
        force = max(float(tip.seen.force @ normal), 0.0)
        sliding_speed = 0.5 * tip.task.contour_speed if tip.seen.contact is not None else 0.0
        velocity = tip.control.velocity(normal, force, binormal, sliding_speed, tip.seen.pose[:3, :3], tip.period)
        yield VelocityCommand(velocity, reason=slide_on_spiral.name)
    return Ended.ARRIVED
