"""One simulated world behind both emulated devices: set points move it, the sensor feels it."""

import itertools
import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contracts import DriverContext
from lwrprobe.contracts import GroundTruth as Truth
from lwrprobe.contracts.plugins import load
from lwrprobe.errors import MotionInterrupted
from lwrprobe.evaluation.truth import is_world_of
from lwrprobe.kinematics import IKSolver, robot_by_name
from lwrprobe.scene import Scene, load_scene, scene_names
from lwrprobe.scene.actual_scene import actual_scene
from lwrprobe_rig import world as world_module
from lwrprobe_rig.console import OperatorConsole
from lwrprobe_rig.ground_truth import GroundTruth
from lwrprobe_rig.reactor import Reactor
from lwrprobe_rig.world import SimulatedWorld

pytestmark = pytest.mark.realtime

CYCLE = 0.01


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
    overrides += ["table.stiffness=2000.0", "table.damping=0.0", "table.friction=0.0"]
    overrides += ["drivers.sim.joint_compliance=0.0"]
    overrides += [f"drivers.sim.bias_{what}=[0.0, 0.0, 0.0]" for what in ("force", "torque")]
    return load_scene("block", [*overrides, "drivers.sim.drift_force=[0.0, 0.0, 0.0]"])


@pytest.fixture(scope="module")
def robot(scene):
    return robot_by_name(scene.arm.robot).with_base(scene.arm.base.matrix()).with_tool(scene.arm.tool.matrix())


