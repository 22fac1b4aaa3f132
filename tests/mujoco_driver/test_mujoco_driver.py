"""The plug-in `mujoco` against kinematics, statics, Coulomb's law and the plug-in `sim`."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from lwrprobe.contracts import DeviceRefused, DriverContext, DriverError, InputError
from lwrprobe.kinematics import link_inertias, mass_matrix, robot_by_name
from lwrprobe.scene import load_scene
from lwrprobe_mujoco import MujocoConfig, MujocoDriver
from lwrprobe_mujoco.solids import SKIN, pieces
from lwrprobe_sim import SimConfig, SimDriver

pytestmark = pytest.mark.slow  # its imports take seconds

QUIET = {
    "noise_force": 0.0, "noise_torque": 0.0, "loss": 0.0, "quantisation": False, "bias_force": (0.0, 0.0, 0.0),
    "bias_torque": (0.0, 0.0, 0.0), "drift_force": (0.0, 0.0, 0.0), "late_share": 0.0,
}  # fmt: skip
ABOVE = np.array([0.0, -0.880840752, 0.0, 1.41659541, 0.0, -0.844156489, 0.0])
"""rad, LWR 4+ of the scene `block`: probe pointing down, the sphere 0.5 mm above the block's top."""


def opened(driver_class, config, scene=None, start=ABOVE, seed=1):
    driver = driver_class(
        DriverContext(config, scene or load_scene("block", ["truth.profile=ideal"]), seed, False, start)
    )
    arm, sensor = driver.arm(), driver.sensor()
    arm.open()
    sensor.open()
    return driver, arm, sensor


def joints_along(robot, start, offsets):
    """Joint values that put the tip at the start's place plus each offset (3,), with the start's direction."""
    q, frame = start.copy(), robot.fk(start).A
    rows = []
    for offset in offsets:
        for _ in range(4):
            now = robot.fk(q).A
            error = np.zeros(6)
            error[:3] = frame[:3, 3] + offset - now[:3, 3]
            turn = frame[:3, :3] @ now[:3, :3].T
            error[3:] = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            q = q + np.linalg.pinv(robot.jacobian(q)) @ error
        rows.append(q)
    return rows


def press_and_slide():
    """Offsets [m]: eased 0.7 mm down, at rest, 4 mm aside, at rest."""
    ease = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 300))
    down = np.zeros((450, 3))
    down[:300, 2], down[300:, 2] = -7e-4 * ease, -7e-4
    aside = np.repeat(down[-1:], 500, axis=0)
    aside[:300, 1], aside[300:, 1] = 0.004 * ease, 0.004
    return np.concatenate([down, aside])


def run(driver_class, config, scene=None):
    driver, arm, sensor = opened(driver_class, config, scene)
    scene = driver.ground_truth().scene
    robot = robot_by_name(scene.arm.robot, scene.arm.tool.matrix(), scene.arm.base.matrix())
    samples = []
    for q in joints_along(robot, ABOVE, press_and_slide()):
        arm.command(q)
        arm.read()
        samples += sensor.read()
    return driver, samples


@pytest.fixture(scope="module")
def pressed():
    return run(MujocoDriver, MujocoConfig(**QUIET))


