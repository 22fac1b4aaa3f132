"""The emulated controller against a remote written from the layout alone: states, programs, rating, checks."""

import numpy as np
import pytest
from naive_fri import Remote, answer, f32, u16

from lwrprobe_fri.emulator import Controller, ControllerSettings, LaggingArm
from lwrprobe_fri.emulator.datagrams import read_command

START = np.radians([0.0, 45.0, 0.0, -80.0, 0.0, 55.0, 0.0])
REQUEST_A = {14: 10, 15: 10}
REQUEST_B = {0: 10, 1: 1}


def remote(**settings):
    controller = Controller(LaggingArm(START), ControllerSettings(**settings))
    return Remote(controller, controller.settings.cycle)


def in_command_mode(**settings):
    remote_ = remote(**settings)
    remote_.turns(30)
    remote_.turns(20, integers=REQUEST_A)
    assert remote_.state == 2
    return remote_


def test_measurement_on_the_wire():
    data = remote().data
    assert len(data) == 916
    assert (u16(data, 4), u16(data, 6)) == (0x394, 0x2006)
    assert u16(data, 0) == 1
    assert u16(data, 144) == 1
    assert f32(data, 148, 2) == pytest.approx((0.01, 0.01))
    assert f32(data, 216, 7) == pytest.approx(START, abs=1e-6)


def test_sequence_wraps_and_reflects():
    r = remote(first_sequence=65534)
    seen = [u16(r.turn(), 0) for _ in range(3)]
    assert seen == [65535, 0, 1]
    assert u16(r.data, 2) == r.sequence & 0xFFFF


def test_quality_needs_answers_and_falls_with_silence():
    r = remote()
    r.turns(10)
    assert r.quality == 0
    r.turns(100)
    assert r.quality == 3
    r.turns(10, silent=True)
    assert r.quality == 2
    r.turns(60, silent=True)
    assert r.quality == 0
    assert u16(r.data, 176) == 70


def test_late_answers_are_missed_answers():
    r = remote()
    r.turns(120)
    r.turns(30, late=True)
    assert r.quality == 1
    assert r.controller.late == 30


def test_program_a_enters_and_leaves_command_mode():
    r = in_command_mode()
    assert r.said[15] == 20
    r.turns(20, integers={14: 10, 15: 20})
    assert r.state == 1
    assert r.said[15] == 10
    assert r.power


def test_program_b_waits_for_perfect():
    r = remote(krl="B")
    for _ in range(12):
        r.turns(9, integers=REQUEST_B)
        r.turn(integers=REQUEST_B, silent=True)
    assert r.quality == 2
    assert r.state == 1
    assert r.said[1] == 10
    r.turns(120, integers=REQUEST_B)
    assert r.state == 2
    assert r.said[1] == 1
    r.turns(20, integers={0: 10, 1: 0})
    assert r.state == 1
    assert r.said[1] == 0


def test_without_program_only_the_operator_starts():
    r = remote(krl="none")
    r.turns(60, integers=REQUEST_A | REQUEST_B)
    assert r.state == 1
    r.controller.fri_start(1.0)
    r.turns(2)
    assert r.state == 2


def test_start_asked_for_with_poor_quality_waits():
    r = remote()
    r.turns(60, integers=REQUEST_A, silent=True)
    assert r.state == 1
    r.turns(8, integers=REQUEST_A)
    assert r.said[15] == 20
    assert r.state == 1
    r.turns(110, integers=REQUEST_A)
    assert r.state == 2


def test_tenth_of_a_radian_is_moved():
    r = in_command_mode()
    goal = np.array(r.set_point())
    for _ in range(100):
        goal[0] += 0.001
        r.turn(joints=goal, integers=REQUEST_A)
    r.turns(20, joints=goal, integers=REQUEST_A)
    assert r.state == 2
    assert f32(r.data, 216)[0] - START[0] == pytest.approx(0.1, abs=1e-5)
    assert f32(r.data, 320)[0] == pytest.approx(0.1, abs=1e-5)


