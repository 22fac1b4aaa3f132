"""Active: long strokes, each chosen by the error of the estimate that it is expected to remove per second."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lwrprobe.contracts import Confidence, InputError, Motion, Observation, Progress, Task
from lwrprobe.mapping.estimate import APART, SurfaceEstimate
from lwrprobe_strategies.coverage_config import CoverageConfig
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.planning.lines import Line, Z
from lwrprobe_strategies.planning.outline_watch import OutlineWatch
from lwrprobe_strategies.planning.scheduler import LineScheduler
from lwrprobe_strategies.planning.stroke_scheduler import StrokeScheduler
from lwrprobe_strategies.skills import Procedure, follow_contour
from lwrprobe_strategies.supervisor import Program

SPACING = 5.0 / 3.0
"""Line spacing that the strokes are worth, in reaches of a contact; they are between one and two reaches apart."""

HIGHER = 0.006
"""m above the sphere on the highest place that a search has touched, where nothing is expected: two cells of the
estimate."""

FREE_APART = 0.012
"""m between the places where nothing is expected: nearer to each of those in between than a wall far below counts."""


@dataclass(slots=True, frozen=True)
class ActiveConfig(CoverageConfig):
    """The shared options, and when to end.

    Attributes
    ----------
    step : m, as far as a contact says something of the surface beside it
    aim : m, mean expected error at which nothing is left to do
    """

    step: float = 0.015
    aim: float = 0.0002

    def __post_init__(self) -> None:
        CoverageConfig.__post_init__(self)
        if not (np.isfinite(self.aim) and 0.0 < self.aim <= 0.01):
            raise InputError("strategy.aim", self.aim, "a length in metres, above 0 and at most 0.01")


class Active(GridVersion):
    """Strokes over an estimate of the surface: lines along x and y, and outlines at constant height.

    Attributes
    ----------
    estimate : of the surface and its error
    found : reliable contacts since the search for the object began, where there was one: place of the sphere's centre
        and normal
    """

    Config: ClassVar[type] = ActiveConfig

    def start(self, task: Task) -> None:
        """Take over: the tip rests in free space."""
        self.found: list[tuple[np.ndarray, np.ndarray]] = []
        super().start(task)

    def program(self) -> Program:
        """Stroke after stroke, until the expected error is small; what bounded the object is known from the start."""
        self.estimate = SurfaceEstimate(self.task.area, self.options.step)
        for centre, normal in self.found:
            self.estimate.touch(centre, normal)
        for place in self.untouched_heights():
            self.estimate.passed(place)
        self.outline = OutlineWatch()
        done = yield from super().program()
        expected = self.strokes.expected
        if not done.complete or not self.options.aim < expected < np.inf:
            return done
        return replace(
            done, reason=f"{done.reason}, with an expected error of {1e3 * expected:.2f} mm: strokes remove no more"
        )

    def untouched_heights(self) -> np.ndarray:
        """(n, 3) m, above all that may be there by what is known: nothing taller is expected until it is touched."""
        low, high = self.task.area.lower, self.task.area.upper
        lowest = self.task.tallest + self.task.probe.radius + HIGHER
        if lowest >= high[Z]:
            return np.empty((0, 3))
        axes = (np.arange(begin, end + FREE_APART, FREE_APART) for begin, end in zip((*low[:2], lowest), high))
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def scheduler(self) -> LineScheduler:
        """Strokes by their worth."""
        tip, options = self.tip, self.options
        speeds = tip.speeds(tip.rotation)
        self.strokes = StrokeScheduler(
            self.task,
            tip.memory,
            options.step,
            self.estimate,
            tip.free,
            speeds,
            tip.control.descent_speed(tip.rotation),
            tip.control.stick_speed,
            options.aim,
            tip.body,
            self.side_orientations,
        )
        return self.strokes

    def step(self, observation: Observation) -> Motion:
        """Answer one observation, after noting it in the estimate."""
        contact = observation.contact
        if contact is None:
            if not self.searching:
                self.estimate.passed(observation.pose[:3, 3])
        elif contact.confidence is Confidence.RELIABLE:
            blind = self.searching or self.bounds is not None
            if blind and (not self.found or np.abs(contact.centre - self.found[-1][0]).max() >= APART):
                self.found.append((contact.centre, contact.normal))
            if not self.searching:
                self.estimate.touch(contact.centre, contact.normal)
        return super().step(observation)

    def line_ended(self) -> None:
        """The next stroke may begin where this one has ended."""
        super().line_ended()
        tip = self.tip
        ended = tip.trace.ended is follow_contour and np.isinf(self.retractions.back)
        touching = tip.reliable and ended and tip.rotation is self.upright
        self.strokes.touched = tip.control.normal.copy() if touching else None

    def approach(self, line: Line) -> Procedure:
        """Off what is touched and to the beginning of a line, or along it at once where it begins here."""
        self.outline = OutlineWatch()
        if not self.strokes.chained:
            return super().approach(line)
        self.drive.begin_line(line)
        return self.drive.contour()

    def raise_area(self, line: Line) -> bool:
        """The estimate of the surface ends where the area does."""
        return False

    def end_found(self) -> bool:
        """An outline ends where it has come around, or leads on under something."""
        return self.outline.ends(self.tip.here, self.tip.control.normal, self.tip.reliable)

    @property
    def line_spacing(self) -> float:
        """m between two strokes, about."""
        return SPACING * super().line_spacing

    def progress(self) -> Progress:
        """The skill that runs, and how near the expected error is to the aim."""
        if self.searching:
            return super().progress()
        kind = "line" if self.strokes.grid_now else "stroke"
        doing = f"{kind} {self.strokes.count()[0] + 1}: {self.tip.trace.state}"
        return Progress(doing, self.strokes.share, self.tip.trace.state)
