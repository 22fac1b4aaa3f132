"""What a run learns of its touch: refusal, the sensor's state, zero, swinging, and swinging."""

from types import SimpleNamespace

import numpy as np
import pytest

from lwrprobe.contact import Wrench, WrenchConditioner, make_estimator
from lwrprobe.contracts import Contact, Goal, VelocityCommand, WrenchSample
from lwrprobe.exploration.loop.sample_step import SampleStep
from lwrprobe.exploration.procedures.start_posture import start_posture
from lwrprobe.exploration.safety.silence_guard import SensorLost
from lwrprobe.exploration.stages.force import ForceStage, TouchRefused
from lwrprobe.exploration.stages.touch_law import arm_stiffness, softer_than_along, stiffness_slope
from lwrprobe.kinematics import follow
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

DOWN = np.diag([1.0, -1.0, -1.0])


def stage(*settings):
    scene = load_scene("block", settings)
    probe = scene.probe.as_probe()
    conditioner = WrenchConditioner(probe, 125.0)
    free = np.random.default_rng(1).normal(size=(100, 6)) * np.repeat([3e-3, 1.6e-5], 3)
    conditioner.take_bias([WrenchSample(k / 125.0, v[:3], v[3:], k) for k, v in enumerate(free)], DOWN)
    made = ForceStage(scene, probe, conditioner, make_estimator(scene.contact.estimator, probe), 125.0)
    return made, conditioner


def wrench(time, force, status=0):
    force = np.array(force, dtype=float)
    return Wrench(time, DOWN.T @ force, np.zeros(3), force, round(125 * time), status)


def touching(force):
    normal = np.array([0.0, 0.0, 1.0])
    return Contact(0.0, np.zeros(3), normal, force * normal, np.zeros(3), 0.9, "")


def test_a_surface_that_no_speed_is_safe_for_is_refused_with_the_numbers():
    force, _ = stage("contact.stiffness=1e7")
    with pytest.raises(TouchRefused, match=r"0\.2 mm/s are needed"):
        force.begin(0.0135)
    assert "mm/s" in force.report()["refused"]
    slower, _ = stage("contact.stiffness=1e5")
    slower.begin(0.0135)
    assert slower.report()["stability_number"] == pytest.approx(np.exp(-1.0), abs=1e-3)


def test_a_stream_that_fails_stops_the_run():
    step = SampleStep.__new__(SampleStep)
    step._pipeline = SimpleNamespace(conditioner=stage()[1])
    step._silence = SimpleNamespace(update=lambda status: None)
    bad = [WrenchSample(2.0 + k / 125.0, np.full(3, np.nan), np.zeros(3), 200 + k) for k in range(3)]
    for sample in bad[:2]:
        step.conditioned(sample, DOWN)
    with pytest.raises(SensorLost, match="3 invalid readings"):
        step.conditioned(bad[2], DOWN)


def test_a_force_that_swings_slows_the_velocity_and_calm_gives_it_back():
    force, _ = stage("uncertainty.profile=ideal")
    force.begin(0.0135)
    command, pose = VelocityCommand(np.array([0.01, 0.0, 0.0])), np.eye(4)
    time = 0.0
    for k in range(24):
        time = 0.024 * k
        size = 0.8 + (0.6 if k % 2 else -0.6)
        force.update(wrench(time, (0, 0, size)), pose, touching(size))
    slowed = force.limit(command, wrench(time, (0, 0, 0.8)), 0.0)
    assert slowed.velocity[0] < 0.006
    assert force.report()["limit_cycles"] >= 1
    for k in range(2000):
        force.update(wrench(time + 0.008 * k, (0, 0, 0.8)), pose, touching(0.8))
    assert force.limit(command, wrench(time + 16.1, (0, 0, 0.8)), 0.0).velocity[0] == 0.01


