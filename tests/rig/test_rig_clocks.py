"""Arm and sensor are dated alike on a host that stalls, over a clock that is counted: its own load plays no part."""

import itertools
import random
import selectors
import socket
import struct

import numpy as np
import pytest

from lwrprobe.host import arrival_time
from lwrprobe.kinematics import IKSolver, robot_by_name
from lwrprobe.scene import load_scene
from lwrprobe_ati import AtiConfig
from lwrprobe_ati.calibration import parse_calibration
from lwrprobe_ati.emulator import device as emulator_module
from lwrprobe_ati.emulator.device import AtiEmulator
from lwrprobe_ati.stream import Stream
from lwrprobe_ati.wire import Command, encode_command
from lwrprobe_rig import world as world_module
from lwrprobe_rig.world import SimulatedWorld

pytestmark = pytest.mark.realtime

CYCLE, STIFFNESS, SPEED = 0.01, 2000.0, 0.005
CYCLES = 600
ON_THE_WAY = 2e-4
"""s from a device to this host."""
STAMP = (socket.SOL_SOCKET, 35)  # SO_TIMESTAMPNS


class CountedClock:
    """Both clocks of the host."""

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now

    def time_ns(self):
        return round(1e9 * (self.now + 1.7e9))

    def arrived(self, instant):
        """Ancillary data of a datagram that came at an instant."""
        seconds, nanoseconds = divmod(round(1e9 * (instant + 1.7e9)), 10**9)
        return [(*STAMP, struct.pack("@ll", seconds, nanoseconds))]


@pytest.fixture
def clock(monkeypatch):
    counted = CountedClock()
    for module in (arrival_time, world_module, emulator_module):
        monkeypatch.setattr(module, "time", counted)
    return counted


@pytest.fixture(scope="module")
def scene():
    # A soft table, all else rigid and without weight or bias: the force is the depth times the stiffness.
    overrides = [
        "truth.profile=ideal",
        "probe.mass=0.0",
        "probe.stiffness_lateral=0.0",
        "probe.stiffness_axial=0.0",
        "object=[]",
    ]
    overrides += [f"table.stiffness={STIFFNESS}", "table.damping=0.0", "table.friction=0.0"]
    overrides += ["drivers.sim.joint_compliance=0.0", "drivers.sim.lag=0.0", "drivers.sim.noise_force=0.0"]
    overrides += [f"drivers.sim.bias_{what}=[0.0, 0.0, 0.0]" for what in ("force", "torque")]
    return load_scene("block", [*overrides, "drivers.sim.drift_force=[0.0, 0.0, 0.0]"])


@pytest.fixture(scope="module")
def robot(scene):
    return robot_by_name(scene.arm.robot).with_base(scene.arm.base.matrix()).with_tool(scene.arm.tool.matrix())


