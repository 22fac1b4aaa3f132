"""The driver's side of the house.

A driver plug-in fills the role `arm`, the role `sensor`, or both. Whoever fills both (the simulator) hands out
two faces of one world. All errors are `DriverError` and its children, never bare socket errors. `close` may be
called at any time and more than once; after it the device is at rest and the next `open` works.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

from lwrprobe.contracts.samples import ArmState, Vector, WrenchSample

DRIVER_CONTRACT = 1

Role = Literal["arm", "sensor"]


@dataclass(slots=True, frozen=True)
class DriverContext:
    """What a driver is told when it is made.

    Attributes
    ----------
    config : an instance of the driver's `Config`
    scene : the resolved `lwrprobe.scene.Scene`. A device driver reads the robot's limits from it at most; a
        simulator builds its world from it
    seed : of everything random
    realtime : a simulator keeps pace with the wall clock
    """

    config: Any
    scene: Any
    seed: int = 0
    realtime: bool = False


@runtime_checkable
class Arm(Protocol):
    """A joint-position-controlled arm with a fixed cycle."""

    cycle: float
    """s between two set points."""

    def open(self) -> None:
        """Connect and become ready to take set points; raises DriverError."""

    def read(self) -> ArmState:
        """The next state: waits for the arm's next cycle (a simulator with a virtual clock advances by one)."""

    def command(self, q: Vector) -> None:
        """Set point (n,) rad for this cycle; the array is copied before this returns."""

    def stop(self) -> None:
        """Come to rest as fast as the arm's limits allow and stay there."""

    def close(self) -> None:
        """Stop, then release the device."""


@runtime_checkable
class SteppedArm(Arm, Protocol):
    """An arm whose time passes only while it is asked, as a simulator's does; optional, and found by its methods.

    Between two wrench samples nothing new is measured, so the set points up to the next sample are known in advance.
    An arm that need not wait for a clock takes them in one call. An arm that keeps pace with the wall clock answers 0
    to `cycles_until_sample` and is commanded and read cycle by cycle, as any other arm.
    """

    def cycles_until_sample(self, most: int) -> int:
        """How many of the next cycles, up to `most`, end without a new sample of the same driver's sensor, for
        certain; 0 where that is not known."""

    def step_many(self, set_points: Vector, times: Vector, joints: Vector, away: float) -> tuple[int, int]:
        """As `command` and `read` in turn, once a row of `set_points` (m, n) rad; raises what these raise.

        The states go into `times` (m,) s and `joints` (m, n) rad. Ends early behind the first cycle whose status is
        not good, or in which a joint is further than `away` rad (m for prismatic joints) from its set point. Returns
        the number of rows carried out and the status after the last one.
        """


@runtime_checkable
class Sensor(Protocol):
    """A six-axis force/torque sensor with its own rate."""

    rate: float
    """Hz, nominal."""
    latency: float
    """s, from the instant of measurement to `read`, as far as known."""

    def open(self) -> None:
        """Connect and stream; raises DriverError."""

    def read(self) -> list[WrenchSample]:
        """All samples that came since the last call, oldest first; never waits; empty when there is none."""

    def tare(self) -> None:
        """Ask the device to take its present reading as zero (a device without it does nothing)."""

    def stop(self) -> None:
        """Stop streaming."""

    def close(self) -> None:
        """Stop streaming, then release the device."""


@dataclass(slots=True)
class TrueContact:
    """Ground truth of one instant, for the evaluator alone: point, normal and force in the world frame."""

    point: Vector
    normal: Vector
    force: float
    count: int = 1


@runtime_checkable
class GroundTruth(Protocol):
    """What only a simulator can offer: the truth, handed to the evaluator and to nobody else."""

    @property
    def link_collisions(self) -> int:
        """How often a robot link other than the sphere and the stick's felt part began to touch the object."""

    @property
    def peak_force(self) -> float:
        """N, the largest true contact force on the sphere so far."""

    def contact_at(self, sequence: int) -> TrueContact | None:
        """True contact at the instant of the wrench sample with that sequence number, None when free."""


@dataclass(slots=True, frozen=True)
class HealthCheck:
    """One line of `lwrprobe doctor`: a name, a value, and whether it is as it should be."""

    name: str
    value: str
    good: bool = True
    detail: dict[str, Any] = field(default_factory=dict)


@runtime_checkable
class Driver(Protocol):
    """An entry of the group `lwrprobe.drivers`: a class made from a `DriverContext`.

    `Config` is a dataclass with the driver's own options, table `[drivers.<name>]` of a scene file.
    """

    Config: ClassVar[type]
    contract: ClassVar[int]
    roles: ClassVar[frozenset[Role]]

    def __init__(self, context: DriverContext) -> None: ...

    def arm(self) -> Arm:
        """The arm's face; raises DriverError where `roles` lacks it."""

    def sensor(self) -> Sensor:
        """The sensor's face; raises DriverError where `roles` lacks it."""

    def judge(self) -> GroundTruth | None:
        """Ground truth, None for a real device."""
