"""What the simulated probe feels: springs in series, friction, several contacts, the stick, and energy."""

import naive_sim as naive
import numpy as np
import pytest
from gantry_rig import Rig, contact, kernels

from lwrprobe_sim import touch_kernels as touch

STICK = ["probe.stiffness_lateral=2500.0", "probe.stiffness_axial=1.3e6"]
TOP = 0.05 + 0.005  # height of the sphere's centre on the block
SIDE = -0.025 - 0.005  # its y at the block's side


def pressed(depth, overrides=(), height=TOP, seconds=0.05, **config):
    """A rig pressed straight down by `depth`, at rest."""
    rig = Rig((0.001, 0.002, height + 5e-4), overrides, **config)
    rig.line((0.001, 0.002, height + 5e-4), (0.001, 0.002, height - depth), seconds)
    rig.go(*[(0.001, 0.002, height - depth)] * 30)
    return rig


@pytest.mark.parametrize("stiffness", 10.0 ** np.arange(2, 8))
@pytest.mark.parametrize("cycle", [1e-4, 1e-3, 5e-3])
def test_rest_force_is_stiffness_times_depth_for_springs_in_series(stiffness, cycle):
    rig = pressed(5e-4, [*STICK, f"object.0.stiffness={stiffness}"], cycle=cycle)
    assert rig.force[2] == pytest.approx(5e-4 / (1 / stiffness + 1 / 1.3e6), rel=1e-9)


def test_the_stick_bends_sideways_by_force_over_lateral_stiffness():
    rig = Rig((0.0, SIDE - 1e-4, 0.03), [*STICK, "object.0.stiffness=1e5"])
    rig.line((0.0, SIDE - 1e-4, 0.03), (0.0, SIDE + 5e-4, 0.03), 0.05)
    rig.go(*[(0.0, SIDE + 5e-4, 0.03)] * 20)
    force = 5e-4 / (1 / 1e5 + 1 / 2500)
    assert rig.force == pytest.approx([0.0, -force, 0.0], rel=1e-9, abs=1e-12)
    assert rig.centre[1] == pytest.approx(SIDE + 5e-4 - force / 2500, abs=1e-12)
    assert rig.world.state[kernels.PROBE_PEAK] == rig.world.state[kernels.PEAK] > 0.9 * force


def test_joints_give_way_by_the_transposed_jacobian():
    rig = pressed(5e-4, ["object.0.stiffness=1e5"], joint_compliance=(0.0, 0.0, 2e-5))
    assert rig.force[2] == pytest.approx(5e-4 / (1e-5 + 2e-5), rel=1e-9)
    # the sensor has moved with the joint: its torque is still that of the force over the sensor's distance
    assert rig.wrench[3:] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("stiffness", 10.0 ** np.arange(2, 8))
@pytest.mark.parametrize("damping", [0.0, 5.0, 5e3])
@pytest.mark.parametrize("cycle", [pytest.param(1e-4, marks=pytest.mark.slow), 1e-3, 5e-3])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_energy_is_never_created(stiffness, damping, cycle, friction):
    material = [f"object.0.{k}={v}" for k, v in dict(stiffness=stiffness, damping=damping, friction=friction).items()]
    rig = Rig((0.0, 0.0, 0.0552), [*STICK, *material], cycle=cycle, tip_mass=0.002, tilt=0.3)
    rig.go((0.001, 0.0005, 0.0545))
    energy = [rig.energy()]
    for _ in range(100):
        rig.go((0.001, 0.0005, 0.0545))
        energy.append(rig.energy())
        assert rig.world.energy() == pytest.approx(energy[-1], rel=1e-9)
    assert np.max(np.diff(energy)) <= 1e-12 * energy[0]
    assert rig.unbalanced == 0