@pytest.fixture(scope="module")
def presses(scene, robot):
    """Set points, one a cycle: down to 2 mm depth and up again to half a millimetre, over and over."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    pose[:3, 3] = 0.0, 0.0, scene.probe.radius - 0.0005
    solver = IKSolver(robot)
    q = solver.solve(pose, np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])).q
    down, following = [q.copy()], q.copy()
    for _ in range(30):
        pose[2, 3] -= SPEED * CYCLE
        assert solver.track(pose, q, following) == 0
        q = following.copy()
        down.append(q)
    return list(itertools.islice(itertools.cycle(down + down[-2:0:-1]), CYCLES))


class Host:
    """An emulated sensor that streams, the rig's world, and how late each process of the host is run, s each cycle.

    `rig` is late to begin its cycles; `answering` and `explorer` to read what has come.
    """

    def __init__(self, clock, scene, start):
        self.clock, self.world = clock, SimulatedWorld(scene, 1, start)
        self.device = device = AtiEmulator("127.0.0.1:0", "127.0.0.1:0", noise=0.0)
        device.set_load(1, lambda instant: self.world.record(device.sequence, instant), self.world.measured_at)
        table = "\n".join(device.transducers[1].table())
        self.stream = Stream(AtiConfig(rate=125), parse_calibration(table, 1, 1))
        self.states, self.samples = [], []

    def run(self, path, rig, answering, explorer):
        clock = self.clock
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line, selectors.SelectSelector() as selector:
            self.device.open(selector)
            host, port = self.device.udp_address.split(":")
            line.connect((host, int(port)))
            line.settimeout(5.0)
            line.send(encode_command(Command.START, 1))
            key, _ = selector.select(5.0)[0]
            key.data()
            waiting, due = [], clock.now
            for k, (begin, end) in enumerate(itertools.pairwise(path)):
                tick = clock.now = max(clock.now, due) + rig[k]
                due = tick + CYCLE
                self.world.advance(begin, end, CYCLE)
                sent = self.device.sent
                self.device.work(tick)
                waiting += [(line.recv(2048), tick + ON_THE_WAY) for _ in range(self.device.sent - sent)]
                self._take_state(tick + ON_THE_WAY, answering[k])
                if explorer[k] < CYCLE:  # else it reads with a later cycle
                    self._take_samples(waiting, tick + 2.0 * ON_THE_WAY + explorer[k])
                    waiting = []
                clock.now = tick
            self.device.close()

    def _take_state(self, came, late):
        self.clock.now = came + late
        self.states.append((arrival_time.arrival_time(self.clock.arrived(came)), self.world.joints()))

    def _take_samples(self, waiting, now):
        self.clock.now = now
        for data, came in waiting:
            self.samples += self.stream.samples(data, arrival_time.arrival_time(self.clock.arrived(came)), now)

    def apart(self, robot, radius):
        """(n,) s, by how much each sample's force is later than the arm's dates say that it is."""
        times = np.array([time for time, _ in self.states])
        heights = robot.fk_batch(np.array([q for _, q in self.states]))[:, 2, 3]
        samples = [s for s in self.samples if times[4] < s.time < times[-4]]
        at = np.array([s.time for s in samples])
        depth = radius - np.interp(at, times, heights)
        return (STIFFNESS * depth + np.array([s.force[2] for s in samples])) / (STIFFNESS * SPEED)


def stalls(seconds, share, seed=3):
    """s late in each cycle: up to `seconds`, in a `share` of the cycles."""
    chance = random.Random(seed)
    return [chance.uniform(0.2, 1.0) * seconds if chance.random() < share else 0.0 for _ in range(CYCLES)]


NEVER = [0.0] * CYCLES


@pytest.mark.parametrize(
    "late",
    [
        {},
        {"rig": stalls(0.004, 0.5)},
        {"rig": stalls(0.2, 0.05)},
        {"answering": stalls(0.05, 0.2)},
        {"explorer": stalls(0.05, 0.3)},
        {"answering": [0.05] * CYCLES},
        {"explorer": [0.008] * CYCLES},
        {"rig": stalls(0.1, 0.05, 1), "answering": stalls(0.05, 0.2, 2), "explorer": stalls(0.1, 0.2, 4)},
    ],
    ids=[
        "quiet",
        "rig often a little",
        "rig 0.2 s",
        "answering",
        "explorer",
        "answering always",
        "explorer always",
        "all",
    ],
)
def test_arm_and_sensor_are_dated_alike(clock, scene, robot, presses, late):
    host = Host(clock, scene, presses[0])
    host.run(presses, **({"rig": NEVER, "answering": NEVER, "explorer": NEVER} | late))
    apart = host.apart(robot, scene.probe.radius)
    assert len(apart) > CYCLES // 2
    # Records wait for the end of the arm's cycle: the fastest of them for up to a fourth of a sensor period.
    assert np.quantile(np.abs(apart), 0.98) < 0.003
    assert np.abs(apart).max() < 0.006