def test_jump_is_refused():
    r = in_command_mode()
    joints = np.array(r.set_point())
    joints[2] += 0.5
    r.turn(joints=joints, integers=REQUEST_A)
    assert (r.state, r.power) == (1, 0)
    assert r.error == 0b100
    assert r.set_point() == pytest.approx(START, abs=1e-6)
    assert "excessive commanded joint speed" in r.controller.events[-1]


@pytest.mark.parametrize(("joint", "degrees"), [(0, 170.5), (1, -120.5), (5, 121.0)])
def test_joint_range_is_watched(joint, degrees):
    start = START.copy()
    start[joint] = np.radians(degrees) * 0.99
    controller = Controller(LaggingArm(start), ControllerSettings())
    r = Remote(controller)
    r.turns(30)
    r.turns(20, integers=REQUEST_A)
    goal = start.copy()
    for _ in range(200):
        goal[joint] += np.sign(degrees) * 0.002
        r.turn(joints=goal, integers=REQUEST_A)
    assert r.state == 1
    assert r.error == 1 << joint


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_a_number_is_refused(bad):
    r = in_command_mode()
    joints = np.array(r.set_point())
    joints[4] = bad
    r.turn(joints=joints, integers=REQUEST_A)
    assert (r.state, r.power, r.error) == (1, 0, 1 << 4)


@pytest.mark.parametrize("flags", [0x0100, 0x0101, 0x0010, 0x0011])
def test_flags_that_do_not_fit_position_control_are_refused(flags):
    r = in_command_mode()
    r.turn(flags=flags, integers=REQUEST_A)
    assert r.state == 1
    assert r.error


def test_a_cycle_without_flags_is_bridged():
    r = in_command_mode()
    r.turn(flags=0, joints=[0.0] * 7, integers=REQUEST_A)
    assert r.state == 2
    r.turns(5, integers=REQUEST_A)
    assert r.state == 2
    assert not r.error


def test_no_flags_and_zeros_in_monitor_mode_are_no_error():
    r = remote()
    r.turns(150, flags=0, joints=[0.0] * 7)
    assert r.quality == 3
    assert not r.error
    assert r.power


def test_start_without_matching_set_point_is_an_interpolation_error():
    r = remote()
    r.turns(30)
    r.turns(20, integers=REQUEST_A, joints=START + 0.02)
    assert r.state == 1
    assert r.power == 0
    assert r.error
    assert "FRI interpolation error" in r.controller.events[-1]


def test_start_tolerates_measured_positions():
    r = remote()
    r.turns(30)
    r.turns(20, integers=REQUEST_A, joints=START + 0.005)
    assert r.state == 2


def test_three_losses_are_bridged_at_the_last_velocity():
    r = in_command_mode()
    goal = np.array(r.set_point())
    for _ in range(20):
        goal[0] += 0.001
        r.turn(joints=goal, integers=REQUEST_A)
    r.turns(3, silent=True)
    assert r.state == 2
    assert r.set_point()[0] - goal[0] == pytest.approx(0.003, abs=1e-6)


def test_silence_ends_command_mode_with_a_ramp_and_counts():
    r = in_command_mode()
    goal = np.array(r.set_point())
    for _ in range(40):
        goal[0] += 0.01
        r.turn(joints=goal, integers=REQUEST_A)
    misses = u16(r.data, 176)
    places = [r.turns(1, silent=True) and r.set_point()[0] for _ in range(40)]
    assert r.state == 1
    assert r.power == 0
    assert u16(r.data, 176) == misses + 40
    speed = np.diff(places) / 0.01
    assert (np.diff(speed) <= 1e-3).all()
    assert abs(speed[-1]) < 1e-6


