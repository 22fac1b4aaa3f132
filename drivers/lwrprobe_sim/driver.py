"""The plug-in `sim`: arm, sensor and ground truth of one simulated world."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, NoReturn

import numpy as np

from lwrprobe.contracts import (
    DRIVER_CONTRACT,
    Arm,
    ArmState,
    DeviceRefused,
    DriverContext,
    DriverError,
    GroundTruth,
    HealthCheck,
    LeftOut,
    Sensor,
    TrueContact,
    WrenchSample,
)
from lwrprobe.contracts.driver import Role
from lwrprobe.kinematics import Robot
from lwrprobe.scene import Scene
from lwrprobe_sim import link_kernels as links
from lwrprobe_sim import world_kernels as kernels
from lwrprobe_sim.actual_world import ActualWorld, actual_world
from lwrprobe_sim.config import SimConfig
from lwrprobe_sim.world import World


class SimulatedDriver:
    """What drivers of a simulated world share: a class that makes the world sets these attributes.

    Attributes
    ----------
    _arm, _sensor, _ground_truth : what the roles are answered with
    _left_out : effects that the world does without
    """

    contract: ClassVar[int] = DRIVER_CONTRACT
    roles: ClassVar[frozenset[Role]] = frozenset({"arm", "sensor"})
    _arm: Arm
    _sensor: Sensor
    _ground_truth: GroundTruth[Scene]
    _left_out: Sequence[LeftOut]

    def arm(self) -> Arm:
        """The arm's face."""
        return self._arm

    def sensor(self) -> Sensor:
        """The sensor's face; its clock is the arm's."""
        return self._sensor

    def ground_truth(self) -> GroundTruth[Scene]:
        """The truth, for the evaluation alone."""
        return self._ground_truth

    @property
    def left_out(self) -> Sequence[LeftOut]:
        """Effects that this world does without: `stage` and `why`."""
        return list(self._left_out)

    def counters(self) -> dict[str, int]:
        """Nothing is counted: there is no connection that could lose anything."""
        return {}

    def health_checks(self, seconds: float) -> list[HealthCheck]:
        """There is no device to check."""
        return []


def refuse_set_point(robot: Robot, q: np.ndarray, status: int, speed: float) -> NoReturn:
    """Raise DeviceRefused for set point q (n,) rad: joint `abs(status)` is beyond its limit, or below 0 too fast.

    `speed` is what the set point asks of that joint in rad/s.
    """
    joint = abs(status) - 1
    if status > 0:
        low, high = robot.lower[joint], robot.upper[joint]
        raise DeviceRefused(f"set point {q[joint]:.6g} rad of joint {joint + 1} is beyond {low:.4g} .. {high:.4g}")
    limit = robot.speed[joint]
    raise DeviceRefused(f"set point of joint {joint + 1} asks for {speed:.4g} rad/s, its limit is {limit:.4g}")


class SimDriver(SimulatedDriver):
    """Simulated arm and sensor in one scene: roles arm and sensor; the arm's `read` advances the time.

    Raises SceneError, InputError and DeviceRefused for a world that cannot be.
    """

    Config: ClassVar[type] = SimConfig
    World: ClassVar[type] = World
    """The physics without the driver roles, for measurements."""

    def __init__(self, context: DriverContext[Scene]) -> None:
        config = context.config
        if config.start_q is None and context.start_q is not None:
            config = replace(config, start_q=tuple(float(v) for v in context.start_q))
        actual = actual_world(context.scene, config, context.seed)
        self._world = World(actual.scene, actual.config, context.seed, actual.robot)
        self._sensor = SimSensor(self._world, config.latency)
        self._arm = SimArm(self._world, self._sensor, context.realtime)
        self._ground_truth = SimGroundTruth(self._world, actual)
        self._left_out = self._world.left_out