@pytest.mark.parametrize(("motion", "moved"), [(Goal(np.eye(4), 0.1), True), (VelocityCommand(np.zeros(3)), False)])
def test_the_zero_is_followed_on_the_way_to_a_goal_only(motion, moved):
    force, conditioner = stage()
    force.begin(0.0135)
    before = conditioner.bias
    for k in range(200):
        time = 1.0 + 0.008 * k
        force.limit(motion, wrench(time, (0.004, 0.0, 0.0)), 0.0)
    assert (force.report()["zero_moved"] > 0) == moved
    assert (conditioner.bias[0] > before[0] + 0.003) == moved


def test_a_touch_on_the_way_or_a_changing_speed_leaves_the_zero_alone():
    for touch, acceleration in ((0.3, 0.0), (0.004, 10.0)):
        force, conditioner = stage()
        force.begin(0.0135)
        before = conditioner.bias
        for k in range(200):
            time = 1.0 + 0.008 * k
            force.limit(Goal(np.eye(4), 0.1), wrench(time, (touch, 0.0, 0.0)), acceleration)
        np.testing.assert_array_equal(conditioner.bias, before)


def press(force, certain=True, compliance=1.5e-5, seconds=2.0):
    """The probe is pressed up and down along the stick on something of this compliance, m/N."""
    pose = np.eye(4)
    pose[:3, :3] = DOWN
    for k in range(int(125 * seconds)):
        size = 1.0 + 0.4 * np.sin(0.3 * k)
        pose[2, 3] = -compliance * size
        force.update(wrench(0.008 * k, (0, 0, size)), pose.copy(), touching(size), certain)


def test_speeds_along_the_stick_follow_the_stiffness_that_presses_have_shown():
    force, _ = stage()
    force.begin(0.0135)
    down, aside = VelocityCommand(np.array([0.0, 0.0, -0.005])), VelocityCommand(np.array([0.01, 0.0, 0.0]))
    free = wrench(0.0, (0, 0, 0))
    force.update(free, np.block([[DOWN, np.zeros((3, 1))], [0.0, 0.0, 0.0, 1.0]]), None)
    first = force.limit(down, free, 1.0).velocity[2]
    assert -0.005 < first < -0.004
    assert force.limit(aside, free, 1.0).velocity[0] == 0.01
    press(force, seconds=8.0)
    assert -0.002 < force.limit(down, free, 1.0).velocity[2] < -0.001
    assert any("the probe moves slower" in sentence for sentence in force.report()["warnings"])


def test_a_resumed_run_keeps_the_speeds_that_presses_had_shown():
    """Its force stage begins twice: before the presses of the first part are recalled, and when the arm moves."""
    force, _ = stage()
    force.begin(0.0135)
    press(force, seconds=8.0)
    slow = force.touch_speed
    force.begin(0.0135)
    assert force.touch_speed == slow


def test_contacts_that_come_back_harder_than_planned_slow_the_probe():
    force, _ = stage("truth.profile=ideal", "uncertainty.profile=ideal")
    force.begin(0.0135)
    before, pose, time = force.touch_speed, np.eye(4), 0.0
    pose[:3, :3] = DOWN
    for _ in range(3):
        for size in (0.0, 0.0, 1.5, 3.0, *[0.8] * 10):
            time += 0.008
            contact = touching(size) if size > 0.0 else None
            force.update(wrench(time, (0.0, 0.0, size)), pose, contact)
    assert force.touch_speed == pytest.approx(before * 1.25 * 1.4 / 2.8)  # 1.4 N over the threshold were planned


def test_a_stick_that_hardly_bends_is_slower_across_as_well():
    shares = []
    for stiffness in (2500.0, 3e5):
        force, _ = stage("uncertainty.profile=datasheet", f"probe.stiffness_lateral={stiffness}")
        force.begin(0.0135)
        force.update(wrench(0.0, (0, 0, 0)), np.block([[DOWN, np.zeros((3, 1))], [0.0, 0.0, 0.0, 1.0]]), None)
        free = wrench(0.0, (0, 0, 0))
        down, aside = VelocityCommand(np.array([0.0, 0.0, -0.001])), VelocityCommand(np.array([0.001, 0.0, 0.0]))
        along, across = force.limit(down, free, 1.0).velocity[2], force.limit(aside, free, 1.0).velocity[0]
        shares.append((along / -0.001, across / 0.001))
    (soft, soft_across), (stiff, stiff_across) = shares
    assert soft == stiff < 0.5
    assert soft_across == 1.0, "the stick gives way far more than the arm"
    assert stiff - 0.05 <= stiff_across < 0.6