@pytest.fixture(scope="module")
def descent(scene, robot):
    """Set points, one a cycle, that lower the probe onto the table 2 mm deep, and the last tip pose."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    pose[:3, 3] = 0.0, 0.0, scene.probe.radius + 0.004
    solver, q = IKSolver(robot), None
    q = solver.solve(pose, np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])).q
    path, following = [q.copy()], q.copy()
    for _ in range(120):
        pose[2, 3] -= 0.00005
        assert solver.track(pose, q, following) == 0
        q = following.copy()
        path.append(q)
    return np.array(path)


def test_depth_times_stiffness_is_felt(scene, descent):
    world = SimulatedWorld(scene, 1, descent[0])
    for before, after in itertools.pairwise(descent):
        world.advance(before, after, CYCLE)
    for _ in range(20):
        world.advance(descent[-1], descent[-1], CYCLE)
    assert world.joints() == pytest.approx(descent[-1], abs=1e-6)
    force = world.wrench(0.0)[:3]
    assert np.linalg.norm(force) == pytest.approx(0.002 * 2000.0, rel=0.05)
    # The table pushes the probe upwards; the sensor's z points down.
    assert force[2] == pytest.approx(-4.0, rel=0.05)
    assert world.ground_truth.peak_force == pytest.approx(4.0, rel=0.05)
    assert not world.refused


def test_a_record_is_of_its_own_instant_and_waits_until_the_world_has_come_there(scene, descent, monkeypatch):
    now = 1000.0
    monkeypatch.setattr(world_module, "time", SimpleNamespace(monotonic=lambda: now))
    world = SimulatedWorld(scene, 1, descent[0])
    assert world.measured_at(now) == now
    for begin, end in itertools.pairwise(descent):
        now += CYCLE
        world.advance(begin, end, CYCLE)
    instants = now - 0.001 * np.arange(5)[::-1]
    forces = [-world.record(number, instant)[2] for number, instant in enumerate(instants)]
    # 5 mm/s onto 2000 N/m: 10 N/s, and the sensor's noise
    assert np.diff(forces).mean() == pytest.approx(0.01, abs=0.005)
    touches = world.contacts(0, 5)
    assert [touch[6] for touch in touches] == pytest.approx(forces, abs=0.05)
    assert (np.diff([touch[6] for touch in touches]) > 0.005).all(), "one touch for each millisecond"
    later = now + 0.001
    assert later < world.measured_at(later) < later + CYCLE * 10
    assert (world.record(20, later) == world.wrench(later)).all()


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_can_be_fetched_from_the_rig(name):
    scene = load_scene(name)
    world = SimpleNamespace(ground_truth=SimpleNamespace(scene=scene))
    assert Scene.model_validate_json(GroundTruth(world).control("scene")) == scene


def test_set_point_that_the_world_cannot_follow_is_named_and_not_followed(scene, descent):
    world = SimulatedWorld(scene, 1, descent[0])
    world.advance(descent[0], descent[0] + 1.0, 0.002)
    assert "limit" in world.refused
    assert world.joints() == pytest.approx(descent[0], abs=1e-6)


def free_address():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def test_touch_over_real_sockets(scene, descent):
    for attempt in range(3):
        try:
            states, samples = touch_over_sockets(scene, descent)
            break
        except MotionInterrupted:  # the host stood still for longer than the controller bridges
            if attempt == 2:
                raise
    assert states[-1].q == pytest.approx(descent[-1], abs=1e-5)
    assert samples[-1].force[2] == pytest.approx(-4.0, rel=0.05)
    assert min(s.force[2] for s in samples[:20]) > -0.1
    # Both clocks are the host's: a sample's instant lies among the arm's states.
    assert states[0].time - 1.0 < samples[0].time < samples[-1].time < states[-1].time


def touch_over_sockets(scene, descent):
    """States of the arm and samples of the sensor while it goes down and for a second after that."""
    world = SimulatedWorld(scene, 1, descent[0])
    bind = free_address()
    controller = load("emulator", "fri").build(world, "127.0.0.1:0", bind, CYCLE, bridged=50)
    device = load("emulator", "ati").build("127.0.0.1:0", "127.0.0.1:0", "1", {1: world.wrench}, 0.0)
    fri, ati = load("driver", "fri"), load("driver", "ati")
    with Reactor([controller, device]):
        arm = fri(DriverContext(fri.Config(bind=bind, remote=controller.address, silence=2.0), scene)).arm()
        addresses = {"telnet": device.telnet_address, "udp": device.udp_address, "local": "127.0.0.1:0"}
        sensor = ati(DriverContext(ati.Config(**addresses), scene)).sensor()
        with arm, sensor:
            samples, states = [], []
            for q in descent:
                states.append(arm.read())
                samples += sensor.read()
                arm.command(q)
            # The world advances at its own rate: a second of it, however long the machine takes for that.
            end, begin = time.monotonic() + 30.0, world.elapsed
            while world.elapsed < begin + 1.0:
                assert time.monotonic() < end
                states.append(arm.read())
                samples += sensor.read()
            states += [arm.read(), arm.read()]  # the second one is measured after the last sample was read
    return states, samples


def test_truth_of_a_run_is_fetched_from_the_rig_once_the_sensor_is_closed(scene, descent):
    world = SimulatedWorld(scene, 1, descent[0])
    for before, after in itertools.pairwise(descent):
        world.advance(before, after, CYCLE)
    control = free_address()
    device = load("emulator", "ati").build("127.0.0.1:0", "127.0.0.1:0", "1", {}, 0.0)
    device.set_load(1, lambda instant: world.record(device.sequence, instant), world.measured_at)
    console = OperatorConsole({"ati": device, "world": GroundTruth(world)}, control, stdin=False)
    ati = load("driver", "ati")
    with Reactor([device, console]):
        addresses = {"telnet": device.telnet_address, "udp": device.udp_address, "local": "127.0.0.1:0"}
        driver = ati(DriverContext(ati.Config(**addresses, ground_truth=control), scene))
        assert driver.ground_truth() is None, "not before there was a run"
        sensor, samples = driver.sensor(), []
        with sensor:
            end = time.monotonic() + 30.0
            while len(samples) < 150:
                assert time.monotonic() < end
                samples += sensor.read()
                time.sleep(0.01)
        truth = driver.ground_truth()
        assert isinstance(truth, Truth)
        assert (truth.scene.objects, truth.scene.probe, truth.scene.table) == (scene.objects, scene.probe, scene.table)
        assert truth.peak_force == pytest.approx(4.0, rel=0.05)
        assert truth.probe_peak_force == pytest.approx(4.0, rel=0.05)
        assert truth.link_collisions == 0
        touches = [truth.contact_at(sample.sequence) for sample in samples]
        assert all(touch.force == pytest.approx(-sample.force[2], abs=0.05) for touch, sample in zip(touches, samples))
        assert touches[0].point[2] == pytest.approx(0.0, abs=1e-6)
        assert touches[0].normal == pytest.approx([0.0, 0.0, 1.0])
        assert truth.contact_at(10_000_000) is None
        silent = ati(DriverContext(ati.Config(**addresses, ground_truth=free_address()), scene))
        with silent.sensor():
            pass
        assert silent.ground_truth() is None


def test_a_world_of_another_seed_is_not_that_of_the_scene():
    """A rig that was started with another seed has its objects elsewhere, and the run says so."""
    one, other = (load_scene("block", ["truth.profile=lab", f"run.seed={seed}"]) for seed in (1, 2))
    fetched = GroundTruth(SimpleNamespace(ground_truth=SimpleNamespace(scene=actual_scene(one)))).control("scene")
    world = Scene.model_validate_json(fetched)
    assert is_world_of(world, one)
    assert not is_world_of(world, other)
    ideal = load_scene("block", ["truth.profile=ideal"])
    assert is_world_of(ideal, ideal)
    assert not is_world_of(world, ideal)


def test_the_line_is_not_the_worlds_affair():
    scene = load_scene("block", ["truth.profile=lab", "run.seed=1"])
    drawn = SimulatedWorld(scene, 1).truth()["differences"]
    assert drawn["loss_burst_ms"] == [0.0]
    assert drawn["clock_skew_ms"] == [0.0]
    assert abs(drawn["probe_length_mm"][0]) > 0.0
    ideal = SimulatedWorld(load_scene("block", ["truth.profile=ideal"]), 1).truth()["differences"]
    assert ideal == {"profile": "ideal"}
