"""The plug-in `mujoco`: arm, sensor and ground truth of one world."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar, NoReturn

import numpy as np

from lwrprobe.contracts import (
    ArmState,
    DriverContext,
    DriverError,
    MissingExtraError,
    TrueContact,
    WrenchSample,
)
from lwrprobe.scene import Scene
from lwrprobe_mujoco.config import MujocoConfig
from lwrprobe_sim.actual_world import ActualWorld, actual_world
from lwrprobe_sim.driver import SimulatedDriver, SimulatedStream, refuse_set_point
from lwrprobe_sim.start import start_joints

if TYPE_CHECKING:
    from lwrprobe_mujoco.world import World


class MujocoDriver(SimulatedDriver):
    """An arm and a sensor in MuJoCo's world of one scene; the arm's `read` advances the time.

    Raises SceneError, InputError and DeviceRefused for a world that cannot be, and MissingExtraError without MuJoCo.
    """

    Config: ClassVar[type] = MujocoConfig

    def __init__(self, context: DriverContext[Scene]) -> None:
        try:
            from lwrprobe_mujoco.world import World
        except ModuleNotFoundError as error:
            raise MissingExtraError("the driver mujoco", str(error.name), "mujoco") from error
        actual = actual_world(context.scene, context.config, context.seed)
        start = context.start_q if context.config.start_q is None else np.array(context.config.start_q)
        start = start_joints(actual.scene, actual.robot, start)
        assert isinstance(actual.config, MujocoConfig)
        self._world = World(actual.scene, actual.config, context.seed, actual.robot, start)
        self._sensor = MujocoSensor(self._world, context.config.latency)
        self._arm = MujocoArm(self._world, self._sensor, context.realtime)
        self._ground_truth = MujocoGroundTruth(self._world, actual)
        self._left_out = self._world.left_out


class MujocoArm:
    """A joint-position-controlled arm on a virtual clock."""

    def __init__(self, world: World, sensor: MujocoSensor, realtime: bool) -> None:
        self.cycle: float = world.config.cycle
        self.mass: float = world.config.arm_mass
        self._world = world
        self._sensor = sensor
        self._realtime = realtime
        self._open = False
        self._began = 0.0

    def open(self) -> None:
        """Ready to take set points; the arm holds its place until one comes."""
        self._open = True
        self._began = time.perf_counter() - self._world.time

    def read(self) -> ArmState:
        """The state one cycle later, with the last set point followed. Raises DriverError when not open."""
        self._refuse_closed()
        world = self._world
        self._sensor.ready += world.advance()
        if self._realtime:
            ahead = self._began + world.time - time.perf_counter()
            if ahead > 0.0:
                time.sleep(ahead)
        return ArmState(world.time, world.q.copy(), world.qd.copy())

    def command(self, q: np.ndarray) -> None:
        """Set point (n,) rad for the next cycle; raises DeviceRefused beyond a joint's limit of position or speed."""
        q = self._world.robot.joint_values(q)
        status = self._world.command(q)
        if status != 0:
            self._refuse(q, status)

    def cycles_until_sample(self, limit: int) -> int:
        """How many of the next cycles, up to `limit`, end without a new sample; 0 where it keeps pace with time."""
        return 0 if self._realtime or self._sensor.ready else self._world.cycles_until_sample(limit)

    def step_many(
        self, set_points: np.ndarray, times: np.ndarray, joints: np.ndarray, following: float
    ) -> tuple[int, int]:
        """Set points (m, n) rad, a cycle each; see `lwrprobe.contracts.SteppedArm`. Raises what `command` does."""
        self._refuse_closed()
        world = self._world
        for k, q in enumerate(set_points):
            status = world.command(q)
            if status != 0:
                self._refuse(q, status)
            self._sensor.ready += world.advance()
            times[k], joints[k] = world.time, world.q
            if not np.abs(world.q - q).max() <= following:
                return k + 1, 0
        return len(set_points), 0

    def stop(self) -> None:
        """Brake all joints to rest; the next set point takes over again."""
        self._world.brake()

    def close(self) -> None:
        """Brake; may be called more than once."""
        self.stop()
        self._open = False

    def _refuse_closed(self) -> None:
        if not self._open:
            raise DriverError("the simulated arm is not open")

    def _refuse(self, q: np.ndarray, status: int) -> NoReturn:
        refuse_set_point(self._world.robot, q, status, self._world.jump_speed(q, abs(status) - 1))


class MujocoSensor(SimulatedStream):
    """A six-axis sensor whose samples arrive as the arm's clock moves on."""

    def __init__(self, world: World, latency: float) -> None:
        self.rate: float = world.scene.sensor.rate
        self.latency = latency
        self.ready: list[WrenchSample] = []
        self._world = world

    def read(self) -> list[WrenchSample]:
        """What has arrived since the last call, oldest first."""
        samples, self.ready = self.ready, []
        return samples if self._streams else []

    def tare(self) -> None:
        """Take the mean of the last samples (at most 16) as zero; samples on their way keep the old zero."""
        self._world.tare()


class MujocoGroundTruth:
    """Ground truth of a run."""

    def __init__(self, world: World, actual: ActualWorld) -> None:
        self._world = world
        self.scene = actual.scene
        self.differences = actual.drawn

    @property
    def link_collisions(self) -> int:
        """How often sensor, holder, fingers or an arm link began to touch object or table."""
        return self._world.link_collisions

    @property
    def peak_force(self) -> float:
        """N, the largest resultant of all contact forces on the sphere so far, friction included."""
        return self._world.peak_force

    @property
    def probe_peak_force(self) -> float:
        """N, the largest resultant so far of the contact forces on the sphere, on the stick, or on both together."""
        return self._world.probe_peak_force

    def contact_at(self, sequence: int) -> TrueContact | None:
        """The sphere's strongest contact at a sample's instant, None when it touched nothing."""
        return self._world.truth.get(sequence)
