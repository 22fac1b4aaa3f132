"""Waves of the gears: found where contacts show them, and nothing is corrected where they do not."""

from functools import cache

import numpy as np
import pytest

from lwrprobe.contracts import Contact
from lwrprobe.exploration.recording.corrections import Corrections
from lwrprobe.exploration.recording.error_sources import recorded_budget
from lwrprobe.exploration.recording.gear_waves import Touches, learn, take_waves_off
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.stages.pipeline import choose, compose
from lwrprobe.kinematics import IKSolver
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

STATED = np.radians(0.005)
WAVES = 320.0
AMPLITUDE = np.array([0.0, 0.0, 0.0, 1.2, 0.0, 0.0, 0.0]) * STATED
"""Of the joint that turns most, by 23 degrees on each line, and lifts the sphere."""
PHASE = np.linspace(0.0, 5.0, 7)


SCENE = load_scene("block")
ROBOT = robot_of(SCENE)


@cache
def dome():
    """Times, centres, normals and joint values of the links on 10 lines along x over a dome of 0.1 m radius."""
    solver, bend, time, rows, out = IKSolver(ROBOT), 0.1, 0.0, [], np.empty(7)
    q = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])
    pose = np.array(ROBOT.fk(q).A)
    pose[:3, 3] = -0.05, -0.04, 0.03
    q = np.array(solver.solve(pose, q).q)
    for line, y in enumerate(np.linspace(-0.04, 0.04, 10)):
        time += 1.0
        for x in np.linspace(-0.05, 0.05, 600) * (-1) ** line:
            time += 0.008
            normal = np.array([x, y, np.sqrt(bend**2 - x * x - y * y)]) / bend
            pose[:3, 3] = np.array([0.0, 0.0, 0.05 - bend]) + bend * normal
            solver.track(pose, q, out)
            q = out.copy()
            rows.append((time, pose[:3, 3].copy(), normal, q))
    return tuple(np.array(column) for column in zip(*rows))


def touched(amplitude, noise=1e-5):
    """The contacts as an arm with such waves measures them, and the true centres."""
    times, true, normals, links = dome()
    motors = links - amplitude * np.sin(WAVES * links + PHASE)
    lifted = noise * np.random.default_rng(4).standard_normal((len(times), 1))
    centres, recorder = ROBOT.fk_batch(motors)[:, :3, 3] + lifted * normals, Recorder(None)
    for time, centre, normal, q in zip(times, centres, normals, motors):
        point = centre - SCENE.probe.radius * normal
        recorder.contact(Contact(float(time), point, normal, 0.8 * normal, centre, 0.9), 1, (q, np.array([0, 0.01, 0])))
    return recorder, true


def errors(recorder, true):
    """(m,) m of the contacts along their normals."""
    points = true - SCENE.probe.radius * recorder.normals()
    return ((recorder.points() - points) * recorder.normals()).sum(axis=1)


@pytest.mark.slow
def test_waves_that_the_contacts_show_are_taken_off_and_the_rest_is_left_as_it_is():
    recorder, true = touched(AMPLITUDE, noise=2e-6)
    measured, before = recorder.contacts.copy(), errors(recorder, true)
    for contact in measured[::100]:
        recorder.touch(contact, SCENE.probe.radius)
    waves = take_waves_off(recorder, SCENE, ROBOT)
    found = np.hypot(waves.sine, waves.cosine)
    sure = found > 0.0
    assert np.array_equal(sure, AMPLITUDE > 0.0)
    assert (np.abs(found - AMPLITUDE)[sure] < 3.5 * np.sqrt(2.0) * waves.error[sure]).all()
    assert (waves.error[sure] < 0.3 * STATED).all()
    assert waves.error[~sure] == pytest.approx(STATED / np.sqrt(2.0))
    assert errors(recorder, true).std() < 0.5 * before.std()
    assert measured[0].point is not recorder.contacts[0].point  # what was measured keeps its place
    assert recorder.contacts[0].centre - measured[0].centre == pytest.approx(
        recorder.contacts[0].point - measured[0].point, abs=1e-12
    )
    # What was touched between the contacts goes with them.
    moved = np.array([contact.centre for contact in recorder.contacts[::100]])
    assert np.array([centre for _, centre in recorder.passed]) == pytest.approx(moved, abs=1e-12)


def test_what_is_larger_than_any_wave_is_not_taken_for_one():
    recorder, _ = touched(4.0 * AMPLITUDE, noise=2e-6)
    before = recorder.points()
    assert take_waves_off(recorder, SCENE, ROBOT) is None
    assert np.array_equal(recorder.points(), before)