def test_the_zero_is_taken_beyond_the_dent_that_was_found_in_a_soft_object():
    """Off what the stated stiffness says, the sphere of a soft object would still press."""
    lifted = []
    for compliance in (0.0, 1e-3):
        force, _ = stage("contact.stiffness=2e5")
        force.begin(0.0135)
        if compliance:
            press(force, compliance=compliance, seconds=8.0)
        pose = np.eye(4)
        pose[:3, :3] = DOWN
        force.update(wrench(20.0, (0, 0, 0.8)), pose, touching(0.8))
        lifted.append(force._gives)
    assert lifted[1] - lifted[0] == pytest.approx(1e-3, rel=0.1)


def test_a_few_presses_that_scatter_refuse_nothing():
    """Batches of ten changes of the force scatter by half of the compliance; three of them had refused a touch."""
    force, _ = stage()
    force.begin(0.0135)
    down, free = VelocityCommand(np.array([0.0, 0.0, -0.005])), wrench(1.0, (0, 0, 0))
    force.update(free, np.block([[DOWN, np.zeros((3, 1))], [0.0, 0.0, 0.0, 1.0]]), None)
    first = force.limit(down, free, 1.0).velocity[2]
    for compliance in (1e-6, 3.4e-5, 2e-6):
        press(force, compliance=compliance, seconds=0.11)
        force.update(free, np.eye(4), None)
    assert force.limit(down, free, 1.0).velocity[2] == first
    for compliance in 4 * (1.5e-5, 3.4e-5, 7e-5):
        press(force, compliance=compliance, seconds=0.11)
    assert -0.005 <= force.limit(down, free, 1.0).velocity[2] < -0.0035, "slower by no more than they scatter"
    assert force.stiffness.compliance == 0.0


def test_an_arm_that_is_hardly_known_is_the_one_that_presses_show():
    """Half of the stated compliance is within what a data sheet says of an arm, and yet twice the force."""
    force, _ = stage('uncertainty.profile="datasheet"', "uncertainty.clock_skew_ms=0", "uncertainty.sensor_delay_ms=0")
    force.begin(0.0135)
    press(force, compliance=2.5e-5)
    down = VelocityCommand(np.array([0.0, 0.0, -0.005]))
    assert -0.0035 < force.limit(down, wrench(0.0, (0, 0, 0)), 1.0).velocity[2] < -0.002


def test_a_loop_whose_delay_two_clocks_leave_open_is_slower_also_after_presses():
    """The samples' age is the difference of two clocks: an offset of theirs is delay that nothing measures."""
    down, speeds = VelocityCommand(np.array([0.0, 0.0, -0.005])), []
    for skew in (0.0, 8.0):
        force, _ = stage(f"uncertainty.clock_skew_ms={skew}", "uncertainty.sensor_delay_ms=0")
        force.begin(0.0156)
        press(force, compliance=5e-5)
        speeds.append(-force.limit(down, wrench(0.0, (0, 0, 0)), 1.0).velocity[2])
    assert speeds[0] == 0.005
    assert 1.0 + 2.0 * 8.0 / 15.6 <= speeds[0] / speeds[1] * 1.25 < 2.3


def test_an_arm_with_mass_is_slower_from_the_first_touch_and_keeps_its_speed():
    (light, _), (heavy, _) = stage(), stage()
    light.begin(0.0135)
    heavy.begin(0.0135, tip_mass=3.2)
    assert heavy.touch_speed < 0.5 * light.touch_speed
    before = heavy.touch_speed
    press(heavy)
    assert heavy.touch_speed == before
    assert heavy.report()["arm_mass_at_tip_kg"] == 3.2
    assert heavy.report()["stiffness_found"] is None


