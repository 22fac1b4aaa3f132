"""The contract between a strategy and the runner: what a strategy is given, what it is shown, what it answers.

A strategy has no threads, no clock and no I/O: the same observations give the same motions, so that a recorded
run can be replayed through it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from lwrprobe.contracts.contact import Clearance, Contact
from lwrprobe.contracts.motion import Motion
from lwrprobe.contracts.probe import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.errors import InputError

STRATEGY_CONTRACT = 2
"""Version of this contract; a strategy states the one it was written for in `contract`."""

STRATEGY_CHANGES = {
    1: "answer `VelocityCommand` where it answers `Feed`, declare `line_spacing` and `trace`, compare "
    "`contact.confidence` instead of `contact.confidence_score`, and do without `task.map` and `task.table`",
}
"""What to change in a strategy that was written for an older version."""


@dataclass(slots=True, frozen=True)
class Area:
    """Axis-aligned box in the world frame in which the tip's centre may move while exploring [m]."""

    lower: Vector
    upper: Vector

    def __post_init__(self) -> None:
        if not (np.isfinite(self.lower).all() and np.isfinite(self.upper).all()):
            raise InputError("area", (self.lower.tolist(), self.upper.tolist()), "finite corners")
        if not (self.lower < self.upper).all():
            raise InputError("area", (self.lower.tolist(), self.upper.tolist()), "lower < upper on every axis")

    def raised(self, by: float) -> Area:
        """The same box with its upper end `by` m higher."""
        return Area(self.lower, self.upper + np.array([0.0, 0.0, by]))


@dataclass(slots=True, frozen=True)
class Task:
    """What is to be explored and within which bounds; handed to `Strategy.start`.

    All coordinates are in the world frame: z points up, the table's top is horizontal.

    Attributes
    ----------
    area : where the sphere's centre may go
    probe : dimensions and compliance of the probe, and its links in the tip's frame
    orientation : (3, 3) of the tip at the start; its z axis points along the stick, from the sensor to the sphere
    start : (3,) m, where the tip stands when the strategy takes over
    free_speed : m/s, where nothing can be touched
    approach_speed : m/s, the most where something may be touched
    contour_speed : m/s, the most along a surface
    acceleration : m/s^2, with which the tip brakes
    force_threshold : N, from which on a contact is declared
    force_target : N, wanted while a surface is followed
    force_limit : N, never to be exceeded
    torque_limit : N m at the sensor, never to be exceeded
    clearance_threshold : m, distance of a link to what was touched, below which a collision threatens
    stiffness : N/m, of object and arm in series as far as known, else an upper bound; the probe's comes on top
    delay : s, from a force at the sphere to the arm's reaction
    softer : (3, 3) m/N, by which object and arm together give way more than 1 / `stiffness` for a force along a unit
        vector n, as n softer n; world frame
    arm_mass : kg, of the arm as its tip shows it to what it strikes; 0 = an arm without mass
    arm_stiffness : N/m, of the arm at its tip, where `arm_mass` counts; part of `stiffness`, inf = rigid
    search_for : m, diameter of the smallest object that is to be found; where it is in the area is not known. None =
        the area is around the object
    detail : m, width of the narrowest part that is to be seen; lines are no farther apart. None = as the options say
    headroom : m by which the strategy may raise the area's upper end where the object reaches up to that
    tallest : m, nothing is known to be taller, inf = as tall as the area allows
    options : the strategy's own configuration, an instance of its `Config`
    reachable : whether the arm, from where it stands, can take the tip straight through these poses (4, 4) in turn,
        within its joint limits, without a jump, and with joints that can follow the tip's acceleration
    clear : whether on that way no link comes nearer to what was touched than it may
    """

    area: Area
    probe: Probe
    orientation: np.ndarray
    start: Vector
    free_speed: float
    approach_speed: float
    contour_speed: float
    acceleration: float
    force_threshold: float
    force_target: float
    force_limit: float
    clearance_threshold: float
    stiffness: float
    delay: float
    softer: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    torque_limit: float = np.inf
    arm_mass: float = 0.0
    arm_stiffness: float = np.inf
    search_for: float | None = None
    detail: float | None = None
    headroom: float = 0.0
    tallest: float = np.inf
    options: Any = None
    reachable: Callable[[Sequence[np.ndarray]], bool] = lambda poses: True
    clear: Callable[[Sequence[np.ndarray]], bool] = lambda poses: True


