"""The driver contract: what a plug-in of the group `lwrprobe.drivers` offers, and what it is given.

A driver fills the role `arm`, the role `sensor`, or both. One that fills both, as the simulator does, hands out an arm
and a sensor that share a clock. All its errors are `DriverError` and its children, never bare socket errors. `close`
may be called at any time and more than once; after it the device is at rest and the next `open` works.

Units are SI; joint values are in rad (m for prismatic joints), in the robot's order from the base to the flange.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, Literal, Protocol, TypedDict, TypeVar, runtime_checkable

from lwrprobe.contracts.samples import ArmState, Vector, WrenchSample

DRIVER_CONTRACT = 2
"""Version of this contract; a driver states the one it was written for in `contract`."""

DRIVER_CHANGES: dict[int, str] = {
    1: "rename judge() to ground_truth(), account() to counters(), readings() to health_checks(), an arm's quiet() and "
    "follow() to cycles_until_sample() and step_many(), and Reading to HealthCheck; add the property left_out and the "
    "methods of the three that are missing ({}, [] and [] will do); a simulator takes start_q from its DriverContext",
}
"""What to change in a driver that was written for an earlier version, by version."""

Role = Literal["arm", "sensor"]
SceneT_co = TypeVar("SceneT_co", covariant=True)
"""Of the scene that a driver is made from: `lwrprobe.scene.Scene`, which this package does not know."""


@dataclass(slots=True, frozen=True)
class DriverContext(Generic[SceneT_co]):
    """What a driver is made from.

    Attributes
    ----------
    config : an instance of the driver's `Config`
    scene : the resolved `lwrprobe.scene.Scene`. A device driver reads at most the robot's limits from it; a
        simulator builds its world from it
    seed : of everything random
    realtime : whether a simulator keeps pace with the wall clock
    start_q : (n,) rad, where a simulated arm stands at first unless its `config` says otherwise, None = anywhere. A
        device driver ignores it
    """

    config: Any
    scene: SceneT_co
    seed: int = 0
    realtime: bool = False
    start_q: Vector | None = None


@runtime_checkable
class Arm(Protocol):
    """A joint-position-controlled arm with a fixed cycle."""

    @property
    def cycle(self) -> float:
        """s between two set points; a plain attribute will do."""

    def open(self) -> None:
        """Connect and become ready to take set points; raises DriverError."""

    def read(self) -> ArmState:
        """The next state: waits for the arm's next cycle (a simulator with a virtual clock advances by one).

        Raises DriverError.
        """

    def command(self, q: Vector) -> None:
        """Set point (n,) rad for this cycle; the array is copied before this returns. Raises DriverError."""

    def stop(self) -> None:
        """Come to rest as fast as the arm's limits allow and stay there; the next set point takes over again."""

    def close(self) -> None:
        """Stop, then release the device."""


@runtime_checkable
class SteppedArm(Arm, Protocol):
    """An arm whose time passes only while it is asked, as a simulator's does; optional, and found by its methods.

    Between two wrench samples nothing new is measured, so the set points up to the next sample are known in advance.
    An arm that need not wait for a clock takes them in one call. An arm that keeps pace with the wall clock answers 0
    to `cycles_until_sample` and is commanded and read cycle by cycle, as any other arm.
    """

    def cycles_until_sample(self, limit: int) -> int:
        """How many of the next cycles, up to `limit`, certainly end without a new sample of the same driver's sensor.

        0 where that is not known.
        """

    def step_many(self, set_points: Vector, times: Vector, joints: Vector, following: float) -> tuple[int, int]:
        """As `command` and `read` in turn, once for each row of `set_points` (m, n) rad; raises what these raise.

        The states go into `times` (m,) s and `joints` (m, n) rad. Ends early behind the first cycle whose status is
        not good, or in which a joint is further than `following` rad from its set point. Returns the number of rows
        carried out and the status (`ArmStatus`) after the last one.
        """


@runtime_checkable
class MassiveArm(Arm, Protocol):
    """An arm that says how heavy it is; optional, and found by its attribute. Any other arm counts as without mass.

    What moves on while the loop reacts presses harder, so that a run with such an arm touches more slowly.
    """

    @property
    def mass(self) -> float:
        """kg of all moving links, as on the arm's data sheet; 0 = none. A plain attribute will do."""


@runtime_checkable
class DelayedArm(Arm, Protocol):
    """An arm that says by how much it follows a set point later than in the next cycle; optional, like `MassiveArm`."""

    @property
    def delay(self) -> float:
        """s beyond the next cycle. A plain attribute will do."""