def touch_from_the_side(force, object_gives, times=3):
    """Slow touches across the stick, which itself gives way by 0.4 mm/N there."""
    pose, normal = np.eye(4), np.array([1.0, 0.0, 0.0])
    pose[:3, :3] = DOWN
    for number in range(times):
        for k in range(30):
            size = 0.05 * min(k, 20)
            pose[0, 3] = -(4e-4 + object_gives) * size
            contact = Contact(0.0, np.zeros(3), normal, size * normal, np.zeros(3), 0.9, "")
            force.update(wrench(0.4 * number + 0.008 * k, size * normal), pose.copy(), contact if k else None)
        force.update(wrench(0.4 * number + 0.3, (0, 0, 0)), pose.copy(), None)


def test_presses_overrule_touches_that_took_the_sticks_give_for_the_objects():
    """Touches from the side see the stick, whose stiffness is known to a fifth; presses along it hardly do."""
    force, _ = stage("uncertainty.profile=datasheet")
    force.begin(0.0135)
    touch_from_the_side(force, 3e-4)
    assert force.stiffness.compliance == pytest.approx(3e-4, rel=0.1)
    assert 1e-5 < force.stiffness.sigma(5e-5, 0.4) < 6e-5, "of the touches"
    stated = 1.0 / load_scene("block").contact.stiffness
    press(force, compliance=stated)
    assert force.stiffness.compliance == 0.0
    assert force.stiffness.sigma(5e-5, 0.4) < 0.2 * stated
    touch_from_the_side(force, 3e-4)
    assert force.stiffness.compliance == 0.0, "later touches do not bring it back"


def test_touches_that_presses_confirm_stay():
    force, _ = stage()
    force.begin(0.0135)
    touch_from_the_side(force, 3e-4)
    press(force, compliance=3e-4)
    assert force.stiffness.compliance == pytest.approx(3e-4, rel=0.1)
    # A soft object's compliance is known to a tenth, which may be more than what was thought possible before.
    assert force.stiffness.sigma(1e-5, 0.0) == pytest.approx(3e-5, rel=0.1)


@pytest.mark.parametrize("ahead", [0.0, 86_400.0])
def test_the_time_since_the_zero_was_taken_counts_from_the_last_time_in_free_space(ahead):
    """Whatever the sensor's clock says when the run begins."""
    force, _ = stage()
    force.begin(0.0135)
    assert force.zero.age(np.array([0.0, 0.7])) == pytest.approx([0.0, 0.7])
    for k in range(100):
        sample = wrench(ahead + 1.0 + 0.008 * k, (0.004, 0.0, 0.0))
        force.update(sample, np.eye(4), None, time=1.0 + 0.008 * k)
        force.limit(Goal(np.eye(4), 0.1), sample, 0.0)
    taken = 1.0 + 0.5
    assert force.zero.error(2.0) < force.zero.error(20.0)
    assert force.zero.age(np.array([0.7, 9.0])) == pytest.approx([0.7, 9.0 - taken], abs=0.02)


def test_what_presses_have_shown_is_dropped_where_the_normals_cannot_be_relied_on():
    force, _ = stage()
    force.begin(0.0135)
    press(force, compliance=2e-4)
    assert force.stiffness.compliance == pytest.approx(2e-4, rel=0.1)
    press(force, certain=False, seconds=0.1)
    assert force.stiffness.compliance == 0.0


def test_the_probe_is_slower_where_the_arm_is_stiffer_than_where_that_is_stated():
    force, _ = stage("truth.profile=ideal", "uncertainty.profile=ideal")
    force.begin(0.0135)
    force.speeds.expect(np.zeros(3), np.array([-3.5, 0.0, 0.0]))
    for x, share in ((0.0, 1.0), (0.08, 1.0), (-0.08, 0.95)):
        pose = np.eye(4)
        pose[:3, :3], pose[0, 3] = DOWN, x
        force.update(wrench(0.0, (0.0, 0.0, 0.0)), pose, None)
        down = force.limit(VelocityCommand(np.array([0.0, 0.0, -0.002])), wrench(0.0, (0.0, 0.0, 0.0)), 0.0)
        assert down.velocity[2] == pytest.approx(-0.002 * share, rel=1e-6)
        across = force.limit(VelocityCommand(np.array([0.002, 0.0, 0.0])), wrench(0.0, (0.0, 0.0, 0.0)), 0.0)
        assert across.velocity[0] == 0.002