@dataclass(slots=True)
class Observation:
    """What a strategy is shown at one wrench sample; all in the world frame.

    Attributes
    ----------
    time : s since the start of the run
    pose : (4, 4) of the tip at the sample's instant; its origin is the sphere's centre
    velocity : (3,) m/s of the tip, as commanded
    force : (3,) N on the sphere, bias and gravity removed; zero-mean noise when nothing is touched
    contact : the estimated contact, None while the force is below the threshold
    clearance : the nearest pair of a link and what was touched, None where the clearance is not watched
    goal_reached : the last `Goal` has been reached and the tip rests
    blocked : why the last motion could not be carried out (out of reach, joint limit), or empty
    """

    time: float
    pose: np.ndarray
    velocity: Vector
    force: Vector
    contact: Contact | None = None
    clearance: Clearance | None = None
    goal_reached: bool = False
    blocked: str = ""


@dataclass(slots=True, frozen=True)
class Progress:
    """How far a strategy is: for the progress line, never for control.

    Attributes
    ----------
    doing : a few words
    covered : share of the work that is done, 0 to 1
    state : what the strategy does now, in a word or two
    """

    doing: str
    covered: float = 0.0
    state: str = ""


@dataclass(slots=True, frozen=True)
class Bounds:
    """Where an object was found that was searched for.

    Attributes
    ----------
    found_at : s of the run, of the first touch
    bounded_at : s of the run, when the object was bounded
    area : what is explored from then on; it grows where the object turns out to go on beyond it
    """

    found_at: float
    bounded_at: float
    area: Area


@runtime_checkable
class SearchingStrategy(Protocol):
    """A strategy that finds and bounds an object first where its task says so; any other explores the whole area.

    Attributes
    ----------
    bounds : None as long as there are none
    """

    @property
    def bounds(self) -> Bounds | None: ...


@runtime_checkable
class RaisingStrategy(Protocol):
    """A strategy that may raise the area's upper end.

    Attributes
    ----------
    raised : m by which it has done so
    """

    @property
    def raised(self) -> float: ...


@runtime_checkable
class CarefulStrategy(Protocol):
    """A strategy that keeps the body behind the stick out of unknown space: no sensor measures its contacts."""

    def touching_poses(self, centre: Vector, facing: Vector) -> Sequence[tuple[np.ndarray, bool]]:
        """Tip poses (4, 4) in which it would touch a surface that faces along a unit vector (3,), with the sphere's
        centre at a place (3,) m; each with whether all behind the stick is in known space there, as far as it has come.
        None of them: it does not say.
        """


@runtime_checkable
class Strategy(Protocol):
    """Turns observations into motions.

    Attributes
    ----------
    Config : a dataclass whose fields are the strategy's options (`--set strategy.step=0.005`)
    contract : the `STRATEGY_CONTRACT` that the strategy was written for
    line_spacing : m between neighbouring lines of contacts, from `start` on; None for a strategy without lines.
        Coverage and reconstruction count with it
    trace : rows (time s, state, event, next state) so far, written to the run's `states.csv`; may stay empty
    """

    Config: ClassVar[type]
    contract: ClassVar[int]

    @property
    def line_spacing(self) -> float | None: ...

    @property
    def trace(self) -> Sequence[tuple[float, str, str, str]]: ...

    def start(self, task: Task) -> None:
        """Take over: the tip rests at `task.start`, in free space, bias taken."""

    def step(self, observation: Observation) -> Motion:
        """Answer one observation; called once a wrench sample."""

    def progress(self) -> Progress:
        """What is going on, in words."""


def check_progress(progress: object) -> Progress:
    """What a strategy says of itself; raises InputError for what is no `Progress`."""
    if not isinstance(progress, Progress):
        raise InputError("progress()", progress, "a Progress")
    if not (isinstance(progress.doing, str) and isinstance(progress.state, str)):
        raise InputError("progress()", progress, "texts as doing and state")
    if not (isinstance(progress.covered, Real) and np.isfinite(float(progress.covered))):
        raise InputError("progress().covered", progress.covered, "a share, 0 to 1")
    return progress


def check_line_spacing(spacing: object) -> float | None:
    """A strategy's `line_spacing`; raises InputError for what is neither a length nor None."""
    if spacing is None or (isinstance(spacing, Real) and 0.0 < float(spacing) < np.inf):
        return None if spacing is None else float(spacing)
    raise InputError("line_spacing", spacing, "a positive length in metres, or None")


def check_transition(row: object) -> tuple[float, str, str, str]:
    """A row of a strategy's `trace`; raises InputError for what is none."""
    if isinstance(row, tuple | list) and len(row) == 4 and isinstance(row[0], Real):
        time, *names = row
        if all(isinstance(name, str) for name in names):
            return float(time), *names
    raise InputError("trace", row, "rows of a time in s and three texts: state, event, next state")