@runtime_checkable
class BufferedArm(Arm, Protocol):
    """An arm whose states are kept while nobody reads them; optional, and found by its method.

    The samples of a sensor that were measured meanwhile are then taken to where the arm was.
    """

    def passed(self) -> list[ArmState]:
        """States that came between the last two that `read` has returned, oldest first."""


@runtime_checkable
class RestartableArm(Arm, Protocol):
    """An arm that can take set points again after it has stopped by itself; optional, and found by its method.

    Its `read` and `command` raise MotionInterrupted from then on until `reenter` has returned.
    """

    def reenter(self, seconds: float, asked: bool) -> None:
        """Wait until the arm rests and its controller allows motion, then take set points again.

        Raises DriverError when that has not happened after so many seconds, and for what a person has to allow first
        while `asked`, whether a person has, is False.
        """


@runtime_checkable
class Sensor(Protocol):
    """A six-axis force/torque sensor with its own rate."""

    @property
    def rate(self) -> float:
        """Hz, nominal; a plain attribute will do."""

    @property
    def latency(self) -> float:
        """s, from the instant of measurement to `read`, as far as known; a plain attribute will do."""

    def open(self) -> None:
        """Connect and stream; raises DriverError."""

    def read(self) -> list[WrenchSample]:
        """All samples that came since the last call, oldest first; never waits; empty when there is none.

        Raises DriverError.
        """

    def close(self) -> None:
        """Stop streaming, then release the device."""


@dataclass(slots=True)
class TrueContact:
    """Ground truth of one instant, for the evaluation alone.

    Attributes
    ----------
    point : (3,) m, world frame, on the undeformed surface
    normal : (3,) unit, world frame, out of the object
    force : N, size of the force on the sphere at this contact
    """

    point: Vector
    normal: Vector
    force: float


@runtime_checkable
class GroundTruth(Protocol[SceneT_co]):
    """What only a simulator can offer: the truth, for the evaluation alone."""

    differences: dict[str, Any]
    """The numbers by which the world differs from what the run's scene says, and their profile."""

    @property
    def scene(self) -> SceneT_co:
        """The scene as it really is: objects, table and probe. A plain attribute will do."""

    @property
    def link_collisions(self) -> int:
        """How often a robot link other than the sphere and the stick's end began to touch anything."""

    @property
    def peak_force(self) -> float:
        """N, the largest true contact force on the sphere so far."""

    @property
    def probe_peak_force(self) -> float:
        """N, the largest true contact force of anything of the probe so far: sphere, stick, or both together."""

    def contact_at(self, sequence: int) -> TrueContact | None:
        """True contact at the instant of the wrench sample with that sequence number, None when free."""


@dataclass(slots=True, frozen=True)
class HealthCheck:
    """One line of `lwrprobe doctor`.

    Attributes
    ----------
    name : of what was checked
    value : what was found, for reading
    good : whether it is as it should be
    detail : the same as numbers, by name with the unit in it
    """

    name: str
    value: str
    good: bool = True
    detail: dict[str, Any] = field(default_factory=dict)


class LeftOut(TypedDict):
    """Something that a run did without."""

    stage: str
    """Its name."""
    why: str
    """The reason, one sentence."""


@runtime_checkable
class Driver(Protocol[SceneT_co]):
    """An entry of the group `lwrprobe.drivers`: a class made from a `DriverContext`.

    `Config` is a dataclass with the driver's own options, table `[drivers.<name>]` of a scene file; `contract` the
    `DRIVER_CONTRACT` it was written for; `roles` what it can be asked for. Making one opens no device.
    """

    Config: ClassVar[type]
    contract: ClassVar[int]
    roles: ClassVar[frozenset[Role]]

    def __init__(self, context: DriverContext[SceneT_co]) -> None: ...

    def arm(self) -> Arm:
        """The arm; raises DriverError where `roles` lacks it."""

    def sensor(self) -> Sensor:
        """The sensor; raises DriverError where `roles` lacks it."""

    def ground_truth(self) -> GroundTruth[SceneT_co] | None:
        """Ground truth, None for a real device."""

    @property
    def left_out(self) -> Sequence[LeftOut]:
        """Effects that a simulator does without, for the run's summary; empty for a real device."""

    def counters(self) -> Mapping[str, Any]:
        """What has been counted on the connection since it was opened (losses, lateness), for the run's summary.

        Plain numbers and texts by name; asked after `close` too. Empty where nothing is counted.
        """

    def health_checks(self, seconds: float) -> Sequence[HealthCheck]:
        """Listen to the device for some seconds and check it, for `lwrprobe doctor`; nothing moves.

        Empty for a simulator. Raises DriverError.
        """