class SimArm:
    """A joint-position-controlled arm on a virtual clock."""

    def __init__(self, world: World, sensor_face: SimSensor, realtime: bool) -> None:
        self.cycle: float = world.config.cycle
        self._world = world
        self._sensor = sensor_face
        self._realtime = realtime
        self._open = False
        self._began = 0.0
        n = world.robot.n
        self._q = world.state[kernels.Q_MEASURED : kernels.Q_MEASURED + n]
        self._qd = world.state[kernels.QD : kernels.QD + n]
        self._state, self._counts = world.state, world.counts

    def open(self) -> None:
        """Ready to take set points; the arm holds its place until one comes."""
        self._open = True
        self._began = time.perf_counter() - self._state[kernels.TIME]

    def read(self) -> ArmState:
        """The state one cycle later, with the last set point followed. Raises DriverError when not open."""
        if not self._open:
            raise DriverError("the simulated arm is not open")
        self._sensor.ready = self._world.advance()
        now = self._state.item(kernels.TIME)
        if self._realtime:
            ahead = self._began + now - time.perf_counter()
            if ahead > 0.0:
                time.sleep(ahead)
        return ArmState(now, self._q.copy(), self._qd.copy())

    def command(self, q: np.ndarray) -> None:
        """Set point (n,) rad for the next cycle.

        Raises DeviceRefused for one beyond a joint limit or further from the last one than the joint's speed limit
        allows in one cycle, and InputError for a wrong shape.
        """
        status = self._world.command(q)
        if status != 0:
            self._refuse(q, status)

    def cycles_until_sample(self, limit: int) -> int:
        """How many of the next cycles, up to `limit`, end without a new sample; 0 in real time."""
        return 0 if self._realtime else self._world.cycles_until_sample(limit)

    def step_many(self, set_points: np.ndarray, times: np.ndarray, joints: np.ndarray, away: float) -> tuple[int, int]:
        """Set points (m, n) rad, a cycle each; see `lwrprobe.contracts.SteppedArm`. Raises what `command` does."""
        if not self._open:
            raise DriverError("the simulated arm is not open")
        done, refused = self._world.step_many(set_points, times, joints, away)
        if refused != 0:
            self._refuse(set_points[done], refused)
        return done, 0

    def stop(self) -> None:
        """Brake all joints to rest; the next set point takes over again."""
        self._counts[kernels.BRAKING] = 1

    def close(self) -> None:
        """Brake; may be called more than once."""
        self.stop()
        self._open = False

    def _refuse(self, q: np.ndarray, status: int) -> NoReturn:
        joint = abs(status) - 1
        speed = abs(q[joint] - self._state[kernels.SET + joint]) / self.cycle
        refuse_set_point(self._world.robot, q, status, speed)


class SimulatedStream:
    """Whether a simulated sensor streams. Its world goes on, and what is taken meanwhile is gone."""

    _streams = True

    def open(self) -> None:
        """Start streaming."""
        self._streams = True

    def stop(self) -> None:
        """Stop streaming."""
        self._streams = False

    def close(self) -> None:
        """Stop streaming; may be called more than once."""
        self._streams = False


class SimSensor(SimulatedStream):
    """A six-axis sensor whose samples arrive as the arm's clock moves on."""

    def __init__(self, world: World, latency: float) -> None:
        self.rate: float = world.scene.sensor.rate
        self.latency = latency
        self.ready = 0
        self._world = world

    def read(self) -> list[WrenchSample]:
        """What has arrived since the last call, oldest first."""
        if self.ready == 0:
            return []
        rows = self._world.fetch()
        self.ready = 0
        if not self._streams:
            return []
        return [WrenchSample(row[0], np.array(row[1:4]), np.array(row[4:7]), int(row[7]), int(row[8])) for row in rows]

    def tare(self) -> None:
        """Take the mean of the last samples (at most 16) as zero; samples on their way keep the old zero."""
        self._world.tare()


class SimGroundTruth:
    """Ground truth of a run."""

    def __init__(self, world: World, actual: ActualWorld) -> None:
        self._world = world
        self.scene = actual.scene
        self.differences = actual.drawn

    @property
    def link_collisions(self) -> int:
        """How often sensor, holder, fingers or an arm link began to touch object or table."""
        return int(self._world.counts[kernels.WATCH_COUNTS + links.COLLISIONS])

    @property
    def peak_force(self) -> float:
        """N, the largest resultant of all contact forces on the sphere so far, friction included."""
        return float(self._world.state[kernels.PEAK])

    @property
    def probe_peak_force(self) -> float:
        """N, the largest resultant so far of the contact forces on the sphere, on the stick, or on both together."""
        return float(self._world.state[kernels.PROBE_PEAK])

    def reserve(self, samples: int) -> None:
        """Reserve memory for the truth of so many samples, so that a loop in real time never has to copy it."""
        world = self._world
        if samples > len(world.truth):
            # The system hands the pages out when they are first written to.
            reserved = np.zeros((samples, world.truth.shape[1]))
            reserved[: len(world.truth)] = world.truth
            world.truth = reserved

    @property
    def object_pose(self) -> np.ndarray:
        """(4, 4) by which the movable object has left its place; identity without one."""
        return self._world.object_pose()

    def contact_at(self, sequence: int) -> TrueContact | None:
        """The sphere's strongest contact at a sample's instant, None when it touched nothing.

        `point` lies on the undeformed surface, `force` is that of this contact.
        """
        truth = self._world.truth
        if not 0 < sequence < len(truth) or truth[sequence, 6] <= 0.0:
            return None
        row = truth[sequence]
        return TrueContact(row[0:3].copy(), row[3:6].copy(), float(row[6]))