@pytest.mark.parametrize("name", ["lwr4", "iiwa14", "ur5e", "panda", "puma560"])
def test_the_sphere_is_where_the_robot_says(name):
    scene = load_scene("empty", [f"arm.robot={name}", "truth.profile=ideal"])
    robot = robot_by_name(name, scene.arm.tool.matrix(), scene.arm.base.matrix())
    low, high = np.maximum(robot.lower, -2.0), np.minimum(robot.upper, 2.0)
    start = low + (high - low) * np.random.default_rng(3).uniform(0.2, 0.8, robot.n)
    driver, arm, _ = opened(MujocoDriver, MujocoConfig(**QUIET, gravity=(0.0, 0.0, 0.0)), scene, start)
    arm.read()
    world = driver._world
    centre = world._d.geom_xpos[world.model.sphere]
    np.testing.assert_allclose(centre, robot.fk(start).A[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ["lwr4", "ur5e", "panda", "puma560"])
def test_the_arm_has_the_mass_that_the_force_law_counts_with(name):
    """MuJoCo's own mass matrix, less what the flange carries, is that of `kinematics.mass_matrix`."""
    scene = load_scene("empty", [f"arm.robot={name}", "truth.profile=ideal", "probe.mass=0"])
    robot = robot_by_name(name, scene.arm.tool.matrix(), scene.arm.base.matrix())
    start = 0.3 * robot.lower + 0.7 * robot.upper if name != "ur5e" else np.linspace(-1.0, 1.0, 6)
    driver, arm, _ = opened(MujocoDriver, MujocoConfig(**QUIET), scene, start)
    world = driver._world
    found = np.zeros((world._m.nv, world._m.nv))
    mujoco.mj_fullM(world._m, world._d, found)
    ours = mass_matrix(robot, link_inertias(robot, arm.mass), start)
    np.testing.assert_allclose(found[: robot.n, : robot.n], ours, rtol=0.01, atol=1e-3)


def test_at_rest_the_sensor_feels_the_weight_alone():
    _, arm, sensor = opened(MujocoDriver, MujocoConfig(**QUIET))
    samples = []
    for _ in range(300):
        arm.read()
        samples += sensor.read()
    weight = load_scene("block").probe.mass * 9.80665
    np.testing.assert_allclose(samples[-1].force, [0.0, 0.0, weight], atol=2e-4)  # the sensor's z points down


def test_a_contact_at_rest_has_the_object_s_stiffness(pressed):
    driver, _ = pressed
    world = driver._world
    touching = [c for c in world._d.contact[: world._d.ncon] if c.dist < 0.0]
    contact = driver.ground_truth().contact_at(max(world.truth))
    assert len(touching) == 1
    # the end of the run rests with friction, so that the normal part is what the stiffness takes
    normal_force = contact.force / np.hypot(1.0, 0.3)
    assert normal_force <= 1e5 * -touching[0].dist * 1.05
    assert contact.force >= 1e5 * -touching[0].dist * 0.95


def test_an_object_that_is_stiffer_than_a_step_resolves_is_taken_as_stiff_as_it_resolves():
    """The light stick had chattered on it, and above 1e6 N/m the world broke down."""
    scene = load_scene("block", ["truth.profile=ideal", "truth.object_stiffness=5e6"])
    driver, samples = run(MujocoDriver, MujocoConfig(**QUIET), scene)
    rest = np.array([s.force for s in samples if s.time > samples[-1].time - 0.1])
    assert np.ptp(rest, axis=0).max() < 0.01
    assert 1.0 < driver.ground_truth().probe_peak_force < 1.2 * np.linalg.norm(rest[-1])
    (left,) = driver.left_out
    assert left["stage"] == "stiffness of the object"
    assert "1.2e+05 N/m" in left["why"]


def test_friction_is_coulomb_s_while_the_sphere_slides(pressed):
    _, samples = pressed
    sliding = [s for s in samples if 0.58 < s.time < 0.65]
    forces = np.array([s.force for s in sliding]) - [0.0, 0.0, 0.0294]
    ratio = np.hypot(forces[:, 0], forces[:, 1]) / np.abs(forces[:, 2])
    np.testing.assert_allclose(ratio, 0.3, atol=0.01)


def test_wrench_agrees_with_the_plug_in_sim(pressed):
    _, ours = pressed
    _, theirs = run(SimDriver, SimConfig(**QUIET))
    for at in (0.44, 0.62):  # pressed at rest, and sliding
        mine = next(s for s in ours if s.time >= at)
        other = next(s for s in theirs if s.time >= at)
        size = np.linalg.norm(other.force)
        assert size > 3.0
        np.testing.assert_allclose(mine.force, other.force, atol=0.03 * size)
        np.testing.assert_allclose(mine.torque, other.torque, atol=0.03 * size * 0.05)


def test_true_contact_lies_on_the_undeformed_surface(pressed):
    driver, samples = pressed
    truth = driver.ground_truth()
    found = [truth.contact_at(s.sequence) for s in samples if truth.contact_at(s.sequence)]
    assert len(found) > 50
    for contact in found:
        assert abs(contact.point[2] - 0.05) < 1e-6
        np.testing.assert_allclose(contact.normal, [0.0, 0.0, 1.0], atol=1e-9)
    assert truth.peak_force >= max(contact.force for contact in found) - 1e-9
    assert truth.link_collisions == 0


def test_same_seed_same_samples_and_another_seed_others():
    def forces(seed):
        _, arm, sensor = opened(MujocoDriver, MujocoConfig(), seed=seed)
        samples = []
        for _ in range(100):
            arm.read()
            samples += sensor.read()
        return np.array([s.force for s in samples])

    np.testing.assert_array_equal(forces(4), forces(4))
    assert not np.array_equal(forces(4), forces(5))


def test_many_steps_are_the_same_as_single_ones():
    robot_rows = np.array([ABOVE + 1e-4 * k * np.eye(7)[6] for k in range(7)])
    _, one, first = opened(MujocoDriver, MujocoConfig())
    _, many, second = opened(MujocoDriver, MujocoConfig())
    assert many.cycles_until_sample(100) == 11  # 8 ms of the first sample, 4 ms of latency
    states = []
    for q in robot_rows:
        one.command(q)
        states.append(one.read())
    times, joints = np.empty(7), np.empty((7, 7))
    assert many.step_many(robot_rows, times, joints, 0.1) == (7, 0)
    np.testing.assert_array_equal(joints, [s.q for s in states])
    np.testing.assert_array_equal(times, [s.time for s in states])
    assert first.read() == second.read() == []


def test_a_link_that_hits_is_counted_once():
    short = ["probe.stick_length=0.01", "probe.sensor_distance=0.015", "arm.tool.xyz=[0.0, 0.0, 0.25]"]
    scene = load_scene("block", ["truth.profile=ideal", *short])
    robot = robot_by_name(scene.arm.robot, scene.arm.tool.matrix(), scene.arm.base.matrix())
    driver, arm, _ = opened(MujocoDriver, MujocoConfig(**QUIET), scene)
    # aside, so that the sphere is clear of the block and the sensor above it is not, then down
    offsets = [(0.0, 0.033 * min(1.0, k / 400), -0.021 * max(0.0, (k - 400) / 400)) for k in range(800)]
    counts = []
    for q in joints_along(robot, ABOVE, np.array(offsets)):
        arm.command(q)
        arm.read()
        counts.append(driver.ground_truth().link_collisions)
    assert counts[700] == 0
    assert counts[-1] == 1
    assert driver.ground_truth().peak_force == 0.0


@pytest.mark.parametrize("scene", ["bridge", "jaw_chuck", "polystyrene_1"])
def test_pieces_lie_on_the_surface_of_the_solid(scene):
    loaded = load_scene(scene)
    solid = loaded.solid()
    parts = [piece for shape in loaded.objects for piece in pieces(shape, 1e-4)]
    corners = np.concatenate([p.corners @ p.pose[:3, :3].T + p.pose[:3, 3] for p in parts if p.corners is not None])
    distance = solid.signed_distance(corners)
    outer = distance.reshape(-1, 2, 3)[:, 0]  # three corners on the surface, three behind it
    assert np.abs(outer).max() < 1.5e-4
    assert distance.min() > -1.2 * SKIN


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("timestep", 3e-4),
        ("timestep", 0.0),
        ("arm_mass", -1.0),
        ("feedforward", 1.5),
        ("impedance", 0.95),
        ("lag", np.nan),
    ],
)
def test_a_bad_option_is_named(option, value):
    with pytest.raises(InputError, match=f"mujoco.{option}"):
        MujocoConfig(**{option: value})


def test_what_the_arm_cannot_do_is_refused():
    _, arm, _ = opened(MujocoDriver, MujocoConfig())
    with pytest.raises(DeviceRefused, match="joint 2 is beyond"):
        arm.command(ABOVE + 9.0 * np.eye(7)[1])
    with pytest.raises(DeviceRefused, match="joint 1 asks for"):
        arm.command(ABOVE + 0.5 * np.eye(7)[0])
    arm.close()
    with pytest.raises(DriverError, match="not open"):
        arm.read()


def test_effects_that_are_not_modelled_are_listed():
    config = replace(MujocoConfig(), friction_turn=0.05)
    driver, _, _ = opened(MujocoDriver, config)
    assert [row["stage"] for row in driver.left_out] == ["friction beside the slip"]


def test_stop_brings_the_arm_to_rest():
    _, arm, _ = opened(MujocoDriver, MujocoConfig(**QUIET))
    q = ABOVE.copy()
    for _ in range(200):
        q[0] += 5e-4
        arm.command(q)
        arm.read()
    arm.stop()
    for _ in range(200):
        state = arm.read()
    assert np.abs(state.qd).max() < 1e-6
    assert state.q[0] > q[0]