@pytest.mark.parametrize("turn", [0.005, 0.0065, 0.008])
def test_a_bend_of_the_surface_on_all_lines_is_not_taken_for_a_wave(turn):
    """60 lines over the same bend, along which a joint turns by half a wave: a wave of any length fits to that."""
    rng, along = np.random.default_rng(2), np.linspace(-1.0, 1.0, 150)
    heights = 4e-5 * along**3 + 2e-6 * rng.standard_normal((60, 150))
    times = np.arange(60)[:, None] + 8e-4 * np.arange(150)
    centres = np.stack(np.broadcast_arrays(0.006 * along, 0.002 * np.arange(60)[:, None], heights), axis=-1)
    joints, linear = np.zeros((60 * 150, 7)), np.zeros((60 * 150, 3, 7))
    joints[:, 3], linear[:, 2, 3] = np.tile(turn * along, 60), 0.5
    up = np.tile([0.0, 0.0, 1.0], (60 * 150, 1))
    found = learn(Touches(times.ravel(), centres.reshape(-1, 3), up, joints, linear), WAVES, STATED)
    assert not found.sine.any()
    assert not found.cosine.any()


def test_a_path_that_is_travelled_more_slowly_says_no_more():
    recorder, _ = touched(AMPLITUDE, noise=2e-6)
    joints = np.array([q for q, _ in recorder.states])
    rows = [recorder.points(), recorder.normals(), joints, ROBOT.jacobian_batch(joints)[:, :3]]
    times = np.array([contact.time for contact in recorder.contacts])
    once = learn(Touches(times, *rows), WAVES, STATED)
    later = (times[:, None] + 1e-3 * np.arange(8)).ravel()
    slowly = learn(Touches(later, *(row.repeat(8, axis=0) for row in rows)), WAVES, STATED)
    sure = once.sine != 0.0
    assert sure.any()
    assert slowly.error[sure] == pytest.approx(once.error[sure], rel=0.2)


def test_without_waves_no_contact_is_moved():
    recorder, _ = touched(np.zeros(7))
    before = recorder.points()
    assert take_waves_off(recorder, SCENE, ROBOT) is None
    assert np.array_equal(recorder.points(), before)


@pytest.mark.parametrize("setting", ["arm.gear_waves=0", "uncertainty.gear_ripple_deg=0", "arm.gear_waves=200"])
def test_nothing_is_learnt_by_who_does_not_know_the_gears_or_knows_them_wrong(setting):
    recorder, _ = touched(AMPLITUDE)
    assert take_waves_off(recorder, load_scene("block", [setting]), ROBOT) is None


def test_contacts_of_an_earlier_part_of_the_run_leave_all_as_it_is():
    recorder, _ = touched(AMPLITUDE)
    recorder.states[0] = None
    assert take_waves_off(recorder, SCENE, ROBOT) is None


def test_edges_say_nothing_of_waves():
    recorder, _ = touched(np.zeros(7))
    joints = np.array([q for q, _ in recorder.states])
    times = np.array([contact.time for contact in recorder.contacts])
    normals = recorder.normals()
    normals[::10] = normals[::10] @ np.array([[0.9, 0.0, 0.436], [0.0, 1.0, 0.0], [-0.436, 0.0, 0.9]])
    linear = ROBOT.jacobian_batch(joints)[:, :3]
    found = learn(Touches(times, recorder.points(), normals, joints, linear), WAVES, STATED)
    assert found.error == pytest.approx(STATED / np.sqrt(2.0))


@pytest.mark.slow
def test_the_budget_counts_what_remains_of_the_waves():
    recorder, _ = touched(AMPLITUDE)
    pipeline = compose(SCENE, choose(SCENE), 0.001, 125.0)
    stated = recorded_budget(SCENE, pipeline, recorder).causes["gears"]
    waves = take_waves_off(recorder, SCENE, ROBOT)
    joints = np.array([q for q, _ in recorder.states])
    lift = np.einsum("mij,mi->mj", ROBOT.jacobian_batch(joints)[:, :3], recorder.normals())
    less = 1e6 * (lift**2).mean(axis=0) @ (0.5 * STATED**2 - waves.error**2)  # mm^2
    assert less > 0.02 * stated**2
    remains = recorded_budget(SCENE, pipeline, recorder, Corrections(waves=waves)).causes["gears"]
    assert remains**2 == pytest.approx(stated**2 - less, rel=1e-4)