def test_the_probe_is_slower_where_the_arm_is_stiffer_along_a_stick_that_leans():
    """Towards its own shoulder the arm gives way less than downwards, away from it more."""
    scene = load_scene("block", ["truth.profile=ideal", "uncertainty.profile=ideal"])
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    force, _ = stage("truth.profile=ideal", "uncertainty.profile=ideal")
    force.begin(0.0135)
    force.speeds.expect(pose[:3, 3], np.zeros(3), softer_than_along(scene, robot, q))
    jacobian, shares = robot.jacobian(q)[:3], []
    for angle in (-0.6, 0.0, 0.6):
        axis = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        held = pose.copy()
        held[:3, :3] = np.array([np.cross([0.0, 1.0, 0.0], axis), [0.0, 1.0, 0.0], axis]).T
        force.update(wrench(0.0, (0.0, 0.0, 0.0)), held, None)
        moved = force.limit(VelocityCommand(0.002 * axis), wrench(0.0, (0.0, 0.0, 0.0)), 0.0)
        shares.append(float(moved.velocity @ axis) / 0.002)
        gives = np.sum((axis @ jacobian) ** 2) / np.sum((pose[:3, 2] @ jacobian) ** 2)
        of_object = 1.0 / scene.contact.object_stiffness
        here = (1.0 / scene.contact.stiffness - of_object) * gives + of_object
        assert shares[-1] == pytest.approx(min(1.25 * here * scene.contact.stiffness, 1.0), abs=0.051)
    assert shares[1] == 1.0
    assert min(shares) < 0.7


def test_the_slope_of_the_stiffness_is_that_between_neighbouring_places():
    scene = load_scene("block")
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)
    slope, shift = stiffness_slope(robot, q), 0.02

    def compliance(x):
        path = np.tile(pose, (20, 1, 1))
        path[:, 0, 3] += np.linspace(0.0, x, 20)
        return float(np.sum((pose[:3, 2] @ robot.jacobian(follow(robot, path, q).q[-1])[:3]) ** 2))

    assert slope[0] == pytest.approx(np.log(compliance(-shift) / compliance(shift)) / (2.0 * shift), rel=0.03)
    assert slope[0] < -3.0  # a third over 0.1 m


def test_the_arm_gives_way_more_sideways_than_along_the_stick_as_its_joints_turn():
    """A naive twin: each joint turns by its torque, and the tip moves by what all of them move it."""
    scene = load_scene("block", ["uncertainty.profile=ideal"])
    robot = robot_of(scene)
    pose, q = start_posture(scene, robot)

    def moved(force):
        torques = [
            1e6 * float(force @ (robot.fk(q + turn).t - robot.fk(q - turn).t)) / 2.0 for turn in 1e-6 * np.eye(robot.n)
        ]
        return robot.fk(q + 1e-6 * np.array(torques)).t - robot.fk(q).t

    along = pose[:3, 2]
    joint = 1.0 / arm_stiffness(scene) / float(along @ moved(along))
    for axis in np.eye(3):
        expected = joint * float(axis @ moved(axis)) - 1.0 / arm_stiffness(scene)
        assert axis @ softer_than_along(scene, robot, q) @ axis == pytest.approx(expected, abs=1e-8)
    sure, ways = np.linalg.eigh(softer_than_along(scene, robot, q))
    unsure = softer_than_along(load_scene("block", ["uncertainty.profile=datasheet"]), robot, q)
    assert sure[0] < 0.0 < sure[-1]
    expected = [value * (0.6 if value > 0.0 else 1.0) for value in sure]  # known to 40 %
    assert np.diag(ways.T @ unsure @ ways) == pytest.approx(expected), "what is stiffer counts in full"