def test_stale_program_needs_stop_before_start():
    r = in_command_mode()
    r.turns(50, silent=True)
    assert r.state == 1
    assert r.said[15] == 20
    r.turns(150, integers=REQUEST_A)
    assert r.state == 1, "the program's state still says that it has started"
    r.turns(10, integers={14: 10, 15: 20})
    assert r.said[15] == 10
    r.turns(10, integers=REQUEST_A)
    assert r.state == 2


def test_error_waits_for_the_operator_where_told_so():
    r = in_command_mode(acknowledge="manual")
    r.controller.violate("limit", 3)
    r.turns(10, integers={14: 10, 15: 20})
    r.turns(20, integers=REQUEST_A)
    assert (r.state, r.power, r.error) == (1, 0, 8)
    r.controller.acknowledge()
    r.turns(10, integers={14: 10, 15: 20})
    r.turns(10, integers=REQUEST_A)
    assert r.state == 2


def test_drives_off_and_poor_quality_end_command_mode():
    r = in_command_mode()
    r.controller.drives_off()
    r.turn(integers=REQUEST_A)
    assert (r.state, r.power) == (1, 0)
    r = in_command_mode()
    r.controller.rating.ceiling = 1
    r.turn(integers=REQUEST_A)
    assert (r.state, r.quality) == (1, 1)
    assert r.power


def test_early_command_is_ignored():
    controller = Controller(LaggingArm(START), ControllerSettings())
    controller.receive(answer(bytes(916), 1, [9.0] * 7, REQUEST_A), 0.0)
    r = Remote(controller)
    r.controller.receive(answer(bytes(916), 1, [9.0] * 7, REQUEST_A)[:300], 0.0)
    assert u16(r.turn(), 2) == r.sequence & 0xFFFF
    assert controller.malformed == 1


def test_impedance_needs_its_program_code():
    r = remote()
    r.turns(30)
    r.turns(20, integers={14: 30, 15: 10}, flags=0x31)
    assert r.state == 2
    assert u16(r.data, 182) == 3
    r.turns(5, integers={14: 30, 15: 10}, flags=0x31)
    assert r.state == 2


def test_frame_and_jacobian_agree_with_finite_differences():
    from lwrprobe_fri.emulator.frames import frame_and_jacobian

    joints = np.array([0.3, 0.7, -0.4, -1.2, 0.5, 0.9, -0.2])
    frame, jacobian = frame_and_jacobian(joints)
    for i in range(7):
        step = np.zeros(7)
        step[i] = 1e-6
        ahead, back = frame_and_jacobian(joints + step)[0], frame_and_jacobian(joints - step)[0]
        assert jacobian[:3, i] == pytest.approx((ahead[:, 3] - back[:, 3]) / 2e-6, abs=1e-6)
        turn = (ahead[:, :3] - back[:, :3]) / 2e-6 @ frame[:, :3].T
        assert jacobian[3:, i] == pytest.approx([turn[1, 0], turn[0, 2], turn[2, 1]], abs=1e-6)
    upright, _ = frame_and_jacobian(np.zeros(7))
    assert upright[:, 3] == pytest.approx([0.0, 0.0, 0.31 + 0.40 + 0.39 + 0.078])


def test_the_naive_answer_is_what_the_emulator_reads():
    command = read_command(answer(bytes(916), 7, [0.5] * 7, {14: 30}, 0x31))
    assert command["joints"].tolist() == [0.5] * 7
    assert command["krl_int"][14] == 30
    assert command["flags"] == 0x31


def test_nothing_that_arrives_makes_the_controller_fail():
    random = np.random.default_rng(11)
    r = in_command_mode()
    for k in range(3000):
        data = bytearray(answer(r.data, k, r.set_point(), REQUEST_A if k % 200 > 20 else {14: 10, 15: 20}))
        for place in random.integers(0, len(data), size=int(random.integers(0, 4))):
            data[place] = int(random.integers(0, 256))
        r.controller.receive(bytes(data), r.now + 0.001)
        r.now += r.cycle
        r.data = r.controller.tick(r.now)
        assert len(r.data) == 916
        assert np.isfinite(r.set_point()).all()
