"""The strategy's side of the house: what it is told, what it sees, what it answers.

A strategy has no threads, no clock and no I/O: the same observations give the same motions, so that a recorded
run can be replayed through it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from lwrprobe.contracts.contact import Clearance, Contact
from lwrprobe.contracts.motion import Motion
from lwrprobe.contracts.probe import Probe
from lwrprobe.contracts.samples import Vector
from lwrprobe.errors import InputError

STRATEGY_CONTRACT = 1
"""Version of this contract; a strategy states the one it was written for in `contract`."""


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


class MapView(Protocol):
    """What a strategy may ask the map: read only."""

    @property
    def resolution(self) -> float:
        """m, edge of the smallest voxel."""

    def __len__(self) -> int:
        """Number of occupied voxels of the smallest size."""

    def occupied(self, point: Vector) -> bool:
        """True where something was touched."""

    def nearest(self, point: Vector) -> tuple[float, Vector]:
        """Distance [m] and centre of the nearest occupied voxel; (inf, nan) on an empty map."""


@dataclass(slots=True, frozen=True)
class Task:
    """What is to be explored and within which bounds; handed to `Strategy.start`.

    Attributes
    ----------
    area : where the tip may go
    table : m, height below which nothing is to be touched (world z of the table's top)
    probe : the probe's dimensions
    orientation : (3, 3) of the tip at the start
    start : (3,) m, where the tip stands when the strategy takes over
    free_speed, approach_speed, contour_speed : m/s
    force_threshold, force_target, force_limit : N; touch is declared, wanted while contouring, never exceeded
    clearance_threshold : m, below it a collision threatens
    stiffness : N/m, series stiffness of probe and object as far as known, else an upper bound
    delay : s, total reaction delay of the loop
    options : the strategy's own configuration, an instance of its `Config`
    reachable : whether the arm, from where it stands, can take the tip straight through these poses (4, 4) in turn,
        within its joint limits and without a jump
    clear : whether on that way no link comes nearer to what has been touched than it may
    """

    area: Area
    table: float
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
    map: MapView
    options: Any = None
    reachable: Callable[[Sequence[np.ndarray]], bool] = lambda poses: True
    clear: Callable[[Sequence[np.ndarray]], bool] = lambda poses: True


@dataclass(slots=True)
class Observation:
    """What a strategy sees at one wrench sample.

    Attributes
    ----------
    time : s since the start of the run
    pose : (4, 4) tip in the world frame at the sample's instant
    velocity : (3,) m/s of the tip
    force : (3,) N on the sphere in the world frame, bias and gravity removed; zero-mean noise when free
    contact : the estimated contact, None while the force is below the threshold
    clearance : nearest link-to-map pair, None while that stage is left out
    goal_reached : the last `Goal` has been reached and the tip rests
    blocked : the last motion could not be carried out (out of reach, joint limit); why, or empty
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
    """How far a strategy is: for the progress line, never for control."""

    doing: str
    covered: float = 0.0
    state: str = ""
    notes: dict[str, Any] = field(default_factory=dict)


@runtime_checkable
class Strategy(Protocol):
    """Turns observations into motions.

    `Config` is a dataclass whose fields are the strategy's options (`--set strategy.step=0.005`), `contract` the
    `STRATEGY_CONTRACT` it was written for. A strategy that has a list `trace` of (time, state, event, next state) finds
    it in the run's `states.csv`.
    """

    Config: ClassVar[type]
    contract: ClassVar[int]

    def start(self, task: Task) -> None:
        """Take over: the tip rests at `task.start`, in free space, bias taken."""

    def step(self, observation: Observation) -> Motion:
        """Answer one observation; called once a wrench sample."""

    def progress(self) -> Progress:
        """What is going on, in words."""