def test_moving_in_a_closed_loop_takes_energy_out():
    rig = Rig((0.0, 0.0, TOP - 2e-4), [*STICK, "object.0.friction=0.4"], tip_mass=0.002)
    rig.go(*[(0.0, 0.0, TOP - 2e-4)] * 50)
    begin = rig.energy()
    angle = np.linspace(0, 4 * np.pi, 2001)
    path = np.c_[1e-3 * np.sin(angle), 1e-3 * (1 - np.cos(angle)), TOP - 2e-4 - 1e-4 * np.sin(angle)]
    centres = np.vstack([rig.world.tip()[:3, 3], path])
    forces = np.array([rig.world.tip()[:3, :3] @ w[:3] for w in rig.go(*path)])
    work = np.sum(-forces * np.diff(centres, axis=0))
    assert work + begin - rig.energy() > 0.0


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.8])
def test_sliding_friction_is_on_the_cone_and_against_the_motion(friction):
    rig = pressed(1e-4, [*STICK, f"object.0.friction={friction}"])
    rig.line((0.001, 0.002, TOP - 1e-4), (0.005, 0.005, TOP - 1e-4), 0.5)
    assert np.hypot(*rig.force[:2]) == pytest.approx(friction * rig.force[2], rel=1e-9)
    assert rig.force[:2] / np.hypot(*rig.force[:2]) == pytest.approx([-0.8, -0.6], abs=1e-6)


def test_sticks_until_the_cone_is_reached():
    rig = pressed(1e-3, [*STICK, "object.0.friction=0.5", "object.0.stiffness=1e4"])
    before = rig.centre
    rig.line((0.001, 0.002, TOP - 1e-3), (0.0015, 0.002, TOP - 1e-3), 0.1)
    series = 1 / (1 / 2500 + 1 / (0.8 * 1e4))
    assert rig.force[0] == pytest.approx(-series * 5e-4, rel=1e-6)
    assert np.abs(rig.rows[0, contact.SLIP]) == pytest.approx(0.0, abs=1e-12)
    assert rig.centre[0] - before[0] == pytest.approx(series * 5e-4 / 8e3, rel=1e-6)


def ratio_while_sliding(speed, **config):
    rig = pressed(5e-4, [*STICK, "object.0.friction=0.3"], **config)
    wrench = rig.line((0.001, 0.002, TOP - 5e-4), (0.001 + 2 * speed, 0.002, TOP - 5e-4), 2.0)
    return np.hypot(wrench[:, 0], wrench[:, 1]) / np.abs(wrench[:, 2])


def test_slow_sliding_sticks_and_slips_and_fast_sliding_does_not():
    slow = ratio_while_sliding(0.001, static_friction=1.5)
    fast = ratio_while_sliding(0.01, static_friction=1.5)
    drops = np.sum(np.diff(slow) < -0.1)
    assert drops >= 3
    assert slow.max() == pytest.approx(0.45, abs=0.01)
    assert np.sum(np.diff(fast) < -0.1) == 1
    assert fast[-1] == pytest.approx(0.3, rel=1e-6)
    assert np.sum(np.diff(ratio_while_sliding(0.001)) < -0.1) == 0


def test_a_turning_sphere_rubs():
    rows, old = np.zeros((1, contact.WIDTH)), np.zeros((0, contact.WIDTH))
    rows[0, contact.NORMAL : contact.NORMAL + 3] = 0.0, 0.0, 1.0
    rows[0, contact.LEVER], rows[0, contact.RADIUS] = 1.0, 0.005
    frame = tuple(np.vstack([np.eye(3), np.zeros(3)]).ravel())
    touch.inherit(rows, 1, old, 0, np.zeros(3), np.array(frame), 0.05, np.array([0.0, 0.01, 0.0]))
    # turned about y, the lowest point of the sphere goes to -x
    assert rows[0, contact.BRISTLE : contact.BRISTLE + 3] == pytest.approx([-5e-5, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_the_wrench_is_that_of_the_forces_at_the_contact_points(tilt):
    at = (0.003, SIDE + 2e-4, 0.05 - 1e-4)
    rig = Rig((0.003, SIDE - 1e-4, 0.05 - 1e-4), [*STICK, "object.0.friction=0.3"], tilt=tilt)
    rig.line((0.003, SIDE - 1e-4, 0.05 - 1e-4), at, 0.1)
    tip = rig.world.tip()
    origin = tip[:3, 3] - 0.05 * tip[:3, 2]
    rows = rig.rows
    centres, normals = rows[:, contact.CENTRE : contact.CENTRE + 3], rows[:, contact.NORMAL : contact.NORMAL + 3]
    forces = rows[:, contact.FORCE : contact.FORCE + 3]
    points = centres - rows[:, contact.RADIUS, None] * normals
    world_wrench = naive.wrench_about(origin, points, forces)
    turn = np.kron(np.eye(2), tip[:3, :3].T)
    assert np.linalg.norm(rig.wrench) > 0.1
    assert rig.wrench == pytest.approx(turn @ world_wrench, abs=1e-12)


def test_the_wrench_axis_meets_the_sphere_at_the_true_contact():
    rig = Rig((0.0, SIDE - 1e-4, 0.03), ["object.0.friction=0.4"])
    rig.line((0.0, SIDE - 1e-4, 0.03), (0.002, SIDE + 1e-4, 0.031), 0.1)
    force, torque = rig.wrench[:3], rig.wrench[3:]
    from_sensor = rig.world.tip()[:3, :3].T @ (np.array([0.002, SIDE + 1e-4 + 0.005, 0.031]) - rig.world.tip()[:3, 3])
    from_sensor[2] += 0.05
    assert torque == pytest.approx(np.cross(from_sensor, force), abs=1e-12)


@pytest.mark.parametrize("direction", [(0.0, 1.0, 1.0), (0.0, -1.0, 1.0), (1.0, 0.0, 1.0)])
def test_an_edge_is_touched_symmetrically(direction):
    direction = np.array(direction) / np.sqrt(2)
    edge = np.sign(direction) * (0.05, 0.025, 0.05)
    start, end = edge + 0.0055 * direction, edge + 0.0049 * direction
    rig = Rig(start)
    rig.line(start, end, 0.1)
    rig.go(*[end] * 10)
    assert len(rig.rows) == 1
    assert rig.force == pytest.approx(1e4 * 1e-4 * direction, rel=1e-6, abs=1e-9)


def test_an_inner_corner_gives_two_and_three_contacts():
    rig = Rig((0.0, 0.0, 0.026), scene="inner_corner")
    rig.line((0.0, 0.0, 0.026), (0.0151, 0.0, 0.0248), 0.1)
    rig.go(*[(0.0151, 0.0, 0.0248)] * 5)
    assert rig.force == pytest.approx([-1.0, 0.0, 2.0], abs=1e-9)
    rig.line((0.0151, 0.0, 0.0248), (0.0151, 0.0153, 0.0248), 0.5)
    rig.go(*[(0.0151, 0.0153, 0.0248)] * 5)
    assert len(rig.rows) == 3
    assert rig.force == pytest.approx([-1.0, -3.0, 2.0], abs=1e-9)


def test_a_sphere_in_a_narrow_slot_is_held_by_both_edges_alike():
    rig = Rig((0.0, 0.0, 0.054), scene="slot_8mm")
    rig.line((0.0, 0.0, 0.054), (0.0, 0.0, 0.0528), 0.1)
    rig.go(*[(0.0, 0.0, 0.0528)] * 5)
    assert len(rig.rows) == 2
    assert rig.rows[0, contact.PRESS] == pytest.approx(rig.rows[1, contact.PRESS], rel=1e-9)
    assert rig.wrench[3:] == pytest.approx(0.0, abs=1e-12)
    depth = 0.005 - np.hypot(0.004, 0.0028)
    assert rig.force[2] == pytest.approx(2 * 1e4 * depth * 0.0028 / np.hypot(0.004, 0.0028), rel=1e-6)


def test_the_table_is_felt_tilted_as_it_is():
    rig = Rig((0.0, 0.0, 0.006), ["table.tilt_deg=5.0", "table.stiffness=2e4"], scene="empty")
    rig.line((0.0, 0.0, 0.006), (0.0, 0.0, 0.0049), 0.1)
    rig.go(*[(0.0, 0.0, 0.0049)] * 5)
    c, s = np.cos(np.radians(5.0)), np.sin(np.radians(5.0))
    assert rig.force == pytest.approx(2e4 * (0.005 - 0.0049 * c) * np.array([0.0, -s, c]), rel=1e-9)


def test_the_stick_is_felt_and_its_torque_gives_it_away():
    rig = Rig((0.0, -0.05, 0.02), scene="overhang")
    rig.line((0.0, -0.05, 0.02), (0.0, -0.0319, 0.02), 0.3)
    rig.go(*[(0.0, -0.0319, 0.02)] * 5)
    assert rig.force == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    lever = rig.wrench[3] / rig.wrench[1]
    assert 0.05 - 0.028 < -lever < 0.05 - 0.0099  # far above the sphere, whose lever is 0.045 .. 0.055
    assert rig.world.state[kernels.PEAK] == 0.0
    assert rig.world.state[kernels.PROBE_PEAK] >= 1.0 - 1e-9  # of anything of the probe
    assert rig.world.state[kernels.RECORD_NEW + 12] == 0.0


def test_an_edge_presses_alike_on_both_halves_of_the_stick():
    """Just above the middle the edge had not been found, and then pressed at once with two newtons more."""
    low, high, side = 0.0145, 0.0215, -0.0318  # the edge is 31 to 24 mm above the sphere
    plate = ["object.0.at={ xyz = [0.0, 0.0, 0.015] }", "object.0.children.1.size=[0.08, 0.06, 0.001]"]
    plate += ["object.0.children.1.at={ xyz = [0.0, 0.0, 0.0305] }"]
    rig = Rig((0.0, -0.05, low), [*STICK, *plate, "object.0.stiffness=1e6"], scene="overhang")
    rig.line((0.0, -0.05, low), (0.0, side, low), 0.3)
    heights = np.arange(low, high, 2e-4)
    forces = []
    for z in heights:
        rig.go(*[(0.0, side, z)] * 5)
        forces.append(-rig.force[1])
    assert min(forces) > 0.5
    assert np.abs(np.diff(forces)).max() < 0.03 * max(forces)


def test_a_push_on_the_stick_moves_the_joints_by_as_much_as_one_on_the_sphere():
    """Near the sensor the joints had seemed rigid: they moved by the contact's lever on the stick, twice over."""
    soft = dict(joint_compliance=5e-5)
    place, plain, pressed = (0.0, -0.0319, 0.02), ["object.0.stiffness=1e6"], []
    for settings, config in (([], {}), ([], soft), (STICK, {}), (STICK, soft)):
        rig = Rig((0.0, -0.05, 0.02), [*settings, *plain], scene="overhang", **config)
        rig.line((0.0, -0.05, 0.02), place, 0.3)
        rig.go(*[place] * 200)
        assert rig.world.state[kernels.PEAK] == 0.0, "the stick alone touches"
        pressed.append(1e-4 / -rig.force[1])  # m/N, the plate's edge is 0.1 mm inside the stick
    rigid, joints, stick, both = pressed
    assert rigid == pytest.approx(1e-6, rel=1e-3)
    assert joints - rigid == pytest.approx(5e-5, rel=1e-3)
    assert both - stick == pytest.approx(5e-5, rel=0.05), "the stick's bending aside"


def test_substeps_converge_to_one_answer_at_first_order():
    """A swinging tip strikes the block: the error of the force against a far finer step falls with the step."""

    def record(substeps):
        rig = Rig((0.0, SIDE - 2e-4, 0.03), [*STICK, "object.0.damping=20.0"], tip_mass=0.01, substeps=substeps)
        return rig.line((0.0, SIDE - 2e-4, 0.03), (0.0, SIDE + 6e-4, 0.03), 0.04)[:, 1]

    reference = record(4096)
    errors = [np.abs(record(n) - reference).max() for n in (8, 16, 32, 64)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 0.02 * np.abs(reference).max()
    assert np.all(orders > 0.7)


def test_touching_nothing_costs_no_search():
    rig = Rig((0.0, 0.0, 0.2))
    rig.line((0.0, 0.0, 0.2), (0.0, 0.0, 0.19), 1.0)
    assert rig.world.counts[kernels.NEAR_STEPS] <= 2
